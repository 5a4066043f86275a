// SPDX-License-Identifier: Apache-2.0
#include "report.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <sstream>

namespace regista::reproduce {
namespace {

std::string number(double value, int digits = 3) {
  std::ostringstream text;
  text.precision(digits);
  text << value;
  return text.str();
}

std::string published(const Row& row) { return row.published ? number(*row.published, 4) : "–"; }

/// Of one of our rows against the publication: by the whole interval, or nothing.
std::string verdict(const Row& row) {
  if (row.controller != "ours" || !row.published) return "";
  const bool lower = row.better == "lower";
  if (lower ? row.ci95_high < *row.published : row.ci95_low > *row.published) return "better";
  if (lower ? row.ci95_low > *row.published : row.ci95_high < *row.published) return "worse";
  return "as good";
}

std::string interval(const Row& row) { return number(row.ci95_low) + " … " + number(row.ci95_high); }

/// Round steps of 1, 2 or 5 · 10^n, some five of them across the range.
double tick_step(double range) {
  const double raw = range / 5;
  const double power = std::pow(10, std::floor(std::log10(raw)));
  for (const double step : {1.0, 2.0, 5.0}) {
    if (raw <= step * power) return step * power;
  }
  return 10 * power;
}

struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();

  void include(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  [[nodiscard]] double size() const { return high - low; }
  void widen(double by) {
    low -= by;
    high += by;
  }
};

}  // namespace

double mean(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double standard_deviation(std::span<const double> values) {
  const double m = mean(values);
  double squares = 0;
  for (const double value : values) squares += (value - m) * (value - m);
  return std::sqrt(squares / static_cast<double>(values.size() - 1));
}

Estimate bootstrap(std::size_t runs, const std::function<double(std::span<const std::size_t>)>& statistic,
                   std::uint64_t seed) {
  constexpr std::size_t draws = 1000;
  std::vector<std::size_t> chosen(runs);
  std::iota(chosen.begin(), chosen.end(), std::size_t{0});
  Estimate estimate{.value = statistic(chosen)};

  std::mt19937_64 random{seed};
  std::uniform_int_distribution<std::size_t> any{0, runs - 1};
  std::vector<double> values(draws);
  for (double& value : values) {
    for (std::size_t& run : chosen) run = any(random);
    value = statistic(chosen);
  }
  std::sort(values.begin(), values.end());
  estimate.low = values[draws * 25 / 1000];
  estimate.high = values[draws * 975 / 1000 - 1];
  return estimate;
}

Estimate mean_of(std::span<const double> values, std::uint64_t seed) {
  return bootstrap(
      values.size(),
      [&](std::span<const std::size_t> runs) {
        double sum = 0;
        for (const std::size_t run : runs) sum += values[run];
        return sum / static_cast<double>(runs.size());
      },
      seed);
}

nlohmann::json to_json(const Row& row) {
  return {{"source", row.source},       {"quantity", row.quantity},
          {"unit", row.unit},           {"controller", row.controller},
          {"better", row.better},       {"published", row.published ? nlohmann::json(*row.published) : nullptr},
          {"value", row.value},         {"ci95_low", row.ci95_low},
          {"ci95_high", row.ci95_high}, {"note", row.note}};
}

std::string to_svg(const Plot& plot) {
  constexpr double width = 640, height = 440, left = 60, right = 170, top = 34, bottom = 46;
  constexpr std::array colours{"#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#8c564b", "#17becf", "#7f7f7f"};
  Range x, y;
  for (const Line& line : plot.lines) {
    for (const double value : line.x) x.include(value);
    for (const double value : line.y) y.include(value);
  }
  if (x.size() <= 0) x.widen(0.5);
  if (y.size() <= 0) y.widen(0.5);
  x.widen(0.03 * x.size());
  y.widen(0.05 * y.size());
  const double plot_width = width - left - right, plot_height = height - top - bottom;
  if (plot.same_scale) {
    const double per_pixel = std::max(x.size() / plot_width, y.size() / plot_height);
    x.widen((per_pixel * plot_width - x.size()) / 2);
    y.widen((per_pixel * plot_height - y.size()) / 2);
  }
  const auto at_x = [&](double value) { return left + (value - x.low) / x.size() * plot_width; };
  const auto at_y = [&](double value) { return top + (y.high - value) / y.size() * plot_height; };

  std::ostringstream svg;
  svg.precision(4);
  svg << R"(<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 640 440" font-family="sans-serif" font-size="12">)"
      << "\n<rect width=\"640\" height=\"440\" fill=\"white\"/>\n<text x=\"" << left << "\" y=\"20\" font-size=\"14\">"
      << plot.title << "</text>\n";
  svg << R"(<g stroke="#ddd" fill="#333">)" << '\n';
  const double step_x = tick_step(x.size()), step_y = tick_step(y.size());
  for (double v = std::ceil(x.low / step_x) * step_x; v <= x.high; v += step_x) {
    svg << "<path d=\"M" << at_x(v) << ' ' << top << "V" << height - bottom << "\"/><text stroke=\"none\" x=\""
        << at_x(v) << "\" y=\"" << height - bottom + 16 << "\" text-anchor=\"middle\">"
        << (std::abs(v) < step_x / 2 ? 0 : v) << "</text>\n";
  }
  for (double v = std::ceil(y.low / step_y) * step_y; v <= y.high; v += step_y) {
    svg << "<path d=\"M" << left << ' ' << at_y(v) << "H" << width - right << "\"/><text stroke=\"none\" x=\""
        << left - 6 << "\" y=\"" << at_y(v) + 4 << "\" text-anchor=\"end\">" << (std::abs(v) < step_y / 2 ? 0 : v)
        << "</text>\n";
  }
  svg << "</g>\n<text x=\"" << left + plot_width / 2 << "\" y=\"" << height - 10 << "\" text-anchor=\"middle\">"
      << plot.x_label << "</text>\n<text transform=\"translate(16 " << top + plot_height / 2
      << ") rotate(-90)\" text-anchor=\"middle\">" << plot.y_label << "</text>\n";
  for (std::size_t i = 0; i < plot.lines.size(); ++i) {
    const Line& line = plot.lines[i];
    const char* colour = colours[i % colours.size()];
    if (line.dots) {
      svg << "<g fill=\"" << colour << "\">";
      for (std::size_t k = 0; k < line.x.size(); ++k) {
        svg << "<circle r=\"2.5\" cx=\"" << at_x(line.x[k]) << "\" cy=\"" << at_y(line.y[k]) << "\"/>";
      }
      svg << "</g>\n";
    } else {
      svg << "<path fill=\"none\" stroke-width=\"1.5\" stroke=\"" << colour << "\" d=\"M";
      const std::size_t stride = line.x.size() / 300 + 1;  // a point every other pixel is enough
      for (std::size_t k = 0; k < line.x.size(); k += stride) svg << at_x(line.x[k]) << ' ' << at_y(line.y[k]) << ' ';
      svg << "\"/>\n";
    }
    const double key_y = top + 12 + 18 * static_cast<double>(i);
    svg << "<rect x=\"" << width - right + 10 << "\" y=\"" << key_y - 8 << "\" width=\"12\" height=\"8\" fill=\""
        << colour << "\"/><text x=\"" << width - right + 27 << "\" y=\"" << key_y << "\">" << line.name << "</text>\n";
  }
  svg << "</svg>\n";
  return svg.str();
}

std::string to_markdown(std::span<const Experiment> experiments, const std::string& plots, const std::string& command) {
  std::ostringstream md;
  md << "# Published and ours\n\n"
        "<!-- Written by "
     << command
     << ": do not edit. -->\n\n"
        "Three published systems, each with its controller as published and with ours, on the plants of `sim/`. The\n"
        "column `published` is what the publication measured on a real robot; `simulated` comes from the plants, with\n"
        "95 % intervals by bootstrap over the runs. Much that shaped the published numbers is not known here: "
        "friction,\n"
        "floors, start poses, some definitions. There the simulated robot is our guess, chosen so that the published\n"
        "controller comes out near its published numbers, and the same for both controllers. So compare the simulated\n"
        "values of *published* and *ours* first; `against published` holds ours against the real robot's number.\n\n"
        "- **H**: Holtzhausen 2013, *Development of distributed control system for SSL soccer robots*, Stellenbosch\n"
        "- **O**: Kvalheim, Isaksen, Næss 2017, *Odometry and Posture Regulation for a 4x4 differential drive mobile "
        "robot*, Oslo\n"
        "- **L**: Lien 2013, *Mobile Robotics in Precision Agriculture*, NTNU\n\n"
        "Made by `"
     << command << "`.\n";
  for (const Experiment& experiment : experiments) {
    md << "\n## " << experiment.title << "\n\n" << experiment.text << "\n";
    if (!experiment.rows.empty()) {
      md << "\n| source | quantity | unit | published | controller | simulated | 95 % interval | against published | "
            "note |\n|---|---|---|---|---|---|---|---|---|\n";
    }
    for (const Row& row : experiment.rows) {
      md << "| " << row.source << " | " << row.quantity << " | " << row.unit << " | " << published(row) << " | "
         << row.controller << " | " << number(row.value) << " | " << interval(row) << " | " << verdict(row) << " | "
         << row.note << " |\n";
    }
    for (const Plot& plot : experiment.plots) {
      md << "\n![" << plot.title << "](" << plots << '/' << plot.file << ".svg)\n";
    }
  }
  return md.str();
}

std::string to_text(std::span<const Experiment> experiments) {
  std::ostringstream text;
  for (const Experiment& experiment : experiments) {
    text << experiment.title << '\n';
    for (const Row& row : experiment.rows) {
      text << "  " << row.source << "  " << row.quantity << ", " << row.controller << ": " << number(row.value) << ' '
           << row.unit << " (" << interval(row) << ')';
      if (row.published) text << ", published " << published(row);
      text << '\n';
    }
  }
  return text.str();
}

}  // namespace regista::reproduce
