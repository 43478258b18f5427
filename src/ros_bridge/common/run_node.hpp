#pragma once

#include <atomic>
#include <cstdio>
#include <functional>
#include <stdexcept>
#include <thread>

#include <ros/init.h>
#include <ros/node_handle.h>

#include "client_watch.hpp"
#include "clock_gate.hpp"
#include "end_watch.hpp"
#include "log.hpp"

namespace helix_arm::ros_bridge {

/// Thrown by the set-up of a node that legitimately has nothing to do: it ends with kDone.
class NothingToDo : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Longest wait for the last lines of a log that is blocked [s].
inline constexpr double kLastLines = 1.0;

/// Runs `body` and converts its exceptions to printed faults and an exit code.
///
/// ROS must be up, since it prints the faults.
int guarded(const std::function<int()>& body);

/// Handles callbacks until the node must end.
///
/// @param may_end  whether a first request to end takes effect immediately.
void spinUntilEnd(EndWatch& end_watch, const std::function<bool()>& may_end);

/// Whether a node has no work to finish before it ends; default: true.
template <class Node>
bool mayEnd(const Node&) {
  return true;
}

/// The main function of a node: creates it, spins until it must end, returns its exit code.
///
/// A Node does its set-up in the default constructor, which may throw; finish() returns its exit
/// code, and may take time if it does not use the ROS master. It is called before ROS is shut down:
/// a hanging master delays the end by EndWatch::kPatience and turns the exit code into kFailed, but
/// does not delay finish(). An exception of a callback ends the node in the same order, with
/// kFailed.
template <class Node>
int runNode(int argc, char** argv, const char* name) {
  std::setvbuf(stdout, nullptr, _IOLBF,
               BUFSIZ);  // lines appear immediately in pipes and files, too
  ClockGate::init(argc, argv, name);
  EndWatch end_watch;
  const ros::NodeHandle started;  // waits for a master; keeps ROS up until faults are printed
  if (!ros::ok()) return kDone;
  LogThread log_thread;
  const EndRequest takes_over;
  return guarded([&]() -> int {
    const ClockGate clock;
    MasterWatch master;
    Node node;
    const int thrown = guarded([&] {
      spinUntilEnd(end_watch, [&node] { return mayEnd(node); });
      return kDone;
    });
    EndRequest::make();  // whatever ended it, the rest is watched
    end_watch.waits(true);
    const int verdict = node.finish();
    end_watch.waits(false);
    if (master.lost()) end_watch.hurry();
    log_thread.flush(kLastLines);
    ros::shutdown();
    return thrown != kDone || master.lost() ? kFailed : verdict;
  });
}

/// A thread whose exceptions do not end the process silently: they are printed and reported.
class GuardedThread {
 public:
  /// Joins; the body must have been told to end.
  ~GuardedThread() { join(); }

  /// @param on_failure  called by the thread as its last action if the body threw.
  void start(
      std::function<void()> body, std::function<void()> on_failure = [] { EndRequest::make(); });
  void join();

  /// Exit code of the node as far as the body is concerned.
  int verdict() const { return verdict_; }

 private:
  std::atomic<int> verdict_{kDone};
  std::thread thread_;
};

}  // namespace helix_arm::ros_bridge
