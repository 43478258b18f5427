#include "helix_arm/statics/workspace.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <iostream>
#include <memory>
#include <sstream>

#include "arguments.hpp"
#include "command.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/statics/workspace_extremes.hpp"
#include "interrupt_watch.hpp"
#include "output.hpp"
#include "plot.hpp"
#include "workspace_file.hpp"
#include "workspace_maps.hpp"
#include "workspace_report.hpp"
#include "workspace_sampling.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;

constexpr std::uint64_t kMostCount = 10000000000;
constexpr int kMostThreads = 256;

void drawMaps(const WorkspaceArguments& arguments, const std::string& scene,
              const std::string& tier, const WorkspaceSummary& summary) {
  const json maps = mapsJson(summary.kept, arguments.sensitivity);
  if (maps.empty()) {
    throw CallerError("--png " + arguments.png + " has nothing to draw: the " +
                      std::to_string(summary.points()) +
                      (summary.points() == 1 ? " tip is" : " tips lie on") +
                      " a line or a point; sample more with --count, or leave out --png");
  }
  const json report{{"scene", scene},
                    {"tier", tier},
                    {"points", summary.kept.size()},
                    {"reach_m", summary.extremes.reach()},
                    {"maps", maps}};
  drawJsonReport(report, arguments.png, "leave out --png");
}

// Fault of a --count; empty if it is valid.
std::string checkCount(const std::string& text) {
  const bool digits = !text.empty() && text.find_first_not_of("0123456789") == std::string::npos;
  const std::optional<double> number = digits ? io::parseNumber(text) : std::nullopt;
  if (number && *number >= 1 && *number <= static_cast<double>(kMostCount)) return {};
  return text + " is not a whole number from 1 to " + std::to_string(kMostCount) +
         ", in digits such as 1000000";
}

statics::Workspace workspaceOf(const io::Scene& scene, const WorkspaceArguments& arguments) {
  if (arguments.sensitivity && hasTendon(scene.arm)) {
    throw CallerError("--sensitivity is per kPa, and scene " + scene.name +
                      " has tendons; leave out --sensitivity");
  }
  return statics::Workspace(modelOf(scene, arguments.tier),
                            {arguments.seed, arguments.sensitivity});
}

int run(WorkspaceArguments arguments, const GlobalOptions& global) {
  const io::Scene scene = loadScene(arguments.scene, global);
  const statics::Workspace workspace = workspaceOf(scene, arguments);
  const statics::TierSetting& setting = workspace.model().choice().setting;
  checkPicture(arguments.png, arguments.out);
  WorkspaceSummary summary;
  {
    const InterruptWatch watch;
    std::optional<CloudFile> file;
    if (!arguments.out.empty()) {
      file.emplace(arguments.out, scene.arm,
                   CloudOrigin{scene.name, setting.name(), arguments.seed, arguments.sensitivity});
    }
    summary = sampleWorkspace(workspace, arguments, file ? &*file : nullptr);
  }
  if (summary.whole && summary.points() > 0) {
    summary.extremes = statics::findExtremes(workspace.model(), summary.sampled);
  }
  if (!summary.whole) {
    std::cerr << "interrupted after " << summary.inputs << " of " << arguments.inputs()
              << " inputs; nothing was written\n";
    return kInterrupted;
  }
  // If the picture fails, the summary is printed all the same, without it.
  std::exception_ptr fault;
  try {
    if (!arguments.png.empty() && summary.points() > 0) {
      drawMaps(arguments, scene.name, setting.name(), summary);
    }
  } catch (const CallerError&) {
    fault = std::current_exception();
    arguments.png.clear();
  }
  if (global.format == Format::kJson) printJson(toJson(scene, setting, arguments, summary));
  if (global.format == Format::kCsv) toCsv(scene, setting, arguments, summary).print(std::cout);
  if (global.format == Format::kText) printText(scene, setting, arguments, summary);
  if (fault) std::rethrow_exception(fault);
  return summary.points() > 0 ? kDone : kNotPossible;
}

}  // namespace

Subcommand addWorkspace(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("workspace", "reachable tip positions, and their sensitivity to errors");
  const auto arguments = std::make_shared<WorkspaceArguments>();
  addScene(*command, "SCENE", arguments->scene, "scene file")->required();
  command->add_option(
      "--out", arguments->out,
      "file for the points: .ply (binary, float32) or .csv (with the inputs); default: summary "
      "only");
  command->add_option("--png", arguments->png, "picture file for maps of the points");
  command
      ->add_option("--count", arguments->count,
                   "number of inputs to sample, evenly within their limits; default 10000000, or "
                   "200000 with "
                   "--sensitivity")
      ->check(checkCount);
  command->add_flag(
      "--sensitivity", arguments->sensitivity,
      "also the tip displacement [m] per error of pressure, length and stiffness, at every point");
  command->add_option("--seed", arguments->seed, "seed of the inputs")->capture_default_str();
  command
      ->add_option("--threads", arguments->threads,
                   "number of sampling threads, 0: one per core; the points do not depend on it")
      ->check(CLI::Range(0, kMostThreads))
      ->capture_default_str();
  addTierOptions(*command, arguments->tier);
  command->footer(
      "bounds_m and reach_m are the largest values of a search from the sampled points and from\n"
      "corners of the limits (1024, under load 128, exact tier 8) to local maxima: each is a\n"
      "tip position of the arm. outer_bounds_m and reach_bound_m: no tip is beyond them, proven\n"
      "by branch and bound; null under load and with a taper. reach_certified: whether\n"
      "reach_bound_m is at most 0.1 % above reach_m. sampled_*: of the sampled points alone.\n"
      "Sensitivity: tip displacement [m] for an error of 1 kPa in every pressure (per_kpa_m),\n"
      "of 1 mm in every free length (per_mm_m), of 1 % in every entry of the stiffness, under\n"
      "load also K_eps (per_percent_K_m).\n"
      "The errors are independent: roots of sums of squares. Not for arms with tendons.\n"
      "json: scene, tier, order, seed, count (inputs), unbalanced (inputs omitted because no\n"
      "shape balances the load there or, with --sensitivity, with 1 % more stiffness), failure\n"
      "(null if there are points), seconds, points_per_second, bounds_m {min, max}, reach_m\n"
      "(largest distance from the base), outer_bounds_m, reach_bound_m, reach_certified,\n"
      "sampled_bounds_m, sampled_reach_m, out, png,\n"
      "sensitivity (null, or for each {median, max}; medians and maps are of the first 2\n"
      "million points). csv: one row of the same. Progress is printed on stderr.\n"
      "A file appears only when it is complete. Ctrl-C: nothing is written, exit code 130. Exit\n"
      "code 1 if no input balances the load.");
  return {command, [arguments](const GlobalOptions& global) { return run(*arguments, global); }};
}

}  // namespace helix_arm::cli
