#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <utility>

#include "helix_arm/basics/thread_annotations.hpp"

namespace helix_arm::basics {

/// A std::mutex for the thread-safety analysis. Declare the data that it guards with
/// HELIX_ARM_GUARDED_BY.
class HELIX_ARM_CAPABILITY("mutex") Mutex {
 public:
  void lock() HELIX_ARM_ACQUIRE() { mutex_.lock(); }
  void unlock() HELIX_ARM_RELEASE() { mutex_.unlock(); }

 private:
  friend class MutexLock;
  std::mutex mutex_;
};

/// Locks a mutex until the end of the scope, and can be unlocked and locked again in between: a
/// std::unique_lock that begins locked.
class HELIX_ARM_SCOPED_CAPABILITY MutexLock {
 public:
  explicit MutexLock(Mutex& mutex) HELIX_ARM_ACQUIRE(mutex) : lock_(mutex.mutex_) {}
  ~MutexLock() HELIX_ARM_RELEASE() = default;
  MutexLock(const MutexLock&) = delete;
  MutexLock& operator=(const MutexLock&) = delete;

  /// @throws std::system_error when it is locked already.
  void lock() HELIX_ARM_ACQUIRE() { lock_.lock(); }
  /// @throws std::system_error when it is not locked.
  void unlock() HELIX_ARM_RELEASE() { lock_.unlock(); }

 private:
  friend class Condition;
  std::unique_lock<std::mutex> lock_;
};

/// A std::condition_variable for a MutexLock.
///
/// Each wait requires a locked MutexLock, which the analysis does not check, and returns with it
/// locked. The predicate declares the lock that it needs:
///
///     condition_.wait(lock, [this]() HELIX_ARM_REQUIRES(mutex_) { return done_; });
class Condition {
 public:
  void notifyOne() noexcept { condition_.notify_one(); }
  void notifyAll() noexcept { condition_.notify_all(); }

  template <class Done>
  void wait(MutexLock& lock, Done done) {
    condition_.wait(lock.lock_, std::move(done));
  }
  /// @return the last result of done().
  template <class Rep, class Period, class Done>
  bool waitFor(MutexLock& lock, const std::chrono::duration<Rep, Period>& longest, Done done) {
    return condition_.wait_for(lock.lock_, longest, std::move(done));
  }
  template <class Clock, class Duration, class Done>
  bool waitUntil(MutexLock& lock, const std::chrono::time_point<Clock, Duration>& end, Done done) {
    return condition_.wait_until(lock.lock_, end, std::move(done));
  }

 private:
  std::condition_variable condition_;
};

}  // namespace helix_arm::basics
