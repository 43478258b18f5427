#include "helix_arm/ros_bridge/model_history.hpp"

#include <algorithm>
#include <cmath>

namespace helix_arm::ros_bridge {

void ModelHistory::add(const ros::Time& stamp, const model::Twists& twists) {
  if (!entries_.empty() && stamp < entries_.back().stamp) entries_.clear();
  entries_.push_back({stamp, twists});
  while ((stamp - entries_.front().stamp).toSec() > kMemory) entries_.pop_front();
}

void ModelHistory::forgetFuture(const ros::Time& now) {
  while (!entries_.empty() && (entries_.back().stamp - now).toSec() > kReach) entries_.pop_back();
}

std::optional<ModelHistory::Entry> ModelHistory::nearest(const ros::Time& stamp) const {
  const auto distance = [&](const Entry& entry) { return std::abs((entry.stamp - stamp).toSec()); };
  const auto found =
      std::min_element(entries_.begin(), entries_.end(),
                       [&](const Entry& a, const Entry& b) { return distance(a) < distance(b); });
  if (found == entries_.end() || distance(*found) > kReach) return std::nullopt;
  return *found;
}

bool ModelHistory::mayGetNearer(const ros::Time& stamp) const {
  return !entries_.empty() && entries_.back().stamp < stamp &&
         (stamp - entries_.back().stamp).toSec() <= kReach;
}

}  // namespace helix_arm::ros_bridge
