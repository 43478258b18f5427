#include "ros_bridge/follow/calibration_watch.hpp"

#include <cmath>
#include <cstddef>
#include <cstdio>

namespace helix_arm::ros_bridge {

void CalibrationWatch::note(double time, const Estimate& estimate) {
  if (time < last_time_) since_.clear();
  last_time_ = time;
  since_.resize(estimate.names.size());
  advice_.clear();
  for (std::size_t k = 0; k < since_.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    const double prior = estimate.prior[i];
    const bool differs =
        std::abs(estimate.value[i]) > kSigmas * prior && estimate.deviation[i] < kKnown * prior;
    if (!differs) {
      since_[k].reset();
      continue;
    }
    if (!since_[k]) since_[k] = time;
    if (time - *since_[k] < kPatience) continue;
    char text[32];
    std::snprintf(text, sizeof text, " %+.1f %%", 100 * std::expm1(estimate.value[i]));
    advice_ += (advice_.empty() ? "" : ", ") + estimate.names[k] + text;
  }
}

}  // namespace helix_arm::ros_bridge
