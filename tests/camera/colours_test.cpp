// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <random>
#include <regista/camera/light.hpp>

#include "rendered_field.hpp"

namespace regista::camera {
namespace {

Colour look_up(const ColourTable& table, const Bgr& bgr) {
  const std::array<std::uint8_t, 3> bytes{static_cast<std::uint8_t>(bgr[0]), static_cast<std::uint8_t>(bgr[1]),
                                          static_cast<std::uint8_t>(bgr[2])};
  return table(bytes.data());
}

TEST(ColourTable, knows_the_usual_colours) {
  const auto models = usual_colours();
  const ColourTable table{models};
  for (const ColourModel& model : models) EXPECT_EQ(look_up(table, model.bgr), model.colour) << name_of(model.colour);
}

TEST(ColourTable, has_no_colour_for_what_is_unlike_all) {
  const ColourTable table{usual_colours()};
  EXPECT_EQ(look_up(table, {255, 255, 0}), Colour::none);  // cyan
}

TEST(LearnColour, takes_up_inks_that_the_usual_colours_do_not_know) {
  // Violet for magenta: some do not get the league's paper.
  std::mt19937 random{5};
  std::normal_distribution<double> noise{0, 4};
  std::vector<Bgr> pixels;
  for (int i = 0; i < 30; ++i) pixels.push_back({200 + noise(random), 40 + noise(random), 110 + noise(random)});
  auto models = usual_colours();
  EXPECT_NE(look_up(ColourTable{models}, {200, 40, 110}), Colour::magenta);
  const auto learned = learn_colour(Colour::magenta, pixels);
  ASSERT_TRUE(learned);
  *std::ranges::find(models, Colour::magenta, &ColourModel::colour) = *learned;
  const ColourTable table{models};
  EXPECT_EQ(look_up(table, {200, 40, 110}), Colour::magenta);
  EXPECT_EQ(look_up(table, {160, 32, 88}), Colour::magenta);  // in the shade
  EXPECT_FALSE(learn_colour(Colour::magenta, {}));
}

TEST(LightMap, makes_the_carpet_equally_bright_everywhere) {
  const cv::Mat picture = render(rendered::Camera::above(0.1, 0.05, 4), {}, {}, {.gradient = 0.6, .noise = 3});
  LightMap light;
  light.measure(rendered::view(picture));
  for (const int x : {40, 250, 520, 740}) {
    double sum = 0;
    for (int y = 430; y < 470; ++y) {
      for (int dx = -8; dx < 8; ++dx) {
        const auto& bgr = picture.at<cv::Vec3b>(y, x + dx);
        for (int i = 0; i < 3; ++i) sum += light.table(x + dx, y)[bgr[i]] / 3.0 / 640;
      }
    }
    EXPECT_NEAR(sum, LightMap::carpet, 5) << x;
  }
}

}  // namespace
}  // namespace regista::camera
