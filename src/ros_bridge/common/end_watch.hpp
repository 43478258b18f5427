#pragma once

#include <atomic>
#include <thread>

#include "helix_arm/basics/mutex.hpp"

namespace helix_arm::ros_bridge {

/// Exit code of a node.
enum ExitCode {
  kDone = 0,              ///< asked to end (Ctrl-C, rosnode kill), or work done
  kFailed = 1,            ///< the ROS master was lost, or the node failed
  kBadConfiguration = 2,  ///< a parameter or a file breaks its rules; every fault was printed
};

/// Request to end a node: by Ctrl-C, SIGTERM, rosnode kill, or from within. It does not shut ROS
/// down: the node can first do its work, such as venting an arm, without the ROS master, which may
/// hang. spinUntilEnd() handles the request.
class EndRequest {
 public:
  /// Replaces roscpp's handlers; its node must have been started.
  EndRequest();

  /// Makes the request, from any thread.
  static void make();
  /// True once the request was made.
  static bool made();
  /// True if the node should not finish its work first: it was asked twice, or from within.
  static bool isUrgent();
};

/// Ends the process if its node was asked to end and cannot: a hanging ROS master blocks every call
/// to it, including unregistering at the end.
///
/// It ends with kFailed, without destructors. If the node drives hardware and has not vented, its
/// guard vents.
class EndWatch {
 public:
  EndWatch() : thread_([this] { watch(); }) {}
  ~EndWatch();
  EndWatch(const EndWatch&) = delete;
  EndWatch& operator=(const EndWatch&) = delete;

  /// Reports that the node's main thread is running; required every kPatience once the node was
  /// asked to end.
  void turn() { ++turns_; }
  /// While true, the watch is suspended, for work that takes time and needs no master.
  void waits(bool so) { waits_ = so; }
  /// There is no master to unregister from: reduces the patience to 1 s.
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
