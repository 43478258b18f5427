#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <deque>
#include <optional>

#include <ros/time.h>

#include "helix_arm/model/shape.hpp"
#include "ros_bridge/common/ros_time.hpp"

namespace helix_arm::ros_bridge {

/// The model's shapes of the last seconds, to find the one at the time of a picture.
class ModelHistory {
 public:
  struct Entry {
    ros::Time stamp;
    model::Shape shape;
  };

  /// Maximum time between a picture and its model [s].
  static constexpr double kReach = 0.25;
  /// Time for which shapes are kept, by their stamps [s].
  static constexpr double kMemory = 2.0;
  /// Maximum number of shapes: kMemory of models at 1000 Hz.
  static constexpr std::size_t kMost = 2000;

  /// A stamp before the last one is a jump back in time: all earlier entries are forgotten. A stamp
  /// equal to the last one (stopped clock) replaces its entry.
  void add(const ros::Time& stamp, const model::Shape& shape) {
    if (!entries_.empty() && stamp < entries_.back().stamp) entries_.clear();
    if (!entries_.empty() && stamp == entries_.back().stamp) {
      entries_.back().shape = shape;
      return;
    }
    entries_.push_back({stamp, shape});
    if (entries_.size() > kMost) entries_.pop_front();
    while (secondsBetween(entries_.front().stamp, stamp) > kMemory) entries_.pop_front();
  }

  /// Forgets entries more than kReach ahead of `now`: they are from before a jump back in time.
  void forgetFuture(const ros::Time& now) {
    while (!entries_.empty() && secondsBetween(now, entries_.back().stamp) > kReach)
      entries_.pop_back();
  }

  /// Time of the latest model behind the stamp, negative if ahead [s]; nothing without a model.
  std::optional<double> lag(const ros::Time& stamp) const {
    if (entries_.empty()) return std::nullopt;
    return secondsBetween(entries_.back().stamp, stamp);
  }

  std::size_t size() const { return entries_.size(); }

  /// The nearest entry within kReach; the earlier of two equally near ones.
  std::optional<Entry> nearest(const ros::Time& stamp) const {
    const auto distance = [&](const Entry& entry) {
      return std::abs(secondsBetween(entry.stamp, stamp));
    };
    const auto found =
        std::min_element(entries_.begin(), entries_.end(),
                         [&](const Entry& a, const Entry& b) { return distance(a) < distance(b); });
    if (found == entries_.end() || distance(*found) > kReach) return std::nullopt;
    return *found;
  }

  /// True if a future model may be nearer than the present ones: models are arriving, and none is
  /// as late as the stamp.
  bool mayGetNearer(const ros::Time& stamp) const {
    return !entries_.empty() && entries_.back().stamp < stamp &&
           secondsBetween(entries_.back().stamp, stamp) <= kReach;
  }

 private:
  std::deque<Entry> entries_;  ///< by ascending stamp
};

}  // namespace helix_arm::ros_bridge
