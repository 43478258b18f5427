#include "shape_model.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"

namespace helix_arm::estimation {
namespace {

// Step of the central differences of the logs, for arms with pieces; their error is of second
// order.
constexpr double kStep = 1e-4;
// Initial bending stiffness of an arm without one, in squares of its actuators' offset.
constexpr double kLikelyBending = 0.2;

int count(const model::Arm& arm, int k) { return arm.firstActuator(k + 1) - arm.firstActuator(k); }

// Change of the pieces' twists, all in one column.
Eigen::VectorXd changeOf(const statics::Solution& above, const statics::Solution& below) {
  const model::Shape::Pieces change = (above.shape.pieces() - below.shape.pieces()) / (2 * kStep);
  return Eigen::Map<const Eigen::VectorXd>(change.data(), change.size());
}

// Whether its shapes are solved, not linear in the lengths.
bool hasPieces(const ArmCaptures& arm) { return arm.isLoaded() || arm.arm.tapered(); }

bool isAlike(const model::Arm& arm) {
  const model::Stiffness& first = arm.actuator(0).stiffness;
  for (int i = 1; i < arm.actuatorCount(); ++i) {
    const model::Stiffness& other = arm.actuator(i).stiffness;
    if (other.kappa != first.kappa || other.gamma != first.gamma || other.tau != first.tau) {
      return false;
    }
  }
  return true;
}

}  // namespace

double& entryOf(Elasticity& elasticity, StiffnessEntry entry) {
  switch (entry) {
    case StiffnessEntry::kKappa:
      return elasticity.ratios.kappa;
    case StiffnessEntry::kGamma:
      return elasticity.ratios.gamma;
    case StiffnessEntry::kEps:
      return elasticity.K_eps;
    case StiffnessEntry::kTau:
      break;
  }
  return elasticity.ratios.tau;
}

ShapeModel::ShapeModel(const std::vector<ArmCaptures>& arms,
                       const std::vector<StiffnessEntry>& fitted)
    : arms_(arms), fitted_(fitted), loaded_(arms.size()) {
  const ArmCaptures& first = arms.front();
  initial_.ratios = first.arm.actuator(0).stiffness;
  if (first.isLoaded()) initial_.K_eps = first.load->K_eps.front();
  reference_ = initial_;
  model::Stiffness& ratios = reference_.ratios;
  double offset = 0;
  for (int i = 0; i < first.arm.actuatorCount(); ++i) {
    offset = std::max(offset, first.arm.actuator(i).X_O.translation.squaredNorm());
  }
  if (!(ratios.kappa > 0)) ratios.kappa = kLikelyBending * offset;
  if (!(ratios.gamma > 0)) ratios.gamma = 1.0;
  if (!(ratios.tau > 0)) ratios.tau = ratios.kappa;
}

Elasticity ShapeModel::elasticityAt(const double* logs, Elasticity elasticity) const {
  for (std::size_t e = 0; e < fitted_.size(); ++e) {
    double& entry = entryOf(elasticity, fitted_[e]);
    entry = (entry > 0 ? entry : referenceOf(fitted_[e])) * std::exp(logs[e]);
  }
  return elasticity;
}

ShapeThere ShapeModel::at(int a, const Eigen::VectorXd& lengths, const double* logs, int scales,
                          bool derivatives) {
  update(logs, derivatives);
  return hasPieces(arms_[a]) ? loaded(a, lengths, scales, derivatives)
                             : unloaded(a, lengths, scales, derivatives);
}

ShapeThere ShapeModel::unloaded(int a, const Eigen::VectorXd& lengths, int scales,
                                bool derivatives) const {
  const model::Arm& arm = arms_[a].arm;
  ShapeThere out;
  model::Twists twists(6, arm.sectionCount());
  if (derivatives) {
    out.by_stiffness.resize(6 * arm.sectionCount(), size());
    out.by_scale.setZero(6 * arm.sectionCount(), scales);
  }
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const auto l = lengths.segment(arm.firstActuator(k), count(arm, k));
    twists.col(k) = maps_[a][k].map * l;
    for (int e = 0; derivatives && e < size(); ++e) {
      out.by_stiffness.block<6, 1>(6 * k, e) = changes_[a][k][e] * l;
    }
    for (int j = 0; derivatives && scales > 0 && j < l.size(); ++j) {
      out.by_scale.block<6, 1>(6 * k, scales == 1 ? 0 : arm.firstActuator(k) + j) +=
          maps_[a][k].map.col(j) * l[j];
    }
  }
  out.shape = model::shapeOf(arm, twists);
  return out;
}

ShapeThere ShapeModel::loaded(int a, const Eigen::VectorXd& lengths, int scales, bool derivatives) {
  Loaded& arm = loaded_[a];
  if (arm.lengths.size() > 0 && arm.lengths == lengths && (arm.has_changes || !derivatives)) {
    return arm.last;
  }
  ShapeThere out;
  const auto found = [&out](const Statics& statics, const Eigen::VectorXd& l) {
    statics::Solution solution = statics(l);
    out.found &= solution.converged();
    return solution;
  };
  out.shape = found(arm.there, lengths).shape;
  if (derivatives) {
    out.by_stiffness.resize(out.shape.pieces().size(), size());
    out.by_scale.resize(out.shape.pieces().size(), scales);
    for (int e = 0; e < size(); ++e) {
      out.by_stiffness.col(e) =
          changeOf(found(arm.above[e], lengths), found(arm.below[e], lengths));
    }
    for (int i = 0; i < scales; ++i) {
      const auto scaled = [&](double log) {
        Eigen::VectorXd l = lengths;
        if (scales == 1) {
          l *= std::exp(log);
        } else {
          l[i] *= std::exp(log);
        }
        return l;
      };
      out.by_scale.col(i) =
          changeOf(found(arm.there, scaled(kStep)), found(arm.there, scaled(-kStep)));
    }
  }
  arm.lengths = lengths;
  arm.has_changes = derivatives;
  arm.last = out;
  return out;
}

