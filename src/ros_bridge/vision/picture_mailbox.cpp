#include "ros_bridge/vision/picture_mailbox.hpp"

#include <utility>

namespace helix_arm::ros_bridge {

bool PictureMailbox::put(Picture picture) {
  bool replaces = false;
  {
    const basics::MutexLock lock(mutex_);
    replaces = next_.has_value();
    next_ = std::move(picture);
  }
  changed_.notifyAll();
  return replaces;
}

std::optional<Picture> PictureMailbox::take() {
  basics::MutexLock lock(mutex_);
  changed_.wait(lock, [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_ || next_; });
  if (stop_) return std::nullopt;
  busy_ = true;
  return std::exchange(next_, std::nullopt);
}

void PictureMailbox::done() {
  {
    const basics::MutexLock lock(mutex_);
    busy_ = false;
  }
  changed_.notifyAll();
}

bool PictureMailbox::waitUntilIdle() {
  basics::MutexLock lock(mutex_);
  changed_.wait(lock, [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_ || (!next_ && !busy_); });
  return !stop_;
}

bool PictureMailbox::sleepUntil(std::chrono::steady_clock::time_point due) {
  basics::MutexLock lock(mutex_);
  return !changed_.waitUntil(lock, due, [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_; });
}

void PictureMailbox::stop() {
  {
    const basics::MutexLock lock(mutex_);
    stop_ = true;
  }
  changed_.notifyAll();
}

bool PictureMailbox::stopped() const {
  const basics::MutexLock lock(mutex_);
  return stop_;
}

}  // namespace helix_arm::ros_bridge
