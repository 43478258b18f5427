#include "tier_solver.hpp"

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "helix_arm/statics/unloaded_change.hpp"
#include "statics/loaded/shape_motion.hpp"

namespace helix_arm::statics {
namespace {

// Up to as many, differences of tips that start at the solution take less time than the linear
// equations of their derivative (loaded_benchmark); of the lowest order, for any number.
constexpr int kFewActuators = 5;

// The maps of all sections (dof * sections x n): derivatives of the twists by each free length.
template <class Group>
Eigen::MatrixXd mapOf(const model::ArmOf<Group>& arm) {
  Eigen::MatrixXd map =
      Eigen::MatrixXd::Zero(Group::kDof * arm.sectionCount(), arm.actuatorCount());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const auto& block = arm.equilibrium(k).map;
    map.block(Group::kDof * k, arm.firstActuator(k), Group::kDof, block.cols()) = block;
  }
  return map;
}

template <class Group>
Eigen::Matrix<double, Group::kDof, Eigen::Dynamic> linearResponse(
    const model::ArmOf<Group>& arm, const model::UnloadedOf<Group>& unloaded) {
  Eigen::Matrix<double, Group::kDof, Eigen::Dynamic> out(Group::kDof, arm.actuatorCount());
  const auto take = [&out](int i, const auto& motion) { out.col(i) = motion; };
  if (arm.tapered()) {
    forTipMotionsOfPieces(arm, unloaded, take);
  } else {
    forTipMotions(arm, unloaded.twists, take);
  }
  return out;
}

template <class Group>
ActuatorChange<Group> byLengths(const model::ArmOf<Group>& arm, const Load* load,
                                const Eigen::VectorXd& lengths) {
  return {arm, load, lengths, ActuatorChange<Group>::By::kLengths};
}

}  // namespace

TierSolver::TierSolver(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
                       const std::optional<Load>& load, const TierSetting& setting)
    : arm_(arm),
      plane_(nullptr),
      load_(takesLoad(setting.tier) ? &*load : nullptr),
      differs_(setting.tier == Tier::kLoaded && !arm.tapered() && load->tables.empty() &&
               (setting.order == kLeastOrder || arm.actuatorCount() <= kFewActuators)) {
  switch (setting.tier) {
    case Tier::kPlanar:
      plane_ = &*planar;
      break;
    case Tier::kLinear:
      break;
    case Tier::kLoaded:
      if (planar && staysInPlane(arm, *load)) {
        plane_ = &*planar;
        planar_loaded_.emplace(*planar, *load, setting.order);
      } else {
        loaded_.emplace(arm, *load, setting.order);
      }
      break;
    case Tier::kExact:
      exact_.emplace(arm, *load);
      break;
  }
}

model::Shape TierSolver::embeddedShape(const model::UnloadedOf<lie::SE2>& unloaded) const {
  if (!plane_->tapered()) return model::shapeOf(arm_, model::embed(unloaded.twists));
  const model::PiecesOf<lie::SE2> flat = plane_->pieces(unloaded);
  model::Shape::Pieces pieces(6, flat.cols());
  for (int j = 0; j < flat.cols(); ++j) {
    pieces.col(j) = lie::embed(lie::SE2::Tangent(flat.col(j)));
  }
  return {pieces, plane_->piecesPerSection(), arm_.links()};
}

template <class Group>
model::UnloadedOf<Group> TierSolver::unloadedAt(const model::ArmOf<Group>& arm,
                                                const model::InputRef& q) const {
  return load_ != nullptr ? unloadedUnder(arm, *load_, q) : arm.unloaded(q);
}
template <class Group>
model::UnloadedOf<Group> TierSolver::unloadedOfLengths(const model::ArmOf<Group>& arm,
                                                       const Eigen::VectorXd& lengths) const {
  return load_ != nullptr ? unloadedUnderOfLengths(arm, *load_, lengths)
                          : arm.unloadedOfLengths(lengths);
}

