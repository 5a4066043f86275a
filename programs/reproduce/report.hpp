// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace regista::reproduce {

/// One number of a publication beside ours: a line of the table, an object of the JSON.
struct Row {
  std::string source;  ///< "H 7.3"
  std::string quantity;
  std::string unit;
  std::string controller;  ///< "published" or "ours"
  std::string better;      ///< "lower" or "higher"
  std::optional<double> published;
  double value = 0;
  double ci95_low = 0;
  double ci95_high = 0;
  std::string note;
};

struct Line {
  std::string name;
  std::vector<double> x;
  std::vector<double> y;
  bool dots = false;  ///< marks instead of a line
};

struct Plot {
  std::string file;  ///< without ".svg"
  std::string title;
  std::string x_label;
  std::string y_label;
  std::vector<Line> lines;
  bool same_scale = false;  ///< a metre is as long on both axes
};

/// What one experiment found.
struct Experiment {
  std::string title;
  std::string text;  ///< Markdown: what was simulated, and what to make of it
  std::vector<Row> rows;
  std::vector<Plot> plots;
};

struct Estimate {
  double value = 0;
  double low = 0;  ///< 95 %
  double high = 0;
};

/// A statistic of `runs` independent runs and its 95 % interval, by the percentile bootstrap (Efron 1979): the
/// statistic of 1000 draws of as many runs, with replacement. `statistic` gets the numbers of the runs to use.
Estimate bootstrap(std::size_t runs, const std::function<double(std::span<const std::size_t>)>& statistic,
                   std::uint64_t seed);

double mean(std::span<const double> values);
/// Of a sample: divided by n - 1.
double standard_deviation(std::span<const double> values);
/// Bootstrap of the mean.
Estimate mean_of(std::span<const double> values, std::uint64_t seed);

nlohmann::json to_json(const Row& row);
std::string to_svg(const Plot& plot);
/// The whole document; plots are linked as PLOTS/FILE.svg.
std::string to_markdown(std::span<const Experiment> experiments, const std::string& plots, const std::string& command);
/// The table alone, for a terminal.
std::string to_text(std::span<const Experiment> experiments);

}  // namespace regista::reproduce
