#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

#include <ros/node_handle.h>

#include "end_watch.hpp"

namespace helix_arm::ros_bridge {

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
/// EndWatch::kPatience and turns the exit code into kFailed, but does not delay finish(). An
/// exception of a callback ends the node in the same order, with kFailed.
int runNode(int argc, char** argv, const std::string& name,
            const std::function<std::unique_ptr<Node>()>& make);

// The nodes. Each throws io::DocumentError, ParameterError or std::invalid_argument with every
// fault of its parameters and files.
std::unique_ptr<Node> makeCalibration();
std::unique_ptr<Node> makePressureCommand();
std::unique_ptr<Node> makeSimulatedRig();
std::unique_ptr<Node> makeVision();
/// In a nodelet manager's process, which a fault in the threads of the node does not end.
std::unique_ptr<Node> makeVisionInManager(const ros::NodeHandle& node,
                                          const ros::NodeHandle& private_node);
std::unique_ptr<Node> makeVisualServo();
/// That of a program, by its name.
std::unique_ptr<Node> makeNode(const std::string& program);

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