template <class Unloaded>
Solution TierSolver::solveFrom(const Unloaded& unloaded) const {
  if (planar_loaded_) return planar_loaded_->solve(unloaded(*plane_));
  if (loaded_) return loaded_->solve(unloaded(arm_));
  if (exact_) return exact_->solve(unloaded(arm_));
  Solution solution;
  solution.shape =
      plane_ != nullptr ? embeddedShape(unloaded(*plane_)) : model::shapeOf(arm_, unloaded(arm_));
  solution.tip = model::tipPose(solution.shape);
  return solution;
}

template <class Unloaded, class Direct>
Tip TierSolver::tipFrom(const Unloaded& unloaded, const Direct& direct) const {
  if (loaded_) return loaded_->tip(unloaded(arm_));
  if (planar_loaded_) {
    const TipOf<lie::SE2> found = planar_loaded_->tip(unloaded(*plane_));
    return {lie::embed(found.tip), found.status, found.residual, found.iterations,
            found.load_steps};
  }
  if (exact_) {
    const Solution found = exact_->solve(unloaded(arm_));
    return {found.tip, found.status, found.residual, found.iterations, found.load_steps};
  }
  Tip found;
  found.tip = plane_ != nullptr ? lie::embed(direct(*plane_)) : direct(arm_);
  return found;
}

Solution TierSolver::solve(const Eigen::VectorXd& lengths) const {
  return solveFrom([&](const auto& arm) { return unloadedOfLengths(arm, lengths); });
}
Solution TierSolver::solveInputs(const model::InputRef& q) const {
  return solveFrom([&](const auto& arm) { return unloadedAt(arm, q); });
}
Tip TierSolver::tip(const Eigen::VectorXd& lengths) const {
  return tipFrom([&](const auto& arm) { return unloadedOfLengths(arm, lengths); },
                 [&](const auto& arm) { return arm.tipOfLengths(lengths); });
}
Tip TierSolver::tipOfInputs(const model::InputRef& q) const {
  return tipFrom([&](const auto& arm) { return unloadedAt(arm, q); },
                 [&](const auto& arm) { return arm.tip(q); });
}

std::vector<model::CurvePoint<lie::SE3>> TierSolver::curve(const model::InputRef& q,
                                                           int count) const {
  if (planar_loaded_) return planar_loaded_->curve(unloadedAt(*plane_, q), count);
  if (loaded_) return loaded_->curve(unloadedAt(arm_, q), count);
  if (exact_) return exact_->curve(unloadedAt(arm_, q), count);
  return model::sampleCurve(solveInputs(q).shape, count);
}

TipResponse TierSolver::tipResponse(const Eigen::VectorXd& lengths) const {
  const auto respond = [&](const auto& tier, const auto& arm) {
    return differs_ ? tier.tipByUnloaded(arm.twistsOfLengths(lengths), mapOf(arm))
                    : tier.tipBy(unloadedOfLengths(arm, lengths), byLengths(arm, load_, lengths));
  };
  if (loaded_) {
    const auto found = respond(*loaded_, arm_);
    return {found.at.tip, found.at.status, found.by};
  }
  if (planar_loaded_) {
    const auto found = respond(*planar_loaded_, *plane_);
    return {lie::embed(found.at.tip), found.at.status, motionsInSpace(found.by)};
  }
  if (exact_) {
    const ShapeResponse found = exact_->differentiate(unloadedOfLengths(arm_, lengths),
                                                      byLengths(arm_, load_, lengths), false);
    const Motions& velocities = found.by.tip;
    TipResponse out{found.at.tip, found.at.status, velocities};
    // Velocities are seen from the base; motions of the body, from the tip.
    for (const int half : {0, 3}) {
      out.by_lengths.middleRows<3>(half) =
          found.at.tip.rotation.transpose() * velocities.middleRows<3>(half);
    }
    return out;
  }
  const auto linear = [&](const auto& arm) {
    return linearResponse(arm, arm.unloadedOfLengths(lengths));
  };
  return {tip(lengths).tip, SolveStatus::kConverged,
          plane_ != nullptr ? motionsInSpace(linear(*plane_)) : linear(arm_)};
}

}  // namespace helix_arm::statics
