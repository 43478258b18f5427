#include "bag/bag_captures.hpp"
#include "basics/pi.hpp"
#include "command.hpp"
#include "io/document/atomic_file.hpp"
#include "measurements.hpp"
#include "procedures/commissioning.hpp"

namespace helix_arm::cli {
namespace {

using procedures::Commissioning;

struct CommissionOptions {
  std::string scene, rig, data, out;
  int suspect = 0;
  std::uint32_t seed = 1;
};

// Direction about the arm and size of a displacement of the tip; null where it was not seen.
void addMotion(const std::string& prefix, const Eigen::Vector2d& tip, json& row) {
  row[prefix + "_deg"] = std::atan2(tip.y(), tip.x()) * 180 / basics::kPi;
  row[prefix + "_mm"] = 1e3 * tip.norm();
}

json nameOrNull(const Commissioning& found, int actuator) {
  if (actuator < 0) return nullptr;
  return found.channels[static_cast<std::size_t>(actuator)].actuator;
}

json reportOf(const io::Scene& scene, const Commissioning& found) {
  json channels = json::array(), sensors = channels;
  for (const procedures::WalkedChannel& one : found.channels) {
    json row{{"actuator", one.actuator},
             {"verdict", one.verdict},
             {"answers_as", nameOrNull(found, one.answers_as)}};
    addMotion("expected", one.expected, row);
    addMotion("seen", one.seen, row);
    channels.push_back(std::move(row));
  }
  for (const procedures::WalkedSensor& one : found.sensors) {
    sensors.push_back({{"actuator", one.actuator},
                       {"gain", one.gain},
                       {"offset_kpa", 1e-3 * one.offset},
                       {"verdict", one.verdict},
                       {"reads_as", nameOrNull(found, one.reads_as)}});
  }
  return {{"scene", scene.name},
          {"good", found.findings.empty()},
          {"reason", found.findings.empty() ? json() : json(found.findings.front())},
          {"findings", found.findings},
          {"channels", channels},
          {"sensors", sensors},
          {"missing_tags", found.missing_tags},
          {"suspects", found.suspects},
          {"out", nullptr}};
}

int run(const CommissionOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadScene(options.scene, global);
  requirePressureDriven(scene);
  requireNoInput(options.out, {options.scene, options.rig, options.data});
  requireYaml(options.out);
  refuseIf(!scene.tags, "scene ", scene.name, " has no tags; add the section tags");
  const Eigen::MatrixXd plan = procedures::walkPlan(scene.arm);
  const procedures::CalibrationData data =
      options.data.empty()
          ? procedures::walkSimulatedRig(
                scene, options.rig.empty() ? scene : io::loadScene(options.rig), plan, options.seed)
          : ros_bridge::loadMeasurements(scene, {options.data}, {});
  const std::vector<io::Override> overrides = overridesOf(global);
  const Commissioning found = procedures::commission(options.scene, overrides, data, plan);
  json report = reportOf(scene, found);
  bool good = found.findings.empty();
  if (!options.out.empty() && !good) {
    const procedures::Correction correction =
        procedures::correct(options.scene, overrides, data, found, options.suspect);
    good = correction.reason.empty();
    if (good) io::writeFileAtomically(options.out, correction.scene_text);
    report[good ? "out" : "reason"] = good ? options.out : correction.reason;
  }
  printResult(global.format, report, without(report, {"suspects", "reason"}),
              Csv{{"actuator", "expected_deg", "seen_deg", "expected_mm", "seen_mm", "verdict",
                   "answers_as"},
                  "channels"});
  return good ? kDone : kNotPossible;
}

}  // namespace

void addCommission(Commands& commands) {
  auto [command, options] = commands.add<CommissionOptions>(
      "commission",
      "walk through the muscles one at a time: is every hose, sensor and tag where "
      "the scene says?",
      run);
  addScene(command, options.scene);
  addSceneOption(command, "--rig", options.rig,
                 "scene of the simulated rig that walks; default: SCENE");
  addOption(command, "--data", options.data,
            "instead of the simulated rig's, the captures of a walk: tag "
            "corners or tag poses of each step, in their order");
  addOption(command, "--out", options.out,
            "scene file to write without the mistake that is found, where a scene can say it");
  addOption(command, "--apply-suspect", options.suspect,
            "the suspect of the result that --out corrects, counted from 1; default: channels that "
            "answer as others, else the first suspect");
  addOption(command, "--seed", options.seed, "seed of all noise of the simulated rig",
            kShowDefault);
  command.footer(
      R"(The walk: rest, each actuator alone at 15 % and 30 % of its range, neighbours together at
30 %, rest. On a rig, run_calibration with walk: true does it; nothing is changed.
json: scene, good, reason (the leading finding, or why --out is not written), findings,
channels [{actuator, expected_deg, seen_deg (of the tip about the arm, from y to z of the
base), expected_mm, seen_mm, verdict (ok, answers_as, dead, weak, strong, wrong_sign,
other_direction, unseen), answers_as}], sensors [{actuator, gain, offset_kpa, verdict (ok,
no_reading, reads_as, gain, offset), reads_as}] of measured beside commanded pressures,
missing_tags (ids never seen), suspects as of calibrate, out. csv: one row per channel.
Exit code 1 unless all is where the scene says, or --out was written.)");
}

}  // namespace helix_arm::cli
