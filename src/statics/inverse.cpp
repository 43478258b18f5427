#include "helix_arm/statics/inverse.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "box_levenberg_marquardt.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "inverse_preference.hpp"
#include "inverse_starts.hpp"
#include "inverse_task.hpp"
#include "inverse_valley.hpp"
#include "length_box.hpp"

namespace helix_arm::statics {

Preference preferenceOf(const std::string& word) {
  std::string list;
  for (std::size_t i = 0; i < kPreferenceWords.size(); ++i) {
    if (word == kPreferenceWords[i]) return static_cast<Preference>(i);
    list += (list.empty() ? "" : ", ") + std::string(kPreferenceWords[i]);
  }
  throw std::invalid_argument("prefer is \"" + basics::quoted(word) + "\"; expected one of " +
                              list);
}

namespace {

constexpr int kMostLoadedStarts = 6;  // each takes a thousand times as long as without load
constexpr int kValleyBudget = 6000;   // iterations in valleys for one target
constexpr int kLoadedValleyBudget = 60;
constexpr double kSnapFraction = 1e-2;  // of the tolerance: a length closer to a limit is set to it
constexpr double kLimitMargin =
    1e-9;  // of an input's range: an input closer to a limit counts as at it
constexpr double kRotationRounding =
    1e-6;  // permitted deviation of R R' of a target from the identity

void requirePositive(const char* name, double value) {
  if (std::isfinite(value) && value > 0) return;
  throw std::invalid_argument("InverseOptions::" + std::string(name) + " is " +
                              std::to_string(value) + "; expected a finite value > 0");
}

// At larger distances, the size of the arm would vanish in rounding.
template <class Target>
void requireNear(const char* what, const Target& target) {
  if (target.allFinite() && target.cwiseAbs().maxCoeff() <= kFarthestTarget) return;
  throw std::invalid_argument("the target " + std::string(what) +
                              " is not finite, or has an entry beyond " +
                              std::to_string(kFarthestTarget) + " m or rad");
}

// Checks the options for an arm with or without a load.
InverseOptions checked(InverseOptions options, bool loaded) {
  requirePositive("position_tolerance", options.position_tolerance);
  requirePositive("rotation_weight", options.rotation_weight);
  requirePositive("max_iterations", options.max_iterations);
  requirePositive("max_starts", options.max_starts);
  if (loaded) options.max_starts = std::min(options.max_starts, kMostLoadedStarts);
  if (!(options.cocontraction >= 0 && options.cocontraction <= 1)) {
    throw std::invalid_argument("InverseOptions::cocontraction is " +
                                std::to_string(options.cocontraction) +
                                "; expected a fraction in [0, 1]");
  }
  return options;
}

}  // namespace

class InverseSolver::Workspace {
 public:
  // @param model  null if only the arm is known. @param loaded  the same if it is not linear.
  Workspace(const model::Arm& arm, const ArmModel* model, const ArmModel* loaded,
            const InverseOptions& options);
  // Not copyable, since its parts refer to each other.
  Workspace(const Workspace&) = delete;
  Workspace& operator=(const Workspace&) = delete;

  void aimAt(const Eigen::Vector3d& position) noexcept;
  void aimAt(const lie::SE3& pose) noexcept;
  void aimAt(const model::Twists& twists) noexcept;
  const InverseResult& solve(const model::InputRef& start);
  void correct(const Correction& correction);
  void limit(const model::InputRef& lower, const model::InputRef& upper);
  const model::Arm& arm() const { return arm_; }

 private:
  void checkStart(const model::InputRef& start) const;
  Descent tryOtherStarts(Descent first) noexcept;
  void snapToLimits() noexcept;
  void report(Descent outcome) noexcept;

