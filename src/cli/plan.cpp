// A way of the pressures around the scene's zones, as a table that pressure_series and follow play.
#include <iostream>

#include "command.hpp"
#include "helix_arm/planning/pressure_planner.hpp"
#include "io/document/atomic_file.hpp"

namespace helix_arm::cli {
namespace {

constexpr model::Range kLongest{1e-3, 3600}, kEvery{1e-3, 10};

struct PlanArguments {
  std::string scene, tip, out;
  InputArguments from{"--from-kpa"}, to{"--to-kpa"};
  double every = 0.1, longest = 5.0;
  std::uint32_t seed = 1;
};

json rowJson(const planning::PlanRow& row) {
  return {{"time_s", row.time},
          {"pressure_pa", row.pressure},
          {"tip_m", row.tip.translation},
          {"clearance_m", row.clearance.distance}};
}

std::string csvOf(const io::Scene& scene, const planning::Plan& plan, double every) {
  json rows = listJson(plan.rows, rowJson);
  for (std::size_t i = 0; i < rows.size(); ++i) rows[i]["kpa"] = plan.rows[i].pressure / 1e3;
  return csvText(
      basics::messageOf("# A way of scene ", scene.name, " around its zones, a row every ", every,
                        " s: pressure_series plays it with _ramp_s:=", every, " _hold_s:=0.\n"),
      {{"rows", rows}},
      {{"time_s", {"kpa", "pressure_*_kpa"}, {"tip_m", "@_m"}, "clearance_m"}, "rows"});
}

json reportOf(const io::Scene& scene, const PlanArguments& arguments, const planning::Plan& plan,
              const clearance::ArmClearance& zones) {
  clearance::Clearance least;
  if (plan.found()) least = plan.nearest().clearance;
  return {{"scene", scene.name},
          {"found", plan.found()},
          {"reason", textOrNull(plan.reason)},
          {"seconds", plan.seconds},
          {"duration_s", plan.found() ? json(plan.rows.back().time) : json()},
          {"clearance_m", least.distance},
          {"zone", textOrNull(zones.nameOf(least.zone))},
          {"rows", listJson(plan.rows, rowJson)},
          {"out", plan.found() ? textOrNull(arguments.out) : json()}};
}

int run(const PlanArguments& arguments, const GlobalOptions& global) {
  refuseIf(arguments.to.given() != arguments.tip.empty(),
           "give exactly one goal: --to-kpa or --tip");
  const io::Scene scene = loadScene(arguments.scene, global);
  refuseIf(!scene.keep_out, "scene ", scene.name,
           " has no zones to plan around; add the key keep_out");
  refuseIf(hasTendon(scene.arm), "scene ", scene.name, " has tendons; plan is for pressures alone");
  requireWritable({arguments.out});
  const Eigen::VectorXd from = inputsOf(scene, arguments.from);
  const planning::PressurePlanner planner(scene.model, *scene.keep_out, scene.safety.channels,
                                          scene.safety.rules);
  const InterruptWatch watch;
  planning::PlanOptions options{arguments.longest, arguments.seed, arguments.every};
  options.stops = [](const planning::PlanProgress&) { return interrupted(); };
  const planning::Plan plan =
      arguments.tip.empty() ? planner.toPressures(from, inputsOf(scene, arguments.to), options)
                            : planner.toTip(from, numberList("--tip", arguments.tip, 3), options);
  if (interrupted()) return kInterrupted;
  const std::string csv = csvOf(scene, plan, arguments.every);
  if (plan.found() && !arguments.out.empty()) io::writeFileAtomically(arguments.out, csv);
  if (plan.found() && arguments.out.empty() && global.format == Format::kCsv) {
    std::cout << csv;
    return kDone;
  }
  const json report = reportOf(scene, arguments, plan, planner.check().clearance());
  printResult(global.format, report, report,
              Csv{{"found", "reason", "seconds", "duration_s", "clearance_m", "zone"}});
  return plan.found() ? kDone : kNotPossible;
}

}  // namespace

void addPlan(Commands& commands) {
  auto [command, arguments] = commands.add<PlanArguments>(
      "plan", "a way of the pressures around the scene's keep_out zones", run);
  addScene(command, arguments.scene);
  addInputOptions(command, arguments.from,
                  "where the arm is, gauge pressures [kPa], one per actuator: a,b,c");
  addInputOptions(command, arguments.to, "where it goes, gauge pressures [kPa]: a,b,c");
  addOption(command, "--tip", arguments.tip, "where its tip goes, base frame [m]: x,y,z");
  addOption(command, "--out", arguments.out,
            "table to write: time_s, pressure_1_kpa .., x_m, y_m, z_m, clearance_m",
            TypeName{"FILE"});
  addOption(command, "--every-s", arguments.every, "time between its rows [s]", TypeName{"S"},
            within(kEvery), kShowDefault);
  addOption(command, "--longest-s", arguments.longest, "longest time of the search [s]",
            TypeName{"S"}, within(kLongest), kShowDefault);
  addOption(command, "--seed", arguments.seed, "of the search's samples",
            CLI::Range(1U, 0xffffffffU), kShowDefault);
  command.footer(
      R"(RRT-Connect and shortcuts of OMPL in the space of pressures; every motion is swept, and the
path once more with the lag of the regulator. Each pressure stays within 60 % of its slew.
json: scene, found, reason (null if found), seconds (that the search took), duration_s,
clearance_m (least of the rows) and its zone, rows [{time_s, pressure_pa, tip_m,
clearance_m}], out (null if absent). csv: the table; without a path, or with --out, a
summary. Exit code 1 if no path was found, which does not prove that there is none.)");
}

}  // namespace helix_arm::cli
