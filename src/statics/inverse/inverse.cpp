#include "helix_arm/statics/inverse.hpp"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "box_levenberg_marquardt.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "inverse_task.hpp"
#include "statics/loaded/buckling.hpp"

namespace helix_arm::statics {
namespace {

constexpr double kSmallTurn = 0.02;  // of the whole arm by the force [rad]
constexpr int kPushedOrder = 4;

/// How far small forces move the tip of an arm.
class TipStiffness {
 public:
  /// @throws std::invalid_argument if K_eps of the arm is unknown.
  explicit TipStiffness(const ArmModel& model) {
    const model::Arm& arm = model.arm();
    basics::require(model.load().has_value(),
                    "preference: the tip's stiffness needs arm.stiffness.K_eps_n in every section");
    double bending = 0.0;
    for (int k = 0; k < arm.sectionCount(); ++k) {
      bending += complianceOf(arm, *model.load(), k).bottomRightCorner<3, 3>().norm();
    }
    force_ = kSmallTurn / (bending * arm.restLength());
    const TierSetting exact{Tier::kExact, 0};
    const TierSetting setting = model.choice().setting.tier == Tier::kExact
                                    ? exact
                                    : TierSetting{Tier::kLoaded, kPushedOrder};
    for (int axis = 0; axis < 3; ++axis) {
      for (const double sign : {1.0, -1.0}) {
        Load load = *model.load();
        PointLoad tip;
        tip.section = arm.sectionCount() - 1;
        tip.offset = arm.link(tip.section).translation;
        tip.force = sign * force_ * Eigen::Vector3d::Unit(axis);
        load.points.push_back(tip);
        pushed_.emplace_back(arm, std::nullopt, std::move(load), setting);
      }
    }
  }

  /// Sum over the axes of the tip's motion along a force on it per force [m/N], at free lengths (n)
  /// [m]; infinite where no shape balances the load.
  double compliance(const Eigen::VectorXd& lengths) const {
    double sum = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
      const Tip with = pushed_[2 * axis].tipOfLengths(lengths);
      const Tip against = pushed_[2 * axis + 1].tipOfLengths(lengths);
      if (!with.converged() || !against.converged()) return std::numeric_limits<double>::infinity();
      sum += (with.tip.translation - against.tip.translation)[axis] / (2.0 * force_);
    }
    return sum;
  }

 private:
  double force_;                  // on the tip [N]
  std::vector<ArmModel> pushed_;  // by it along each axis and against it
};

// A residual below this, relative to the arm's length, is a near miss. If the linear model predicts
// a decrease of its square by this fraction, the target may be reachable.
constexpr double kNearMiss = 1e-2;
constexpr double kValleyPromise = 0.5;
constexpr double kValleyGain = 0.9;  // most of the squared residual after a step along a valley
constexpr int kValleyDescent = 25;   // iterations from a step back to the bottom of the valley

/// Continues descents that ended near a target, along a valley of the cost.
///
/// A section that closes to a circle hardly moves its tip when the circle turns about its start: a
/// narrow valley, so curved that a descent makes little progress. This class takes the full step of
/// the linear model along it, descends from there, and only then compares the costs.
class InverseValley {
 public:
  /// @param rest_length  of the arm [m]. @param budget  iterations in valleys per target.
  InverseValley(BoxLevenbergMarquardt& minimiser, int actuators, double rest_length, int budget)
      : minimiser_(minimiser),
        rest_length_(rest_length),
        budget_(budget),
        tangent_(actuators),
        base_lengths_(actuators) {}

  /// Restores the full budget, for a new target.
  void restart() { left_ = budget_; }

  /// @param before  result of the descent to the point. @return result of this descent.
  Descent follow(InversePoint& point, Descent before) {
    const double near = kNearMiss * rest_length_;
    if (before == Descent::kReached || point.cost > near * near) return before;
    bool gained = true;
    while (gained && left_ > 0) {
      minimiser_.linearise(point);
      if (minimiser_.proposeStep(point, kLeastDamping) < kValleyPromise * point.cost) return before;
      tangent_ = minimiser_.proposed() - point.lengths;
      base_lengths_ = point.lengths;
      const double cost = point.cost;
      gained = false;
      for (double fraction = 1.0; !gained && fraction > kLeastStepFraction; fraction *= 0.5) {
        point.lengths = base_lengths_ + fraction * tangent_;
        minimiser_.evaluate(point);
        const int iterations = minimiser_.iterations();
        if (minimiser_.descend(point, kValleyDescent) == Descent::kReached)
          return Descent::kReached;
        left_ -= 1 + minimiser_.iterations() - iterations;
        gained = point.cost < kValleyGain * cost;
      }
      if (gained) continue;
      point.lengths = base_lengths_;
      minimiser_.evaluate(point);
    }
    return gained ? Descent::kExhausted : before;
  }

