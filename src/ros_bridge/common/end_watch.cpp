#include "end_watch.hpp"

#include <chrono>
#include <csignal>
#include <cstring>

#include <poll.h>
#include <ros/xmlrpc_manager.h>
#include <unistd.h>

namespace helix_arm::ros_bridge {
namespace {

constexpr int kUrgent = 2;

std::atomic<int> requests{0};
static_assert(std::atomic<int>::is_always_lock_free, "signal handlers must not wait");

void onSignal(int) { requests.fetch_add(1); }

// Call by the master, as sent by rosnode kill.
void onShutdown(XmlRpc::XmlRpcValue&, XmlRpc::XmlRpcValue& result) {
  requests.fetch_add(1);
  result = ros::xmlrpc::responseInt(1, "", 0);
}

constexpr double kPeriod = 0.1;  // between two checks [s]

// Uses neither ROS nor buffered streams, which may be what blocks.
[[noreturn]] void end() {
  constexpr char kText[] =
      "this node could not end in time and exits at once: the ROS master does not answer (run "
      "rosnode cleanup once it does), a callback does not return, or the log is blocked\n";
  pollfd ready{STDERR_FILENO, POLLOUT, 0};
  if (poll(&ready, 1, 0) > 0 && (ready.revents & POLLOUT) != 0) {
    const ssize_t written = write(STDERR_FILENO, kText, std::strlen(kText));
    static_cast<void>(written);  // nothing can be done if it fails
  }
  _exit(kFailed);
}

}  // namespace

EndRequest::EndRequest() {
  std::signal(SIGINT, onSignal);
  std::signal(SIGTERM, onSignal);
  const auto& manager = ros::XMLRPCManager::instance();
  manager->unbind("shutdown");
  manager->bind("shutdown", onShutdown);
}

void EndRequest::make() { requests.fetch_add(kUrgent); }
bool EndRequest::made() { return requests > 0; }
bool EndRequest::isUrgent() { return requests >= kUrgent; }

EndWatch::~EndWatch() {
  {
    const basics::MutexLock lock(mutex_);
    stop_ = true;
  }
  wake_.notifyAll();
  thread_.join();
}

void EndWatch::watch() {
  // Counts periods rather than time: a process that was stopped has lost only one.
  double idle = 0;
  unsigned seen = 0;
  basics::MutexLock lock(mutex_);
  while (!wake_.waitFor(lock, std::chrono::duration<double>(kPeriod),
                        [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_; })) {
    const unsigned turns = turns_;
    const bool goes_on = turns != seen || waits_ || !EndRequest::made();
    seen = turns;
    idle = goes_on ? 0 : idle + kPeriod;
    if (idle >= patience_) end();
  }
}

}  // namespace helix_arm::ros_bridge
