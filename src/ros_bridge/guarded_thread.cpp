#include "helix_arm/ros_bridge/guarded_thread.hpp"

#include <utility>

namespace helix_arm::ros_bridge {

void GuardedThread::start(std::function<void()> body) {
  thread_ = std::thread([this, body = std::move(body)] {
    const int code = guarded([&body] {
      body();
      return kDone;
    });
    verdict_ = code;
    if (code != kDone) ros::requestShutdown();
  });
}

void GuardedThread::join() {
  if (thread_.joinable()) thread_.join();
}

}  // namespace helix_arm::ros_bridge