 private:
  BoxLevenbergMarquardt& minimiser_;
  double rest_length_;
  int budget_;
  int left_ = 0;  // remaining budget
  Eigen::VectorXd tangent_, base_lengths_;
};

constexpr double kStepAtRest = 1e-7;       // of a step, relative to the range of the lengths
constexpr double kWeight = 1e-8;           // against the task, relative to diag(J'J)
constexpr double kFractionStep = 1e-3;     // of differences, of a range
constexpr double kFirstStep = 0.25;        // towards a stiffer tip, of a range
constexpr double kLeastStiffening = 1e-6;  // relative, of a step
constexpr double kLeastSlope = 1e-3;       // of a contraction, relative to its mean
constexpr int kStiffStarts = 24;           // besides the first solution
constexpr std::size_t kStiffDescents = 8;  // from the stiffest of them
constexpr double kApart = 0.15;            // between starts of descents, of the range of a length

/// Optimises the preference among inputs that reach a target, for arms with redundant actuators:
/// moves along those inputs to a local minimum of sum_i ((q_i - q_ref,i) / range_i)^2 or, for
/// kStiff, to the lowest minimum of the tip's compliance among those of several starts.
///
/// Keeps references to arm, box, minimiser, starts and task. All memory is allocated in the
/// constructor, except by kStiff.
class InversePreference {
 public:
  InversePreference(const ArmModel& model, const InverseOptions& options, const LengthBox& box,
                    BoxLevenbergMarquardt& minimiser, InverseStarts& starts,
                    const InverseTask& task)
      : arm_(model.arm()),
        options_(options),
        box_(box),
        minimiser_(minimiser),
        starts_(starts),
        task_(task),
        n_(box.size()),
        reference_(Eigen::VectorXd::Zero(n_)),
        slope_(n_),
        diagonal_(n_),
        gradient_(n_),
        tangent_(n_),
        base_lengths_(n_),
        base_input_(n_) {
    if (options.preference != Preference::kStiff) return;
    stiffness_.emplace(model);
    by_fraction_.resize(n_);
  }

  /// Sets q_ref for a solution that starts at inputs `start` (n).
  void prefer(const model::InputRef& start) noexcept {
    for (int i = 0; i < n_; ++i) {
      const model::Range& limits = arm_.actuator(i).limits;
      const double fraction =
          options_.preference == Preference::kCocontraction ? options_.cocontraction : 0.0;
      reference_[i] = options_.preference == Preference::kMinChange
                          ? start[i]
                          : limits.lower + fraction * (limits.upper - limits.lower);
    }
  }

  /// @param point  evaluated point that reaches the target; modified.
  /// @param input  inputs (n) of the point; modified.
  /// @return the number of steps taken, at most max_iterations from each start.
  int follow(InversePoint& point, Eigen::VectorXd& input) {
    const int steps = settle(point, input);
    return stiffness_ ? steps + searchElsewhere(point, input) : steps;
  }

 private:
  double cost(const Eigen::VectorXd& input) const {
    if (stiffness_) return softness(input);
    double sum = 0.0;
    for (int i = 0; i < n_; ++i) {
      const double u = offset(i, input[i]);
      sum += u * u;
    }
    return sum;
  }

  // Cost of kStiff: logarithm of the compliance at inputs; its gradient by fractions of their
  // ranges.
  double softness(const Eigen::VectorXd& input) const {
    Eigen::VectorXd lengths(n_);
    for (int i = 0; i < n_; ++i) {
      const model::Range& limits = arm_.actuator(i).limits;
      lengths[i] = arm_.actuator(i).contraction.lengthInside(
          std::clamp(input[i], limits.lower, limits.upper));
    }
    return std::log(stiffness_->compliance(lengths));
  }

