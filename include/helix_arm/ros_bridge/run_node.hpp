#pragma once

#include <cstdio>
#include <functional>
#include <stdexcept>

#include <ros/init.h>
#include <ros/node_handle.h>

#include "helix_arm/ros_bridge/clock_gate.hpp"
#include "helix_arm/ros_bridge/master_watch.hpp"

namespace helix_arm::ros_bridge {

/// What a node's process ends with.
enum ExitCode {
  kDone = 0,              ///< asked to end (Ctrl-C, rosnode kill), or its work is done
  kFailed = 1,            ///< the ROS master was lost, or the node's own verdict
  kBadConfiguration = 2,  ///< a parameter or a file breaks its rules; every fault was printed
};

/// Thrown by the set-up of a node that has no work here, and rightly so: it ends with kDone.
class NothingToDo : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Runs `body`, turns what it throws into printed faults and an exit code.
///
/// ROS must be up, since it does the printing.
int guarded(const std::function<int()>& body);

/// The main of a node: makes it, spins until it is to end, returns its exit code.
///
/// A Node does its set-up in the default constructor, which may throw; finish() gives the verdict
/// on its run.
template <class Node>
int runNode(int argc, char** argv, const char* name) {
  std::setvbuf(stdout, nullptr, _IOLBF, BUFSIZ);  // lines show at once in pipes and files, too
  ClockGate::init(argc, argv, name);
  const ros::NodeHandle started;  // waits for a master; keeps ROS up until faults are printed
  if (!ros::ok()) return kDone;
  return guarded([]() -> int {
    const ClockGate clock;
    Node node;
    MasterWatch watch;
    ros::spin();
    const int verdict = node.finish();
    return watch.lost() ? kFailed : verdict;
  });
}

}  // namespace helix_arm::ros_bridge
