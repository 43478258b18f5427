#include "helix_arm/statics/jacobian.hpp"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "gauss_rule.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "wrench.hpp"

namespace helix_arm::statics {
namespace {

using lie::SE3;
using lie::Vector6;

constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
constexpr int kStiffnessEntries = 3;
// A motion that costs less than this fraction of another one is free of cost.
constexpr double kFreeOfCost = 1e-9;

ShapeDerivative emptyDerivative(int sections, int columns, double value) {
  return {Eigen::MatrixXd::Constant(6, columns, value),
          Eigen::MatrixXd::Constant(6 * sections, columns, value)};
}

// Turns the columns from the tip's frame to that of the base.
void turnToBase(const SE3& tip, ShapeDerivative& derivative) {
  derivative.tip.topRows<3>() = (tip.rotation * derivative.tip.topRows<3>()).eval();
  derivative.tip.bottomRows<3>() = (tip.rotation * derivative.tip.bottomRows<3>()).eval();
}

// Pose of the tip seen from the end of each section, and the motion of the tip, in its own frame,
// by a change of that section's twist.
struct Chain {
  Chain(const model::Arm& arm, const model::Twists& twists)
      : after(static_cast<std::size_t>(arm.sectionCount())), by_twist(after.size()) {
    SE3 beyond;
    for (int k = arm.sectionCount() - 1; k >= 0; --k) {
      const auto at = static_cast<std::size_t>(k);
      if (arm.links()) beyond = arm.link(k) * beyond;
      after[at] = beyond;
      by_twist[at] = beyond.inverse().adjoint() * SE3::rightJacobian(twists.col(k));
      beyond = SE3::exp(twists.col(k)) * beyond;
    }
    tip = beyond;
  }
  std::vector<SE3> after;
  std::vector<lie::Matrix6> by_twist;
  SE3 tip;
};

ShapeDerivative byLengths(const model::Arm& arm, const Chain& chain) {
  ShapeDerivative out = emptyDerivative(arm.sectionCount(), arm.actuatorCount(), 0.0);
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const auto& map = arm.equilibrium(k).map;
    const int first = arm.firstActuator(k);
    out.twists.block(6 * k, first, 6, map.cols()) = map;
    out.tip.middleCols(first, map.cols()) = chain.by_twist[static_cast<std::size_t>(k)] * map;
  }
  turnToBase(chain.tip, out);
  return out;
}

// The entries of K that belong to one component of a stiffness, as a diagonal.
Vector6 entriesOf(int component) {
  model::Stiffness unit{0.0, 0.0, 0.0};
  (component == 0 ? unit.gamma : component == 1 ? unit.tau : unit.kappa) = 1.0;
  Vector6 out = unit.diagonal<SE3>();
  out[0] = 0.0;  // K is normalised by it
  return out;
}

bool costsNothing(const Eigen::MatrixXd& motions, double scale) {
  return motions.cols() == 0 || motions.cwiseAbs().maxCoeff() <= kFreeOfCost * scale;
}

// From A g = D l: A dg = sum Ad_i^-T dK_i (l_i e1 - Ad_i^-1 g), where A keeps its rank.
ShapeDerivative byStiffness(const model::Arm& arm, const Eigen::VectorXd& lengths,
                            const model::Twists& twists, const Chain& chain) {
  ShapeDerivative out =
      emptyDerivative(arm.sectionCount(), kStiffnessEntries * arm.actuatorCount(), 0.0);
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const auto& equilibrium = arm.equilibrium(k);
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      const lie::Matrix6 to_actuator = arm.actuator(i).X_O.inverse().adjoint();
      const Vector6 strain = lengths[i] * Vector6::Unit(0) - to_actuator * twists.col(k);
      const Eigen::MatrixXd free = to_actuator * equilibrium.null_space;
      for (int component = 0; component < kStiffnessEntries; ++component) {
        const Vector6 entries = entriesOf(component);
        const int column = kStiffnessEntries * i + component;
        const bool keeps_rank = costsNothing(entries.asDiagonal() * free, 1.0);
        const Vector6 change =
            keeps_rank ? Vector6(equilibrium.compliance *
                                 (to_actuator.transpose() * entries.cwiseProduct(strain)))
                       : Vector6(Vector6::Constant(kNoNumber));
        out.twists.block<6, 1>(6 * k, column) = change;
        out.tip.col(column) = chain.by_twist[static_cast<std::size_t>(k)] * change;
      }
    }
  }
  turnToBase(chain.tip, out);
  return out;
}