  // Returns the curvature that makes the first step a quarter of a range.
  double softnessGradient(const Eigen::VectorXd& input) {
    Eigen::VectorXd moved = input;
    for (int i = 0; i < n_; ++i) {
      const model::Range& limits = arm_.actuator(i).limits;
      const double range = limits.upper - limits.lower;
      const double below = std::max(limits.lower, input[i] - kFractionStep * range);
      const double above = std::min(limits.upper, input[i] + kFractionStep * range);
      moved[i] = below;
      const double before = softness(moved);
      moved[i] = above;
      by_fraction_[i] = (softness(moved) - before) * range / (above - below);
      moved[i] = input[i];
    }
    return std::max(by_fraction_.lpNorm<Eigen::Infinity>() / kFirstStep,
                    std::numeric_limits<double>::min());
  }

  // One step: minimises the preference on the tangent of the solution set, then returns to the set.
  // False, without a move, if no step is left.
  bool improve(InversePoint& point, Eigen::VectorXd& input) {
    const double before = cost(input);
    const double curvature = stiffness_ ? softnessGradient(input) : 1.0;
    if (!std::isfinite(before) || !std::isfinite(curvature)) return false;
    minimiser_.linearise(point);
    double mean_weight = 0.0;
    for (int i = 0; i < n_; ++i) {
      const model::Actuator& actuator = arm_.actuator(i);
      const double range = actuator.limits.upper - actuator.limits.lower;
      const double mean_slope = (box_.upper()[i] - box_.lower()[i]) / range;
      // A flat contraction does not determine its input: the slope is bounded away from zero.
      const double slope = actuator.contraction.slopeInside(input[i]);
      const double kept = std::copysign(std::max(std::abs(slope), kLeastSlope * mean_slope), slope);
      slope_[i] = 1.0 / (kept * range);
      mean_weight += slope_[i] * slope_[i] / n_;
    }
    const double weight = kWeight * minimiser_.scale() / mean_weight;
    for (int i = 0; i < n_; ++i) {
      diagonal_[i] = weight * slope_[i] * slope_[i];
      gradient_[i] =
          weight * slope_[i] * (stiffness_ ? by_fraction_[i] / curvature : offset(i, input[i]));
    }
    tangent_ = minimiser_.stepWith(diagonal_, gradient_);
    if ((tangent_.array().abs() <= kStepAtRest * (box_.upper() - box_.lower()).array()).all()) {
      return false;
    }
    base_lengths_ = point.lengths;
    base_input_ = input;
    for (double fraction = 1.0; fraction > kLeastStepFraction; fraction *= 0.5) {
      point.lengths =
          (base_lengths_ + fraction * tangent_).cwiseMax(box_.lower()).cwiseMin(box_.upper());
      minimiser_.evaluate(point);
      if (minimiser_.descend(point, options_.max_iterations) != Descent::kReached) continue;
      box_.readInputs(point.lengths, input);
      if (cost(input) < before - (stiffness_ ? kLeastStiffening : 0.0)) return true;
    }
    point.lengths = base_lengths_;
    input = base_input_;
    minimiser_.evaluate(point);
    return false;
  }

  int settle(InversePoint& point, Eigen::VectorXd& input) {
    int steps = 0;
    while (steps < options_.max_iterations && improve(point, input)) ++steps;
    return steps;
  }

  // A muscle is softest inside its range of inputs, so the compliance has a minimum on either side.
  // Settles from the stiffest of other inputs that reach the target, and keeps the best.
  int searchElsewhere(InversePoint& point, Eigen::VectorXd& input) {
    struct Start {
      double cost;
      InversePoint point;
      Eigen::VectorXd input;
    };
    std::vector<Start> reached;
    for (int s = 0; s < kStiffStarts; ++s) {
      Start start{0.0, point, input};
      start.point.lengths = starts_.next(s, task_).cwiseMax(box_.lower()).cwiseMin(box_.upper());
      minimiser_.evaluate(start.point);
      if (minimiser_.descend(start.point, options_.max_iterations) != Descent::kReached) continue;
      box_.readInputs(start.point.lengths, start.input);
      start.cost = cost(start.input);
      if (std::isfinite(start.cost)) reached.push_back(std::move(start));
    }
    std::sort(reached.begin(), reached.end(),
              [](const Start& a, const Start& b) { return a.cost < b.cost; });
    // Neighbours would settle at the same minimum.
    const Eigen::VectorXd apart = kApart * (box_.upper() - box_.lower());
    std::vector<Start> distinct;
    for (Start& start : reached) {
      const bool near = std::any_of(distinct.begin(), distinct.end(), [&](const Start& other) {
        return ((start.point.lengths - other.point.lengths).array().abs() < apart.array()).all();
      });
      if (!near && distinct.size() < kStiffDescents) distinct.push_back(std::move(start));
    }
    double least = cost(input);
    int steps = 0;
    for (Start& start : distinct) {
      steps += settle(start.point, start.input);
      const double found = cost(start.input);
      if (!(found < least - kLeastStiffening)) continue;
      least = found;
      std::swap(point, start.point);
      std::swap(input, start.input);
    }
    return steps;
  }

