#pragma once

#include <atomic>
#include <thread>

#include "helix_arm/basics/mutex.hpp"

namespace helix_arm::ros_bridge {

/// Ends the process where its node was asked to end and cannot: a ROS master that hangs holds up
/// every call to it, the unregistering at the end included.
///
/// It ends with kFailed, without destructors: where the node drives hardware and has not vented,
/// its guard does.
class EndWatch {
 public:
  EndWatch();
  ~EndWatch();
  EndWatch(const EndWatch&) = delete;
  EndWatch& operator=(const EndWatch&) = delete;

  /// The node's main thread goes on; once the node was asked to end it is to say so every
  /// kPatience.
  void turn() { ++turns_; }
  /// What comes next takes the time that it takes, and needs no master: from true to false.
  void waits(bool so) { waits_ = so; }
  /// There is no master to unregister from: what is left is given a second.
  void hurry() { patience_ = 1; }

  static constexpr double kPatience = 5;  ///< [s]

 private:
  void watch();

  basics::Mutex mutex_;
  basics::Condition wake_;
  bool stop_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  std::atomic<unsigned> turns_{0};
  std::atomic<bool> waits_{false};
  std::atomic<double> patience_{kPatience};
  std::thread thread_;
};

}  // namespace helix_arm::ros_bridge
