#include "box_levenberg_marquardt.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace helix_arm::statics {
namespace {

// Below the tolerance, which leaves room for rounding when lengths become inputs.
constexpr double kGoalFraction = 0.1;
constexpr double kAtRest = 1e-13;  // relative decrease below which the descent ends
// A residual counts as minimal if no step shortens it by a thousandth of the tolerance; twice that,
// since the decrease is that of the square.
constexpr double kRestFraction = 2e-3;
constexpr double kNewtonGain = 0.1;  // accepted decrease of the cost by an undamped step

// A step is accepted if it gains this fraction of the decrease that the linear model predicts.
constexpr double kLeastRatio = 1e-3;
// The damping falls above the first ratio and rises below the second.
constexpr double kGoodRatio = 0.75;
constexpr double kPoorRatio = 0.25;
constexpr double kDampingFall = 0.1;
constexpr double kDampingRise = 4.0;
constexpr double kDampingRiseRefused = 8.0;    // after a step that was rejected
constexpr double kLeastDampingRefused = 1e-4;  // and at least to this

}  // namespace

BoxLevenbergMarquardt::BoxLevenbergMarquardt(const InverseTask& task, const LengthBox& box,
                                             double tolerance)
    : task_(task),
      box_(box),
      tolerance_(tolerance),
      n_(box.size()),
      trial_(n_, task.maxRows()),
      step_(n_),
      normal_(n_, n_) {}

void BoxLevenbergMarquardt::evaluate(InversePoint& point) const {
  task_.evaluate(point.lengths, point.residual, point.jacobian);
  point.cost = point.residual.head(task_.rows()).squaredNorm();
}

template <int kRows>
void BoxLevenbergMarquardt::sumNormalEquations(const InversePoint& point) noexcept {
  const Eigen::Index rows = task_.rows();
  double trace = 0.0;
  for (int i = 0; i < n_; ++i) {
    const auto column = point.jacobian.col(i).head<kRows>(rows);
    for (int j = 0; j <= i; ++j)
      normal_(i, j) = column.dot(point.jacobian.col(j).head<kRows>(rows));
    trace += normal_(i, i);
    step_.g[i] = column.dot(point.residual.head<kRows>(rows));
  }
  scale_ = trace / n_ + std::numeric_limits<double>::min();
}

void BoxLevenbergMarquardt::buildNormalEquations(const InversePoint& point) noexcept {
  // A position has three rows; the fixed size saves a tenth of the time of a solution.
  task_.rows() == 3 ? sumNormalEquations<3>(point) : sumNormalEquations<Eigen::Dynamic>(point);
}

void BoxLevenbergMarquardt::linearise(const InversePoint& point) noexcept {
  buildNormalEquations(point);
  for (int i = 0; i < n_; ++i) {
    step_.lower[i] = box_.lower()[i] - point.lengths[i];
    step_.upper[i] = box_.upper()[i] - point.lengths[i];
  }
}

// For three muscles and a position, solves the square system directly, at a third of the cost of
// the normal equations. Returns false if that leaves the box or gains little: damped steps follow.
bool BoxLevenbergMarquardt::takeNewtonStep(InversePoint& point) {
  const Eigen::Matrix3d J = point.jacobian.topRows<3>();
  const Eigen::Vector3d a = J.col(0), b = J.col(1), c = J.col(2), r = point.residual.head<3>();
  const Eigen::Vector3d bc = b.cross(c),
                        rows = Eigen::Vector3d(bc.dot(r), c.cross(a).dot(r), a.cross(b).dot(r));
  trial_.lengths = point.lengths - rows / a.dot(bc);
  const bool inside = (trial_.lengths.array() >= box_.lower().array()).all() &&
                      (trial_.lengths.array() <= box_.upper().array()).all();
  if (!inside) return false;
  evaluate(trial_);
  if (!(trial_.cost < kNewtonGain * point.cost)) return false;
  std::swap(point, trial_);
  return true;
}

double BoxLevenbergMarquardt::proposeStep(const InversePoint& point, double damping) noexcept {
  for (int a = 0; a < n_; ++a) {
    for (int b = 0; b < a; ++b) step_.H(a, b) = normal_(a, b);
    step_.H(a, a) = normal_(a, a) + damping * scale_;
  }
  const Eigen::VectorXd& delta = step_.solve();
  double promised = 0.0;
  for (int a = 0; a < n_; ++a) {
    double row = 0.5 * normal_(a, a) * delta[a];
    for (int b = 0; b < a; ++b) row += normal_(a, b) * delta[b];
    promised -= 2.0 * delta[a] * (step_.g[a] + row);
    trial_.lengths[a] =
        std::min(std::max(point.lengths[a] + delta[a], box_.lower()[a]), box_.upper()[a]);
  }
  return promised;
}

const Eigen::VectorXd& BoxLevenbergMarquardt::stepWith(const Eigen::VectorXd& diagonal,
                                                       const Eigen::VectorXd& gradient) noexcept {
  for (int a = 0; a < n_; ++a) {
    for (int b = 0; b < a; ++b) step_.H(a, b) = normal_(a, b);
    step_.H(a, a) = normal_(a, a) + diagonal[a];
    step_.g[a] += gradient[a];
  }
  return step_.solve();
}

Descent BoxLevenbergMarquardt::descend(InversePoint& point, int most_iterations) {
  const double goal = std::pow(kGoalFraction * tolerance_, 2);
  const double rest_gain = kRestFraction * tolerance_;
  double damping = kLeastDamping;
  bool fresh = true;
  bool newton = n_ == 3 && task_.rows() == 3 && !task_.hasSpareActuators();
  for (int i = 0; i < most_iterations; ++i) {
    if (point.cost <= goal) return Descent::kReached;
    ++iterations_;
    if (newton) {
      newton = takeNewtonStep(point);
      if (newton) continue;
    }
    if (fresh) linearise(point);
    const double promised = proposeStep(point, damping);
    if (promised <= std::max(kAtRest * point.cost, rest_gain * std::sqrt(point.cost))) {
      return Descent::kAtRest;
    }
    evaluate(trial_);
    const double ratio = (point.cost - trial_.cost) / promised;
    fresh = ratio > kLeastRatio;
    if (fresh) {
      std::swap(point, trial_);
      damping = std::max(ratio > kGoodRatio   ? kDampingFall * damping
                         : ratio < kPoorRatio ? kDampingRise * damping
                                              : damping,
                         kLeastDamping);
    } else {
      damping = std::max(kDampingRiseRefused * damping, kLeastDampingRefused);
    }
  }
  return point.cost <= goal ? Descent::kReached : Descent::kExhausted;
}

}  // namespace helix_arm::statics
