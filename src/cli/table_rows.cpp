#include "table_rows.hpp"

#include <iostream>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "command.hpp"

namespace helix_arm::cli {

namespace {

// What forward and inverse print besides numbers, so that each reads what the other printed.
const std::vector<std::string> kPrinted = {"tier",      "order",         "status",
                                           "converged", "active_limits", "tip_error_percent"};

}  // namespace

io::DataSet tableOf(const std::string& path) {
  return path == "-" ? io::readDataSet(std::cin, "stdin", kPrinted)
                     : io::loadDataSet(path, kPrinted);
}

std::vector<std::string> poseColumns(const io::DataSet& data) {
  const bool printed = data.find("x_m") < 0 && data.find("tip_x_m") >= 0;
  const std::string prefix = printed ? "tip_" : "";
  std::vector<std::string> names;
  for (const char* name : {"x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"}) {
    if (names.size() < 3 || data.find(prefix + "qx") >= 0) names.push_back(prefix + name);
  }
  return names;
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

}  // namespace helix_arm::cli
