#include "stand_calibration.hpp"

#include <set>
#include <utility>

#include "basics/text.hpp"
#include "calibration_job.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/calibrated_scene.hpp"
#include "helix_arm/io/data_set.hpp"

namespace helix_arm::procedures {
namespace {

std::set<std::string> curvesOf(const model::Arm& arm) {
  std::set<std::string> out;
  for (int i = 0; i < arm.actuatorCount(); ++i) out.insert(arm.actuator(i).curve);
  return out;
}

// First actuator with a curve.
int actuatorOf(const io::Scene& scene, const std::string& contraction) {
  const std::set<std::string> curves = curvesOf(scene.arm);
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    const std::string& curve = scene.arm.actuator(i).curve;
    if (curve == contraction || (contraction.empty() && curves.size() == 1)) return i;
  }
  throw std::invalid_argument(basics::messageOf(
      "the actuators of scene ", scene.name, " have the contractions ",
      basics::joined(std::vector<std::string>(curves.begin(), curves.end())),
      contraction.empty() ? "; name the one of the muscle that was measured with --contraction"
                          : "; expected one of them for --contraction"));
}

// Adds what was fitted.
io::Provenance with(const estimation::StandFit& fit, io::Provenance out) {
  for (Eigen::Index k = 0; k < fit.K_eps.size(); ++k) {
    const std::string number = "_" + std::to_string(k + 1);
    out.parameters.push_back({"K_eps" + number, fit.K_eps[k], fit.K_eps_error[k], true, "N"});
    out.parameters.push_back({"length" + number, fit.lengths[k], fit.lengths_error[k], true, "m"});
  }
  out.rms = fit.rms;
  out.held_out_error = fit.held_out_rms;
  out.error_unit = "N";
  return out;
}

}  // namespace

StandData loadStand(const std::vector<std::string>& paths) {
  StandData out;
  for (const std::string& path : paths) {
    const io::DataSet data = io::loadDataSet(path);
    const bool in_pascals = data.find("pressure_kpa") < 0 && data.find("pressure_pa") >= 0;
    const char* const pressure = in_pascals ? "pressure_pa" : "pressure_kpa";
    io::requireColumns(data, {pressure, "length_m", "force_n"},
                       "readings of a testing machine: pressure_kpa, length_m, force_n");
    estimation::StandRun run{path, {}};
    for (Eigen::Index row = 0; row < data.values.rows(); ++row) {
      run.readings.push_back({(in_pascals ? 1.0 : 1e3) * data.values(row, data.find(pressure)),
                              data.values(row, data.find("length_m")),
                              data.values(row, data.find("force_n"))});
    }
    out.sources.push_back({path, data.sha256, static_cast<int>(data.values.rows())});
    out.runs.push_back(std::move(run));
  }
  if (const auto repeated = repeatedSource(out.sources)) throw io::DocumentError(*repeated);
  return out;
}

estimation::StandLaw standLawOf(const io::Scene& scene, const std::string& contraction) {
  const int i = actuatorOf(scene, contraction);
  basics::require(scene.model.load().has_value(), "scene ", scene.name,
                  " has no arm.stiffness.K_eps_n; expected one, or calibrate it to the stand");
  std::size_t section = 0;
  while (i >= scene.arm.firstActuator(static_cast<int>(section) + 1)) ++section;
  const statics::Load& load = *scene.model.load();
  return {scene.arm.actuator(i).contraction, load.K_eps[section],
          load.tables.empty() ? model::StiffnessTable{} : load.tables[section]};
}

StandOutcome calibrateStand(const std::string& path, const std::vector<io::Override>& overrides,
                            const std::string& contraction, int muscles, const StandData& data) {
  const io::Scene scene = io::loadScene(path, overrides);
  StandOutcome out;
  out.contraction = scene.arm.actuator(actuatorOf(scene, contraction)).curve;
  basics::require(curvesOf(scene.arm).size() == 1, "scene ", scene.name,
                  " has muscles with other contractions than ", out.contraction,
                  ", but one K_eps_n is of all; measure them, and write sections[].stiffness");
  out.fit = estimation::fitStand(data.runs, muscles);
  if (!out.fit.law) return out;
  estimation::StandRun all;
  for (const estimation::StandRun& run : data.runs) {
    all.readings.insert(all.readings.end(), run.readings.begin(), run.readings.end());
  }
  out.all = compareStand(*out.fit.law, all, muscles);
  io::SceneCalibration changes;
  changes.contractions.emplace_back(out.contraction, out.fit.contraction);
  changes.K_eps = out.fit.law->K_eps;
  changes.K_eps_table = out.fit.law->table;
  changes.provenance = with(out.fit, provenanceOf(path, overrides, scene.sha256, data.sources));
  out.scene_text = io::calibratedSceneText(path, overrides, changes, scene.sha256);
  return out;
}

}  // namespace helix_arm::procedures
