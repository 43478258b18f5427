#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <ros/console.h>

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
  void write(Level level, std::string line);

 private:
  void run();

  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::pair<Level, std::string>> waiting_;
  std::uint64_t lost_ = 0;
  bool ended_ = false;
  std::thread thread_;
};

}  // namespace helix_arm::ros_bridge
