#pragma once

#include <pthread.h>

#include "helix_arm/basics/thread_annotations.hpp"

namespace helix_arm::regulator {

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
