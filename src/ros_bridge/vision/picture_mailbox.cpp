#include "helix_arm/ros_bridge/vision/picture_mailbox.hpp"

#include <utility>

namespace helix_arm::ros_bridge {

bool PictureMailbox::put(Picture picture) {
  bool replaces = false;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    replaces = next_.has_value();
    next_ = std::move(picture);
  }
  changed_.notify_all();
  return replaces;
}

std::optional<Picture> PictureMailbox::take() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stop_ && !next_) changed_.wait(lock);
  if (stop_) return std::nullopt;
  busy_ = true;
  return std::exchange(next_, std::nullopt);
}

void PictureMailbox::done() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    busy_ = false;
  }
  changed_.notify_all();
}

bool PictureMailbox::waitUntilIdle() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stop_ && (next_ || busy_)) changed_.wait(lock);
  return !stop_;
}

bool PictureMailbox::sleepUntil(std::chrono::steady_clock::time_point due) {
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stop_ && std::chrono::steady_clock::now() < due) changed_.wait_until(lock, due);
  return !stop_;
}

void PictureMailbox::stop() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
}

bool PictureMailbox::stopped() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return stop_;
}

}  // namespace helix_arm::ros_bridge
