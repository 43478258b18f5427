#include "calibration_descent.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace helix_arm::estimation {
namespace {

// Prior of a direction of the stiffness logs that is held.
constexpr double kHeldDeviation = 1e-4;
// Convergence: the last step lowers the cost by less. A parameter that is off by its standard error
// costs 0.5. With the robust loss, steps may shrink slowly long after they matter.
constexpr double kSettledStep = 1e-4;
constexpr double kParameterTolerance = 1e-10;
constexpr double kGradientTolerance = 1e-10;
// Fraction of the cost; a step that is expected to lower it by less is probably the last.
constexpr double kLastStep = 1e-8;

// Trust region: the damping is the clamped diagonal of J'WJ, in units of the columns' initial
// sizes, over the radius.
constexpr double kFirstRadius = 1e4, kLargestRadius = 1e16, kLeastRadius = 1e-32;
constexpr double kLeastDiagonal = 1e-6, kMostDiagonal = 1e32;
// Least ratio of a step's decrease to the expected one.
constexpr double kLeastDecrease = 1e-3;
constexpr int kMostInvalidSteps = 5;

class Radius {
 public:
  double value() const { return radius_; }
  void accept(double quality) {
    radius_ /= std::max(1.0 / 3, 1 - std::pow(2 * quality - 1, 3));
    radius_ = std::min(radius_, kLargestRadius);
    shrink_ = 2;
  }
  void reject() {
    radius_ /= shrink_;
    shrink_ *= 2;
  }

 private:
  double radius_ = kFirstRadius, shrink_ = 2;
};

}  // namespace

CalibrationDescent::CalibrationDescent(Shared& shared, ReadingKind kind,
                                       const std::vector<Place>& places,
                                       const std::vector<ReadingTerm>& terms,
                                       ParameterBlocks& blocks)
    : terms_(terms),
      blocks_(blocks),
      equations_(blocks, terms,
                 shared.selection.free_shapes ? ParameterBlock::kShape : ParameterBlock::kTag),
      here_(std::make_unique<LinearisedReadings>(shared, kind, places, terms)),
      there_(std::make_unique<LinearisedReadings>(shared, kind, places, terms)) {}

const LinearisedReadings& CalibrationDescent::readings(const Included& included, bool derivatives) {
  here_->update(blocks_.values(), blocks_.numbers(), included, derivatives);
  return *here_;
}

ArrowEquations& CalibrationDescent::equations(double noise_scale, const Included& included) {
  assemble({noise_scale, included}, readings(included, true), blocks_.numbers());
  return equations_;
}

double CalibrationDescent::cost(const DescentTask& task, const LinearisedReadings& readings,
                                const Eigen::VectorXd& numbers) const {
  const double inverse2 = 1 / (task.noise_scale * task.noise_scale);
  double sum = 0;
  for (std::size_t t = 0; t < terms_.size(); ++t) {
    if (!task.included(terms_[t].cost->place().capture)) continue;
    sum += terms_[t].loss(inverse2 * readings.square(t));
  }
  for (const ParameterBlocks::Block& block : blocks_.all()) {
    if (!takesPart(block, task.included)) continue;
    const auto offset = numbers.segment(block.column, block.size()) - block.mean;
    sum += offset.cwiseQuotient(block.deviation).squaredNorm();
    if (task.held == nullptr || block.kind != ParameterBlock::kStiffness) continue;
    const auto moved = (numbers - start_).segment(block.column, block.size());
    sum += std::pow(task.held->dot(moved) / kHeldDeviation, 2);
  }
  return std::isfinite(sum) ? sum / 2 : std::numeric_limits<double>::quiet_NaN();
}

void CalibrationDescent::assemble(const DescentTask& task, const LinearisedReadings& readings,
                                  const Eigen::VectorXd& numbers) {
  const double inverse2 = 1 / (task.noise_scale * task.noise_scale);
  equations_.clear([&](const auto& block) { return takesPart(block, task.included); });
  for (std::size_t b = 0; b < blocks_.all().size(); ++b) {
    const ParameterBlocks::Block& block = blocks_.all()[b];
    if (!takesPart(block, task.included)) continue;
    equations_.addPrior(b, numbers.segment(block.column, block.size()) - block.mean);
    if (task.held == nullptr || block.kind != ParameterBlock::kStiffness) continue;
    const Eigen::VectorXd moved = (numbers - start_).segment(block.column, block.size());
    equations_.addDirection(b, *task.held, kHeldDeviation, task.held->dot(moved));
  }
  for (std::size_t t = 0; t < terms_.size(); ++t) {
    const double square = inverse2 * readings.square(t);
    if (!task.included(terms_[t].cost->place().capture) || !std::isfinite(square)) continue;
    equations_.addTerm(t, readings.jacobian(t), inverse2 * terms_[t].weight(square));
  }
}

Solved CalibrationDescent::solve(const DescentTask& task) {
  Eigen::VectorXd now = start_ = blocks_.numbers();
  here_->update(blocks_.values(), now, task.included, true);
  Solved out{false, cost(task, *here_, now)};
  if (std::isnan(out.cost)) return out;
  assemble(task, *here_, now);
  const auto isFlat = [this] {
    const Eigen::VectorXd gradient = equations_.gradient();
    return gradient.size() == 0 || gradient.cwiseAbs().maxCoeff() <= kGradientTolerance;
  };
  out.converged = isFlat();
  const Eigen::ArrayXd unit2 = (1 + equations_.diagonal().array().sqrt()).square();
  Radius radius;
  int invalid = 0;
  bool settled = false;  // whether the last step was one, and small
  for (int n = 0; !out.converged; ++n) {
    if (n == task.max_iterations) {
      out.converged = settled;
      break;
    }
    settled = false;
    const Eigen::ArrayXd diagonal = equations_.diagonal().array();
    const Eigen::VectorXd damping =
        (diagonal / unit2).max(kLeastDiagonal).min(kMostDiagonal) * unit2 / radius.value();
    Eigen::VectorXd step;
    double expected = 0;  // decrease of the cost
    if (equations_.factor(damping)) {
      step = equations_.step();
      expected = 0.5 * (step.dot(damping.cwiseProduct(step)) - step.dot(equations_.gradient()));
    }
    if (!(expected > 0) || !step.allFinite()) {
      if (++invalid >= kMostInvalidSteps) break;
      radius.reject();
      continue;
    }
    invalid = 0;
    if (expected <= task.tolerance * out.cost) {
      out.converged = true;
      break;
    }
    const Eigen::VectorXd next = now + step;
    blocks_.setNumbers(next);
    const bool derivatives = expected > kLastStep * out.cost;
    there_->update(blocks_.values(), next, task.included, derivatives);
    const double cost_there = cost(task, *there_, next);
    const double decrease = out.cost - cost_there;
    const bool at_end = step.norm() <= kParameterTolerance * (now.norm() + kParameterTolerance) ||
                        std::abs(decrease) <= task.tolerance * out.cost;
    // Without derivatives there, the end is here, where they are known.
    const bool better = decrease > kLeastDecrease * expected && (derivatives || !at_end);
    if (!better) {
      blocks_.setNumbers(now);
      radius.reject();
      out.converged = at_end || radius.value() < kLeastRadius;
      continue;
    }
    radius.accept(decrease / expected);
    now = next;
    out.cost = cost_there;
    there_->update(blocks_.values(), now, task.included, true);
    std::swap(here_, there_);
    settled = decrease < kSettledStep;
    if (!at_end) assemble(task, *here_, now);
    out.converged = at_end || isFlat();
  }
  return out;
}

}  // namespace helix_arm::estimation