  // Difference of an input from its reference, divided by its range.
  double offset(int i, double input) const {
    const model::Range& limits = arm_.actuator(i).limits;
    return (input - reference_[i]) / (limits.upper - limits.lower);
  }

  const model::Arm& arm_;
  const InverseOptions options_;
  const LengthBox& box_;
  BoxLevenbergMarquardt& minimiser_;
  InverseStarts& starts_;
  const InverseTask& task_;
  int n_;
  std::optional<TipStiffness> stiffness_;  // for kStiff
  Eigen::VectorXd reference_;              // q_ref
  Eigen::VectorXd slope_;                  // d((q - q_ref) / range) / dl
  Eigen::VectorXd diagonal_, gradient_;    // of the weighted preference
  Eigen::VectorXd by_fraction_;            // gradient of the softness
  Eigen::VectorXd tangent_, base_lengths_, base_input_;
};

constexpr int kMostLoadedStarts = 6;  // each takes a thousand times as long as without load
constexpr int kValleyBudget = 6000;   // iterations in valleys for one target
constexpr int kLoadedValleyBudget = 60;
constexpr double kSnapFraction = 1e-2;  // of the tolerance: a length closer to a limit is set to it
constexpr double kLimitMargin = 1e-9;   // of an input's range, within which it counts as at a limit
constexpr double kRotationRounding = 1e-6;  // permitted, of a target's R R' from the identity

void requirePositive(const char* name, double value) {
  basics::require(std::isfinite(value) && value > 0, "InverseOptions::", name, " is ",
                  std::to_string(value), "; expected a finite value > 0");
}

// At larger distances, the size of the arm would vanish in rounding.
template <class Target>
void requireNear(const char* what, const Target& target) {
  if (target.allFinite() && target.cwiseAbs().maxCoeff() <= kFarthestTarget) return;
  throw std::invalid_argument(basics::messageOf("the target ", what,
                                                " is not finite, or has an entry beyond ",
                                                std::to_string(kFarthestTarget), " m or rad"));
}

// Checks the options for an arm with or without a load.
InverseOptions checked(InverseOptions options, bool loaded) {
  requirePositive("position_tolerance", options.position_tolerance);
  requirePositive("rotation_weight", options.rotation_weight);
  requirePositive("max_iterations", options.max_iterations);
  requirePositive("max_starts", options.max_starts);
  if (loaded) options.max_starts = std::min(options.max_starts, kMostLoadedStarts);
  basics::require(options.cocontraction >= 0 && options.cocontraction <= 1,
                  "InverseOptions::cocontraction is ", std::to_string(options.cocontraction),
                  "; expected a fraction in [0, 1]");
  return options;
}

}  // namespace

Preference preferenceOf(const std::string& word) {
  for (std::size_t i = 0; i < kPreferenceWords.size(); ++i) {
    if (word == kPreferenceWords[i]) return static_cast<Preference>(i);
  }
  throw std::invalid_argument("prefer is \"" + basics::quoted(word) + "\"; expected one of " +
                              basics::joined(kPreferenceWords));
}

class InverseSolver::Workspace {
 public:
  Workspace(const ArmModel& model, const InverseOptions& options)
      : model_(model),
        arm_(model_.arm()),
        options_(checked(options, !model.isLinear())),
        n_(arm_.actuatorCount()),
        corrected_(model),
        task_(corrected_, options_.rotation_weight),
        box_(arm_),
        minimiser_(task_, box_, options_.position_tolerance),
        valley_(minimiser_, n_, arm_.restLength(),
                model.isLinear() ? kValleyBudget : kLoadedValleyBudget),
        starts_(model, box_),
        preference_(model, options_, box_, minimiser_, starts_, task_),
        input_(n_),
        current_(n_, task_.maxRows()),
        best_(n_, task_.maxRows()) {
    result_.input.resize(n_);
    result_.limits.resize(n_);
  }

