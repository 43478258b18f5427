#include "helix_arm/statics/attain.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/taper.hpp"
#include "statics/inverse/box_quadratic.hpp"
#include "statics/inverse/inverse_task.hpp"
#include "statics/loaded/gauss_rule.hpp"

namespace helix_arm::statics {
namespace {

using lie::SE3;
using lie::Vector6;

constexpr int kPlacesPerSection = 8;   // per section, at least
constexpr int kWeightNodes = 8;        // per piece, of its own weight
constexpr double kLeastRadius = 1e-3;  // of a bundle, relative to its length
constexpr double kLengthWeight =
    1e-9;                       // of the lengths against the residual, relative to diag(J'J)
constexpr int kMostSteps = 60;  // per start
constexpr double kLengthAtRest = 1e-9;  // relative to the range of a length
constexpr double kLeastSectionDamping = 1e-6, kMostSectionDamping = 1e6, kDampingStep = 6.0;

/// A force and its moment about the base's origin, base frame.
struct Wrench {
  Eigen::Vector3d force = Eigen::Vector3d::Zero(), moment = Eigen::Vector3d::Zero();

  void add(const Eigen::Vector3d& more, const Eigen::Vector3d& at) {
    force += more;
    moment += at.cross(more);
  }
  Vector6 seenFrom(const SE3& X) const {
    Vector6 out;
    out << X.rotation.transpose() * force,
        X.rotation.transpose() * (moment - X.translation.cross(force));
    return out;
  }
};

/// A place of a section at which wrenches are compared.
struct Place {
  double s, weight;
  Vector6 twist, required;
};

/// The places of all sections with the wrenches that a load requires there.
std::vector<std::vector<Place>> placesOf(const model::Shape& shape, const Load& load) {
  const int pieces = shape.piecesPerSection();
  const GaussRule& rule = GaussRule::of(std::max(1, kPlacesPerSection / pieces));
  const GaussRule& inner = GaussRule::of(kWeightNodes);
  std::vector<SE3> starts{SE3{}};
  for (int j = 0; j < shape.pieces().cols(); ++j) starts.push_back(shape.beyond(starts.back(), j));
  std::vector<std::vector<Place>> out(static_cast<std::size_t>(shape.sectionCount()));
  Wrench beyond;
  for (int j = static_cast<int>(shape.pieces().cols()) - 1; j >= 0; --j) {
    const int section = j / pieces;
    const double begin = static_cast<double>(j % pieces) / pieces, end = begin + 1.0 / pieces;
    const Vector6 g = shape.pieces().col(j);
    const SE3& start = starts[static_cast<std::size_t>(j)];
    const auto poseAt = [&](double s) { return start * SE3::exp((s - begin) * pieces * g); };
    const Eigen::Vector3d weight = load.mass[static_cast<std::size_t>(section)] * load.gravity;
    // The wrench beyond s with that of this piece.
    const auto withPiece = [&](double s, bool also_at) {
      Wrench sum = beyond;
      for (const PointLoad& point : load.points) {
        const bool here = point.section == section && point.s <= end && point.s > begin;
        if (!here || (also_at ? point.s < s : point.s <= s)) continue;
        sum.add(load.forceOf(point), poseAt(point.s) * point.offset);
        sum.moment += point.moment;
      }
      for (int i = 0; i < inner.count() && !weight.isZero(0); ++i) {
        sum.add((end - s) * inner.weights()[i] * weight,
                poseAt(s + (end - s) * inner.nodes()[i]).translation);
      }
      return sum;
    };
    for (int i = 0; i < rule.count(); ++i) {
      const double s = begin + rule.nodes()[i] / pieces;
      out[static_cast<std::size_t>(section)].push_back(
          {s, rule.weights()[i] / pieces, pieces * g, withPiece(s, false).seenFrom(poseAt(s))});
    }
    beyond = withPiece(begin, true);
  }
  return out;
}

// R of the norm |R w| [N] of a wrench: the elastic energy w' C w of what it deforms, as a force
// along the arm that has the same. A wrench that nothing resists counts by itself, its moment over
// the bundle's radius.
lie::Matrix6 rootOfNorm(const model::Arm& arm, int section, double s) {
  const auto& mean = arm.equilibrium(section);
  const int first = arm.firstActuator(section), end = arm.firstActuator(section + 1);
  double radius = 0.0;
  for (int i = first; i < end; ++i) {
    radius += arm.actuator(i).X_O.translation.norm() / (end - first);
  }
  radius = std::max(radius, kLeastRadius * arm.freeLength(section));
  lie::Matrix6 norm = arm.taper(section) ? arm.taper(section)->complianceAt(s) : mean.compliance;
  norm /= mean.compliance(0, 0);
  for (int j = 0; j < mean.null_space.cols(); ++j) {
    Vector6 motion = mean.null_space.col(j);
    motion.tail<3>() /= radius;
    norm += motion * motion.transpose();
  }
  return norm.llt().matrixU();
}

/// The missing wrenches of one section by the free lengths of its actuators.
class SectionBalance {
 public:
  SectionBalance(const model::Arm& arm, const Load& load, const LengthBox& box, int section,
                 const std::vector<Place>& places)
      : arm_(arm),
        box_(box),
        places_(places),
        first_(arm.firstActuator(section)),
        n_(arm.firstActuator(section + 1) - first_),
        per_strain_(load.K_eps[static_cast<std::size_t>(section)] / arm.freeLength(section)),
        bending_(arm.bending(section)),
        input_(Eigen::VectorXd::Zero(n_)) {
    if (!load.tables.empty()) table_ = load.tables[static_cast<std::size_t>(section)];
    tapered_ = arm.taper(section) != nullptr;
    for (std::size_t p = 0; p < (tapered_ ? places_.size() : 1); ++p) {
      for (int i = 0; i < n_; ++i) {
        seen_.push_back(
            model::poseAlong(arm.actuator(first_ + i), places_[p].s).inverse().adjoint());
      }
      roots_.push_back(rootOfNorm(arm, section, places_[p].s));
    }
  }

