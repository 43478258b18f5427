#include "helix_arm/io/pressure_history.hpp"

#include <utility>

#include "helix_arm/io/fault_list.hpp"

namespace helix_arm::io {

model::InputHistory historyOf(const DataSet& data, int actuators) {
  return historyOf(data, pressuresOf(data, actuators));
}

model::InputHistory historyOf(const DataSet& data, Eigen::MatrixXd pressure) {
  model::InputHistory history;
  history.input = std::move(pressure);
  const int time = data.find("time_s"), trial = data.find("trial");
  FaultList faults(data.path);
  for (Eigen::Index row = 0; row < data.values.rows(); ++row) {
    const bool first =
        row == 0 || (trial >= 0 && data.values(row, trial) != data.values(row - 1, trial));
    history.starts_anew.push_back(first);
    if (time < 0) continue;
    history.time.push_back(data.values(row, time));
    if (first || data.values(row, time) >= data.values(row - 1, time)) continue;
    faults.add(data.lines[static_cast<std::size_t>(row)],
               "time_s goes back; expected times that do not fall, or another trial");
  }
  faults.throwIfAny();
  return history;
}

}  // namespace helix_arm::io
