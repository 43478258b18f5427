#include "basics/text.hpp"
#include "command.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/driver.hpp"
#include "procedures/rig_check.hpp"

namespace helix_arm::cli {
namespace {

using procedures::Finding;
using procedures::RigCheck;
using procedures::Severity;
using procedures::VisionFigures;

constexpr int kDecimals = 2;  // of a pressure in kPa

struct CheckArguments {
  std::string scene;
  bool probe = false;
  int samples = 150;
};

// Tells what was read, and holds it against the scene.
void judge(const io::Scene& scene, const regulator::Pressures& readings,
           std::vector<Finding>& findings) {
  const std::string name = regulator::describe(*scene.regulator);
  const Eigen::VectorXd& pressure = readings.pressure;
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    if (std::isfinite(pressure[i])) continue;
    findings.push_back({Severity::kFault, "no_reading", scene.arm.actuator(i).name,
                        "its channel gives no reading",
                        "look at its sensor and address: helix_arm regulator SCENE probe"});
  }
  std::string said = pressureText(scene.arm, pressure, kDecimals);
  const bool measured = std::isfinite(readings.supply);
  if (measured) said += basics::format(", supply %.*f kPa", kDecimals, readings.supply / 1e3);
  findings.push_back({Severity::kNote, "answered", name,
                      "it vented and answered, gauge pressures: " + said,
                      "expect 0 kPa within the noise of the sensors"});
  if (!regulator::isHardware(*scene.regulator)) return;  // its supply stands in the scene
  if (!measured) {
    findings.push_back(
        {Severity::kNote, "supply_not_measured", name,
         "it does not tell the pressure of its supply, which is therefore not compared with the "
         "limits of the arm",
         "read the gauge of the supply: it must show the highest max_pressure_kpa or more"});
    return;
  }
  for (const Finding& one : procedures::checkSupply(scene, readings.supply)) {
    findings.push_back(one);
  }
}

// Connects, which vents, and reads once; nothing if it does not answer.
std::optional<regulator::Pressures> ask(const io::Scene& scene, std::vector<Finding>& findings) {
  std::optional<regulator::Pressures> readings;
  const std::string name = regulator::describe(*scene.regulator);
  try {
    const auto driver = regulator::makeDriver(*scene.regulator, scene.arm.actuatorCount());
    driver->connect();
    regulator::Pressures pressures(scene.arm.actuatorCount());
    driver->read(pressures);
    readings = pressures;
  } catch (const regulator::LinkError& error) {
    findings.push_back(
        {Severity::kFault, "no_answer", name, error.what(), "check power, cable and address"});
  } catch (const regulator::BadReply& error) {
    findings.push_back(
        {Severity::kFault, "bad_reply", name, error.what(), "check the profile of the regulator"});
  }
  if (readings) judge(scene, *readings, findings);
  procedures::sortBySeverity(findings);
  return readings;
}

json visionJson(const std::optional<VisionFigures>& vision) {
  if (!vision) return nullptr;
  const bool measured = vision->measured > 0;
  return {{"samples", vision->samples},
          {"least_tags", vision->least_tags},
          {"median_tags", vision->median_tags},
          {"measured", vision->measured},
          {"median_tip_sd_m", valueIf(measured, vision->median_tip_sd)},
          {"worst_tip_sd_m", valueIf(measured, vision->worst_tip_sd)},
          {"pixels_per_bit", valueIf(vision->pixels_per_bit > 0, vision->pixels_per_bit)}};
}

json reportOf(const io::Scene& scene, const RigCheck& check, bool probed,
              const std::optional<regulator::Pressures>& readings) {
  const json findings = listJson(check.findings, [](const Finding& finding) -> json {
    return {{"severity", nameOf(finding.severity)},
            {"check", finding.check},
            {"culprit", finding.culprit},
            {"value", finding.value},
            {"remedy", finding.remedy}};
  });
  return {{"scene", scene.name},
          {"passed", !check.hasFault()},
          {"findings", findings},
          {"sight", visionJson(check.vision)},
          {"probed", probed},
          {"regulator", scene.regulator ? json(regulator::describe(*scene.regulator)) : json()},
          {"pressures_pa", readings ? json(readings->pressure) : json()},
          {"supply_pa", readings ? json(readings->supply) : json()}};
}

int run(const CheckArguments& arguments, const GlobalOptions& global) {
  const io::Scene scene = loadScene(arguments.scene, global);
  refuseIf(arguments.probe && !scene.regulator, "scene ", scene.name,
           " has no regulator to probe; add the section regulator, or leave out --probe");
  RigCheck check = procedures::checkRig(scene, arguments.samples);
  std::optional<regulator::Pressures> readings;
  if (arguments.probe) readings = ask(scene, check.findings);
  const json report = reportOf(scene, check, arguments.probe, readings);
  json shown = report;
  if (scene.regulator && regulator::isHardware(*scene.regulator) && !arguments.probe) {
    shown["notes"] = {"the regulator was not asked: --probe connects to it, which vents"};
  }
  const Csv csv{{"severity", "check", "culprit", "value", "remedy"}, "findings"};
  printResult(global.format, report, shown, [&](std::ostream& out) {
    if (check.findings.empty()) out << "severity,check,culprit,value,remedy\n";
    printCsv(report, csv, out);
  });
  return check.hasFault() ? kNotPossible : kDone;
}

}  // namespace

void addCheck(Commands& commands) {
  auto [command, arguments] = commands.add<CheckArguments>(
      "check", "look for what keeps a rig from working, before it moves", run);
  addScene(command, arguments.scene);
  command.add_flag("--probe", arguments.probe,
                   "also connect to the regulator, which vents, and read it once");
  addOption(command, "--samples", arguments.samples,
            "number of inputs drawn within the limits, besides their corners",
            CLI::Range(0, 100000), kShowDefault);
  command.footer(
      R"(Nothing moves. Faults of the file itself are reported as by every command (exit code 2).
json: scene, passed, findings [{severity (fault, warning, note), check, culprit, value,
remedy}], sight {samples, least_tags, median_tags (in sight, large enough to be read),
measured (part of the samples), median_tip_sd_m, worst_tip_sd_m, pixels_per_bit (that 90 %
of the tags that face the camera exceed)} (null without camera or tags), probed, regulator
(null without), pressures_pa (null unless it answered), supply_pa (null unless measured).
csv: one row per finding. Exit code 1 if a fault was found.)");
}

}  // namespace helix_arm::cli
