#include "helix_arm/statics/jacobian.hpp"

#include <limits>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "helix_arm/statics/unloaded_change.hpp"
#include "statics/loaded/buckling.hpp"
#include "statics/loaded/gauss_rule.hpp"
#include "statics/loaded/shape_motion.hpp"

namespace helix_arm::statics {
namespace {

using lie::SE3;
using lie::Vector6;
using Change = ActuatorChange<SE3>;

constexpr int kEntries = Change::kEntries;

ShapeDerivative columnsOf(const ShapeDerivative& from, const std::vector<int>& columns) {
  return {from.tip(Eigen::all, columns), from.twists(Eigen::all, columns)};
}

// Pose of the tip seen from the end of each section.
std::vector<SE3> tipSeenFromEnds(const model::Arm& arm, const model::Twists& twists) {
  std::vector<SE3> out(static_cast<std::size_t>(arm.sectionCount()));
  SE3 beyond;
  for (int k = arm.sectionCount() - 1; k >= 0; --k) {
    beyond = arm.link(k) * beyond;
    out[static_cast<std::size_t>(k)] = beyond;
    beyond = SE3::exp(twists.col(k)) * beyond;
  }
  return out;
}

// Each point of a section strains by C Ad_Y^-T F under a wrench F at the tip, seen from the tip;
// Y is the tip seen from that point. Section by section, in the pieces of a loaded arm's shape. For
// sections of constant twist and one stiffness: to rounding, and in a third of the time of
// loadedResponse(), which order kMostOrder leaves with errors of 3e-7.
ShapeDerivative byTipLoad(const model::Arm& arm, const Load& load, const model::Twists& twists) {
  constexpr int kNodes = 16;  // more turns per piece than any arm has
  const GaussRule& rule = GaussRule::of(kNodes);
  ShapeDerivative out = constantDerivative(arm.sectionCount(), 6, 0.0);
  const double step = 1.0 / kLoadedPieces;
  const std::vector<SE3> ends = tipSeenFromEnds(arm, twists);
  const SE3 tip_here = SE3::exp(twists.col(0)) * ends[0];
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const lie::Matrix6 compliance = complianceOf(arm, load, k);
    const Vector6 g = twists.col(k);
    for (int piece = 0; piece < kLoadedPieces; ++piece) {
      const SE3 beyond =
          SE3::exp((1.0 - step * (piece + 1)) * g) * ends[static_cast<std::size_t>(k)];
      lie::Matrix6 motion = lie::Matrix6::Zero();  // of the piece's end, seen from there
      for (int node = 0; node < kNodes; ++node) {
        const double rest = step * (1.0 - rule.nodes()[node]);  // of the piece, beyond the node
        const SE3 end = SE3::exp(rest * g), tip = end * beyond;
        // A wrench seen from the tip, seen from the node.
        const lie::Matrix6 wrench = tip.inverse().adjoint().transpose();
        motion += step * rule.weights()[node] * end.inverse().adjoint() * compliance * wrench;
      }
      for (int j = 0; j < 6; ++j) {
        out.twists.block<6, 1>(6 * k, j) +=
            SE3::solveRightJacobian(step * g, Vector6(motion.col(j)));
      }
      out.tip += beyond.inverse().adjoint() * motion;
    }
  }
  // Force and moment are given in the base frame.
  lie::Matrix6 turned = lie::Matrix6::Zero();
  turned.topLeftCorner<3, 3>() = turned.bottomRightCorner<3, 3>() = tip_here.rotation.transpose();
  out.tip = (turned.transpose() * out.tip * turned).eval();
  out.twists = (out.twists * turned).eval();
  return out;
}

// The shape has no derivative by these entries of the stiffness.
void markJumps(const model::Arm& arm, const Change& change, ShapeDerivative& by_stiffness) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    for (int component = 0; component < kEntries; ++component) {
      if (!change.jumps(i, component)) continue;
      by_stiffness.tip.col(kEntries * i + component).setConstant(kNan);
      by_stiffness.twists.col(kEntries * i + component).setConstant(kNan);
    }
  }
}

// Without load: the tip, and the derivatives by parameters that change one section each.
// @param byPiece  (6 x parameters of section k) derivatives of the twist of its piece j.
template <class ByPiece>
std::pair<SE3, ShapeDerivative> unloadedDerivative(const model::Arm& arm,
                                                   const model::Unloaded& unloaded,
                                                   int per_actuator, const ByPiece& byPiece) {
  ShapeDerivative out =
      constantDerivative(arm.sectionCount(), per_actuator * arm.actuatorCount(), 0.0);
  const model::PiecesOf<SE3> pieces = arm.pieces(unloaded);
  const int per_section = arm.piecesPerSection();
  SE3 X;
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const int first = per_actuator * arm.firstActuator(k);
    for (int j = 0; j < per_section; ++j) {
      const Vector6 g = pieces.col(k * per_section + j);
      const lie::Matrix6 motion = X.adjoint() * SE3::leftJacobian(g);
      const auto by = byPiece(k, j);
      for (int column = 0; column < by.cols(); ++column) {
        out.tip.col(first + column) += motion * by.col(column);
        out.twists.block<6, 1>(6 * k, first + column) += by.col(column);
      }
      X = X * SE3::exp(g);
    }
    X = X * arm.link(k);
  }
  out.tip = velocitiesOf(X, out.tip);
  return {X, std::move(out)};
}

