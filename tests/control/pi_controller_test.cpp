// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/control/pi_controller.hpp>

#include <cmath>
#include <stdexcept>

namespace regista::control {
namespace {

using namespace std::chrono_literals;

TEST(PiController, is_proportional_to_the_error) {
  PiController controller{{.proportional = 3, .output_limit = 10}};
  EXPECT_DOUBLE_EQ(controller.step(2, 1.5, 10ms), 1.5);
  EXPECT_DOUBLE_EQ(controller.step(-2, -1.5, 10ms), -1.5);
}

TEST(PiController, integrates_a_constant_error_over_time) {
  PiController controller{{.integral = 6, .output_limit = 10}};
  double output = 0;
  for (int i = 0; i < 100; ++i) output = controller.step(1, 0.5, 10ms);
  EXPECT_NEAR(output, 6 * 0.5 * 1.0, 1e-12);
}

TEST(PiController, brings_an_integrating_plant_to_the_set_point_as_the_closed_form_says) {
  // With x' = u, P = 3 and I = 2 the error obeys e'' + 3 e' + 2 e = 0, e(0) = 1, e'(0) = -3: e = 2 e^-2t - e^-t.
  PiController controller{{.proportional = 3, .integral = 2, .output_limit = 100}};
  constexpr auto dt = 100us;
  double x = 0;
  for (int i = 1; i <= 20'000; ++i) {
    x += controller.step(1, x, dt) * seconds(dt);
    const double t = i * seconds(dt);
    ASSERT_NEAR(1 - x, 2 * std::exp(-2 * t) - std::exp(-t), 1e-3);
  }
}

TEST(PiController, keeps_to_its_limit_and_comes_off_it_at_once) {
  PiController controller{{.proportional = 1, .integral = 10, .output_limit = 1}};
  for (int i = 0; i < 1000; ++i) EXPECT_LE(controller.step(5, 0, 10ms), 1);
  EXPECT_LT(controller.step(0, 0.5, 10ms), 0.6);  // ten seconds of windup would hold it at 1
}

TEST(PiController, damps_by_the_measured_value_without_a_kick_of_the_set_point) {
  PiController controller{{.derivative = 1, .output_limit = 100}};
  EXPECT_EQ(controller.step(0, 0, 10ms), 0);
  EXPECT_EQ(controller.step(5, 0, 10ms), 0);
  EXPECT_NEAR(controller.step(5, 0.1, 10ms), -10, 1e-9);
}

TEST(PiController, forgets_its_integral_when_the_set_point_jumps_by_more_than_thirty_percent) {
  for (const auto& [jump, forgets] : {std::pair{1.29, false}, {1.31, true}, {0.71, false}, {0.69, true}}) {
    PiController controller{{.integral = 1, .output_limit = 100, .reset_jump = 0.3}};
    for (int i = 0; i < 100; ++i) (void)controller.step(1, 0, 10ms);
    EXPECT_EQ(controller.step(jump, jump, 10ms) == 0, forgets) << jump;
  }
}

TEST(PiController, refuses_what_is_no_number_and_stays_as_it_was) {
  PiController controller{{.integral = 1, .output_limit = 100}};
  (void)controller.step(1, 0, 1s);
  EXPECT_EQ(controller.step(std::nan(""), 0, 1s), 0);
  EXPECT_EQ(controller.step(1, INFINITY, 1s), 0);
  EXPECT_EQ(controller.refused(), 2U);
  EXPECT_DOUBLE_EQ(controller.step(1, 0, 1s), 2);
}

TEST(PiController, names_the_gain_that_it_refuses) {
  EXPECT_THROW(PiController({.proportional = -1, .output_limit = 1}), std::invalid_argument);
  EXPECT_THROW(PiController({.integral = std::nan(""), .output_limit = 1}), std::invalid_argument);
  EXPECT_THROW(PiController({.reset_jump = 0}), std::invalid_argument);
  try {
    PiController controller{{.proportional = 1}};
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "output_limit is 0: give a finite number above 0");
  }
}

}  // namespace
}  // namespace regista::control
