#include "helix_arm/simulation/play.hpp"

#include <cmath>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::simulation {

Play::Play(int channels, double width) : width_(width), felt_(Eigen::VectorXd::Zero(channels)) {
  basics::requireValue(std::isfinite(width) && width >= 0, "true arm", "the play [Pa]", width,
                       "a finite value >= 0");
}

const Eigen::VectorXd& Play::follow(const Eigen::VectorXd& pressure) {
  felt_ = felt_.array().max(pressure.array() - width_).min(pressure.array() + width_);
  return felt_;
}

}  // namespace helix_arm::simulation