// Each point of a section strains by C Ad_Y^-T F under a wrench F at the tip, seen from the tip;
// Y is the tip seen from that point. Section by section, in the pieces of a loaded arm's shape.
ShapeDerivative byTipLoad(const model::Arm& arm, const Load& load, const model::Twists& twists,
                          const Chain& chain) {
  constexpr int kNodes = 16;  // more turns per piece than any arm has
  const GaussRule<kNodes>& rule = GaussRule<kNodes>::get();
  ShapeDerivative out = emptyDerivative(arm.sectionCount(), 6, 0.0);
  const double step = 1.0 / kLoadedPieces;
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const lie::Matrix6 compliance =
        arm.freeLength(k) / load.K_eps[static_cast<std::size_t>(k)] * arm.equilibrium(k).compliance;
    const Vector6 g = twists.col(k);
    for (int piece = 0; piece < kLoadedPieces; ++piece) {
      lie::Matrix6 motion = lie::Matrix6::Zero();  // of the piece's end, seen from there
      for (int node = 0; node < kNodes; ++node) {
        const double rest = step * (1.0 - rule.nodes()[node]);  // of the piece, beyond the node
        const SE3 end = SE3::exp(rest * g);
        const SE3 tip = end * SE3::exp((1.0 - step * (piece + 1)) * g) *
                        chain.after[static_cast<std::size_t>(k)];
        // A wrench seen from the tip, seen from the node.
        const lie::Matrix6 wrench = tip.inverse().adjoint().transpose();
        motion += step * rule.weights()[node] * end.inverse().adjoint() * compliance * wrench;
      }
      for (int j = 0; j < 6; ++j) {
        out.twists.block<6, 1>(6 * k, j) +=
            SE3::solveRightJacobian(step * g, Vector6(motion.col(j)));
      }
      const SE3 beyond =
          SE3::exp((1.0 - step * (piece + 1)) * g) * chain.after[static_cast<std::size_t>(k)];
      out.tip += beyond.inverse().adjoint() * motion;
    }
  }
  // Force and moment are given in the base frame.
  lie::Matrix6 turned = lie::Matrix6::Zero();
  turned.topLeftCorner<3, 3>() = turned.bottomRightCorner<3, 3>() = chain.tip.rotation.transpose();
  out.tip = (out.tip * turned).eval();
  out.twists = (out.twists * turned).eval();
  turnToBase(chain.tip, out);
  return out;
}

ShapeJacobian withoutLoad(const ArmModel& model, const model::InputRef& q) {
  const model::Arm& arm = model.arm();
  ShapeJacobian out;
  out.twists = arm.twists(q);
  const Chain chain(arm, out.twists);
  out.tip = chain.tip;
  out.by_lengths = byLengths(arm, chain);
  out.by_stiffness = byStiffness(arm, arm.lengths(q), out.twists, chain);
  if (model.load()) out.by_load = byTipLoad(arm, *model.load(), out.twists, chain);
  return out;
}

// ---- Under load, or tapered: differences of fourth order ---------------------------------------

// About the fifth root of a solution's error: of a section's angle [rad], and of the stiffness.
constexpr double kAngleStep = 1e-2;
constexpr double kStiffnessStep = 5e-3;
// A force that only stretches the arm strains it by less than what buckles a slender one.
constexpr double kStretchStep = 1e-3;

struct Term {
  double place, weight;
};
constexpr Term kCentral[] = {{-2.0, 1.0 / 12}, {-1.0, -2.0 / 3}, {1.0, 2.0 / 3}, {2.0, -1.0 / 12}};
// Of an entry that cannot be less.
constexpr Term kForward[] = {{1.0, 4.0}, {2.0, -3.0}, {3.0, 4.0 / 3}, {4.0, -0.25}};

class Differences {
 public:
  explicit Differences(const Solution& here) : here_(here) {}

  /// One column, from the solutions that are some steps away.
  template <std::size_t kTerms, class Changed>
  void take(const Term (&terms)[kTerms], double step, int column, const Changed& changed,
            ShapeDerivative& derivative) {
    Vector6 tip = Vector6::Zero();
    Eigen::VectorXd twists = Eigen::VectorXd::Zero(derivative.twists.rows());
    const model::Twists twists_here = here_.shape.twists();
    for (const Term& term : terms) {
      const Solution there = changed(term.place * step);
      if (!there.converged()) status_ = there.status;
      tip += term.weight / step * (here_.tip.inverse() * there.tip).log();
      twists += term.weight / step * (there.shape.twists() - twists_here).reshaped();
    }
    derivative.tip.col(column) = tip;
    derivative.twists.col(column) = twists;
  }

  SolveStatus status() const { return status_; }

 private:
  const Solution& here_;
  SolveStatus status_ = SolveStatus::kConverged;
};

