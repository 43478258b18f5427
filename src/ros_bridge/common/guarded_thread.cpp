#include "ros_bridge/common/guarded_thread.hpp"

#include <utility>

namespace helix_arm::ros_bridge {

void GuardedThread::start(std::function<void()> body, std::function<void()> on_failure) {
  thread_ = std::thread([this, body = std::move(body), on_failure = std::move(on_failure)] {
    const int code = guarded([&body] {
      body();
      return kDone;
    });
    verdict_ = code;
    if (code != kDone) on_failure();
  });
}

void GuardedThread::join() {
  if (thread_.joinable()) thread_.join();
}

}  // namespace helix_arm::ros_bridge