  bool isLinear() const { return table_.empty() && bending_.empty(); }
  int size() const { return n_; }
  const LengthBox& box() const { return box_; }
  int first() const { return first_; }
  double lower(int i) const { return box_.lower()[first_ + i]; }
  double upper(int i) const { return box_.upper()[first_ + i]; }
  int rows() const { return 6 * static_cast<int>(places_.size()); }

  /// Inputs (n) of lengths (n).
  const Eigen::VectorXd& inputsOf(const Eigen::VectorXd& lengths) {
    for (int i = 0; i < n_; ++i) {
      const model::Actuator& actuator = arm_.actuator(first_ + i);
      input_[i] = std::clamp(model::nearestInput(actuator, lengths[i]).q, actuator.limits.lower,
                             actuator.limits.upper);
    }
    return input_;
  }

  /// Weighted residual (rows) [N] at lengths (n) [m] and its Jacobian (rows x n) [N/m].
  void evaluate(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                Eigen::MatrixXd& jacobian) {
    double bend = 1.0, bend_slope = 0.0;
    if (!isLinear()) inputsOf(lengths);
    if (!bending_.empty()) {
      bend = bending_.at(bending_.argumentAt(input_));
      bend_slope = bending_.slopeAt(bending_.argumentAt(input_));
    }
    for (std::size_t p = 0; p < places_.size(); ++p) {
      const Place& place = places_[p];
      Vector6 sum = Vector6::Zero(), bent = Vector6::Zero();
      auto columns = jacobian.middleRows<6>(6 * static_cast<Eigen::Index>(p));
      for (int i = 0; i < n_; ++i) {
        const model::Actuator& actuator = arm_.actuator(first_ + i);
        const lie::Matrix6& seen =
            seen_[(tapered_ ? p * static_cast<std::size_t>(n_) : 0) + static_cast<std::size_t>(i)];
        Vector6 strain = seen * place.twist;
        strain[0] -= lengths[i];
        const Vector6 K =
            actuator.stiffness.diagonal<SE3>() + (bend - 1.0) * actuator.stiffness.bending<SE3>();
        const double k = table_.empty() ? 1.0 : table_.at(input_[i]);
        const Vector6 by_factor = seen.transpose() * K.cwiseProduct(strain);
        sum += k * by_factor;
        columns.col(i) = -k * K[0] * seen.row(0).transpose();
        if (!table_.empty()) {
          columns.col(i) += table_.slopeAt(input_[i]) * inputByLength(i) * by_factor;
        }
        if (!bending_.empty()) {
          bent += k * seen.transpose() * actuator.stiffness.bending<SE3>().cwiseProduct(strain);
        }
      }
      for (int i = 0; i < n_ && !bending_.empty(); ++i) {
        columns.col(i) += bend_slope * bending_.argumentSlope(input_, i) * inputByLength(i) * bent;
      }
      const lie::Matrix6 scaled = std::sqrt(place.weight) * rootAt(p);
      residual.segment<6>(6 * static_cast<Eigen::Index>(p)) =
          scaled * (per_strain_ * sum - place.required);
      for (int i = 0; i < n_; ++i) columns.col(i) = scaled * Vector6(per_strain_ * columns.col(i));
    }
  }

