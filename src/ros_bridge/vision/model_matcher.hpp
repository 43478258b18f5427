#pragma once

#include <chrono>
#include <optional>

#include <ros/time.h>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/shape.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/model_history.hpp"
#include "ros_bridge/vision/vision_status_publisher.hpp"

namespace helix_arm::ros_bridge {

/// Finds the model of a picture's time, and the shape from which the search for tags starts.
class ModelMatcher {
 public:
  /// @param scene   the search starts from its resting arm until a model comes.
  /// @param status  is told how far models are behind the pictures; outlives this.
  ModelMatcher(const io::Scene& scene, VisionStatusPublisher& status);

  /// From any thread.
  void add(const ros::Time& stamp, const model::Shape& shape) HELIX_ARM_EXCLUDES(mutex_);
  /// From any thread: match() waits no more.
  void stop() HELIX_ARM_EXCLUDES(mutex_);

  // For the thread of the measurements only.

  /// The model nearest to the stamp, if there is one within ModelHistory::kReach. Waits for a
  /// limited time while one that is yet to come may be nearer.
  std::optional<ModelHistory::Entry> match(const ros::Time& stamp) HELIX_ARM_EXCLUDES(mutex_);
  /// Shape from which the search starts: the last model matched.
  const model::Shape& start() const { return start_; }
  /// The search starts from the scene's resting arm again.
  void restart(const io::Scene& scene);

 private:
  /// What the history knows of a stamp.
  struct LookUp {
    std::optional<ModelHistory::Entry> model;
    std::optional<double> lag;  ///< of the latest model [s]
    bool in_time;               ///< no nearer one was to come when the wait ended
  };
  LookUp lookUp(const ros::Time& stamp) HELIX_ARM_EXCLUDES(mutex_);
  void warnOfLag(double lag);

  VisionStatusPublisher& status_;

  // Used by the thread of the measurements only.
  model::Shape start_;
  std::chrono::milliseconds patience_;
  FaultCount late_models_;

  basics::Mutex mutex_;
  basics::Condition changed_;  ///< something guarded by mutex_ has changed
  bool stop_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  ModelHistory models_ HELIX_ARM_GUARDED_BY(mutex_);
};

}  // namespace helix_arm::ros_bridge
