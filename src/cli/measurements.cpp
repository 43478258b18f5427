#include "measurements.hpp"

#include <iostream>

#include "basics/text.hpp"
#include "command.hpp"
#include "helix_arm/model/curve.hpp"
#include "io/document/number.hpp"

namespace helix_arm::cli {
namespace {

// Columns that forward and inverse print besides numbers, so that each reads what the other
// printed.
const std::vector<std::string> kPrinted = {"tier",      "order",         "status",
                                           "converged", "active_limits", "tip_error_percent"};

Eigen::VectorXd halfWidths(const model::Arm& arm) {
  Eigen::VectorXd out(arm.actuatorCount());
  for (int i = 0; i < out.size(); ++i) out[i] = arm.actuator(i).response.halfWidth();
  return out;
}

}  // namespace

void requirePressureDriven(const io::Scene& scene) {
  refuseIf(hasTendon(scene.arm), "scene ", scene.name,
           " has tendons, but the data set gives pressures; expected a scene whose "
           "actuators are all driven by pressure");
}

std::string reasonForNoShape(statics::SolveStatus status) {
  if (status == statics::SolveStatus::kUnsupported) {
    return "the load pulls along a motion that no actuator resists";
  }
  if (status == statics::SolveStatus::kSnapped) {
    return "the shapes that grow from the unloaded one end at a smaller load, and the arm may snap "
           "to several others; lower the load, or raise arm.stiffness.K_eps_n";
  }
  return "no shape that balances the load was found within the error that the tier states; less "
         "load, a higher order or tier: exact may help";
}

std::string noteOnStart(const statics::Solution& solution) {
  if (solution.converged()) return {};
  return "the search began at the shape without load: " + reasonForNoShape(solution.status);
}

lie::SE3 measuredTip(const estimation::TwistFit& fit) {
  return fit.X_B0B * model::tipPose(fit.shape);
}

std::string whyUndetermined(const io::Scene& scene, const std::vector<int>& tags, int needed) {
  std::vector<int> counts(scene.looks.size());
  for (const int tag : tags) ++counts[scene.tags->tags[tag].section];
  std::string lacking;
  for (std::size_t k = 0; k < counts.size(); ++k) {
    if (counts[k] >= needed) continue;
    lacking += (lacking.empty() ? "" : ", ") + ("section " + scene.looks[k].name) + " has " +
               std::to_string(counts[k]) + (counts[k] == 1 ? " tag" : " tags") + " in sight";
  }
  if (!lacking.empty()) return lacking + "; expected at least " + std::to_string(needed);
  return "the visible tags do not determine the arm's shape; place tags farther apart and on "
         "different sides of the arm";
}

void addPressures(CLI::App& command, procedures::RecordedPressures& pressures) {
  addOption(command, "--pressures", pressures.path,
            "table with time_s and pressure_1_kpa .., for a recording of bodies without pressures",
            TypeName{"FILE"});
  command
      .add_option_function<std::string>(
          "--offset-s",
          [&pressures](const std::string& text) {
            pressures.offset = io::parseNumber(text);
            if (!pressures.offset && text != "auto") {
              throw CLI::ValidationError("--offset-s", "expected a number of seconds, or auto");
            }
          },
          "what is added to the times of the pressures [s]; auto: found, as pressures and bodies "
          "change together. Default 0")
      ->type_name("S");
}

json missingColumns(const io::Scene& scene, const io::DataSet& data) {
  const int actuators = scene.arm.actuatorCount();
  const std::string warning = io::missingText(data, actuators);
  if (warning.empty()) return json::array();
  std::cerr << "warning: " << warning << "\n";
  return io::missingPressures(data, actuators);
}

model::InputHistory historyOfFile(const io::Scene& scene, const std::string& path) {
  requirePressureDriven(scene);
  const io::DataSet data = io::loadDataSet(path);
  missingColumns(scene, data);
  return io::historyOf(data, scene.arm.actuatorCount());
}

std::string noteOnResponse(const model::Arm& arm) {
  if (model::ArmResponse(arm).instant()) return {};
  const double widest = halfWidths(arm).maxCoeff(), rest = model::ArmResponse(arm).restTime();
  return "at rest, " + (rest > 0 ? basics::format("which takes %g s, ", rest) : "") +
         "with every effective pressure the pressure itself" +
         (widest > 0
              ? basics::format(": the middle of hysteresis loops of up to +-%g kPa", 1e-3 * widest)
              : "");
}

void addResponse(const model::Arm& arm, const model::ArmResponse& response, Eigen::Index rows,
                 json& result) {
  if (response.instant()) return;
  json& out = result["response"];
  out["history_rows"] = rows;
  out["memory_known"] = rows > 0 && response.known();
  out["half_width_pa"] = halfWidths(arm);
  if (const double rest = response.restTime(); rest > 0) out["rest_time_s"] = rest;
  out["uncertainty_pa"] = response.uncertainty(arm);
  out["note"] = rows > 0 ? json() : json(noteOnResponse(arm));
}

io::DataSet tableOf(const std::string& path) {
  return path == "-" ? io::readDataSet(std::cin, "stdin", kPrinted)
                     : io::loadDataSet(path, kPrinted);
}

Eigen::MatrixXd inputRowsOf(const io::Scene& scene, const io::DataSet& data) {
  const model::Arm& arm = scene.arm;
  std::vector<std::string> names;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const model::DriveUnit unit = model::unitOf(arm.actuator(i).drive);
    const std::string number = std::to_string(i + 1);
    names.push_back("input_" + number);
    const std::string printed = std::string(unit.quantity) + "_" + number + "_" + unit.si_suffix;
    if (hasTendon(arm) && data.find(printed) >= 0) names.back() = printed;
  }
  const bool in_si = hasTendon(arm) || data.find(names.front()) >= 0;
  if (!in_si) missingColumns(scene, data);
  Eigen::MatrixXd inputs =
      in_si ? columnsOf(data, names) : io::pressuresOf(data, arm.actuatorCount());
  for (Eigen::Index row = 0; row < inputs.rows(); ++row) {
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      const model::Actuator& actuator = arm.actuator(i);
      if (actuator.limits.contains(inputs(row, i))) continue;
      throw CallerError(data.path + ":" +
                        std::to_string(data.lines[static_cast<std::size_t>(row)]) +
                        " is beyond the limits of " + actuator.name + ": " +
                        inputText(actuator, actuator.limits.lower) + " to " +
                        inputText(actuator, actuator.limits.upper));
    }
  }
  if (in_si || data.find("pressure_1_pa") >= 0) warnOfKilopascals(data.path, arm, inputs);
  return inputs;
}

Eigen::MatrixXd columnsOf(const io::DataSet& data, const std::vector<std::string>& names) {
  Eigen::MatrixXd out(data.values.rows(), static_cast<Eigen::Index>(names.size()));
  std::string missing;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const int column = data.find(names[i]);
    if (column < 0) {
      missing += (missing.empty() ? "" : ", ") + names[i];
    } else {
      out.col(static_cast<Eigen::Index>(i)) = data.values.col(column);
    }
  }
  if (!missing.empty()) throw CallerError(data.path + " has no column " + missing);
  return out;
}

}  // namespace helix_arm::cli
