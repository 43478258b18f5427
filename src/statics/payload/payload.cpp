#include "helix_arm/statics/payload.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "basics/fraction.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/statics/attain.hpp"
#include "helix_arm/statics/jacobian.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "statics/inverse/box_levenberg_marquardt.hpp"
#include "statics/inverse/inverse_task.hpp"

namespace helix_arm::statics {
namespace {

constexpr TierSetting kSetting{Tier::kLoaded, 5};
constexpr double kAccuracy = 1e-3;    // of the force
constexpr double kGrowth = 2.0;       // of the force, as long as it is held
constexpr double kMostStrain = 10.0;  // of all actuators, at which the search ends
constexpr int kDescent = 40;          // iterations per force and start
constexpr int kShortDescent = 8;      // the same where the last two answers lead
constexpr int kOtherStarts = 10;      // two of equal inputs, the others drawn within the limits
constexpr double kBeyond = 1.01;      // the force that other starts have to hold to be taken
constexpr double kLeastForce = 1e-9;  // of the largest, below which none counts as held

PointLoad tipLoad(const model::Arm& arm, const Eigen::Vector3d& force,
                  const Eigen::Vector3d& moment) {
  PointLoad out = placeAt(arm, arm.sectionCount());
  out.force = force;
  out.moment = moment;
  return out;
}

// The arm with a load and its tier for it.
ArmModel withLoad(const ArmModel& model, const PointLoad& point) {
  Load load = *model.load();
  load.points.push_back(point);
  const bool exact = model.choice().setting.tier == Tier::kExact;
  return {model.arm(), std::nullopt, std::move(load), exact ? model.choice().setting : kSetting};
}

// The inverse under one force.
class Push {
 public:
  Push(ArmModel model, const LengthBox& box, const Eigen::Vector3d& tip, double tolerance)
      : model_(std::move(model)),
        corrected_(model_),
        task_(corrected_, 1.0),
        minimiser_(task_, box, tolerance) {
    task_.setPosition(tip);
  }
  Push(const Push&) = delete;  // its parts refer to each other
  Push& operator=(const Push&) = delete;

  // Moves a point to the nearest tip.
  void descend(InversePoint& point, int most_iterations) {
    minimiser_.evaluate(point);
    minimiser_.descend(point, most_iterations);
  }

 private:
  const ArmModel model_;
  const CorrectedModel corrected_;
  InverseTask task_;
  BoxLevenbergMarquardt minimiser_;
};

}  // namespace

const char* nameOf(PayloadEnd end) {
  static const char* const kNames[] = {"limits", "unstable", "unactuated", "unreached", "none"};
  return kNames[static_cast<std::size_t>(end)];
}

Eigen::Matrix<double, 3, 26> payloadDirections() {
  Eigen::Matrix<double, 3, 26> out;
  int column = 0;
  for (int i = 0; i < 27; ++i) {
    const Eigen::Vector3d d(i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1);
    if (!d.isZero(0)) out.col(column++) = d.normalized();
  }
  return out;
}

class PayloadSolver::Search {
 public:
  Search(const ArmModel& model, const PayloadOptions& options)
      : base_(withLoad(checked(model, options),
                       tipLoad(model.arm(), Eigen::Vector3d::Zero(), options.moment))),
        tolerance_(options.position_tolerance * model.arm().restLength()),
        box_(base_.arm()),
        inverse_(base_) {
    for (int k = 0; k < arm().sectionCount(); ++k) {
      most_force_ += kMostStrain * base_.load()->K_eps[static_cast<std::size_t>(k)] *
                     (arm().firstActuator(k + 1) - arm().firstActuator(k));
    }
    const bool one_answer = arm().actuatorCount() <= 3 && !readsInputs(arm(), &*base_.load());
    if (one_answer) return;
    std::mt19937_64 generator(20261129);
    for (int s = 0; s < kOtherStarts; ++s) {
      Eigen::VectorXd fraction(arm().actuatorCount());
      for (double& one : fraction) one = s < 2 ? 0.5 * (s + 1) : basics::fractionOf(generator());
      starts_.push_back(arm().lengths(arm().inputAt(fraction)));
    }
  }

  const InverseResult& moveTo(const Eigen::Vector3d& tip) {
    tip_ = tip;
    found_ = inverse_.toPosition(tip, arm().inputAt(0.0));
    return found_;
  }
  bool isThere() const { return found_.position_error <= tolerance_; }

  Payload along(const Eigen::Vector3d& direction) {
    basics::require(direction.allFinite() && direction.norm() > 0,
                    "the direction is not finite or is 0; expected another vector");
    direction_ = direction.normalized();
    Payload out;
    out.input = found_.input;
    out.limits.assign(static_cast<std::size_t>(out.input.size()), Limit::kNone);
    out.stiffness = std::numeric_limits<double>::quiet_NaN();
    if (!isThere()) return out;
    held_ = {0.0, arm().lengths(found_.input)};
    earlier_ = held_;
    Bracket found = grown({0.0, tolerance_ * stiffnessAt(base_, found_.input)});
    while (std::isfinite(found.beyond)) {
      const double more = found.held > 0 ? kBeyond * found.held : found.beyond;
      if (!holdsElsewhere(more)) break;
      found = grown({more, kGrowth * more});
    }
    out.force = found.held;
    box_.readInputs(held_.lengths, out.input);
    nameEnd(found.beyond, out);
    out.stiffness = stiffnessAt(pushed(found.held), out.input);
    return out;
  }

  const ArmModel& model() const { return base_; }
  double tolerance() const { return tolerance_; }

 private:
  // Lengths (n) that hold a force [m].
  struct Held {
    double force = 0.0;
    Eigen::VectorXd lengths;
  };
  // A force that is held, and a larger one that is not; infinite if there is none.
  struct Bracket {
    double held, beyond;
  };

