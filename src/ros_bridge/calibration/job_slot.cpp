#include "ros_bridge/calibration/job_slot.hpp"

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::ros_bridge {

JobSlot::Claim::Claim(JobSlot& slot, Job job) : slot_(slot) {
  const basics::MutexLock lock(slot_.mutex_);
  slot_.requireIdle();
  slot_.job_ = job;
}

JobSlot::Claim::~Claim() {
  const basics::MutexLock lock(slot_.mutex_);
  slot_.job_ = Job::kNone;
}

bool JobSlot::runs() const {
  const basics::MutexLock lock(mutex_);
  return job_ == Job::kRun;
}

void JobSlot::requireIdle() const {
  basics::require(job_ != Job::kRun, "run_calibration is running; wait for it, or cancel it first");
  basics::require(job_ != Job::kFit, "a fit is running; wait for it");
}

}  // namespace helix_arm::ros_bridge