// By the entries of the stiffness, without load. @param unloaded  at these lengths.
ShapeDerivative unloadedByStiffness(const model::Arm& arm, const model::Unloaded& unloaded,
                                    const Eigen::VectorXd& lengths) {
  const Change change(arm, nullptr, lengths, Change::By::kLengthsAndStiffness);
  const int per_section = arm.piecesPerSection();
  std::optional<model::TaperTwist<SE3>> profile;
  const auto byPiece = [&](int k, int j) -> Motions {
    const int first = arm.firstActuator(k), count = arm.firstActuator(k + 1) - first;
    if (!arm.taper(k)) return change.twist(k, 0.0).rightCols(kEntries * count) / per_section;
    if (j == 0) profile.emplace(*arm.taper(k), lengths.segment(first, count));
    const double from = static_cast<double>(j) / per_section, to = (j + 1.0) / per_section;
    return taperStep(*profile, change, k, from, to).by.rightCols(kEntries * count);
  };
  ShapeDerivative out = unloadedDerivative(arm, unloaded, kEntries, byPiece).second;
  markJumps(arm, change, out);
  return out;
}

// By the parameters of a change and, on request, a load at the tip, at the equilibrium of a tier.
ShapeResponse loadedResponse(const model::Arm& arm, const Load& load, const TierSetting& setting,
                             const Eigen::VectorXd& lengths, const Change& change, bool by_load) {
  const model::Unloaded unloaded = unloadedUnderOfLengths(arm, load, lengths);
  // In space, even if the arm stays in its plane: the tip's load may leave it.
  return setting.tier == Tier::kExact
             ? ExactArm(arm, load).differentiate(unloaded, change, by_load)
             : LoadedArm(arm, load, setting.order).differentiate(unloaded, change, by_load);
}

// The stiffness alone.
Load withoutForces(const Load& load) {
  Load out;
  out.mass.assign(load.mass.size(), 0.0);
  out.K_eps = load.K_eps;
  out.tables = load.tables;
  return out;
}

ShapeDerivative byLoad(const ShapeResponse& response) {
  return {response.by.tip.rightCols<6>(), response.by.twists.rightCols<6>()};
}

ShapeJacobian loadedJacobian(const ArmModel& model, const Eigen::VectorXd& lengths,
                             const JacobianParts& wanted) {
  const model::Arm& arm = model.arm();
  const Load& load = *model.load();
  const Change change(
      arm, &load, lengths,
      wanted.by_stiffness ? Change::By::kLengthsAndStiffness : Change::By::kLengths);
  const ShapeResponse found =
      loadedResponse(arm, load, model.choice().setting, lengths, change, wanted.by_load);
  ShapeJacobian out;
  out.status = found.at.status;
  out.tip = found.at.tip;
  out.twists = found.at.shape.twists();
  std::vector<int> of_lengths, of_stiffness;
  for (int k = 0; k < arm.sectionCount(); ++k) {
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      of_lengths.push_back(change.lengthColumn(k, i));
      for (int component = 0; component < kEntries; ++component) {
        of_stiffness.push_back(change.stiffnessColumn(k, i, component));
      }
    }
  }
  out.by_lengths = columnsOf(found.by, of_lengths);
  if (wanted.by_stiffness) {
    out.by_stiffness = columnsOf(found.by, of_stiffness);
    markJumps(arm, change, *out.by_stiffness);
  }
  if (wanted.by_load) out.by_load = byLoad(found);
  return out;
}

// Jacobian of the tiers that take no load.
ShapeJacobian unloadedJacobian(const ArmModel& model, const model::InputRef& q,
                               const JacobianParts& wanted) {
  const model::Arm& arm = model.arm();
  const std::optional<Load>& load = model.load();
  const model::Unloaded unloaded = arm.unloaded(q);
  ShapeJacobian out;
  out.twists = unloaded.twists;
  std::tie(out.tip, out.by_lengths) = unloadedDerivative(
      arm, unloaded, 1, [&](int k, int j) { return arm.pieceByLengths(k, j, unloaded); });
  if (wanted.by_stiffness) out.by_stiffness = unloadedByStiffness(arm, unloaded, arm.lengths(q));
  if (!wanted.by_load || !load) return out;
  if (arm.isLinear() && load->tables.empty()) {
    out.by_load = byTipLoad(arm, *load, out.twists);
    return out;
  }
  const Load none = withoutForces(*load);
  const Eigen::VectorXd lengths = arm.lengths(q);
  const Change change(arm, &none, lengths, Change::By::kLengths);
  const ShapeResponse at_rest =
      loadedResponse(arm, none, {Tier::kLoaded, kMostOrder}, lengths, change, /*by_load=*/true);
  out.status = at_rest.at.status;
  out.by_load = byLoad(at_rest);
  return out;
}

}  // namespace

ShapeJacobian jacobianAt(const ArmModel& model, const model::InputRef& q,
                         const JacobianParts& wanted) {
  const model::Arm& arm = model.arm();
  ShapeJacobian out = takesLoad(model.choice().setting.tier)
                          ? loadedJacobian(model, arm.lengths(q), wanted)
                          : unloadedJacobian(model, q, wanted);
  out.by_inputs = out.by_lengths;
  for (int i = 0; i < q.size(); ++i) {
    const double slope = arm.actuator(i).contraction.slopeInside(q[i]);
    out.by_inputs.tip.col(i) *= slope;
    out.by_inputs.twists.col(i) *= slope;
  }
  return out;
}

}  // namespace helix_arm::statics
