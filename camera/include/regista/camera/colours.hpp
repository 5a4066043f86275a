// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <regista/camera/pattern.hpp>
#include <regista/core/result.hpp>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace regista::camera {

using Bgr = std::array<double, 3>;  ///< blue, green, red; 0 to 255

/// How a colour looks in the light of LightMap: a normal distribution of the hue, which light does not change, and of
/// the brightness, which it does.
struct ColourModel {
  Colour colour = Colour::none;
  Bgr bgr{};                       ///< typical
  std::array<double, 3> spread{};  ///< standard deviations of ln(red/green), ln(blue/green) and ln(brightness)
};

/// Under white light, without a calibration.
std::vector<ColourModel> usual_colours();

/// From pixels of one colour. The spread is at least that of a camera's noise and of a hall's light.
/// Fails with `invalid_argument` when there are fewer than three pixels.
Result<ColourModel> learn_colour(Colour colour, std::span<const Bgr> pixels);

std::string_view name_of(Colour colour);
/// "orange"; none when there is no such colour.
std::optional<Colour> colour_named(std::string_view name);

/// Which colour each of the cube's colours is: the most likely one, or none when all are unlikely.
class ColourTable {
 public:
  explicit ColourTable(std::span<const ColourModel> models);

  /// Of a pixel in any light: `light` is of LightMap::table.
  [[nodiscard]] Colour operator()(const std::uint8_t* bgr, const std::uint8_t* light) const {
    return look_up(light[bgr[0]], light[bgr[1]], light[bgr[2]]);
  }
  /// In normal light.
  [[nodiscard]] Colour operator()(const std::uint8_t* bgr) const { return look_up(bgr[0], bgr[1], bgr[2]); }

 private:
  static constexpr unsigned bits = 6;  // 256 KiB: stays in the second cache
  static constexpr unsigned drop = 8 - bits;

  [[nodiscard]] Colour look_up(unsigned b, unsigned g, unsigned r) const {
    return table_[(b >> drop << (2 * bits)) | (g >> drop << bits) | r >> drop];
  }

  std::vector<Colour> table_;
};

}  // namespace regista::camera
