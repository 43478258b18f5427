#include "effective_pressures.hpp"

#include <sstream>

#include "measurements.hpp"

namespace helix_arm::cli {
namespace {

Eigen::VectorXd halfWidths(const model::Arm& arm) {
  Eigen::VectorXd out(arm.actuatorCount());
  for (int i = 0; i < out.size(); ++i) out[i] = arm.actuator(i).response.halfWidth();
  return out;
}

}  // namespace

model::InputHistory historyOfFile(const io::Scene& scene, const std::string& path) {
  requirePressureDriven(scene);
  return io::historyOf(io::loadDataSet(path), scene.arm.actuatorCount());
}

std::string noteOnResponse(const model::Arm& arm) {
  if (model::ArmResponse(arm).instant()) return {};
  std::ostringstream note;
  note << "at rest, with every effective pressure the pressure itself";
  const double widest = halfWidths(arm).maxCoeff();
  if (widest > 0) {
    note << ": the middle of hysteresis loops of up to +-" << 1e-3 * widest << " kPa";
  }
  return note.str();
}

void addResponse(const model::Arm& arm, const model::ArmResponse& response, Eigen::Index rows,
                 nlohmann::json& result) {
  if (response.instant()) return;
  nlohmann::json& out = result["response"];
  out["history_rows"] = rows;
  out["memory_known"] = rows > 0 && response.known();
  out["half_width_pa"] = toJson(halfWidths(arm));
  out["uncertainty_pa"] = toJson(response.uncertainty());
  out["note"] = rows > 0 ? nlohmann::json() : nlohmann::json(noteOnResponse(arm));
}

}  // namespace helix_arm::cli
