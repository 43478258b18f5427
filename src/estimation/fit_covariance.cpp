#include "fit_covariance.hpp"

#include <algorithm>
#include <cmath>

namespace helix_arm::estimation {

double ellipsoidScale(double directions, double freedom) {
  constexpr double kNormal95 = 1.6449;
  constexpr double kLambda = (kNormal95 * kNormal95 - 3) / 6;
  constexpr double kFewest = 2;  // with fewer, the formula is not accurate
  const double per_direction = 1 / (std::max(directions, kFewest) - 1);
  const auto logOfQuantile = [per_direction](double per_freedom) {
    const double h = 2 / (per_direction + per_freedom);
    return 2 * (kNormal95 * std::sqrt(h + kLambda) / h -
                (per_direction - per_freedom) * (kLambda + 5.0 / 6 - 2 / (3 * h)));
  };
  return std::exp(logOfQuantile(1 / (freedom - 1)) - logOfQuantile(0));
}

}  // namespace helix_arm::estimation
