#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>

#include <ros/node_handle.h>

namespace helix_arm::ros_bridge {

/// Exit code of a node.
enum ExitCode {
  kDone = 0,              ///< asked to end (Ctrl-C, rosnode kill), or work done
  kFailed = 1,            ///< the ROS master was lost, or the node failed
  kBadConfiguration = 2,  ///< a parameter or a file breaks its rules; every fault was printed
};

/// Request to end a node: by Ctrl-C, SIGTERM, rosnode kill, or from within. ROS stays up: the node
/// can do its work, such as venting, without the ROS master, which may hang. For runNode().
class EndRequest {
 public:
  /// Replaces roscpp's handlers; its node must have been started.
  EndRequest();

  /// Makes the request, from any thread.
  static void make();
  /// True once the request was made.
  static bool made();
  /// True if the node should not finish its work first: it was asked twice, or from within.
  static bool isUrgent();
};

/// Thrown by the set-up of a node that legitimately has nothing to do: it ends with kDone.
class NothingToDo : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Runs `body` and converts its exceptions to printed faults and an exit code.
///
/// ROS must be up, since it prints the faults.
int guarded(const std::function<int()>& body);

/// A node. Its constructor is its set-up, and throws where that fails.
class Node {
 public:
  virtual ~Node() = default;
  /// Whether it has no work to finish before it ends.
  virtual bool mayEnd() const { return true; }
  /// Its exit code. May take time if it does not use the ROS master.
  virtual int finish() { return kDone; }
};

/// The main function of a node: makes it, spins until it must end, returns its exit code.
///
/// finish() is called before ROS is shut down: a hanging master delays the end by
/// 5 s and turns the exit code into kFailed, but does not delay finish(). An
/// exception of a callback ends the node in the same order, with kFailed.
int runNode(int argc, char** argv, const std::string& name,
            const std::function<std::unique_ptr<Node>()>& make);

// The nodes. Each throws io::DocumentError or std::invalid_argument with every fault of its
// parameters and files.
std::unique_ptr<Node> makePressureCommand();
std::unique_ptr<Node> makeSimulatedRig();
std::unique_ptr<Node> makeVision();
/// In a nodelet manager's process, which a fault in the threads of the node does not end.
std::unique_ptr<Node> makeVisionInManager(const ros::NodeHandle& node,
                                          const ros::NodeHandle& private_node);
std::unique_ptr<Node> makeVisualServo();
/// Node of a program, by its name.
std::unique_ptr<Node> makeNode(const std::string& program);

/// Calls a function periodically in a thread of its own, until that returns false or this is
/// destroyed, which waits for the function to return.
class Ticker {
 public:
  /// @param period  before each call, after the end of the last one [s].
  Ticker(double period, std::function<bool()> turn)
      : thread_([end = end_.get_future(), period, turn = std::move(turn)] {
          const std::chrono::duration<double> pause(period);
          while (end.wait_for(pause) == std::future_status::timeout && turn()) {
          }
        }) {}
  ~Ticker() {
    end_.set_value();
    thread_.join();
  }

 private:
  std::promise<void> end_;
  std::thread thread_;
};

/// A thread whose exceptions do not end the process silently: they are printed and reported.
class GuardedThread {
 public:
  /// Joins; the body must have been told to end.
  ~GuardedThread() { join(); }

  /// @param on_failure  called by the thread as its last action if the body threw.
  void start(
      std::function<void()> body, std::function<void()> on_failure = [] { EndRequest::make(); });
  void join() {
    if (thread_.joinable()) thread_.join();
  }

  /// Exit code of the node as far as the body is concerned.
  int verdict() const { return verdict_; }

 private:
  std::atomic<int> verdict_{kDone};
  std::thread thread_;
};

}  // namespace helix_arm::ros_bridge