  /// The largest missing wrench of a residual.
  MissingWrench missing(const Eigen::VectorXd& residual, int section) const {
    MissingWrench out{section};
    double most = -1.0;
    for (std::size_t p = 0; p < places_.size(); ++p) {
      const Vector6 here =
          -residual.segment<6>(6 * static_cast<Eigen::Index>(p)) / std::sqrt(places_[p].weight);
      if (here.norm() <= most) continue;
      most = here.norm();
      const Vector6 wrench = rootAt(p).triangularView<Eigen::Upper>().solve(here);
      out = {section, places_[p].s, wrench.head<3>(), wrench.tail<3>()};
    }
    return out;
  }

 private:
  const lie::Matrix6& rootAt(std::size_t place) const { return roots_[tapered_ ? place : 0]; }
  double inputByLength(int i) const {
    const model::Actuator& actuator = arm_.actuator(first_ + i);
    const double mean = (upper(i) - lower(i)) / (actuator.limits.upper - actuator.limits.lower);
    const double slope = actuator.contraction.slopeInside(input_[i]);
    constexpr double kLeastCurveSlope = 1e-3;  // relative to the mean one
    return 1.0 / std::copysign(std::max(std::abs(slope), kLeastCurveSlope * mean), slope);
  }

  const model::Arm& arm_;
  const LengthBox& box_;
  const std::vector<Place>& places_;
  int first_, n_;
  double per_strain_;
  StiffnessTable table_;
  model::BendingTable bending_;
  bool tapered_ = false;
  std::vector<lie::Matrix6> seen_;   // Ad_i^-1, of a tapered section at each place
  std::vector<lie::Matrix6> roots_;  // of the norm, likewise
  Eigen::VectorXd input_;
};

/// Bounded least squares of a section.
class SectionSearch {
 public:
  explicit SectionSearch(SectionBalance& balance)
      : lengths(balance.size()),
        balance_(balance),
        step_(balance.size()),
        residual_(balance.rows()),
        trial_(balance.rows()),
        jacobian_(balance.rows(), balance.size()),
        trial_jacobian_(balance.rows(), balance.size()) {}

  Eigen::VectorXd lengths;  ///< (n) where it begins and ends [m]

  /// Descends. @return the cost [N^2].
  double descend() {
    evaluate();
    double damping = balance_.isLinear() ? 0.0 : kLeastSectionDamping;
    const Eigen::VectorXd start = lengths;
    for (int i = 0; i < (balance_.isLinear() ? 1 : kMostSteps) && damping < kMostSectionDamping;
         ++i) {
      linearise(damping, start);
      const Eigen::VectorXd moved = bounded(lengths + step_.solve());
      if (atRest(moved)) break;
      balance_.evaluate(moved, trial_, trial_jacobian_);
      if (balance_.isLinear() || trial_.squaredNorm() < residual_.squaredNorm()) {
        lengths = moved;
        residual_.swap(trial_);
        jacobian_.swap(trial_jacobian_);
        damping =
            std::max(damping / kDampingStep, balance_.isLinear() ? 0.0 : kLeastSectionDamping);
      } else {
        damping *= kDampingStep;
      }
    }
    return residual_.squaredNorm();
  }

  void evaluate() { balance_.evaluate(lengths, residual_, jacobian_); }
  const Eigen::VectorXd& residual() const { return residual_; }

  /// Whether less would be missing if actuator i could go beyond the bound at which it is.
  bool isHeld(int i) const {
    return balance_.box().holds(balance_.first() + i, lengths[i], jacobian_.col(i), residual_,
                                residual_.squaredNorm());
  }

 private:
  Eigen::VectorXd bounded(Eigen::VectorXd l) const {
    for (int i = 0; i < l.size(); ++i)
      l[i] = std::clamp(l[i], balance_.lower(i), balance_.upper(i));
    return l;
  }
  bool atRest(const Eigen::VectorXd& moved) const {
    for (int i = 0; i < moved.size(); ++i) {
      const double range = balance_.upper(i) - balance_.lower(i);
      if (std::abs(moved[i] - lengths[i]) > kLengthAtRest * range) return false;
    }
    return true;
  }
  // Among lengths of equal wrenches, those nearest to the start count.
  void linearise(double damping, const Eigen::VectorXd& start) {
    const auto n = static_cast<int>(lengths.size());
    step_.H.noalias() = jacobian_.transpose() * jacobian_;
    step_.g.noalias() = jacobian_.transpose() * residual_;
    const double scale = step_.H.trace() / n + std::numeric_limits<double>::min();
    step_.g += kLengthWeight * scale * (lengths - start);
    for (int i = 0; i < n; ++i) {
      step_.H(i, i) += (kLengthWeight + damping) * scale;
      step_.lower[i] = balance_.lower(i) - lengths[i];
      step_.upper[i] = balance_.upper(i) - lengths[i];
    }
  }

