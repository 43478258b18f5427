#include <algorithm>
#include <cmath>

#include "calibration_checks.hpp"
#include "calibration_problem.hpp"

namespace helix_arm::estimation {
namespace {

// K_kappa is searched within this factor (as a log) of the scene's, to this precision.
constexpr double kScanWidth = 4.6;
constexpr int kScanSteps = 400;
constexpr double kScanPrecision = 1e-7;

}  // namespace

std::optional<LeastTipError> fitLeastTipError(const std::vector<ArmCaptures>& arms) {
  const std::vector<ArmCaptures> read = withReadings(arms);
  if (unsound(read)) return std::nullopt;
  CalibrationOptions options;
  options.K_gamma = false;
  if (unfit(read, options, kindOf(firstReading(read)))) return std::nullopt;
  CalibrationProblem problem(read, options, selectionOf(options));
  const auto errorAt = [&problem](double log_kappa) {
    problem.values().stiffness[0] = log_kappa;
    double sum = 0;
    const std::vector<Comparison> comparisons = problem.compare(1.0);
    for (const Comparison& one : comparisons) sum += one.error;
    return sum / static_cast<double>(comparisons.size());
  };
  // A mean of distances may have several minima: scan, then golden-section search around the best.
  double best = 0, least = errorAt(0);
  for (int step = -kScanSteps; step <= kScanSteps; ++step) {
    const double at = kScanWidth * step / kScanSteps, error = errorAt(at);
    if (error < least) {
      least = error;
      best = at;
    }
  }
  if (std::abs(best) == kScanWidth) return std::nullopt;
  const double golden = 0.5 * (std::sqrt(5.0) - 1), width = kScanWidth / kScanSteps;
  double lower = best - width, upper = best + width;
  while (upper - lower > kScanPrecision) {
    const double a = upper - golden * (upper - lower), b = lower + golden * (upper - lower);
    if (errorAt(a) < errorAt(b)) {
      upper = b;
    } else {
      lower = a;
    }
  }
  const double log_kappa = 0.5 * (lower + upper), error = errorAt(log_kappa);
  return LeastTipError{problem.stiffness().kappa, error};
}

}  // namespace helix_arm::estimation
