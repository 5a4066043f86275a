// SPDX-License-Identifier: Apache-2.0
#include <benchmark/benchmark.h>

#include <cstdio>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace {

/// The usual table, then each benchmark as a multiple of the first of its group: the name up to the last slash.
class RatioReporter final : public benchmark::ConsoleReporter {
 public:
  void ReportRuns(const std::vector<Run>& runs) override {
    ConsoleReporter::ReportRuns(runs);
    for (const Run& run : runs) {
      failed_ = failed_ || run.error_occurred;
      if (run.run_type != Run::RT_Iteration || run.error_occurred) continue;
      const std::string name = run.run_name.function_name;
      const double time = run.GetAdjustedCPUTime();
      const auto [baseline, is_first] = baselines_.try_emplace(name.substr(0, name.rfind('/')), time);
      if (!is_first) ratios_.emplace_back(name, time / baseline->second);
    }
  }

  void Finalize() override {
    std::printf("\nTimes its baseline:\n");
    for (const auto& [name, ratio] : ratios_) std::printf("%-60s %8.2f\n", name.c_str(), ratio);
  }

  [[nodiscard]] bool failed() const { return failed_; }

 private:
  bool failed_ = false;
  std::map<std::string, double> baselines_;  // [time unit of the run], by group
  std::vector<std::pair<std::string, double>> ratios_;
};

}  // namespace

/// Google Benchmark's options, and `--quick`: each benchmark once and briefly, to see that it still runs.
int main(int argc, char** argv) {
  static char briefly[] = "--benchmark_min_time=0.001";
  for (int i = 1; i < argc; ++i) {
    if (std::string_view{argv[i]} == "--quick") argv[i] = briefly;
  }
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  RatioReporter reporter;
  return benchmark::RunSpecifiedBenchmarks(&reporter) == 0 || reporter.failed() ? 1 : 0;
}
