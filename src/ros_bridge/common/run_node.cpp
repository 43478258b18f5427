#include "run_node.hpp"

#include <csignal>
#include <cstdio>
#include <cstring>
#include <map>

#include <poll.h>
#include <ros/callback_queue.h>
#include <ros/init.h>
#include <ros/master.h>
#include <ros/this_node.h>
#include <ros/xmlrpc_manager.h>
#include <unistd.h>

#include "client_watch.hpp"
#include "diagnostics.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "ros_bridge/names.hpp"

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

/// Ends the process if its node was asked to end and cannot: a hanging ROS master blocks every call
/// to it, including unregistering at the end.
///
/// It ends with kFailed, without destructors. The guard of hardware vents what is not vented.
class ShutdownWatchdog {
 public:
  /// Tells that the main thread runs; required every kPatience once the node was asked to end.
  void turn() { ++turns_; }
  /// While true, the watch is suspended, for work that takes time and needs no master.
  void waits(bool so) { waits_ = so; }
  /// There is no master to unregister from: reduces the patience to 1 s.
  void hurry() { patience_ = 1; }

 private:
  static constexpr double kPatience = 5;  // [s]
  static constexpr double kPeriod = 0.1;  // between two checks [s]

  bool check() {
    const unsigned turns = turns_;
    const bool goes_on = turns != seen_ || waits_ || !EndRequest::made();
    seen_ = turns;
    // Counts periods rather than time: a process that was stopped has lost only one.
    idle_ = goes_on ? 0 : idle_ + kPeriod;
    if (idle_ >= patience_) end();
    return true;
  }

  std::atomic<unsigned> turns_{0};
  std::atomic<bool> waits_{false};
  std::atomic<double> patience_{kPatience};
  double idle_ = 0;  // these two are the watch's own [s]
  unsigned seen_ = 0;
  Ticker ticker_{kPeriod, [this] { return check(); }};
};

const char* textOf(Reply answer) {
  if (answer == Reply::kFailure) return "was restarted and does not know this node";
  return answer == Reply::kHangs ? "does not answer: it hangs, or is cut off" : "is gone";
}

/// Asks the node to end if its ROS master is gone, hangs, or was restarted and does not know the
/// node; roscpp notices none of these.
class MasterWatch {
 public:
  /// True once the master is gone and the node was asked to end.
  bool lost() const { return lost_; }

 private:
  static constexpr double kPeriod = 1.0;  // between two queries [s]
  static constexpr int kMisses = 3;       // in a row, after which the master counts as gone

  bool ask() {
    const Reply answer = askMaster();
    missed_ = answer == Reply::kSuccess ? 0 : missed_ + 1;
    if (missed_ < kMisses || !ros::ok()) return true;
    lost_ = true;
    EndRequest::make();
    logFatal("the ROS master at %s %s: this node exits", ros::master::getURI().c_str(),
             textOf(answer));
    return false;
  }

  int missed_ = 0;
  std::atomic<bool> lost_{false};
  Ticker ticker_{kPeriod, [this] { return ask(); }};
};

constexpr double kLongestWait = 0.1;  // for a callback [s]
constexpr double kLastLines = 1.0;  // longest wait for the last lines of a log that is blocked [s]

void spinUntilEnd(ShutdownWatchdog& watchdog, const Node& node) {
  const auto is_to_end = [&] {
    return EndRequest::isUrgent() || (EndRequest::made() && node.mayEnd()) || ros::isShuttingDown();
  };
  while (!is_to_end()) {
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(kLongestWait));
    watchdog.turn();
  }
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

int guarded(const std::function<int()>& body) {
  try {
    return body();
  } catch (const NothingToDo& reason) {
    logInfo("%s", reason.what());
    return kDone;
  } catch (const std::exception& error) {
    logFatal("%s", error.what());
    const bool of_document = dynamic_cast<const io::DocumentError*>(&error) != nullptr;
    const bool of_value = dynamic_cast<const std::invalid_argument*>(&error) != nullptr;
    return of_document || of_value ? kBadConfiguration : kFailed;
  }
}

int runNode(int argc, char** argv, const std::string& name,
            const std::function<std::unique_ptr<Node>()>& make) {
  // Lines appear immediately in pipes and files, too.
  std::setvbuf(stdout, nullptr, _IOLBF, BUFSIZ);
  ros::init(argc, argv, name);
  ShutdownWatchdog watchdog;
  const ros::NodeHandle started;  // waits for a master; keeps ROS up until faults are printed
  if (!ros::ok()) return kDone;
  LogThread log_thread;
  const EndRequest takes_over;
  return guarded([&]() -> int {
    MasterWatch master;
    const std::unique_ptr<Node> node = make();
    const int thrown = guarded([&] {
      spinUntilEnd(watchdog, *node);
      return kDone;
    });
    EndRequest::make();  // whatever ended it, the rest is watched
    watchdog.waits(true);
    const int verdict = node->finish();
    watchdog.waits(false);
    if (master.lost()) watchdog.hurry();
    log_thread.flush(kLastLines);
    ros::shutdown();
    return thrown != kDone || master.lost() ? kFailed : verdict;
  });
}

std::unique_ptr<Node> makeNode(const std::string& program) {
  static const std::map<std::string, std::unique_ptr<Node> (*)()> kNodes = {
      {names::kPressureCommandNode, makePressureCommand},
      {names::kSimulatedRigNode, makeSimulatedRig},
      {names::kVisionNode, makeVision},
      {names::kVisualServoNode, makeVisualServo}};
  return kNodes.at(program)();
}

void GuardedThread::start(std::function<void()> body, std::function<void()> on_failure) {
  thread_ = std::thread([this, body = std::move(body), on_failure = std::move(on_failure)] {
    const int code = guarded([&body] {
      body();
      return kDone;
    });
    verdict_ = code;
    if (code != kDone) on_failure();
  });
}

}  // namespace helix_arm::ros_bridge
