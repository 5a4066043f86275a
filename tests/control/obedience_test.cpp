// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <regista/control/obedience.hpp>
#include <stdexcept>

namespace regista::control {
namespace {

using namespace std::chrono_literals;

/// How long it is believed that the base obeys, 10 s at most.
Duration patience(const BodyVelocity& commanded, const std::optional<BodyVelocity>& measured) {
  Obedience obedience{{.patience = 2s, .speed_mps = 0.1, .turn_radps = 0.3}};
  Duration time{};
  while (time < 10s && obedience.step(commanded, measured, 10ms)) time += 10ms;
  return time;
}

TEST(Obedience, lets_a_base_lag_and_slip) {
  EXPECT_EQ(patience({.x = 1, .w = 1}, BodyVelocity{.x = 0.6, .w = 1.4}), 10s);
  EXPECT_EQ(patience({.x = 0.05}, BodyVelocity{}), 10s);
}

TEST(Obedience, sees_a_base_that_stands_turns_or_moves_by_itself_or_is_silent) {
  EXPECT_EQ(patience({.x = 0.5}, BodyVelocity{}), 2s);
  EXPECT_EQ(patience({.x = 0.5}, BodyVelocity{.x = 0.5, .w = 0.5}), 2s);
  EXPECT_EQ(patience({}, BodyVelocity{.x = -0.3}), 2s);
  EXPECT_EQ(patience({.x = 0.5}, std::nullopt), 2s);
  EXPECT_EQ(patience({.x = 0.5}, BodyVelocity{.x = std::nan("")}), 2s);
}

TEST(Obedience, forgets_what_was_before_it_obeyed_again) {
  Obedience obedience{{.patience = 2s}};
  const BodyVelocity ahead{.x = 1};
  for (int i = 0; i < 10; ++i) {
    EXPECT_TRUE(obedience.step(ahead, BodyVelocity{}, 1900ms));
    EXPECT_TRUE(obedience.step(ahead, ahead, 10ms));
  }
  EXPECT_TRUE(obedience.step(ahead, BodyVelocity{}, 1900ms));
  obedience.forgive();
  EXPECT_TRUE(obedience.step(ahead, BodyVelocity{}, 1900ms));
  EXPECT_FALSE(obedience.step(ahead, BodyVelocity{}, 200ms));
}

TEST(Obedience, refuses_patience_that_is_none) {
  EXPECT_THROW(Obedience({.patience = 0s}), std::invalid_argument);
  EXPECT_THROW(Obedience({.speed_mps = std::nan("")}), std::invalid_argument);
}

}  // namespace
}  // namespace regista::control
