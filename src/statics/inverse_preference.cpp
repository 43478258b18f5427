#include "inverse_preference.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::statics {
namespace {

constexpr double kStepAtRest = 1e-7;       // of a step, relative to the range of the lengths
constexpr double kWeight = 1e-8;           // against the task, relative to diag(J'J)
constexpr double kFractionStep = 1e-3;     // of differences, of a range
constexpr double kFirstStep = 0.25;        // towards a stiffer tip, of a range
constexpr double kLeastStiffening = 1e-6;  // relative, of a step
constexpr double kLeastSlope = 1e-3;       // of a contraction, relative to its mean
constexpr int kStiffStarts = 24;           // besides the first solution
constexpr std::size_t kStiffDescents = 8;  // from the stiffest of them
constexpr double kApart = 0.15;            // between starts of descents, of the range of a length

}  // namespace

InversePreference::InversePreference(const model::Arm& arm, const InverseOptions& options,
                                     const LengthBox& box, BoxLevenbergMarquardt& minimiser,
                                     InverseStarts& starts, const InverseTask& task,
                                     const ArmModel* model)
    : arm_(arm),
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
  basics::require(model != nullptr, "preference: the tip's stiffness needs the arm's ArmModel");
  stiffness_.emplace(*model);
  by_fraction_.resize(n_);
}

double InversePreference::softness(const Eigen::VectorXd& input) const noexcept {
  Eigen::VectorXd lengths(n_);
  for (int i = 0; i < n_; ++i) {
    const model::Range& limits = arm_.actuator(i).limits;
    lengths[i] =
        arm_.actuator(i).contraction.lengthInside(std::clamp(input[i], limits.lower, limits.upper));
  }
  return std::log(stiffness_->compliance(lengths));
}

// Returns the curvature that makes the first step a quarter of a range.
double InversePreference::softnessGradient(const Eigen::VectorXd& input) noexcept {
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

void InversePreference::prefer(const model::InputRef& start) noexcept {
  for (int i = 0; i < n_; ++i) {
    const model::Range& limits = arm_.actuator(i).limits;
    const double fraction =
        options_.preference == Preference::kCocontraction ? options_.cocontraction : 0.0;
    reference_[i] = options_.preference == Preference::kMinChange
                        ? start[i]
                        : limits.lower + fraction * (limits.upper - limits.lower);
  }
}

double InversePreference::offset(int i, double input) const {
  const model::Range& limits = arm_.actuator(i).limits;
  return (input - reference_[i]) / (limits.upper - limits.lower);
}

double InversePreference::cost(const Eigen::VectorXd& input) const noexcept {
  if (stiffness_) return softness(input);
  double sum = 0.0;
  for (int i = 0; i < n_; ++i) {
    const double u = offset(i, input[i]);
    sum += u * u;
  }
  return sum;
}

int InversePreference::follow(InversePoint& point, Eigen::VectorXd& input) noexcept {
  const int steps = settle(point, input);
  return stiffness_ ? steps + searchElsewhere(point, input) : steps;
}

int InversePreference::settle(InversePoint& point, Eigen::VectorXd& input) noexcept {
  int steps = 0;
  while (steps < options_.max_iterations && improve(point, input)) ++steps;
  return steps;
}

// A muscle is softest inside its range of inputs, so the compliance has a minimum on either side.
// Settles from the stiffest of other inputs that reach the target, and keeps the best.
int InversePreference::searchElsewhere(InversePoint& point, Eigen::VectorXd& input) noexcept {
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

// One step: minimises the preference on the tangent of the solution set, then returns to the set.
// False, without a move, if no step is left.
bool InversePreference::improve(InversePoint& point, Eigen::VectorXd& input) noexcept {
  const double before = cost(input);
  const double curvature = stiffness_ ? softnessGradient(input) : 1.0;
  if (!std::isfinite(before) || !std::isfinite(curvature)) return false;
  minimiser_.linearise(point);
  double mean_weight = 0.0;
  for (int i = 0; i < n_; ++i) {
    const model::Actuator& actuator = arm_.actuator(i);
    const double range = actuator.limits.upper - actuator.limits.lower;
    const double mean_slope = (box_.upper()[i] - box_.lower()[i]) / range;
    // Where the contraction is flat, a length does not determine its input, so the slope is bounded
    // away from zero.
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

}  // namespace helix_arm::statics
