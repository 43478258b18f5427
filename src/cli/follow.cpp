#include <iostream>
#include <sstream>

#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "command.hpp"
#include "io/data/tip_path_file.hpp"
#include "io/document/atomic_file.hpp"
#include "io/document/number.hpp"
#include "procedures/budget_table.hpp"
#include "procedures/calibration_job.hpp"
#include "procedures/contact_proof.hpp"
#include "procedures/follow_run.hpp"
#include "procedures/loop_config.hpp"
#include "procedures/report_plot.hpp"

namespace helix_arm::cli {

namespace {

using procedures::FollowPlan;
using procedures::FollowResult;
using procedures::FollowRow;

constexpr model::Range kSeconds{0.1, 3600};
constexpr model::Range kLatency{0, 1};
constexpr std::size_t kMostTips = 1000;
constexpr double kMostForce = 100.0;      // [N]
constexpr std::size_t kMostDrawn = 5000;  // rows of a run in a picture

// A simulated run with what was asked for.
struct FollowReport {
  const io::Scene& scene;
  std::string rig;  // file of the rig's scene; empty if that is `scene`
  const FollowPlan& plan;
  const FollowResult& result;
  std::string out, png;  // files; empty where there is none
  std::optional<procedures::ContactProof> proof;
};

const char* visionName(const FollowPlan& plan) {
  return plan.vision == simulation::VisionKind::kRendered ? "rendered" : "corners";
}

// If K_eps of the arm is unknown, forces are only known relative to it.
json alarmsJson(const FollowResult& result) {
  return listJson(result.alarms, [](const procedures::FollowAlarm& alarm) -> json {
    return {{"time_s", alarm.time},
            {"onset_s", alarm.onset},
            {alarm.normalised ? "force_per_K_eps" : "force_n", alarm.force},
            {"covariance", alarm.covariance}};
  });
}

json spreadJson(const char* name, const estimation::TipSpread& spread) {
  return {{"name", name}, {"sd_m", spread.deviation()}, {"covariance_m2", spread.covariance}};
}

json budgetJson(const std::optional<estimation::TipErrorBudget>& budget) {
  if (!budget) return nullptr;
  json parts;
  for (int i = 0; i < estimation::kBudgetPartCount; ++i) {
    const auto part = static_cast<estimation::BudgetPart>(i);
    parts.push_back(spreadJson(nameOf(part), budget->part(part)));
  }
  parts.push_back(spreadJson("predicted", budget->predicted));
  parts.push_back(spreadJson("open_loop", budget->open_loop));
  return {{"time_s", budget->time},   {"parts", parts},
          {"error_m", budget->error}, {"distance2", budget->distance2},
          {"limit", budget->limit},   {"state", nameOf(budget->state)}};
}

std::string millimetres(double metres) { return basics::format("%.2f mm", 1e3 * metres); }

// "path RMS 0.43 mm" or "RMS of the last seconds 0.20 mm"
std::string summary(const procedures::FollowFigures& figures) {
  if (figures.path_rms) return "RMS " + millimetres(*figures.path_rms);
  double square = 0.0;
  int reachable = 0;
  for (std::size_t k = 0; k < figures.steady_rms.size(); ++k) {
    if (figures.unreachable[k]) continue;
    square += figures.steady_rms[k] * figures.steady_rms[k];
    ++reachable;
  }
  if (reachable == 0) return "";
  return "steady RMS " + millimetres(std::sqrt(square / reachable));
}

// Rows that count for the figures: all, or those of the path.
std::vector<const FollowRow*> drawnRows(const FollowPlan& plan, const FollowResult& result) {
  std::vector<const FollowRow*> rows;
  for (const FollowRow& row : result.rows) {
    if (!row.wanted) continue;
    const bool on_path = row.path_time && *row.path_time >= 0 &&
                         (!plan.path || *row.path_time <= plan.path->lastTime());
    if (!plan.path || on_path) rows.push_back(&row);
  }
  const std::size_t stride = rows.size() / kMostDrawn + 1;
  std::vector<const FollowRow*> drawn;
  for (std::size_t k = 0; k < rows.size(); k += stride) drawn.push_back(rows[k]);
  return drawn;
}

json runJson(const char* name, const FollowPlan& plan, const FollowResult& result) {
  json times = json::array(), tips = json::array(), errors = json::array();
  for (const FollowRow* row : drawnRows(plan, result)) {
    times.push_back(row->time);
    tips.push_back(row->true_tip);
    errors.push_back((row->true_tip - *row->wanted).norm());
  }
  const std::string figure = summary(result.figures);
  return {{"name", figure.empty() ? name : name + (": " + figure)},
          {"time_s", times},
          {"tip_m", tips},
          {"error_m", errors}};
}

// Reason of a failure, after the first suspect, which is told as well where the loop is not closed
// at the end.
std::string reasonOf(const FollowReport& report) {
  const FollowResult& result = report.result;
  const std::string failure = failureOf(report.plan, result);
  const bool closed =
      !result.states.empty() && result.states.back().state == follow::LoopState::kClosed;
  if (result.suspects.empty() || (failure.empty() && closed)) return failure;
  const std::string suspect = procedures::textsOf(result.suspects).front();
  return failure.empty() ? suspect : suspect + "; " + failure;
}

json movedJson(const std::optional<FollowResult::Move>& moved) {
  if (!moved) return nullptr;
  return {{"time_s", moved->time},
          {"translation_m", moved->base.xi.head<3>().norm()},
          {"rotation_rad", moved->base.xi.tail<3>().norm()},
          {"deviations", moved->base.deviations}};
}

json proofJson(const procedures::ContactProof& proof) {
  return {{"seconds", proof.quiet.seconds},
          {"highest_score", proof.quiet.highest},
          {"contact_limit", proof.limit},
          {"on_contact", nameOf(proof.on_contact)},
          {"doubt", textOrNull(proof.doubt)},
          {proof.normalised ? "found_force_per_K_eps" : "found_force_n", proof.force}};
}

double secondsOf(const FollowReport& report) {
  const bool known = !report.plan.to_path_end || report.result.rows.empty();
  return known ? report.plan.seconds : report.result.rows.back().time;
}

json reportOf(const FollowReport& report) {
  const procedures::FollowFigures& figures = report.result.figures;
  const json states =
      listJson(report.result.states, [](const procedures::FollowState& change) -> json {
        return {{"time_s", change.time}, {"state", nameOf(change.state)}};
      });
  json out{{"scene", report.scene.name},
           {"rig", textOrNull(report.rig)},
           {"plant", textOrNull(report.plan.plant)},
           {"seed", report.plan.seed},
           {"sight", visionName(report.plan)},
           {"open", report.plan.open},
           {"seconds", secondsOf(report)},
           {"pictures", report.result.pictures},
           {"reason", textOrNull(reasonOf(report))},
           {"path_rms_m", figures.path_rms},
           {"path_max_m", figures.path_max},
           {"last_turn_rms_m", figures.last_turn_rms},
           {"steady_rms_m", figures.steady_rms},
           {"settle_s", figures.settle},
           {"unreachable", figures.unreachable},
           {"limit", listJson(figures.limits,
                              [&](const auto& limits) {
                                return textOrNull(limitsText(report.scene.arm, limits));
                              })},
           {"states", states},
           {"alarms", alarmsJson(report.result)},
           {"suspects", report.result.suspects},
           {"base_moved", movedJson(report.result.moved)},
           {"uncalibrated_tags", report.result.uncalibrated_tags},
           {"contact_blind_s", report.result.contact_blind},
           {"lag_s", report.result.lag.value},
           {"lag_deviation_s", report.result.lag.deviation},
           {"play_kpa", 1e-3 * report.result.play.value},
           {"play_deviation_kpa", 1e-3 * report.result.play.deviation},
           {"budget", budgetJson(report.result.budget)},
           {"out", textOrNull(report.out)},
           {"png", textOrNull(report.png)}};
  if (report.proof) out["contact_proof"] = proofJson(*report.proof);
  return out;
}

// One row a turn, after a comment.
std::string csvOf(const FollowReport& report) {
  std::ostringstream out;
  out << "# Simulated run of scene " << report.scene.name << ", loop "
      << (report.plan.open ? "open" : "closed") << ", sight " << visionName(report.plan)
      << ", seed " << report.plan.seed
      << ". Tips seen from the arm's base. A measured tip is in the\n# row in which it became "
         "known; measured_time_s is the time of its picture.\n";
  CsvTable table(out,
                 {"time_s",
                  {"wanted", "wanted_@_m"},
                  {"true", "true_@_m"},
                  "measured_time_s",
                  {"measured", "measured_@_m"},
                  {"predicted", "predicted_@_m"},
                  "inputs",
                  "state"},
                 &report.scene.arm);
  for (const FollowRow& row : report.result.rows) {
    table.add({{"time_s", row.time},
               {"wanted", row.wanted},
               {"true", row.true_tip},
               {"measured_time_s", valueIf(row.measured.has_value(), row.measured_time)},
               {"measured", row.measured},
               {"predicted", row.predicted},
               {"pressure_pa", row.pressure},
               {"state", nameOf(row.state)}});
  }
  return out.str();
}

// The report with figures of the tips as one table, and of the budget the deviations alone.
json shownOf(const FollowReport& report, json shown) {
  shown["loop"] = report.plan.open ? "open" : "closed";
  json tips = json::array();
  const procedures::FollowFigures& figures = report.result.figures;
  for (std::size_t k = 0; k < figures.steady_rms.size(); ++k) {
    tips.push_back({{"name", "tip " + std::to_string(k + 1)},
                    {"unreachable", shown["unreachable"][k]},
                    {"limit", shown["limit"][k]},
                    {"steady_rms_m", shown["steady_rms_m"][k]},
                    {"settled_s", shown["settle_s"][k]}});
  }
  for (const char* key : {"open", "unreachable", "limit", "steady_rms_m", "settle_s", "suspects"}) {
    shown.erase(key);
  }
  if (report.result.uncalibrated_tags.empty()) shown.erase("uncalibrated_tags");
  if (!report.plan.path) shown = without(shown, {"path_rms_m", "path_max_m"});
  shown["tips"] = tips;
  return shown;
}

// Input of plot_report.
// @param open  the same run with the loop open; null to draw the run alone.
json plotOf(const FollowReport& report, const FollowResult* open) {
  const json wanted = listJson(drawnRows(report.plan, report.result),
                               [](const FollowRow* row) { return *row->wanted; });
  json runs = json::array();
  if (open != nullptr) runs.push_back(runJson("open loop", report.plan, *open));
  runs.push_back(
      runJson(report.plan.open ? "open loop" : "closed loop", report.plan, report.result));
  const auto& blind = report.plan.blind;
  return {{"scene", report.scene.name},
          {"follow",
           {{"wanted_m", wanted},
            {"along_path", report.plan.path.has_value()},
            {"blind_s", blind ? json({blind->lower, blind->upper}) : json()},
            {"runs", runs}}}};
}

struct FollowArguments {
  std::string scene, rig, tip, path, prefer, vision = "corners", force, blind, out, png;
  std::optional<double> seconds;
  FollowPlan plan;  // with all that needs no scene
};

std::vector<Eigen::Vector3d> tipsOf(const FollowArguments& arguments) {
  std::vector<Eigen::Vector3d> tips;
  for (const std::string& text : wordsOf(arguments.tip, ';')) {
    tips.emplace_back(numberList("--tip", text, 3));
    refuseIf(tips.back().cwiseAbs().maxCoeff() > statics::kFarthestTarget, "--tip ", text,
             " is farther than 1e6 m; expected metres from the base");
  }
  refuseIf(tips.size() > kMostTips, "--tip has ", tips.size(), " tips; expected at most ",
           kMostTips);
  const double least = procedures::kLeastTipTime * static_cast<double>(tips.size());
  refuseIf(arguments.plan.seconds < least, "--seconds ", arguments.plan.seconds,
           " is too short for ", tips.size(), " tips; expected at least 1 s for each: --seconds ",
           least);
  return tips;
}

// Checks of the options before a scene is known.
void check(FollowArguments& arguments) {
  FollowPlan& plan = arguments.plan;
  if (plan.ignore_contacts) {
    refuseIf(!(arguments.tip + arguments.path).empty() || plan.open,
             "--prove-contact moves the arm by itself; leave out --tip, --path and --open");
    requireYaml(arguments.out);
    requireNoInput(arguments.out, {arguments.scene});
    plan.seconds = procedures::kProofTime;
  } else if (arguments.tip.empty() == arguments.path.empty()) {
    throw CallerError("give either --tip or --path");
  } else if (!arguments.seconds && arguments.path.empty()) {
    throw CallerError("--seconds is required with --tip");
  }
  plan.seconds = arguments.seconds.value_or(plan.seconds);
}

FollowPlan planOf(const FollowArguments& arguments, const io::Scene& scene) {
  FollowPlan plan = arguments.plan;
  if (arguments.vision == "rendered") plan.vision = simulation::VisionKind::kRendered;
  if (!arguments.force.empty()) {
    const Eigen::Vector4d numbers = numberList("--force", arguments.force, 4);
    plan.force = procedures::TimedForce{numbers[0], numbers.tail<3>()};
    refuseIf(plan.force->force.norm() > kMostForce, "--force ", arguments.force,
             " is more than 100 N; expected time,x,y,z in s and N");
  }
  if (!arguments.blind.empty()) {
    const Eigen::Vector2d times = numberList("--blind", arguments.blind, 2);
    refuseIf(times[0] > times[1], "--blind ", arguments.blind,
             " ends before it begins; expected from,to [s]");
    plan.blind = model::Range{times[0], times[1]};
  }
  if (plan.ignore_contacts) {
    plan.path = procedures::quietPath(scene, plan.seconds, plan.seed);
  } else if (arguments.path.empty()) {
    plan.tips = tipsOf(arguments);
  } else {
    plan.path.emplace(io::loadTipPath(io::loadDataSet(arguments.path)));
    const auto refusal = procedures::checkPath(scene, *plan.path);
    refuseIf(refusal.has_value(), "--path ", arguments.path, ": ", refusal ? refusal->reason : "");
    if (!arguments.seconds) procedures::endWithPath(plan);
  }
  return plan;
}

int follow(const FollowArguments& arguments, const GlobalOptions& global) {
  io::Scene scene = loadScene(arguments.scene, global);
  if (!arguments.prefer.empty()) {
    scene.follow.preference = statics::preferenceOf(arguments.prefer);
  }
  const io::Scene rig = arguments.rig.empty() ? scene : io::loadScene(arguments.rig);
  const std::string warning = procedures::loopWarning(procedures::loopConfigOf(scene));
  const FollowPlan plan = planOf(arguments, scene);
  requireWritable({arguments.out, arguments.png});
  if (!warning.empty()) std::cerr << warning << "\n";

  const InterruptWatch watch;
  const auto runOf = [&](const FollowPlan& run, const char* what) {
    Progress progress(what, run.seconds, " s");
    return procedures::runFollow(scene, rig, run,
                                 [&](double time) { return progress.reached(time); });
  };
  const FollowResult result = runOf(plan, plan.open ? "open loop" : "closed loop");
  FollowReport report{scene, arguments.rig, plan, result, arguments.out, arguments.png, {}};
  if (plan.ignore_contacts) report.proof = procedures::contactProof(scene, result.quiet);
  std::optional<FollowResult> open;
  if (!arguments.png.empty() && !plan.open && !interrupted()) {
    FollowPlan beside = plan;
    beside.open = true;
    open = runOf(beside, "open loop, for the picture");
  }
  if (interrupted()) {
    std::cerr << "interrupted; nothing was written\n";
    return kInterrupted;
  }
  if (report.proof && !failureOf(plan, result).empty()) report.out.clear();
  if (!report.out.empty()) {
    io::writeFileAtomically(
        report.out, report.proof ? procedures::provenSceneText(arguments.scene, overridesOf(global),
                                                               *report.proof)
                                 : csvOf(report));
  }
  if (!arguments.png.empty()) {
    procedures::drawReport(plotOf(report, open ? &*open : nullptr).dump(), arguments.png,
                           "leave out --png");
  }
  const json tree = reportOf(report);
  printResult(global.format, tree, shownOf(report, tree),
              [&report](std::ostream& out) { out << csvOf(report); });
  for (const std::string& text : procedures::textsOf(result.suspects)) std::cerr << text << "\n";
  if (!result.uncalibrated_tags.empty()) {
    std::cerr << procedures::uncalibratedText(result.uncalibrated_tags) << "\n";
  }
  if (result.contact_blind > 0) {
    std::cerr << "for " << io::formatNumber(std::round(100 * result.contact_blind) / 100) << " s "
              << procedures::kContactBlind << "\n";
  }
  if (result.budget) std::cerr << procedures::budgetTable(*result.budget);
  return failureOf(plan, result).empty() ? kDone : kNotPossible;
}

int run(const FollowArguments& arguments, const GlobalOptions& global) {
  try {
    FollowArguments checked = arguments;
    check(checked);
    return follow(checked, global);
  } catch (const simulation::PlantError& error) {
    std::cerr << basics::printable(error.what()) << "\n";
    return kNotPossible;
  }
}

// Options for the arm and its goal.
void addGoal(CLI::App& command, FollowArguments& arguments) {
  addScene(command, arguments.scene, "scene file with camera, tags and pressures");
  addSceneOption(
      command, "--rig", arguments.rig,
      "scene file of the rig, if it is another one (true arm, regulator, camera and tags; "
      "--set does not apply to it)")
      ->type_name("FILE");
  addOption(command, "--plant", arguments.plan.plant,
            "command that simulates the true arm in place of the rig's: docs/closed_loop.md",
            TypeName{"COMMAND"});
  addOption(command, "--tip", arguments.tip,
            "tips, seen from the base [m]: x,y,z;x,y,z;...; they share the seconds evenly");
  addOption(command, "--path", arguments.path, "path file, as `helix_arm path` writes it",
            TypeName{"FILE"});
  addOption(command, "--prefer", arguments.prefer,
            "pressures of redundant actuators in motion: min-change or min-pressure, which may "
            "jump; default: follow.prefer of the scene, or min-change",
            CLI::IsMember({"min-change", "min-pressure"}));
  command.add_flag("--prove-contact", arguments.plan.ignore_contacts,
                   "nobody touches the arm: moves it, and sets the limit of contacts and what "
                   "follows from them");
  addOption(command, "--seconds", arguments.seconds,
            "simulated time [s]; with --path, unless given, until its end; 400 for --prove-contact",
            TypeName{"S"}, within(kSeconds));
  command.add_flag("--open", arguments.plan.open, "keep the loop open: the model alone commands");
}

}  // namespace

void addFollow(Commands& commands) {
  auto [command, arguments] = commands.add<FollowArguments>(
      "follow", "the simulated arm follows tips or a path, with the loop closed over vision", run);
  addGoal(command, arguments);
  addOption(command, "--sight", arguments.vision,
            "corners (of the visible tags, with 0.3 px of noise; fast) or rendered (pictures, in "
            "which the tags are detected)",
            CLI::IsMember({"corners", "rendered"}), kShowDefault);
  addOption(command, "--force", arguments.force,
            "force on the true tip from a time on, seen from the base [s, N]: t,x,y,z");
  addOption(command, "--blind", arguments.blind, "interval without pictures [s]: from,to");
  addOption(command, "--latency-s", arguments.plan.latency,
            "time from a picture to its measurement [s]", TypeName{"S"}, within(kLatency),
            kShowDefault);
  addOption(command, "--seed", arguments.plan.seed, "seed of all noise", kShowDefault);
  addOption(command, "--out", arguments.out,
            "CSV file to write: one row per step of 10 ms; of --prove-contact: the scene file",
            TypeName{"FILE"});
  addOption(command, "--png", arguments.png,
            "picture file: wanted tip, true tip with the loop closed and open, errors",
            TypeName{"FILE"});
  command.footer(
      R"(The rig of the scene (keys simulation, regulator, safety) in one thread with a simulated
time: the same call gives the same figures on any machine. Rules of the loop: key follow.
Errors are those of the true tip against the wanted one.
A path begins when the tip has moved to its first point, at most at 0.1 m/s. It is refused
where the model misses it by more than 2 mm or a pressure needs more than 80 % of
safety.slew_kpa_s, or where it has more than 1,000,000 places to check: its points, and one
every 10 ms and every 2 mm. A tip out of reach is not an error: the arm goes to the closest position.
json: scene, rig (file, or null), plant (command, or null), seed, sight, open, seconds, pictures (used), reason (null, or why there are no
figures, or none of a closed loop; first the first suspect, also where the loop is not closed at the end), path_rms_m and path_max_m (from the path's start to its end; null without),
last_turn_rms_m (of a closed path, null otherwise),
steady_rms_m (of each tip's last second), settle_s (of each tip: time until within 2 mm +
5 % of the step for good, null if never), unreachable (of each tip: true or false), limit
(of each tip: actuators at a limit at its end, as "muscle_1 upper"), states
[{time_s, state}], alarms [{time_s, onset_s, force_n, covariance}] (contacts that no suspect explains), suspects
[{cause, where, explains, remedy}] (why the arm does not move as the scene says, best first: channels
exchanged or dead, wrong pressures, a camera that has moved), base_moved (null, or when, how
far and in how many standard deviations camera or base were found away from their place in the
scene), uncalibrated_tags (ids of fitted tags that no capture of the calibration
shows), contact_blind_s (time in which contacts may not be found: the model balances no force
at the tip), lag_s, lag_deviation_s, play_kpa and play_deviation_kpa (by which the arm follows its
pressures late, errors of the pictures' stamps included, and half the width of its hysteresis, as
estimated with standard errors; 0 if the scene tells a response), budget (or null), out, png; with
--prove-contact also contact_proof {seconds (in which contacts could have been found),
highest_score, contact_limit (twice that, at least the default), on_contact (yield, or stop if
the scene stops; report if there is a doubt), doubt (null, or why), found_force_n}. csv: one row
per step of 10 ms. On stderr: the progress, and at the end the error budget of the last picture:
standard deviations of the tip in mm.
Files appear only when they are complete. Ctrl-C: nothing is written, exit code 130. Exit
code 1 if the time ends before the path begins, no picture is used although the loop is closed,
the safety core vents the arm, or the plant fails.)");
}

}  // namespace helix_arm::cli
