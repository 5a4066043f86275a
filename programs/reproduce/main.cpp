// SPDX-License-Identifier: Apache-2.0
// regista-reproduce: three published systems and ours, side by side, on simulated robots.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>

#include "../command_line.hpp"
#include "experiments.hpp"

namespace {

void write(const std::filesystem::path& path, const std::string& text) {
  std::ofstream file{path};
  file << text;
  if (!file.flush()) throw std::runtime_error{"cannot write " + path.string() + ": is its folder there?"};
}

/// What people added to the page: from this line on it is kept.
std::string written_by_hand(const std::filesystem::path& path) {
  std::ifstream file{path};
  const std::string page{std::istreambuf_iterator<char>{file}, {}};
  const std::size_t at = page.find("\n<!-- By hand from here on. -->\n");
  return at == std::string::npos ? "" : page.substr(at);
}

}  // namespace

int main(int argc, char** argv) try {
  regista::reproduce::Settings settings;
  std::string json, markdown, plots;
  CLI::App app{"Simulates what three publications measured, with their controllers and with ours, and compares"};
  app.set_version_flag("--version", REGISTA_VERSION);
  app.add_option("--seed", settings.seed, "Chance starts here; the same seed gives the same numbers")
      ->capture_default_str()
      ->check(regista::seeds);
  app.add_option("--runs", settings.runs, "Runs of each experiment")
      ->capture_default_str()
      ->check(CLI::Range(2, 10000));
  auto* json_option =
      app.add_option("--json", json, "Write the rows, an array of objects, to this file, or instead of the text")
          ->option_text("[FILE]")
          ->expected(0, 1);
  app.add_option("--markdown", markdown,
                 "Write the tables to this file; what follows '<!-- By hand from here on. -->' in it stays");
  app.add_option("--plots", plots, "Write the plots, SVG, into this folder, and link them in the Markdown");
  if (const auto done = regista::parse(app, argc, argv)) return *done;
  if (json_option->count() > 0 && json.empty()) json = "-";

  std::vector<regista::reproduce::Experiment> experiments;
  for (const auto& run : {regista::reproduce::soccer_experiments, regista::reproduce::posture_experiments,
                          regista::reproduce::waypoint_experiments}) {
    std::ranges::move(run(settings), std::back_inserter(experiments));
  }

  if (!plots.empty()) {
    std::filesystem::create_directories(plots);
    for (const auto& experiment : experiments) {
      for (const auto& plot : experiment.plots)
        write(std::filesystem::path{plots} / (plot.file + ".svg"), to_svg(plot));
    }
  }
  if (!markdown.empty()) {
    const auto folder = std::filesystem::path{markdown}.parent_path();
    const auto linked = std::filesystem::path{plots}.lexically_relative(folder.empty() ? "." : folder).generic_string();
    std::string command = "regista-reproduce --seed " + std::to_string(settings.seed) + " --runs " +
                          std::to_string(settings.runs) + " --markdown " + markdown;
    if (!plots.empty()) {
      command += " --plots " + plots;
    } else {
      for (auto& experiment : experiments) experiment.plots.clear();
    }
    const std::string by_hand = written_by_hand(markdown);
    write(markdown, to_markdown(experiments, linked, command) + by_hand);
  }
  if (!json.empty()) {
    auto rows = nlohmann::json::array();
    for (const auto& experiment : experiments) {
      for (const auto& row : experiment.rows) rows.push_back(to_json(row));
    }
    json == "-" ? void(std::cout << rows.dump(2) << '\n') : write(json, rows.dump(2) + '\n');
  }
  if (json != "-") std::cout << to_text(experiments);
  return 0;
} catch (const std::exception& error) {
  std::cerr << "regista-reproduce: " << error.what() << '\n';
  return 1;
}
