#pragma once

#include "helix_arm/basics/mutex.hpp"

namespace helix_arm::ros_bridge {

/// The one long job that the calibration node does at a time: a run of its action, or the fit of a
/// service. While a job holds the slot, no other starts, and neither samples nor scene are changed
/// from outside. From any thread.
///
/// Its mutex is locked after that of ReloadServer, and before those of Recorder and Calibrator.
class JobSlot {
 public:
  enum class Job {
    kNone,
    kRun,  ///< run_calibration
    kFit,  ///< the fit of a service
  };

  /// Holds the slot as long as it lives.
  class Claim {
   public:
    /// @throws std::invalid_argument naming the job that is under way.
    Claim(JobSlot& slot, Job job);
    ~Claim();
    Claim(const Claim&) = delete;
    Claim& operator=(const Claim&) = delete;

   private:
    JobSlot& slot_;
  };

  bool runs() const HELIX_ARM_EXCLUDES(mutex_);  ///< run_calibration is under way

  /// Runs a short body; no job starts meanwhile.
  /// @return what the body returns.
  /// @throws std::invalid_argument naming the job that is under way, and what the body throws.
  template <class Body>
  auto whileIdle(const Body& body) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    requireIdle();
    return body();
  }

 private:
  void requireIdle() const HELIX_ARM_REQUIRES(mutex_);

  mutable basics::Mutex mutex_;
  Job job_ HELIX_ARM_GUARDED_BY(mutex_) = Job::kNone;
};

}  // namespace helix_arm::ros_bridge
