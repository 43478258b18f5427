#include "shape_model.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/unloaded_change.hpp"

namespace helix_arm::estimation {
namespace {

// Step of the central differences of the logs, for loaded arms; their error is of second order.
constexpr double kStep = 1e-4;
// Initial bending stiffness of an arm without one, in squares of its actuators' offset.
constexpr double kLikelyBending = 0.2;

int count(const model::Arm& arm, int k) { return arm.firstActuator(k + 1) - arm.firstActuator(k); }

// Component of an actuator's stiffness, as ActuatorChange counts it.
int componentOf(FitParameter entry) {
  return entry == FitParameter::kGamma ? 0 : entry == FitParameter::kTau ? 1 : 2;
}

// Change of the pieces' twists, all in one column.
Eigen::VectorXd changeOf(const model::Shape& above, const model::Shape& below) {
  const model::Shape::Pieces change = (above.pieces() - below.pieces()) / (2 * kStep);
  return Eigen::Map<const Eigen::VectorXd>(change.data(), change.size());
}

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

double& entryOf(Elasticity& elasticity, FitParameter entry) {
  switch (entry) {
    case FitParameter::kKappa:
      return elasticity.ratios.kappa;
    case FitParameter::kGamma:
      return elasticity.ratios.gamma;
    case FitParameter::kEps:
      return elasticity.K_eps;
    default:
      break;
  }
  return elasticity.ratios.tau;
}

std::vector<ArmCaptures> statesOf(const std::vector<ArmCaptures>& arms) {
  std::vector<ArmCaptures> out;
  for (const ArmCaptures& arm : arms) out.push_back(arm.under(std::nullopt));
  for (const ArmCaptures& arm : arms) {
    for (const Capture& capture : arm.captures) {
      if (capture.payload) out.push_back(arm.under(capture.payload));
    }
  }
  return out;
}

ShapeModel::ShapeModel(const std::vector<ArmCaptures>& arms,
                       const std::vector<FitParameter>& fitted)
    : arms_(arms), fitted_(fitted), points_(arms.size()) {
  const ArmCaptures& first = arms.front();
  initial_.ratios = first.arm.actuator(0).stiffness;
  const auto loaded =
      std::find_if(arms.begin(), arms.end(), [](const ArmCaptures& arm) { return arm.isLoaded(); });
  if (loaded != arms.end()) initial_.K_eps = loaded->load->K_eps.front();
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

LinearisedShape ShapeModel::at(int a, const Eigen::VectorXd& lengths, const double* logs,
                               int scales, bool derivatives) {
  update(logs, derivatives);
  const LinearisationPoint& arm = points_[a];
  const statics::Solution solution = arm.at->model.solveLengths(lengths);
  LinearisedShape out;
  out.shape = solution.shape;
  out.found = solution.converged() && !arm.at->too_steep;
  if (!derivatives) return out;
  out.by_stiffness.setZero(out.shape.pieces().size(), size());
  out.by_scale.setZero(out.shape.pieces().size(), scales);
  if (arms_[a].isLoaded()) {
    takeDifferences(arm, lengths, out);
  } else {
    differentiate(arm.at->model.arm(), lengths, out);
  }
  return out;
}

void ShapeModel::takeDifferences(const LinearisationPoint& arm, const Eigen::VectorXd& lengths,
                                 LinearisedShape& out) const {
  const auto found = [&out](const Statics& statics, const Eigen::VectorXd& l) {
    const statics::Solution solution = statics.model.solveLengths(l);
    out.found &= solution.converged() && !statics.too_steep;
    return solution.shape;
  };
  for (int e = 0; e < size(); ++e) {
    out.by_stiffness.col(e) = changeOf(found(arm.above[e], lengths), found(arm.below[e], lengths));
  }
  const Eigen::Index scales = out.by_scale.cols();
  for (Eigen::Index i = 0; i < scales; ++i) {
    const auto scaled = [&](double log) {
      Eigen::VectorXd l = lengths;
      l.segment(i, scales == 1 ? l.size() : 1) *= std::exp(log);
      return l;
    };
    out.by_scale.col(i) = changeOf(found(*arm.at, scaled(kStep)), found(*arm.at, scaled(-kStep)));
  }
}

void ShapeModel::differentiate(const model::Arm& arm, const Eigen::VectorXd& lengths,
                               LinearisedShape& out) const {
  using Change = statics::ActuatorChange<lie::SE3>;
  const Change change(arm, nullptr, lengths, Change::By::kLengthsAndStiffness);
  const int pieces = arm.piecesPerSection();
  const auto scales = static_cast<int>(out.by_scale.cols());
  for (int piece = 0; piece < pieces * arm.sectionCount(); ++piece) {
    const int k = piece / pieces, first = arm.firstActuator(k);
    const double from = static_cast<double>(piece % pieces) / pieces, to = from + 1.0 / pieces;
    Change::Motion by;
    if (arm.taper(k)) {
      const model::TaperTwist<lie::SE3> profile(*arm.taper(k),
                                                lengths.segment(first, count(arm, k)));
      by = statics::taperStep(profile, change, k, from, to).by;
    } else {
      by = change.twist(k, from) / pieces;
    }
    for (int i = first; i < arm.firstActuator(k + 1); ++i) {
      if (scales > 0) {
        out.by_scale.block<6, 1>(6 * piece, scales == 1 ? 0 : i) += lengths[i] * by.col(i - first);
      }
      Elasticity stiffness{arm.actuator(i).stiffness, 0};
      for (int e = 0; e < size(); ++e) {
        if (fitted_[e] == FitParameter::kEps) continue;  // which acts under load alone
        const int column = change.stiffnessColumn(k, i, componentOf(fitted_[e])) - change.first(k);
        out.by_stiffness.block<6, 1>(6 * piece, e) +=
            entryOf(stiffness, fitted_[e]) * by.col(column);
      }
    }
  }
}

ShapeModel::Statics ShapeModel::staticsAt(const ArmCaptures& data,
                                          const Eigen::VectorXd& logs) const {
  const bool fits_ratios = std::any_of(fitted_.begin(), fitted_.end(), [](FitParameter entry) {
    return entry != FitParameter::kEps;
  });
  // An entry of 0 can only change if all actuators have the same ratios.
  const Elasticity factors = elasticityAt(logs.data(), {{1, 1, 1}, 1});
  const auto moved = [&](const model::Stiffness& own) {
    return elasticityAt(logs.data(), {own, 0}).ratios;
  };
  model::Arm arm = data.arm;
  bool too_steep = false;
  if (fits_ratios) {
    try {
      arm = isAlike(data.arm) ? arm.withStiffness(moved(data.arm.actuator(0).stiffness))
                              : arm.scaledStiffness(factors.ratios);
    } catch (const std::invalid_argument&) {
      too_steep = true;
    }
  }
  std::optional<statics::Load> load = data.load;
  if (load) {
    for (double& K_eps : load->K_eps) K_eps *= factors.K_eps;
  }
  // Tags and cameras are in space, so the arm is, too.
  const statics::TierSetting setting =
      data.isLoaded() ? data.tier : statics::TierSetting{statics::Tier::kLinear, 0};
  return {{std::move(arm), std::nullopt, std::move(load), setting}, too_steep};
}

void ShapeModel::update(const double* logs, bool derivatives) {
  const Eigen::VectorXd at = Eigen::Map<const Eigen::VectorXd>(logs, size());
  const bool known = points_.front().at && at_ == at;
  if (known && (has_changes_ || !derivatives)) return;
  at_ = at;
  has_changes_ = derivatives;
  for (std::size_t a = 0; a < arms_.size(); ++a) {
    LinearisationPoint& arm = points_[a];
    if (!known) arm.at.emplace(staticsAt(arms_[a], at));
    arm.above.clear();
    arm.below.clear();
    for (int e = 0; derivatives && arms_[a].isLoaded() && e < size(); ++e) {
      const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(size(), e);
      arm.above.push_back(staticsAt(arms_[a], at + step));
      arm.below.push_back(staticsAt(arms_[a], at - step));
    }
  }
}

}  // namespace helix_arm::estimation