  SectionBalance& balance_;
  BoxQuadratic step_;
  Eigen::VectorXd residual_, trial_;
  Eigen::MatrixXd jacobian_, trial_jacobian_;
};

// Parts of the limits at which a search begins: the lowest inputs, and, where the stiffness depends
// on them, others as well; of few actuators also near each corner of the limits.
constexpr double kStarts[] = {0.0, 0.25, 0.6, 1.0};
constexpr double kCornerStarts[] = {0.1, 0.9};
constexpr int kMostForCorners = 4;

// Leaves the best of all starts in the search. @param enough  residual that ends it [N].
// @return its residual [N].
double bestOf(const model::Arm& arm, int first, double enough, SectionSearch& search,
              const SectionBalance& balance) {
  double least = std::numeric_limits<double>::infinity();
  Eigen::VectorXd best;
  const int even = std::size(kStarts), n = balance.size();
  const int starts = balance.isLinear() ? 1 : even + (n <= kMostForCorners ? 1 << n : 0);
  for (int start = 0; start < starts && least > enough; ++start) {
    Eigen::VectorXd q = arm.inputAt(kStarts[std::min(start, even - 1)]);
    for (int i = 0; i < n; ++i) {
      const model::Range& limits = arm.actuator(first + i).limits;
      const double part = kCornerStarts[(start - even) >> i & 1];
      if (start >= even) q[first + i] = limits.lower + part * (limits.upper - limits.lower);
      search.lengths[i] = arm.actuator(first + i).contraction.lengthInside(q[first + i]);
    }
    const double size = std::sqrt(search.descend());
    if (size < least) {
      least = size;
      best = search.lengths;
    }
  }
  search.lengths = best;
  search.evaluate();
  return least;
}

double largestForceOf(const model::Arm& arm, const Load& load, const LengthBox& box, int k) {
  const auto section = static_cast<std::size_t>(k);
  double most = 1.0, stroke = 0.0;
  if (!load.tables.empty()) {
    for (const double factor : load.tables[section].factor) most = std::max(most, factor);
  }
  for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
    stroke += box.upper()[i] - box.lower()[i];
  }
  return load.K_eps[section] / arm.freeLength(k) * most * stroke;
}

}  // namespace

PointLoad placeAt(const model::Arm& arm, double s) {
  const int sections = arm.sectionCount();
  basics::require(s >= 0 && s <= sections, "a load is at s = ", s, "; expected 0 to ", sections,
                  ", the number of sections, which is the tip");
  PointLoad out;
  out.section = std::min(static_cast<int>(s), sections - 1);
  out.s = s - out.section;
  if (s == sections) out.offset = arm.link(out.section).translation;
  return out;
}

AttainSolver::AttainSolver(model::Arm arm, const Load& load, double tolerance)
    : arm_(std::move(arm)), load_(load), tolerance_(tolerance) {
  load.validate(arm_.sectionCount());
  basics::require(std::isfinite(tolerance) && tolerance > 0, "tolerance is ", tolerance,
                  "; expected a finite fraction > 0");
  const LengthBox box(arm_);
  for (int k = 0; k < arm_.sectionCount(); ++k) {
    largest_force_ = std::max(largest_force_, largestForceOf(arm_, load_, box, k));
  }
}

Attainment AttainSolver::attain(const model::Shape& shape,
                                const std::vector<PointLoad>& points) const {
  basics::require(shape.sectionCount() == arm_.sectionCount(), "the shape has ",
                  shape.sectionCount(), " sections; the arm has ", arm_.sectionCount());
  basics::require(shape.pieces().allFinite(), "the shape is not finite");
  Load load = load_;
  load.points.insert(load.points.end(), points.begin(), points.end());
  load.validate(arm_.sectionCount());
  load = load.atEnds(arm_.links().get());
  const std::vector<std::vector<Place>> places = placesOf(shape, load);
  const LengthBox box(arm_);
  Attainment out;
  out.input.resize(arm_.actuatorCount());
  out.limits.assign(static_cast<std::size_t>(arm_.actuatorCount()), Limit::kNone);
  out.residual = -1.0;
  for (int k = 0; k < arm_.sectionCount(); ++k) {
    const int first = arm_.firstActuator(k);
    SectionBalance balance(arm_, load, box, k, places[static_cast<std::size_t>(k)]);
    SectionSearch search(balance);
    const double size = bestOf(arm_, first, 0.01 * tolerance_ * largest_force_, search, balance);
    out.input.segment(first, balance.size()) = balance.inputsOf(search.lengths);
    for (int i = 0; i < balance.size(); ++i) {
      if (!search.isHeld(i)) continue;
      out.limits[static_cast<std::size_t>(first + i)] =
          box.nearestLimit(first + i, out.input[first + i]);
    }
    if (size <= out.residual) continue;
    out.residual = size;
    out.missing = balance.missing(search.residual(), k);
  }
  out.attainable = out.residual <= tolerance_ * largest_force_;
  return out;
}

}  // namespace helix_arm::statics
