#include "model_history.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace helix_arm::ros_bridge {

double secondsBetween(const ros::Time& from, const ros::Time& to) {
  return 1e-9 * static_cast<double>(static_cast<std::int64_t>(to.toNSec()) -
                                    static_cast<std::int64_t>(from.toNSec()));
}

void ModelHistory::add(const ros::Time& stamp, const model::Shape& shape) {
  if (!entries_.empty() && stamp < entries_.back().stamp) entries_.clear();
  if (!entries_.empty() && stamp == entries_.back().stamp) {
    entries_.back().shape = shape;
    return;
  }
  entries_.push_back({stamp, shape});
  if (entries_.size() > kMost) entries_.pop_front();
  while (secondsBetween(entries_.front().stamp, stamp) > kMemory) entries_.pop_front();
}

std::optional<ModelHistory::Entry> ModelHistory::nearest(const ros::Time& stamp) const {
  const auto distance = [&](const Entry& entry) {
    return std::abs(secondsBetween(entry.stamp, stamp));
  };
  const auto found =
      std::min_element(entries_.begin(), entries_.end(),
                       [&](const Entry& a, const Entry& b) { return distance(a) < distance(b); });
  if (found == entries_.end() || distance(*found) > kReach) return std::nullopt;
  return *found;
}

}  // namespace helix_arm::ros_bridge
