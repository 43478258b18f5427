#include "helix_arm/ros_bridge/common/log_thread.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr std::size_t kMostWaiting = 100;

}  // namespace

LogThread::LogThread() : thread_([this] { run(); }) {}

LogThread::~LogThread() {
  {
    const basics::MutexLock lock(mutex_);
    ended_ = true;
  }
  changed_.notifyOne();
  thread_.join();
}

void LogThread::write(Level level, std::string line) {
  {
    const basics::MutexLock lock(mutex_);
    if (waiting_.size() < kMostWaiting) {
      waiting_.emplace_back(level, std::move(line));
    } else {
      ++lost_;
    }
  }
  changed_.notifyOne();
}

void LogThread::run() {
  basics::MutexLock lock(mutex_);
  while (!ended_ || !waiting_.empty()) {
    changed_.wait(lock,
                  [this]() HELIX_ARM_REQUIRES(mutex_) { return ended_ || !waiting_.empty(); });
    decltype(waiting_) lines;
    lines.swap(waiting_);
    const std::uint64_t lost = std::exchange(lost_, 0);
    lock.unlock();
    for (const auto& [level, line] : lines) {
      ROS_LOG(level, ROSCONSOLE_DEFAULT_NAME, "%s", line.c_str());
    }
    if (lost > 0) ROS_WARN("%lu more lines were lost: the log was held up", lost);
    lock.lock();
  }
}

}  // namespace helix_arm::ros_bridge
