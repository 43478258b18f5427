#include "ros_bridge/cockpit/call_desk.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <map>
#include <system_error>
#include <thread>
#include <utility>

#include "helix_arm/basics/mutex.hpp"

namespace helix_arm::ros_bridge {
namespace {

using Clock = std::chrono::steady_clock;

CallAnswer noAnswer(const std::string& what, const std::string& why) {
  return {what, false, why, false};
}

}  // namespace

// Shared with the threads of the calls, which may outlive the desk.
struct CallDesk::State {
  struct Waiting {
    std::string what, remedy;
    double limit;
    Clock::time_point due;
  };

  explicit State(Done done) : done_(std::move(done)) {}

  /// Registers a call, unless too many of its name have not ended; then it is answered.
  bool begin(const std::string& what, double limit, const std::string& remedy,
             std::uint64_t& ticket) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    const auto waiting = count(what);
    if (waiting >= kMostWaiting || running_[what] >= kMostRunning) {
      tell(noAnswer(what, waiting >= kMostWaiting
                              ? "earlier calls still wait for their answers; is the node alive?"
                              : "too many calls hang; end the node that hangs"),
           remedy);
      return false;
    }
    ++running_[what];
    ticket = ++last_ticket_;
    const auto time =
        std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(limit));
    waiting_.emplace(ticket, Waiting{what, remedy, limit, Clock::now() + time});
    changed_.notifyAll();
    return true;
  }

  /// The call has ended; its answer counts unless it was given up on.
  void end(std::uint64_t ticket, const CallAnswer& answer) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    --running_[answer.what];
    const auto call = waiting_.extract(ticket);
    if (call) tell(answer, call.mapped().remedy);
  }

  bool waits(const std::string& what) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    return count(what) > 0;
  }

  void close() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    closed_ = true;
    changed_.notifyAll();
  }

  /// Gives up on the calls that are late, until the desk is closed.
  void watch() HELIX_ARM_EXCLUDES(mutex_) {
    basics::MutexLock lock(mutex_);
    while (!closed_) {
      const Clock::time_point now = Clock::now();
      Clock::time_point next = now + std::chrono::hours(1);
      for (auto it = waiting_.begin(); it != waiting_.end();) {
        if (it->second.due > now) {
          next = std::min(next, it->second.due);
          ++it;
          continue;
        }
        char text[120];
        std::snprintf(text, sizeof text, "no answer within %g s; is the node alive?",
                      it->second.limit);
        tell(noAnswer(it->second.what, text), it->second.remedy);
        it = waiting_.erase(it);
      }
      const std::uint64_t seen = last_ticket_;
      changed_.waitUntil(lock, next, [this, seen]() HELIX_ARM_REQUIRES(mutex_) {
        return closed_ || last_ticket_ != seen;
      });
    }
  }

 private:
  std::ptrdiff_t count(const std::string& what) const HELIX_ARM_REQUIRES(mutex_) {
    return std::count_if(waiting_.begin(), waiting_.end(),
                         [&](const auto& one) { return one.second.what == what; });
  }

  // With the lock, so that nothing is told once the desk is closed.
  void tell(CallAnswer answer, const std::string& remedy) HELIX_ARM_REQUIRES(mutex_) {
    if (!answer.success) answer.remedy = remedy;
    if (!closed_) done_(answer);
  }

  const Done done_;
  basics::Mutex mutex_;
  basics::Condition changed_;
  bool closed_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  std::uint64_t last_ticket_ HELIX_ARM_GUARDED_BY(mutex_) = 0;
  std::map<std::uint64_t, Waiting> waiting_ HELIX_ARM_GUARDED_BY(mutex_);
  std::map<std::string, int> running_ HELIX_ARM_GUARDED_BY(mutex_);  ///< also those given up on
};

CallDesk::CallDesk(Done done) : state_(std::make_shared<State>(std::move(done))) {
  std::thread([state = state_] { state->watch(); }).detach();
}

CallDesk::~CallDesk() { state_->close(); }

void CallDesk::ask(const std::string& what, double limit, Call call, const std::string& remedy) {
  std::uint64_t ticket = 0;
  if (!state_->begin(what, limit, remedy, ticket)) return;
  const auto run = [state = state_, what, ticket, call = std::move(call)] {
    CallAnswer answer;
    try {
      answer = call();
    } catch (const std::exception& fault) {
      answer = noAnswer(what, fault.what());
    }
    answer.what = what;
    state->end(ticket, answer);
  };
  try {
    // Detached: nothing ends a call to a service that neither answers nor hangs up.
    std::thread(run).detach();
  } catch (const std::system_error& fault) {
    state_->end(ticket, noAnswer(what, std::string("no thread for it: ") + fault.what()));
  }
}

bool CallDesk::waits(const std::string& what) const { return state_->waits(what); }

}  // namespace helix_arm::ros_bridge
