// SPDX-License-Identifier: Apache-2.0
#include <benchmark/benchmark.h>

#include <cstdio>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace {

/// The usual table of medians, then each as a multiple of the first registered of its group: the name up to the last
/// slash.
class RatioReporter final : public benchmark::ConsoleReporter {
 public:
  void ReportRuns(const std::vector<Run>& runs) override {
    ConsoleReporter::ReportRuns(runs);
    for (const Run& run : runs) {
      failed_ = failed_ || run.error_occurred;
      if (run.aggregate_name == "median")
        medians_[run.family_index] = {run.run_name.function_name, run.GetAdjustedCPUTime()};
    }
  }

  void Finalize() override {
    std::printf("\nTimes its baseline:\n");
    std::map<std::string, double> baselines;  // by group
    for (const auto& [family, median] : medians_) {
      const auto& [name, time] = median;
      const auto [baseline, is_first] = baselines.try_emplace(name.substr(0, name.rfind('/')), time);
      if (!is_first) std::printf("%-60s %8.2f\n", name.c_str(), time / baseline->second);
    }
  }

  [[nodiscard]] bool failed() const { return failed_; }

 private:
  bool failed_ = false;
  std::map<std::int64_t, std::pair<std::string, double>> medians_;  // name and time, in order of registration
};

}  // namespace

/// Google Benchmark's options, and
///   --quick      each benchmark briefly, to see that it still runs
///   --json FILE  the results for programs too
/// Repetitions of all benchmarks are interleaved at random, so that a change of the machine's speed meets all alike.
int main(int argc, char** argv) {
  std::vector<std::string> options{argv[0], "--benchmark_enable_random_interleaving=true",
                                   "--benchmark_report_aggregates_only=true", "--benchmark_repetitions=25",
                                   "--benchmark_min_time=0.02"};
  for (const std::string_view given : std::span{argv, static_cast<std::size_t>(argc)}.subspan(1)) {
    if (given == "--quick") {
      options.insert(options.end(), {"--benchmark_repetitions=3", "--benchmark_min_time=0.001"});
    } else if (options.back() == "--json") {
      options.back() = "--benchmark_out=" + std::string{given};
    } else {
      options.emplace_back(given);
    }
  }
  std::vector<char*> pointers;
  for (std::string& option : options) pointers.push_back(option.data());
  int count = static_cast<int>(pointers.size());
  benchmark::Initialize(&count, pointers.data());
  if (benchmark::ReportUnrecognizedArguments(count, pointers.data())) return 1;
  RatioReporter reporter;
  return benchmark::RunSpecifiedBenchmarks(&reporter) == 0 || reporter.failed() ? 1 : 0;
}
