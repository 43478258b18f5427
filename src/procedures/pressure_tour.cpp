#include "helix_arm/procedures/pressure_tour.hpp"

#include <cmath>
#include <stdexcept>

#include "helix_arm/basics/pi.hpp"

namespace helix_arm::procedures {
namespace {

constexpr double kFullAngle = 2 * basics::kPi;
constexpr int kStops = 12;  // on the way around

}  // namespace

Eigen::MatrixXd pressureTour(const model::Arm& arm, double fraction) {
  if (!(fraction > 0 && fraction <= 1)) {
    throw std::invalid_argument("a tour over " + std::to_string(fraction) +
                                " of the range; expected a fraction in (0, 1]");
  }
  // Rows: rest, the stops of one turn with the first repeated, all actuators together, rest.
  Eigen::MatrixXd share = Eigen::MatrixXd::Zero(kStops + 4, arm.actuatorCount());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const int first = arm.firstActuator(k), count = arm.firstActuator(k + 1) - first;
    for (int i = 0; i < count; ++i) {
      const double place = static_cast<double>(i) / count + 0.5 * (k % 2);
      for (int stop = 0; stop <= kStops; ++stop) {
        const double angle = kFullAngle * (static_cast<double>(stop) / kStops - place);
        share(1 + stop, first + i) = 0.5 * (1.0 + std::cos(angle));
      }
      share(kStops + 2, first + i) = 0.5;
    }
  }
  Eigen::MatrixXd tour(share.rows(), share.cols());
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const model::Range& limits = arm.actuator(i).limits;
    tour.col(i) = limits.lower + (fraction * (limits.upper - limits.lower) * share.col(i)).array();
  }
  return tour;
}

}  // namespace helix_arm::procedures
