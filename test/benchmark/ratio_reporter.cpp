// Runs the benchmarks a few times in random order and prints, from the medians of that one run, how
// ours stand to the peer's.
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

namespace {

class MedianReporter : public benchmark::ConsoleReporter {
 public:
  void ReportRuns(const std::vector<Run>& runs) override {
    ConsoleReporter::ReportRuns(runs);
    for (const Run& run : runs) {
      if (run.aggregate_name != "median") continue;
      const std::string name =
          run.run_name.function_name + (run.run_name.args.empty() ? "" : "/" + run.run_name.args);
      medians_[name] =
          run.GetAdjustedCPUTime() * 1e9 / benchmark::GetTimeUnitMultiplier(run.time_unit);
    }
  }

  // How many times `ours` fits into `peer`, if both were run.
  void printRatio(const std::string& ours, const std::string& peer) const {
    const auto a = medians_.find(ours), b = medians_.find(peer);
    if (a == medians_.end() || b == medians_.end()) return;
    std::printf("%-26s %12.1f ns   beside %-28s %12.1f ns: %7.2f\n", ours.c_str(), a->second,
                peer.c_str(), b->second, b->second / a->second);
  }

 private:
  std::map<std::string, double> medians_;  // of processor time [ns]
};

}  // namespace

int main(int argc, char** argv) {
  std::vector<char*> arguments(argv, argv + argc);
  std::string defaults[] = {"--benchmark_repetitions=11", "--benchmark_report_aggregates_only=true",
                            "--benchmark_enable_random_interleaving=true",
                            "--benchmark_min_time=0.05"};
  // The caller's flags come last and win.
  for (std::string& flag : defaults) arguments.insert(arguments.begin() + 1, flag.data());
  int count = static_cast<int>(arguments.size());
  benchmark::Initialize(&count, arguments.data());
  if (benchmark::ReportUnrecognizedArguments(count, arguments.data())) return 2;
  MedianReporter reporter;
  benchmark::RunSpecifiedBenchmarks(&reporter);

  std::printf("\nmedians of this run, and how many times ours fits into the peer's:\n");
  for (const std::string arm : {"/straight", "/helical"}) {
    reporter.printRatio("forward" + arm, "forwardOfPeer");
    reporter.printRatio("inverse" + arm, "inverseOfPeerLma");
    reporter.printRatio("inverse" + arm, "inverseOfPeerNrJl");
    reporter.printRatio("batch" + arm, "fmaRoof");
    reporter.printRatio("batch" + arm, "bandwidthRoof/streamed");
  }
  for (const std::string size : {"/720p", "/1080p"}) {
    reporter.printRatio("observation" + size + "_edges", "searchOfPeer" + size + "_colour");
    reporter.printRatio("observation" + size + "_edges", "searchOfPeer" + size + "_gray");
  }
  for (const std::string until : {"parameters", "errors", "suggestions"}) {
    reporter.printRatio("stiffness/" + until, "stiffnessOfPeer");
  }
  reporter.printRatio("distance", "capsulesOfPeer");
  for (const std::string ours : {"fit", "payload", "distance", "placement"}) {
    reporter.printRatio(ours, ours + "OfPeer");
  }
  for (const std::string arm :
       {"soft_hanging", "soft_horizontal", "scene_hanging", "scene_horizontal"}) {
    reporter.printRatio("loaded/" + arm + "/5", "loadedOfPeer/" + arm + "/20");
  }
  return 0;
}