  static const ArmModel& checked(const ArmModel& model, const PayloadOptions& options) {
    basics::require(model.load().has_value(),
                    "a payload needs arm.stiffness.K_eps_n in every section");
    basics::require(std::isfinite(options.position_tolerance) && options.position_tolerance > 0,
                    "position_tolerance is ", options.position_tolerance,
                    "; expected a finite fraction > 0");
    basics::require(options.moment.allFinite(), "the moment on the tip is not finite");
    return model;
  }

  const model::Arm& arm() const { return base_.arm(); }
  ArmModel pushed(double force) const {
    return withLoad(base_, tipLoad(arm(), force * direction_, Eigen::Vector3d::Zero()));
  }

  // The nearest tip under a force, from lengths (n).
  InversePoint nearest(const ArmModel& model, const Eigen::VectorXd& lengths,
                       int most_iterations) const {
    InversePoint point(arm().actuatorCount(), 6 * arm().sectionCount());
    point.lengths = lengths;
    Push(model, box_, tip_, tolerance_).descend(point, most_iterations);
    return point;
  }
  // Whether a force is held from lengths (n); the answer becomes held_.
  bool holdsFrom(const Eigen::VectorXd& lengths, double force, int most_iterations) {
    const ArmModel model = pushed(force);
    const Tip here = model.tipOfLengths(lengths);
    if (!here.converged()) return false;
    if ((here.tip.translation - tip_).norm() <= tolerance_) return keep(lengths, force);
    const InversePoint point = nearest(model, lengths, most_iterations);
    return point.cost <= tolerance_ * tolerance_ && keep(point.lengths, force);
  }
  bool keep(const Eigen::VectorXd& lengths, double force) {
    if (force > held_.force) earlier_ = held_;
    held_ = {force, lengths};
    return true;
  }
  // Goes on from the last two answers: a tip that stays has nearly the same shape, and the lengths
  // that balance a force on one shape change in proportion to it.
  bool holds(double force) {
    const double between = held_.force - earlier_.force;
    const double ratio = between > 0 ? (force - held_.force) / between : 0.0;
    const Eigen::VectorXd onwards = held_.lengths + ratio * (held_.lengths - earlier_.lengths);
    return holdsFrom(onwards.cwiseMax(box_.lower()).cwiseMin(box_.upper()), force, kShortDescent);
  }
  bool holdsElsewhere(double force) {
    return std::any_of(starts_.begin(), starts_.end(), [&](const Eigen::VectorXd& lengths) {
      if (!holdsFrom(lengths, force, kDescent)) return false;
      earlier_ = held_;
      return true;
    });
  }

  Bracket grown(Bracket found) {
    while (holds(found.beyond)) {
      found = {found.beyond, kGrowth * found.beyond};
      if (found.beyond > most_force_) return {found.held, std::numeric_limits<double>::infinity()};
    }
    while (found.beyond - found.held > kAccuracy * found.beyond &&
           found.beyond > kLeastForce * most_force_) {
      const double force = 0.5 * (found.held + found.beyond);
      (holds(force) ? found.held : found.beyond) = force;
    }
    return found;
  }

  double stiffnessAt(const ArmModel& model, const Eigen::VectorXd& input) const {
    const ShapeJacobian at = jacobianAt(model, input, {false, true});
    return 1.0 / direction_.dot(at.by_load->tip.topLeftCorner<3, 3>() * direction_);
  }

  void nameEnd(double beyond, Payload& out) const {
    out.end = PayloadEnd::kNone;
    if (!std::isfinite(beyond)) return;
    const InversePoint point = nearest(pushed(beyond), held_.lengths, kDescent);
    out.end = point.residual[0] < kNoBalance ? PayloadEnd::kUnactuated : PayloadEnd::kUnstable;
    const Eigen::VectorXd residual = point.residual.head<3>();
    for (int i = 0; i < point.lengths.size() && out.end != PayloadEnd::kUnstable; ++i) {
      const auto column = point.jacobian.col(i).head<3>();
      if (!box_.holds(i, point.lengths[i], column, residual, point.cost)) continue;
      const double q = model::nearestInput(arm().actuator(i), point.lengths[i]).q;
      out.limits[static_cast<std::size_t>(i)] = box_.nearestLimit(i, q);
      out.end = PayloadEnd::kLimits;
    }
  }

  const ArmModel base_;
  const double tolerance_;  // [m]
  const LengthBox box_;
  InverseSolver inverse_;
  double most_force_ = 0.0;              // [N]
  std::vector<Eigen::VectorXd> starts_;  // lengths (n) of other starts
  Eigen::Vector3d tip_ = Eigen::Vector3d::Zero(), direction_ = Eigen::Vector3d::UnitX();
  InverseResult found_;  // without the force
  Held held_, earlier_;  // the last answer, and the one before
};

PayloadSolver::PayloadSolver(const ArmModel& model, const PayloadOptions& options)
    : search_(std::make_unique<Search>(model, options)) {}
PayloadSolver::~PayloadSolver() = default;
PayloadSolver::PayloadSolver(PayloadSolver&&) noexcept = default;
PayloadSolver& PayloadSolver::operator=(PayloadSolver&&) noexcept = default;

const InverseResult& PayloadSolver::moveTo(const Eigen::Vector3d& tip) {
  return search_->moveTo(tip);
}
bool PayloadSolver::isThere() const { return search_->isThere(); }
Payload PayloadSolver::along(const Eigen::Vector3d& direction) { return search_->along(direction); }
double PayloadSolver::positionTolerance() const { return search_->tolerance(); }
const ArmModel& PayloadSolver::model() const { return search_->model(); }

}  // namespace helix_arm::statics
