#pragma once

#include <cstdint>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <ros/console.h>

#include "helix_arm/basics/mutex.hpp"

namespace helix_arm::ros_bridge {

/// Writes lines to ROS's log in its own thread, so that a blocked terminal delays no other thread.
class LogThread {
 public:
  using Level = ros::console::Level;

  LogThread();
  /// Returns once the waiting lines are written.
  ~LogThread();
  LogThread(const LogThread&) = delete;
  LogThread& operator=(const LogThread&) = delete;

  /// Queues a line. Thread-safe. If too many are waiting the line is lost, and the log says so.
  void write(Level level, std::string line) HELIX_ARM_EXCLUDES(mutex_);

 private:
  void run();

  basics::Mutex mutex_;
  basics::Condition changed_;
  std::vector<std::pair<Level, std::string>> waiting_ HELIX_ARM_GUARDED_BY(mutex_);
  std::uint64_t lost_ HELIX_ARM_GUARDED_BY(mutex_) = 0;
  bool ended_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace helix_arm::ros_bridge