  // Not copyable, since its parts refer to each other.
  Workspace(const Workspace&) = delete;
  Workspace& operator=(const Workspace&) = delete;

  void aimAt(const Eigen::Vector3d& position) noexcept {
    answered_ = answered_ && task_.kind() == InverseTask::Kind::kPosition;
    if (answered_) current_.residual.head<3>() += task_.position() - position;
    task_.setPosition(position);
  }
  void aimAt(const lie::SE3& pose) noexcept {
    answered_ = false;
    task_.setPose(pose);
  }
  void aimAt(const model::Twists& twists) noexcept {
    answered_ = false;
    task_.setTwists(twists);
  }

  const InverseResult& solve(const model::InputRef& start) {
    checkStart(start);
    minimiser_.restart();
    // Along a path, each start is the previous answer, whose tip and Jacobian are still valid.
    const bool at_hand = std::exchange(answered_, false) && start == input_;
    for (int i = 0; i < n_; ++i) {
      if (!at_hand) current_.lengths[i] = arm_.actuator(i).contraction.lengthInside(start[i]);
      input_[i] = start[i];
    }
    preference_.prefer(start);
    if (at_hand) {
      current_.cost = current_.residual.head<3>().squaredNorm();
    } else {
      minimiser_.evaluate(current_);
    }
    Descent outcome = minimiser_.descend(current_, options_.max_iterations);
    // Twists are linear in the lengths, so that their squares have one minimum. Tips may have more.
    if (outcome != Descent::kReached && task_.kind() != InverseTask::Kind::kTwists) {
      valley_.restart();
      outcome = valley_.follow(current_, outcome);
      if (outcome != Descent::kReached) outcome = tryOtherStarts(outcome);
    }
    box_.readInputs(current_.lengths, input_);
    int preference_steps = 0;
    if (outcome == Descent::kReached && task_.hasSpareActuators()) {
      preference_steps = preference_.follow(current_, input_);
    }
    snapToLimits();
    result_.iterations = minimiser_.iterations() + preference_steps;
    report(outcome);
    answered_ = result_.status == InverseStatus::kReached;
    return result_;
  }

  void correct(const Correction& correction) {
    corrected_.set(correction);
    answered_ = false;
  }

  void limit(const model::InputRef& lower, const model::InputRef& upper) {
    basics::require(lower.size() == n_ && upper.size() == n_, "got ", lower.size(), " and ",
                    upper.size(), " limits; the arm has ", n_, " actuators");
    for (int i = 0; i < n_; ++i) {
      const model::Range& limits = arm_.actuator(i).limits;
      if (limits.contains(lower[i]) && limits.contains(upper[i]) && lower[i] < upper[i]) continue;
      throw std::invalid_argument("the limits of " + arm_.actuator(i).name + " are " +
                                  std::to_string(lower[i]) + " to " + std::to_string(upper[i]) +
                                  "; expected a range within " + std::to_string(limits.lower) +
                                  " to " + std::to_string(limits.upper));
    }
    box_.limit(lower, upper);
    answered_ = false;
  }

  const model::Arm& arm() const { return arm_; }

 private:
  void checkStart(const model::InputRef& start) const {
    basics::require(start.size() == n_, "the start has ", start.size(), " inputs; the arm has ", n_,
                    " actuators");
    for (int i = 0; i < n_; ++i) {
      if (!box_.limits(i).contains(start[i])) {
        throw std::invalid_argument("the start is outside the limits of " + arm_.actuator(i).name +
                                    ": " + std::to_string(start[i]));
      }
    }
  }

  // Leaves the best of the starts in current_: converged if any start as good has converged.
  Descent tryOtherStarts(Descent first) {
    const double infinity = std::numeric_limits<double>::infinity();
    double rest_cost = first == Descent::kAtRest ? current_.cost : infinity;
    std::swap(best_, current_);
    for (int s = 0; s < options_.max_starts; ++s) {
      current_.lengths = starts_.next(s, task_).cwiseMax(box_.lower()).cwiseMin(box_.upper());
      minimiser_.evaluate(current_);
      const Descent descent =
          valley_.follow(current_, minimiser_.descend(current_, options_.max_iterations));
      if (descent == Descent::kReached) return descent;
      if (descent == Descent::kAtRest) rest_cost = std::min(rest_cost, current_.cost);
      if (current_.cost < best_.cost) std::swap(best_, current_);
    }
    std::swap(best_, current_);
    const bool at_rest =
        std::sqrt(rest_cost) <= std::sqrt(current_.cost) + options_.position_tolerance;
    return at_rest ? Descent::kAtRest : Descent::kExhausted;
  }

