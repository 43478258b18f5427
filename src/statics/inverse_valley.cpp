#include "inverse_valley.hpp"

namespace helix_arm::statics {
namespace {

// A residual below this, relative to the arm's length, is a near miss. If the linear model predicts
// a decrease of its square by this fraction, the target may be reachable.
constexpr double kNearMiss = 1e-2;
constexpr double kValleyPromise = 0.5;
constexpr double kValleyGain =
    0.9;  // required decrease factor of the squared residual by a step along a valley
constexpr int kValleyDescent = 25;  // iterations from a step back to the bottom of the valley

}  // namespace

InverseValley::InverseValley(BoxLevenbergMarquardt& minimiser, int actuators, double rest_length,
                             int budget)
    : minimiser_(minimiser),
      rest_length_(rest_length),
      budget_(budget),
      tangent_(actuators),
      base_lengths_(actuators) {}

Descent InverseValley::follow(InversePoint& point, Descent before) noexcept {
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
      if (minimiser_.descend(point, kValleyDescent) == Descent::kReached) return Descent::kReached;
      left_ -= 1 + minimiser_.iterations() - iterations;
      gained = point.cost < kValleyGain * cost;
    }
    if (gained) continue;
    point.lengths = base_lengths_;
    minimiser_.evaluate(point);
  }
  return gained ? Descent::kExhausted : before;
}

}  // namespace helix_arm::statics
