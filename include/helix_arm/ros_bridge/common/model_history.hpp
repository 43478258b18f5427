#pragma once

#include <cstddef>
#include <deque>
#include <optional>

#include <ros/time.h>

#include "helix_arm/model/shape.hpp"

namespace helix_arm::ros_bridge {

/// Exact, and for any two stamps: the difference of ros::Time throws where messages are far apart.
double secondsBetween(const ros::Time& from, const ros::Time& to);

/// The model's shapes of the last seconds, so that a picture meets the one of its own time.
class ModelHistory {
 public:
  struct Entry {
    ros::Time stamp;
    model::Shape shape;
  };

  /// Longest time between a picture and a model that has to do with it [s].
  static constexpr double kReach = 0.25;
  /// How long shapes are kept, by their stamps [s].
  static constexpr double kMemory = 2.0;
  /// As many at most: kMemory of models at 1000 Hz.
  static constexpr std::size_t kMost = 2000;

  /// A stamp before the last one is a jump back in time: what was kept is forgotten. One equal to
  /// the last, as of a clock that stands still, takes its place.
  void add(const ros::Time& stamp, const model::Shape& shape);

  /// Forgets what lies farther ahead of `now` than kReach: it is from before a jump back in time.
  void forgetFuture(const ros::Time& now);

  /// How far the latest model is behind the stamp, negative when ahead [s]; nothing without one.
  std::optional<double> lag(const ros::Time& stamp) const;

  std::size_t size() const { return entries_.size(); }

  /// The nearest within kReach; of two as near, the earlier.
  std::optional<Entry> nearest(const ros::Time& stamp) const;

  /// True when a model that is yet to come may be nearer than those that came: models do come, and
  /// none of them is as late as the stamp.
  bool mayGetNearer(const ros::Time& stamp) const;

 private:
  std::deque<Entry> entries_;  ///< by ascending stamp
};

}  // namespace helix_arm::ros_bridge