double& componentOf(model::Stiffness& stiffness, int component) {
  if (component == 0) return stiffness.gamma;
  return component == 1 ? stiffness.tau : stiffness.kappa;
}

void differByStiffness(const ArmModel& model, const Eigen::VectorXd& lengths,
                       Differences& differences, ShapeDerivative& out) {
  const model::Arm& arm = model.arm();
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    for (int component = 0; component < kStiffnessEntries; ++component) {
      const int column = kStiffnessEntries * i + component;
      if (out.twists.col(column).hasNaN()) continue;  // the shape jumps
      const auto changed = [&](double change) {
        model::Stiffness changed_stiffness = arm.actuator(i).stiffness;
        componentOf(changed_stiffness, component) += change;
        std::optional<model::PlanarArm> planar;
        if (model.planar()) planar = model.planar()->withStiffness(i, changed_stiffness);
        return ArmModel(arm.withStiffness(i, changed_stiffness), std::move(planar), model.load(),
                        model.choice().setting)
            .solveLengths(lengths);
      };
      model::Stiffness stiffness = arm.actuator(i).stiffness;
      const double entry = componentOf(stiffness, component);
      if (entry > 0) {
        differences.take(kCentral, kStiffnessStep * entry, column, changed, out);
      } else {
        const double like = component == 0 ? 1.0 : stiffness.kappa;
        differences.take(kForward, kStiffnessStep * like, column, changed, out);
      }
    }
  }
}

void differByTipLoad(const ArmModel& model, const Eigen::VectorXd& lengths,
                     Differences& differences, ShapeDerivative& out) {
  const TierSetting& own = model.choice().setting;
  const TierSetting setting =
      takesLoad(own.tier) ? own : TierSetting{Tier::kLoaded, kMostOrder};  // of a tapered arm
  for (int j = 0; j < 6; ++j) {
    const double angle = out.tip.col(j).tail<3>().norm();
    const double strain = out.tip.col(j).head<3>().norm() / model.arm().restLength();
    const double turn = std::max(angle, kAngleStep / kStretchStep * strain);
    const auto changed = [&](double change) {
      Load load = *model.load();
      PointLoad tip;
      tip.section = model.arm().sectionCount() - 1;
      tip.offset = model.arm().link(tip.section).translation;
      (j < 3 ? tip.force : tip.moment)[j % 3] = change;
      load.points.push_back(tip);
      return ArmModel(model.arm(), model.planar(), std::move(load), setting).solveLengths(lengths);
    };
    if (turn > 0) differences.take(kCentral, kAngleStep / turn, j, changed, out);
  }
}

// @param start  the derivatives without load, which set steps and say where the shape jumps.
ShapeJacobian underLoad(const ArmModel& model, const model::InputRef& q, ShapeJacobian start) {
  const model::Arm& arm = model.arm();
  const Eigen::VectorXd lengths = arm.lengths(q);
  const Solution here = model.solveLengths(lengths);
  ShapeJacobian out = std::move(start);
  out.tip = here.tip;
  out.twists = here.shape.twists();
  Differences differences(here);
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const double turn = out.by_lengths.tip.col(i).tail<3>().norm();
    const double step = turn > 0 ? kAngleStep / turn : kAngleStep * arm.restLength();
    const auto changed = [&](double change) {
      Eigen::VectorXd there = lengths;
      there[i] += change;
      return model.solveLengths(there);
    };
    differences.take(kCentral, step, i, changed, out.by_lengths);
  }
  differByStiffness(model, lengths, differences, out.by_stiffness);
  std::vector<ShapeDerivative*> derivatives = {&out.by_lengths, &out.by_stiffness};
  if (out.by_load) {
    differByTipLoad(model, lengths, differences, *out.by_load);
    derivatives.push_back(&*out.by_load);
  }
  for (ShapeDerivative* derivative : derivatives) turnToBase(out.tip, *derivative);
  out.status = here.converged() ? differences.status() : here.status;
  if (out.status == SolveStatus::kConverged) return out;
  for (ShapeDerivative* derivative : derivatives) {
    derivative->tip.setConstant(kNoNumber);
    derivative->twists.setConstant(kNoNumber);
  }
  return out;
}

}  // namespace

ShapeJacobian jacobianAt(const ArmModel& model, const model::InputRef& q) {
  ShapeJacobian out = withoutLoad(model, q);
  if (!model.isLinear()) out = underLoad(model, q, std::move(out));
  out.by_inputs = out.by_lengths;
  for (int i = 0; i < q.size(); ++i) {
    const double slope = model.arm().actuator(i).contraction.slopeInside(q[i]);
    out.by_inputs.tip.col(i) *= slope;
    out.by_inputs.twists.col(i) *= slope;
  }
  return out;
}

}  // namespace helix_arm::statics
