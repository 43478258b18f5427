#include <iostream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "command.hpp"
#include "follow_report.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/tip_path_file.hpp"
#include "helix_arm/procedures/budget_table.hpp"
#include "helix_arm/procedures/follow_run.hpp"
#include "helix_arm/procedures/loop_config.hpp"
#include "interrupt_watch.hpp"
#include "output.hpp"
#include "plot.hpp"

namespace helix_arm::cli {
namespace {

using procedures::FollowPlan;
using procedures::FollowResult;

constexpr model::Range kSeconds{0.1, 3600};
constexpr model::Range kLatency{0, 1};
constexpr std::size_t kMostTips = 1000;
constexpr double kMostForce = 100.0;  // [N]

struct FollowArguments {
  std::string scene, rig, tip, path, vision = "corners", force, blind, out, png;
  double seconds = 0.0, latency = 0.06;
  bool open = false;
  std::uint32_t seed = 1;
};

Eigen::Vector3d tipOf(const std::string& text) {
  const std::vector<double> numbers = numberList("--tip", text, 3);
  const Eigen::Vector3d tip(numbers[0], numbers[1], numbers[2]);
  if (tip.cwiseAbs().maxCoeff() <= statics::kFarthestTarget) return tip;
  throw CallerError("--tip " + text + " is farther than 1e6 m; expected metres from the base");
}

std::vector<Eigen::Vector3d> tipsOf(const FollowArguments& arguments) {
  std::vector<Eigen::Vector3d> tips;
  std::istringstream texts(arguments.tip);
  for (std::string text; std::getline(texts, text, ';');) tips.push_back(tipOf(text));
  if (tips.size() > kMostTips) {
    throw CallerError("--tip has " + std::to_string(tips.size()) + " tips; expected at most " +
                      std::to_string(kMostTips));
  }
  const double least = procedures::kLeastTipTime * static_cast<double>(tips.size());
  if (arguments.seconds < least) {
    std::ostringstream message;
    message << "--seconds " << arguments.seconds << " is too short for " << tips.size()
            << " tips; expected at least 1 s for each: --seconds " << least;
    throw CallerError(message.str());
  }
  return tips;
}

model::Range blindOf(const std::string& text) {
  const std::vector<double> times = numberList("--blind", text, 2);
  if (times[0] <= times[1]) return {times[0], times[1]};
  throw CallerError("--blind " + text + " ends before it begins; expected from,to [s]");
}

procedures::TimedForce forceOf(const std::string& text) {
  const std::vector<double> numbers = numberList("--force", text, 4);
  const procedures::TimedForce out{numbers[0], {numbers[1], numbers[2], numbers[3]}};
  if (out.force.norm() <= kMostForce) return out;
  throw CallerError("--force " + text + " is more than 100 N; expected time,x,y,z in s and N");
}

control::TipPath pathOf(const FollowArguments& arguments, const io::Scene& scene) {
  const control::TipPath path(io::loadTipPath(io::loadDataSet(arguments.path)));
  if (const auto refusal = procedures::checkPath(scene, path)) {
    throw CallerError("--path " + arguments.path + ": " + refusal->reason);
  }
  return path;
}

FollowPlan planOf(const FollowArguments& arguments, const io::Scene& scene) {
  if (arguments.tip.empty() == arguments.path.empty()) {
    throw CallerError("give either --tip or --path");
  }
  FollowPlan plan;
  plan.seconds = arguments.seconds;
  plan.open = arguments.open;
  if (arguments.vision == "rendered") plan.vision = simulation::VisionKind::kRendered;
  plan.latency = arguments.latency;
  plan.seed = arguments.seed;
  if (!arguments.force.empty()) plan.force = forceOf(arguments.force);
  if (!arguments.blind.empty()) plan.blind = blindOf(arguments.blind);
  if (arguments.path.empty()) {
    plan.tips = tipsOf(arguments);
  } else {
    plan.path = pathOf(arguments, scene);
  }
  return plan;
}

// Prints the progress on stderr, every 10 %. Returns false once interrupted.
std::function<bool(double)> progressOf(const FollowPlan& plan, const std::string& what) {
  const auto tenths = std::make_shared<int>(0);
  return [seconds = plan.seconds, what, tenths](double time) {
    const int reached = static_cast<int>(10 * time / seconds);
    if (reached > *tenths) {
      *tenths = reached;
      std::cerr << what << ": " << time << " of " << seconds << " s\n";
    }
    return !interrupted();
  };
}

int run(const FollowArguments& arguments, const GlobalOptions& global) {
  const io::Scene scene = loadScene(arguments.scene, global);
  const io::Scene rig = arguments.rig.empty() ? scene : io::loadScene(arguments.rig);
  const std::string warning = procedures::loopWarning(procedures::loopConfigOf(scene));
  const FollowPlan plan = planOf(arguments, scene);
  if (!arguments.out.empty()) const io::AtomicFile trial(arguments.out);
  checkPicture(arguments.png, arguments.out);
  if (!warning.empty()) std::cerr << warning << "\n";

  const InterruptWatch watch;
  const char* const what = plan.open ? "open loop" : "closed loop";
  const FollowResult result = procedures::runFollow(scene, rig, plan, progressOf(plan, what));
  const FollowReport report{scene, arguments.rig, plan, result, arguments.out, arguments.png};
  std::optional<FollowResult> open;
  if (!arguments.png.empty() && !plan.open && !interrupted()) {
    FollowPlan beside = plan;
    beside.open = true;
    open =
        procedures::runFollow(scene, rig, beside, progressOf(plan, "open loop, for the picture"));
  }
  if (interrupted()) {
    std::cerr << "interrupted; nothing was written\n";
    return kInterrupted;
  }
  if (!arguments.out.empty()) io::writeFileAtomically(arguments.out, csvOf(report));
  if (!arguments.png.empty()) {
    drawJsonReport(plotOf(report, open ? &*open : nullptr), arguments.png, "leave out --png");
  }
  if (global.format == Format::kJson) printJson(toJson(report));
  if (global.format == Format::kCsv) std::cout << csvOf(report);
  if (global.format == Format::kText) printText(report);
  if (result.budget) std::cerr << procedures::budgetTable(*result.budget);
  return failureOf(report).empty() ? kDone : kNotPossible;
}

}  // namespace

Subcommand addFollow(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "follow", "the simulated arm follows tips or a path, with the loop closed over vision");
  const auto arguments = std::make_shared<FollowArguments>();
  addScene(*command, "SCENE", arguments->scene, "scene file with camera, tags and pressures")
      ->required();
  addScene(*command, "--rig", arguments->rig,
           "scene file of the rig, if it is another one (true arm, regulator, camera and tags; "
           "--set does not apply to it)")
      ->type_name("FILE");
  command->add_option(
      "--tip", arguments->tip,
      "tips, seen from the base [m]: x,y,z;x,y,z;...; they share the seconds evenly");
  command->add_option("--path", arguments->path, "path file, as `helix_arm path` writes it")
      ->type_name("FILE");
  command->add_option("--seconds", arguments->seconds, "simulated time [s]")
      ->required()
      ->type_name("S")
      ->check(within(kSeconds));
  command->add_flag("--open", arguments->open, "keep the loop open: the model alone commands");
  command
      ->add_option("--sight", arguments->vision,
                   "corners (of the visible tags, with 0.3 px of noise; fast) or rendered "
                   "(pictures, in which the tags are detected)")
      ->check(CLI::IsMember({"corners", "rendered"}))
      ->capture_default_str();
  command->add_option("--force", arguments->force,
                      "force on the true tip from a time on, seen from the base [s, N]: t,x,y,z");
  command->add_option("--blind", arguments->blind, "interval without pictures [s]: from,to");
  command
      ->add_option("--latency-s", arguments->latency, "time from a picture to its measurement [s]")
      ->type_name("S")
      ->check(within(kLatency))
      ->capture_default_str();
  command->add_option("--seed", arguments->seed, "seed of all noise")->capture_default_str();
  command->add_option("--out", arguments->out, "CSV file to write: one row per step of 10 ms")
      ->type_name("FILE");
  command
      ->add_option("--png", arguments->png,
                   "picture file: wanted tip, true tip with the loop closed and open, errors")
      ->type_name("FILE");
  command->footer(
      "The rig of the scene (keys simulation, regulator, safety) in one thread with a simulated\n"
      "time: the same call gives the same figures on any machine. Rules of the loop: key follow.\n"
      "Errors are those of the true tip against the wanted one.\n"
      "A path begins when the tip has moved to its first point, at most at 0.1 m/s. It is refused\n"
      "where the model misses it by more than 2 mm or a pressure needs more than 80 % of\n"
      "safety.slew_kpa_s, or where it has more than 1,000,000 places to check: its points, and "
      "one\n"
      "every 10 ms and every 2 mm. A tip out of reach is not an error: the arm goes to the closest "
      "position.\n"
      "json: scene, rig (file, or null), seed, sight, open, seconds, pictures (used), reason "
      "(null, or why there are "
      "no\n"
      "figures), path_rms_m and path_max_m (from the path's start to its end; null without),\n"
      "steady_rms_m (of each tip's last second), settle_s (of each tip: time until within 2 mm +\n"
      "5 % of the step for good, null if never), unreachable (of each tip: true or false), states\n"
      "[{time_s, state}], alarms [{time_s, onset_s, force_n, covariance}], budget (or null), out,\n"
      "png. csv: the rows of --out. Progress is printed on stderr, and at the end the error "
      "budget\n"
      "of the last picture: standard deviations of the tip in mm.\n"
      "Files appear only when they are complete. Ctrl-C: nothing is written, exit code 130. Exit\n"
      "code 1 if the time ends before the path begins, or the safety core vents the arm.");
  return {command, [arguments](const GlobalOptions& global) { return run(*arguments, global); }};
}

}  // namespace helix_arm::cli