std::vector<model::Strand<lie::SE3>> ShapeModel::strandsAt(int a, int k,
                                                           const Eigen::VectorXd& logs) const {
  const model::Arm& arm = arms_[a].arm;
  std::vector<model::Strand<lie::SE3>> strands;
  for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
    const model::Actuator& actuator = arm.actuator(i);
    strands.push_back(
        {actuator.X_O,
         elasticityAt(logs.data(), {actuator.stiffness, 0}).ratios.diagonal<lie::SE3>()});
  }
  return strands;
}

ShapeModel::Changes ShapeModel::changesAt(int a, int k) const {
  // A map = D, and D does not depend on the stiffness. Neither does the null space of A, since no
  // entry vanishes.
  const model::Arm& arm = arms_[a].arm;
  const model::Equilibrium<lie::SE3>& equilibrium = maps_[a][k];
  std::vector<lie::Matrix6> A(fitted_.size(), lie::Matrix6::Zero());
  for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
    const lie::Matrix6 Ad = arm.actuator(i).X_O.inverse().adjoint();
    const Elasticity now = elasticityAt(at_.data(), {arm.actuator(i).stiffness, 0});
    for (std::size_t e = 0; e < fitted_.size(); ++e) {
      Elasticity without = now;
      entryOf(without, fitted_[e]) = 0;
      const lie::Vector6 change =
          now.ratios.diagonal<lie::SE3>() - without.ratios.diagonal<lie::SE3>();
      A[e] += Ad.transpose() * change.asDiagonal() * Ad;
    }
  }
  Changes changes;
  for (const lie::Matrix6& by_log : A) {
    changes.emplace_back(-equilibrium.compliance * by_log * equilibrium.map);
  }
  return changes;
}

ShapeModel::Statics ShapeModel::staticsAt(const ArmCaptures& data,
                                          const Eigen::VectorXd& logs) const {
  const bool fits_ratios = std::any_of(fitted_.begin(), fitted_.end(), [](StiffnessEntry entry) {
    return entry != StiffnessEntry::kEps;
  });
  // An entry of 0 can only change if all actuators have the same ratios.
  const Elasticity factors = elasticityAt(logs.data(), {{1, 1, 1}, 1});
  const auto moved = [&](const model::Stiffness& own) {
    return elasticityAt(logs.data(), {own, 0}).ratios;
  };
  model::Arm arm = data.arm;
  if (fits_ratios) {
    arm = isAlike(data.arm) ? arm.withStiffness(moved(data.arm.actuator(0).stiffness))
                            : arm.scaledStiffness(factors.ratios);
  }
  statics::Load load = data.load.value_or(statics::Load());
  for (double& K_eps : load.K_eps) K_eps *= factors.K_eps;
  const auto statics = [&arm, &load](auto solver) -> Statics {
    return [arm, load, solver = std::move(solver)](const Eigen::VectorXd& lengths) {
      return solver.solve(statics::unloadedUnderOfLengths(arm, load, lengths));
    };
  };
  switch (data.tier.tier) {
    case statics::Tier::kExact:
      return statics(statics::ExactArm(arm, load));
    case statics::Tier::kLoaded:
      return statics(statics::LoadedArm(arm, load, data.tier.order));
    case statics::Tier::kPlanar:
    case statics::Tier::kLinear:
      break;
  }
  return [arm](const Eigen::VectorXd& lengths) {
    statics::Solution solution;
    solution.shape = model::shapeOf(arm, arm.unloadedOfLengths(lengths));
    solution.tip = model::tipPose(solution.shape);
    return solution;
  };
}

void ShapeModel::update(const double* logs, bool derivatives) {
  const Eigen::VectorXd at = Eigen::Map<const Eigen::VectorXd>(logs, size());
  const bool known = !maps_.empty() && at_ == at;
  if (known && (has_changes_ || !derivatives)) return;
  if (!known) {
    maps_.assign(arms_.size(), {});
    for (std::size_t a = 0; a < arms_.size(); ++a) {
      for (int k = 0; k < arms_[a].arm.sectionCount(); ++k) {
        maps_[a].push_back(model::solveEquilibrium(strandsAt(static_cast<int>(a), k, at)));
      }
      if (hasPieces(arms_[a])) loaded_[a].there = staticsAt(arms_[a], at);
      loaded_[a].lengths.resize(0);
    }
  }
  at_ = at;
  has_changes_ = derivatives;
  if (!derivatives) return;
  changes_.assign(arms_.size(), {});
  for (std::size_t a = 0; a < arms_.size(); ++a) {
    if (!hasPieces(arms_[a])) {
      for (int k = 0; k < arms_[a].arm.sectionCount(); ++k) {
        changes_[a].push_back(changesAt(static_cast<int>(a), k));
      }
      continue;
    }
    loaded_[a].above.clear();
    loaded_[a].below.clear();
    for (int e = 0; e < size(); ++e) {
      const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(size(), e);
      loaded_[a].above.push_back(staticsAt(arms_[a], at + step));
      loaded_[a].below.push_back(staticsAt(arms_[a], at - step));
    }
  }
}

}  // namespace helix_arm::estimation
