#include "helix_arm/statics/workspace.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "helix_arm/basics/fraction.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/batch.hpp"

namespace helix_arm::statics {
namespace {

// Sizes of pieces: about 20 ns per point in closed form, up to 0.1 s with sensitivity by the exact
// tier.
constexpr int kBatchPiece = 16384;
constexpr int kClosedFormPiece = 256;
constexpr int kLoadedPiece = 64;
constexpr int kLoadedSensitivityPiece = 8;
constexpr int kExactPiece = 4;
constexpr int kExactSensitivityPiece = 1;

constexpr double kKilopascal = 1e3;   // [Pa]
constexpr double kMillimetre = 1e-3;  // [m]
constexpr double kOnePercentMore = 1.01;

// SplitMix64 (Steele, Lea, Flood 2014): every number of its sequence can be computed directly.
constexpr std::uint64_t kGoldenGamma = 0x9e3779b97f4a7c15;
std::uint64_t mixed(std::uint64_t z) {
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
  z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
  return z ^ (z >> 31);
}

// The models, by the same tier, with each entry of K in turn 1 % larger.
std::vector<ArmModel> stifferModels(const ArmModel& model) {
  const TierSetting& setting = model.choice().setting;
  std::vector<ArmModel> out;
  const model::Stiffness factors[] = {
      {kOnePercentMore, 1.0, 1.0}, {1.0, kOnePercentMore, 1.0}, {1.0, 1.0, kOnePercentMore}};
  for (const model::Stiffness& factor : factors) {
    std::optional<model::PlanarArm> planar;
    if (model.planar()) planar = model.planar()->scaledStiffness(factor);
    out.emplace_back(model.arm().scaledStiffness(factor), std::move(planar), model.load(), setting);
  }
  if (model.load() && !model.load()->empty()) {
    Load load = *model.load();
    for (double& K_eps : load.K_eps) K_eps *= kOnePercentMore;
    out.emplace_back(model.arm(), model.planar(), std::move(load), setting);
  }
  return out;
}

}  // namespace

Workspace::Workspace(const ArmModel& model, const WorkspaceOptions& options)
    : model_(model), options_(options) {
  batch_ = !takesLoad(model_.choice().setting.tier);
  if (!options_.sensitivity) return;
  for (int i = 0; i < model_.arm().actuatorCount(); ++i) {
    const model::Actuator& actuator = model_.arm().actuator(i);
    basics::require(model::isPressure(actuator.drive), "sensitivity: it is per kPa, and ",
                    actuator.name, " is a tendon; leave it out");
  }
  stiffer_ = stifferModels(model_);
}

int Workspace::pieceSize() const {
  const bool sensitivity = options_.sensitivity;
  if (batch_) return sensitivity ? kClosedFormPiece : kBatchPiece;
  if (model_.choice().setting.tier == Tier::kExact) {
    return sensitivity ? kExactSensitivityPiece : kExactPiece;
  }
  return sensitivity ? kLoadedSensitivityPiece : kLoadedPiece;
}

Eigen::MatrixXd Workspace::drawInputs(std::uint64_t first, int count) const {
  const int n = model_.arm().actuatorCount();
  const std::uint64_t start = mixed(options_.seed + kGoldenGamma);
  Eigen::MatrixXd inputs(count, n);
  for (int i = 0; i < n; ++i) {
    const model::Range& limits = model_.arm().actuator(i).limits;
    for (int row = 0; row < count; ++row) {
      const std::uint64_t place = (first + row) * n + i + 1;
      const double fraction = basics::fractionOf(mixed(start + place * kGoldenGamma));
      // Rounding may exceed the limit.
      inputs(row, i) =
          std::min(limits.lower + fraction * (limits.upper - limits.lower), limits.upper);
    }
  }
  return inputs;
}

Eigen::RowVector3d Workspace::sensitivityAt(const Eigen::VectorXd& q,
                                            const Eigen::Vector3d& tip) const {
  const model::Arm& arm = model_.arm();
  const TipResponse response = model_.tipResponse(arm.lengths(q));
  // Without a derivative, nothing bounds it.
  if (response.status != SolveStatus::kConverged) {
    return Eigen::RowVector3d::Constant(std::numeric_limits<double>::infinity());
  }
  // Not rotated to the base frame, which would not change their lengths.
  const auto moves = response.by_lengths.topRows<3>().eval();
  double pressure = 0.0, stiffness = 0.0;
  for (int i = 0; i < q.size(); ++i) {
    pressure += (arm.actuator(i).contraction.slopeInside(q[i]) * moves.col(i)).squaredNorm();
  }
  for (const ArmModel& model : stiffer_) {
    const Tip found = model.tip(q);
    if (!found.converged()) stiffness = std::numeric_limits<double>::infinity();
    stiffness += (found.tip.translation - tip).squaredNorm();
  }
  return {kKilopascal * std::sqrt(pressure), kMillimetre * moves.norm(), std::sqrt(stiffness)};
}

void Workspace::sampleBatch(std::uint64_t first, int count, WorkspacePoints& out) const {
  out.inputs = drawInputs(first, count);
  out.tips.resize(count, 3);
  std::vector<const double*> columns;
  for (int i = 0; i < out.inputs.cols(); ++i) columns.push_back(out.inputs.col(i).data());
  model::batchTips(model_.arm(), columns.data(), static_cast<std::size_t>(count),
                   out.tips.col(0).data(), out.tips.col(1).data(), out.tips.col(2).data());
}

WorkspacePoints Workspace::sample(std::uint64_t first, int count) const {
  WorkspacePoints out;
  if (batch_) {
    sampleBatch(first, count, out);
    if (!options_.sensitivity) return out;
  } else {
    out.inputs = drawInputs(first, count);
    out.tips.resize(count, 3);
  }
  if (options_.sensitivity) out.sensitivity.resize(count, kSensitivities);
  int kept = 0;
  for (int row = 0; row < count; ++row) {
    const Eigen::VectorXd q = out.inputs.row(row);
    Eigen::Vector3d tip = out.tips.row(row);
    if (!batch_) {
      const Tip found = model_.tip(q);
      if (!found.converged()) continue;
      tip = found.tip.translation;
    }
    if (options_.sensitivity) {
      const Eigen::RowVector3d sensitivity = sensitivityAt(q, tip);
      if (!sensitivity.allFinite()) continue;
      out.sensitivity.row(kept) = sensitivity;
    }
    out.inputs.row(kept) = q;
    out.tips.row(kept) = tip;
    ++kept;
  }
  out.unbalanced = count - kept;
  out.inputs.conservativeResize(kept, Eigen::NoChange);
  out.tips.conservativeResize(kept, Eigen::NoChange);
  if (options_.sensitivity) out.sensitivity.conservativeResize(kept, Eigen::NoChange);
  return out;
}

}  // namespace helix_arm::statics
