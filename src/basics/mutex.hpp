#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <utility>

/// Annotations for Clang's thread-safety analysis (-Wthread-safety):
/// https://clang.llvm.org/docs/ThreadSafetyAnalysis.html. They are empty for other compilers.
///
/// scripts/lint runs the analysis. It works per function: it checks neither constructors nor
/// destructors, and a lambda does not inherit the locks of the function that contains it.

#if defined(__clang__)
#define HELIX_ARM_THREAD_ANNOTATION(attribute) __attribute__((attribute))
#else
#define HELIX_ARM_THREAD_ANNOTATION(attribute)
#endif

/// For a class: its objects can be locked. `kind` is the word in messages: "mutex".
#define HELIX_ARM_CAPABILITY(kind) HELIX_ARM_THREAD_ANNOTATION(capability(kind))

/// For a class: it locks in its constructor and unlocks in its destructor.
#define HELIX_ARM_SCOPED_CAPABILITY HELIX_ARM_THREAD_ANNOTATION(scoped_lockable)

/// For a member: it may be read and written only with this mutex locked.
#define HELIX_ARM_GUARDED_BY(mutex) HELIX_ARM_THREAD_ANNOTATION(guarded_by(mutex))

/// For a function or a lambda: the caller must have locked these mutexes.
#define HELIX_ARM_REQUIRES(...) HELIX_ARM_THREAD_ANNOTATION(requires_capability(__VA_ARGS__))

/// For a function: the caller must not have locked these mutexes, since the function locks them.
#define HELIX_ARM_EXCLUDES(...) HELIX_ARM_THREAD_ANNOTATION(locks_excluded(__VA_ARGS__))

/// For a function: it locks these mutexes or, without an argument, its own object.
#define HELIX_ARM_ACQUIRE(...) HELIX_ARM_THREAD_ANNOTATION(acquire_capability(__VA_ARGS__))

/// For a function: it unlocks these mutexes or, without an argument, its own object.
#define HELIX_ARM_RELEASE(...) HELIX_ARM_THREAD_ANNOTATION(release_capability(__VA_ARGS__))
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
