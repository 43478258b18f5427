#pragma once

#include <string>

#include <pthread.h>

#include "basics/mutex.hpp"

/// Real-time scheduling and memory locking for the threads between targets and valves. If the
/// user's limits refuse it, everything still works, with delays on a busy machine.
namespace helix_arm::regulator {

/// Default priority of these threads, below that of the kernel's interrupt threads (50).
inline constexpr int kRealtimePriority = 40;
inline constexpr int kHighestRealtimePriority = 99;  ///< as Linux has it

/// Schedules the calling thread as SCHED_FIFO; threads that it starts keep ordinary scheduling.
/// @param priority  0 for no change, up to kHighestRealtimePriority.
/// @return the reason for failure and the remedy; empty on success and for priority 0.
std::string scheduleRealtime(int priority);

/// Tests whether scheduleRealtime() works here, on a separate thread.
/// @return as scheduleRealtime().
std::string tryRealtime(int priority);

/// Prevents this process's memory from being swapped out from now on.
/// @return the reason for failure and the remedy; empty on success.
std::string lockMemory();

/// A mutex with priority inheritance: its holder runs at the priority of the highest waiting
/// thread, so that a busy machine does not keep a holder of ordinary priority from releasing it.
class HELIX_ARM_CAPABILITY("mutex") PriorityMutex {
 public:
  PriorityMutex() {
    pthread_mutexattr_t attributes;
    pthread_mutexattr_init(&attributes);
    pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT);
    pthread_mutex_init(&mutex_, &attributes);
    pthread_mutexattr_destroy(&attributes);
  }
  ~PriorityMutex() { pthread_mutex_destroy(&mutex_); }
  PriorityMutex(const PriorityMutex&) = delete;
  PriorityMutex& operator=(const PriorityMutex&) = delete;

  void lock() HELIX_ARM_ACQUIRE() { pthread_mutex_lock(&mutex_); }
  void unlock() HELIX_ARM_RELEASE() { pthread_mutex_unlock(&mutex_); }

 private:
  pthread_mutex_t mutex_;
};

/// Locks a PriorityMutex until the end of the scope.
class HELIX_ARM_SCOPED_CAPABILITY PriorityLock {
 public:
  explicit PriorityLock(PriorityMutex& mutex) HELIX_ARM_ACQUIRE(mutex) : mutex_(mutex) {
    mutex_.lock();
  }
  ~PriorityLock() HELIX_ARM_RELEASE() { mutex_.unlock(); }
  PriorityLock(const PriorityLock&) = delete;
  PriorityLock& operator=(const PriorityLock&) = delete;

 private:
  PriorityMutex& mutex_;
};

}  // namespace helix_arm::regulator