  // A length within rounding of a limit is set to it.
  void snapToLimits() {
    const double near = kSnapFraction * options_.position_tolerance;
    bool snapped = false;
    for (int i = 0; i < n_; ++i) {
      for (const double bound : {box_.lower()[i], box_.upper()[i]}) {
        if (current_.lengths[i] == bound || std::abs(current_.lengths[i] - bound) > near) continue;
        current_.lengths[i] = bound;
        snapped = true;
      }
    }
    if (!snapped) return;
    box_.readInputs(current_.lengths, input_);
    minimiser_.evaluate(current_);
  }

  void report(Descent outcome) {
    result_.status = outcome == Descent::kReached  ? InverseStatus::kReached
                     : outcome == Descent::kAtRest ? InverseStatus::kUnreachable
                                                   : InverseStatus::kNotConverged;
    result_.input = input_;
    result_.residual = std::sqrt(current_.cost);
    if (result_.residual <= options_.position_tolerance) result_.status = InverseStatus::kReached;
    result_.position_error = task_.kind() == InverseTask::Kind::kPosition ? result_.residual
                             : task_.kind() == InverseTask::Kind::kPose
                                 ? current_.residual.head<3>().norm()
                                 : task_.positionError(current_.lengths);
    for (int i = 0; i < n_; ++i) {
      const model::Range& limits = box_.limits(i);
      const double margin = kLimitMargin * (limits.upper - limits.lower);
      result_.limits[i] = input_[i] <= limits.lower + margin   ? Limit::kLower
                          : input_[i] >= limits.upper - margin ? Limit::kUpper
                                                               : Limit::kNone;
    }
    if (result_.residual < kNoBalance) return;
    result_.status = InverseStatus::kNotConverged;
    result_.residual = result_.position_error = std::numeric_limits<double>::infinity();
  }

  const ArmModel model_;
  const model::Arm& arm_;
  const InverseOptions options_;
  const int n_;
  CorrectedModel corrected_;
  InverseTask task_;
  LengthBox box_;
  BoxLevenbergMarquardt minimiser_;
  InverseValley valley_;
  InverseStarts starts_;
  InversePreference preference_;
  Eigen::VectorXd input_;  // inputs at the current lengths, and initial guess for the next ones
  InversePoint current_, best_;
  bool answered_ = false;  // whether current_ is the last answer, to a target of this kind
  InverseResult result_;
};

InverseSolver::InverseSolver(const ArmModel& model, const InverseOptions& options)
    : workspace_(std::make_unique<Workspace>(model, options)) {}
InverseSolver::~InverseSolver() = default;
InverseSolver::InverseSolver(InverseSolver&&) noexcept = default;
InverseSolver& InverseSolver::operator=(InverseSolver&&) noexcept = default;

void InverseSolver::limit(const model::InputRef& lower, const model::InputRef& upper) {
  workspace_->limit(lower, upper);
}

void InverseSolver::correct(const Correction& correction) { workspace_->correct(correction); }

const InverseResult& InverseSolver::toPosition(const Eigen::Vector3d& position,
                                               const model::InputRef& start) {
  requireNear("position", position);
  workspace_->aimAt(position);
  return workspace_->solve(start);
}

const InverseResult& InverseSolver::toPose(const lie::SE3& pose, const model::InputRef& start) {
  requireNear("position", pose.translation);
  const Eigen::Matrix3d& R = pose.rotation;
  basics::require((R * R.transpose() - Eigen::Matrix3d::Identity()).norm() <= kRotationRounding &&
                      R.determinant() > 0,
                  "the target's rotation is not orthogonal and right-handed");
  workspace_->aimAt(pose);
  return workspace_->solve(start);
}

const InverseResult& InverseSolver::toTwists(const model::Twists& twists,
                                             const model::InputRef& start) {
  const int sections = workspace_->arm().sectionCount();
  basics::require(twists.cols() == sections, "got twists of ", twists.cols(),
                  " sections; the arm has ", sections);
  requireNear("twists", twists);
  workspace_->aimAt(twists);
  return workspace_->solve(start);
}

}  // namespace helix_arm::statics
