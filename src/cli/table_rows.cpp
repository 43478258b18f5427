#include "table_rows.hpp"

#include <iostream>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "command.hpp"

namespace helix_arm::cli {

io::DataSet tableOf(const std::string& path) {
  return path == "-" ? io::readDataSet(std::cin, "stdin") : io::loadDataSet(path);
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
  for (int i = 1; i <= arm.actuatorCount(); ++i) names.push_back("input_" + std::to_string(i));
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
  return inputs;
}

}  // namespace helix_arm::cli
