// Runs the benchmarks a few times in random order and prints, from the medians of that one run, how
// ours stand to the peer's.
#include <algorithm>
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
      const double unit = 1e9 / benchmark::GetTimeUnitMultiplier(run.time_unit);
      medians_[name] = run.GetAdjustedCPUTime() * unit;
      elapsed_[name] = run.GetAdjustedRealTime() * unit;
      const auto error = run.counters.find("error");
      if (error != run.counters.end()) errors_[name] = error->second;
    }
  }

  // How many times `ours` fits into `peer`.
  void printRatio(const std::string& claim, const std::string& ours,
                  const std::string& peer) const {
    const auto a = medians_.find(ours), b = medians_.find(peer);
    if (a == medians_.end() || b == medians_.end()) return;
    std::printf("%-48s %12.1f ns   beside %12.1f ns: %7.2f", claim.c_str(), a->second, b->second,
                b->second / a->second);
    const auto error = errors_.find(ours), error_of_peer = errors_.find(peer);
    if (error != errors_.end() && error_of_peer != errors_.end()) {
      std::printf("   errors %.1e %% beside %.1e %%", error->second, error_of_peer->second);
    }
    std::printf("\n");
  }

  // Which of the machine's limits binds, and how much of it is reached. Memory is read and written
  // in the faster of two ways.
  void printRoof(const std::string& claim, const std::string& ours) const {
    const auto time = medians_.find(ours), fma = medians_.find("fmaRoof");
    const auto cached = medians_.find("bandwidthRoof/cached"),
               streamed = medians_.find("bandwidthRoof/streamed");
    for (const auto& found : {time, fma, cached, streamed}) {
      if (found == medians_.end()) return;
    }
    const double memory = std::min(cached->second, streamed->second);
    const bool by_memory = memory > fma->second;
    std::printf("%-48s %12.1f ns   roofs: memory %.1f, fused products %.1f ns; %s binds: %.0f %%\n",
                claim.c_str(), time->second, memory, fma->second,
                by_memory ? "memory" : "arithmetic",
                100 * std::max(memory, fma->second) / time->second);
  }

  // How time falls with the number of threads: elapsed, and of the processor for the share of one
  // thread, which other programs on the machine disturb less.
  void printScaling(const std::string& claim, const std::string& name) const {
    const auto one = elapsed_.find(name + "/1");
    for (int threads = 1; one != elapsed_.end(); ++threads) {
      const std::string key = name + "/" + std::to_string(threads);
      const auto many = elapsed_.find(key);
      if (many == elapsed_.end()) return;
      std::printf("%-48s %12.1f ns   in %d threads: %5.2f elapsed, %5.2f by processor time\n",
                  claim.c_str(), many->second, threads, one->second / many->second,
                  medians_.at(name + "/1") / medians_.at(key));
    }
  }

 private:
  std::map<std::string, double> medians_;  // of processor time [ns]
  std::map<std::string, double> elapsed_;  // [ns]
  std::map<std::string, double> errors_;   // of the tip, % of the arm's length
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
  for (const std::string arm : {"straight", "helical"}) {
    reporter.printRatio("tip pose, " + arm + ", against KDL FK", "forward/" + arm, "forwardOfPeer");
    reporter.printRatio("warm inverse, " + arm + ", against KDL LMA", "inverse/" + arm,
                        "inverseOfPeerLma");
    reporter.printRatio("warm inverse, " + arm + ", against KDL NR_JL", "inverse/" + arm,
                        "inverseOfPeerNrJl");
    reporter.printRoof("batch of 1e6, " + arm, "batch/" + arm);
  }
  reporter.printRoof("batch of 1e6, helical, rows to rows", "batchRows/helical");
  reporter.printScaling("batch of 1e6, helical, over threads", "batchThreads");
  for (const std::string size : {"720p", "1080p"}) {
    reporter.printRatio("JPEG " + size + " to twist, against the colour chain",
                        "observation/" + size + "_edges", "searchOfPeer/" + size + "_colour");
    reporter.printRatio("JPEG " + size + " to twist, against the gray chain",
                        "observation/" + size + "_edges", "searchOfPeer/" + size + "_gray");
  }
  reporter.printRatio("warm fit of 8 tags, against GSL nmsimplex2", "fit", "fitOfPeer");
  for (const std::string until : {"parameters", "errors", "suggestions"}) {
    reporter.printRatio("stiffness of 21 x 7 tags, to " + until + ", against nmsimplex2",
                        "stiffness/" + until, "stiffnessOfPeer");
  }
  reporter.printRatio("attain, against Ceres", "attain", "attainOfPeer");
  reporter.printRatio("payload, against Ceres", "payload", "payloadOfPeer");
  reporter.printRatio("distance from 6 zones, against dense sampling", "distance",
                      "distanceOfPeer");
  reporter.printRatio("distance from 6 zones, against capsules of FCL", "distance",
                      "capsulesOfPeer");
  reporter.printRatio("placement of 50 x 8 tags, against differences", "placement",
                      "placementOfPeer");
  for (const std::string arm : {"soft", "scene"}) {
    for (const std::string posture : {"hanging", "horizontal"}) {
      const std::string name = arm + "_" + posture, where = " (" + arm + ", " + posture + ")";
      for (const std::string steps : {"20", "50", "100"}) {
        reporter.printRatio("order 5, against RK4 in " + steps + " steps" + where,
                            "loaded/" + name + "/5", "loadedOfPeer/" + name + "/" + steps);
      }
    }
  }
  return 0;
}