  const model::Arm& arm_;
  const InverseOptions options_;
  const int n_;
  InverseTask task_;
  CorrectedModel corrected_;
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

InverseSolver::Workspace::Workspace(const model::Arm& arm, const ArmModel* model,
                                    const ArmModel* loaded, const InverseOptions& options)
    : arm_(arm),
      options_(checked(options, loaded != nullptr)),
      n_(arm.actuatorCount()),
      task_(arm, loaded, options_.rotation_weight),
      corrected_(arm, loaded),
      box_(arm),
      minimiser_(task_, box_, options_.position_tolerance),
      valley_(minimiser_, n_, arm.restLength(),
              loaded != nullptr ? kLoadedValleyBudget : kValleyBudget),
      starts_(arm, loaded, box_),
      preference_(arm, options_, box_, minimiser_, starts_, task_, model),
      input_(n_),
      current_(n_, task_.maxRows()),
      best_(n_, task_.maxRows()) {
  result_.input.resize(n_);
  result_.limits.resize(n_);
}

void InverseSolver::Workspace::checkStart(const model::InputRef& start) const {
  if (start.size() != n_) {
    throw std::invalid_argument("the start has " + std::to_string(start.size()) +
                                " inputs; the arm has " + std::to_string(n_) + " actuators");
  }
  for (int i = 0; i < n_; ++i) {
    if (!box_.limits(i).contains(start[i])) {
      throw std::invalid_argument("the start is outside the limits of " + arm_.actuator(i).name +
                                  ": " + std::to_string(start[i]));
    }
  }
}

void InverseSolver::Workspace::correct(const Correction& correction) {
  corrected_.set(correction);
  task_.correctBy(corrected_);
  answered_ = false;
}

void InverseSolver::Workspace::limit(const model::InputRef& lower, const model::InputRef& upper) {
  if (lower.size() != n_ || upper.size() != n_) {
    throw std::invalid_argument("got " + std::to_string(lower.size()) + " and " +
                                std::to_string(upper.size()) + " limits; the arm has " +
                                std::to_string(n_) + " actuators");
  }
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

void InverseSolver::Workspace::aimAt(const Eigen::Vector3d& position) noexcept {
  answered_ = answered_ && task_.kind() == InverseTask::Kind::kPosition;
  if (answered_) current_.residual.head<3>() += task_.position() - position;
  task_.setPosition(position);
}

void InverseSolver::Workspace::aimAt(const lie::SE3& pose) noexcept {
  answered_ = false;
  task_.setPose(pose);
}

void InverseSolver::Workspace::aimAt(const model::Twists& twists) noexcept {
  answered_ = false;
  task_.setTwists(twists);
}

const InverseResult& InverseSolver::Workspace::solve(const model::InputRef& start) {
  checkStart(start);
  minimiser_.restart();
  // Along a path, each start is the previous answer, whose tip and Jacobian are still valid.
  const bool at_hand = answered_ && start == input_;
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
  // Twists are linear in the lengths, so their least squares have one minimum. Tips may have local
  // minima.
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

// Leaves the best of the starts in current_. It counts as converged if any start as good has
// converged.
Descent InverseSolver::Workspace::tryOtherStarts(Descent first) noexcept {
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
void InverseSolver::Workspace::snapToLimits() noexcept {
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

void InverseSolver::Workspace::report(Descent outcome) noexcept {
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

InverseSolver::InverseSolver(const model::Arm& arm, const InverseOptions& options)
    : workspace_(std::make_unique<Workspace>(arm, nullptr, nullptr, options)) {
  basics::require(!arm.tapered(), "inverse: the arm is tapered; expected its ArmModel");
}
InverseSolver::InverseSolver(const ArmModel& model, const InverseOptions& options)
    : workspace_(std::make_unique<Workspace>(model.arm(), &model,
                                             model.isLinear() ? nullptr : &model, options)) {}
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
  if (!((R * R.transpose() - Eigen::Matrix3d::Identity()).norm() <= kRotationRounding &&
        R.determinant() > 0)) {
    throw std::invalid_argument("the target's rotation is not orthogonal and right-handed");
  }
  workspace_->aimAt(pose);
  return workspace_->solve(start);
}

const InverseResult& InverseSolver::toTwists(const model::Twists& twists,
                                             const model::InputRef& start) {
  const int sections = workspace_->arm().sectionCount();
  if (twists.cols() != sections) {
    throw std::invalid_argument("got twists of " + std::to_string(twists.cols()) +
                                " sections; the arm has " + std::to_string(sections));
  }
  requireNear("twists", twists);
  workspace_->aimAt(twists);
  return workspace_->solve(start);
}

}  // namespace helix_arm::statics
