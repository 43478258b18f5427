#pragma once

#include <cstdint>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <ros/console.h>

#include "helix_arm/basics/mutex.hpp"

namespace helix_arm::ros_bridge {

/// Writes lines to ROS's log in a thread of its own: a terminal that takes no more of them holds up
/// nobody else.
class LogThread {
 public:
  using Level = ros::console::Level;

  LogThread();
  /// Once what waits is written.
  ~LogThread();
  LogThread(const LogThread&) = delete;
  LogThread& operator=(const LogThread&) = delete;

  /// To be written, of any thread; where too many wait it is lost, and the log says so.
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
