#include "ros_bridge/cockpit/link_builder.hpp"

#include <chrono>
#include <exception>
#include <system_error>
#include <thread>
#include <utility>

#include <ros/master.h>

#include "helix_arm/basics/mutex.hpp"
#include "ros_bridge/common/master_watch.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr std::chrono::milliseconds kAskAgain(500);  // a master that did not answer

}  // namespace

// Shared with the thread, which may outlive the builder.
struct LinkBuilder::State {
  void work() HELIX_ARM_EXCLUDES(mutex) {
    basics::MutexLock lock(mutex);
    while (!wish.empty()) {
      const std::string ns = wish;
      lock.unlock();
      const bool answers = masterAnswers();
      std::unique_ptr<CockpitLink> link;
      std::exception_ptr thrown;
      try {
        if (answers) link = std::make_unique<CockpitLink>(ns);
      } catch (const std::exception&) {
        thrown = std::current_exception();
      }
      lock.lock();
      silent = !answers;
      if (silent) {
        changed.waitFor(lock, kAskAgain, [&]() HELIX_ARM_REQUIRES(mutex) { return wish != ns; });
      } else if (wish == ns) {
        made = std::move(link);
        fault = thrown;
        wish.clear();
      } else {
        lock.unlock();
        link.reset();
        lock.lock();
      }
    }
    works = false;
  }

  basics::Mutex mutex;
  basics::Condition changed;
  std::string wish HELIX_ARM_GUARDED_BY(mutex);  ///< resolved namespace; empty: none
  bool works HELIX_ARM_GUARDED_BY(mutex) = false;
  bool silent HELIX_ARM_GUARDED_BY(mutex) = false;  ///< the master did not answer
  std::unique_ptr<CockpitLink> made HELIX_ARM_GUARDED_BY(mutex);
  std::exception_ptr fault HELIX_ARM_GUARDED_BY(mutex);
};

LinkBuilder::LinkBuilder() : state_(std::make_shared<State>()) {}

LinkBuilder::~LinkBuilder() { cancel(); }

void LinkBuilder::begin(const std::string& ns) {
  const std::string resolved = CockpitLink::resolved(ns);
  cancel();
  const basics::MutexLock lock(state_->mutex);
  state_->wish = resolved;
  state_->silent = false;
  if (state_->works) return;
  std::thread([state = state_] { state->work(); }).detach();
  state_->works = true;
}

void LinkBuilder::cancel() {
  std::unique_ptr<CockpitLink> unwanted;
  {
    const basics::MutexLock lock(state_->mutex);
    state_->wish.clear();
    state_->fault = nullptr;
    unwanted = std::move(state_->made);
    state_->changed.notifyAll();
  }
  end(std::move(unwanted));
}

std::unique_ptr<CockpitLink> LinkBuilder::take() {
  const basics::MutexLock lock(state_->mutex);
  if (state_->fault) std::rethrow_exception(std::exchange(state_->fault, nullptr));
  return std::move(state_->made);
}

std::string LinkBuilder::connectingTo() const {
  const basics::MutexLock lock(state_->mutex);
  return state_->wish;
}

std::string LinkBuilder::silentMaster() const {
  const basics::MutexLock lock(state_->mutex);
  return state_->silent && !state_->wish.empty() ? ros::master::getURI() : "";
}

void LinkBuilder::end(std::unique_ptr<CockpitLink> link) {
  if (!link) return;
  CockpitLink* const last = link.get();
  try {
    std::thread([last] { delete last; }).detach();
    static_cast<void>(link.release());
  } catch (const std::system_error&) {
    link.reset();  // here, since there is no thread for it
  }
}

}  // namespace helix_arm::ros_bridge
