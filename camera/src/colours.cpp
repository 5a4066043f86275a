// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <regista/camera/colours.hpp>

namespace regista::camera {

namespace {

struct NamedColour {
  Colour colour;
  std::string_view name;
};
constexpr std::array<NamedColour, 8> names{{{Colour::orange, "orange"},
                                            {Colour::yellow, "yellow"},
                                            {Colour::blue, "blue"},
                                            {Colour::green, "green"},
                                            {Colour::magenta, "magenta"},
                                            {Colour::field, "field"},
                                            {Colour::white, "white"},
                                            {Colour::black, "black"}}};

using Feature = std::array<double, 3>;

Feature feature_of(const Bgr& bgr) {
  // Draws all that is dark together: of noise the quotient means nothing.
  constexpr double dark = 12;
  const auto& [b, g, r] = bgr;
  return {std::log((r + dark) / (g + dark)), std::log((b + dark) / (g + dark)), std::log((b + g + r) / 3 + dark)};
}

// Noise of 5 in a channel of 100, and what LightMap leaves.
constexpr Feature least_spread{0.08, 0.08, 0.2};
/// Further than so many standard deviations away, a pixel is of no colour.
constexpr double farthest = 4.5;

}  // namespace

std::vector<ColourModel> usual_colours() {
  constexpr Feature vivid{0.22, 0.22, 0.35};
  constexpr Feature plain{0.12, 0.12, 0.5};
  return {{Colour::orange, {25, 110, 240}, {0.16, 0.25, 0.35}},
          {Colour::yellow, {30, 215, 240}, {0.16, 0.3, 0.35}},
          {Colour::blue, {215, 90, 30}, {0.3, 0.25, 0.35}},
          {Colour::green, {70, 230, 70}, vivid},
          {Colour::magenta, {190, 60, 230}, vivid},
          {Colour::field, {45, 95, 40}, {0.2, 0.2, 0.2}},
          {Colour::white, {225, 225, 225}, plain},
          {Colour::black, {25, 25, 25}, plain}};
}

Result<ColourModel> learn_colour(Colour colour, std::span<const Bgr> pixels) {
  constexpr std::size_t fewest = 3;
  if (pixels.size() < fewest)
    return Error{std::errc::invalid_argument, "learn '" + std::string{name_of(colour)} + "' from fewer than 3 pixels"};
  ColourModel model{.colour = colour};
  Feature mean{};
  const auto count = static_cast<double>(pixels.size());
  for (const Bgr& pixel : pixels) {
    const Feature feature = feature_of(pixel);
    for (std::size_t i = 0; i < 3; ++i) {
      mean[i] += feature[i] / count;
      model.bgr[i] += pixel[i] / count;
    }
  }
  for (std::size_t i = 0; i < 3; ++i) {
    double variance = 0;
    for (const Bgr& pixel : pixels) variance += std::pow(feature_of(pixel)[i] - mean[i], 2) / count;
    model.spread[i] = std::max(1.5 * std::sqrt(variance), least_spread[i]);
  }
  return model;
}

std::string_view name_of(Colour colour) {
  const auto found = std::ranges::find(names, colour, &NamedColour::colour);
  return found == names.end() ? "none" : found->name;
}

std::optional<Colour> colour_named(std::string_view name) {
  const auto found = std::ranges::find(names, name, &NamedColour::name);
  return found == names.end() ? std::nullopt : std::optional{found->colour};
}

ColourTable::ColourTable(std::span<const ColourModel> models) : table_(1U << (3 * bits)) {
  std::vector<Feature> means;
  for (const ColourModel& model : models) means.push_back(feature_of(model.bgr));
  for (unsigned i = 0; i < table_.size(); ++i) {
    constexpr unsigned mask = (1U << bits) - 1;
    const auto middle = [](unsigned level) { return (level << drop) + (1U << drop) / 2.0 - 0.5; };
    const Feature feature = feature_of({middle(i >> (2 * bits)), middle((i >> bits) & mask), middle(i & mask)});
    double best = std::numeric_limits<double>::infinity();
    for (std::size_t m = 0; m < models.size(); ++m) {
      double square = 0;
      double cost = 0;  // -2 ln of the likelihood, but for a constant
      for (std::size_t j = 0; j < 3; ++j) {
        const double sigmas = (feature[j] - means[m][j]) / models[m].spread[j];
        square += sigmas * sigmas;
        cost += sigmas * sigmas + 2 * std::log(models[m].spread[j]);
      }
      if (square > farthest * farthest || cost >= best) continue;
      best = cost;
      table_[i] = models[m].colour;
    }
  }
}

}  // namespace regista::camera
