#pragma once

#include <cstdio>
#include <functional>
#include <stdexcept>

#include <ros/init.h>
#include <ros/node_handle.h>

#include "helix_arm/ros_bridge/common/clock_gate.hpp"
#include "helix_arm/ros_bridge/common/end_request.hpp"
#include "helix_arm/ros_bridge/common/end_watch.hpp"
#include "helix_arm/ros_bridge/common/exit_code.hpp"
#include "helix_arm/ros_bridge/common/master_watch.hpp"

namespace helix_arm::ros_bridge {

/// Thrown by the set-up of a node that has no work here, and rightly so: it ends with kDone.
class NothingToDo : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Runs `body`, turns what it throws into printed faults and an exit code.
///
/// ROS must be up, since it does the printing.
int guarded(const std::function<int()>& body);

/// Handles callbacks until the node is to end.
///
/// @param may_end  whether a first request to end is followed at once.
void spinUntilEnd(EndWatch& end_watch, const std::function<bool()>& may_end);

/// Whether a node is about nothing that it should finish before it ends; by default none is.
template <class Node>
bool mayEnd(const Node&) {
  return true;
}

/// The main of a node: makes it, spins until it is to end, returns its exit code.
///
/// A Node does its set-up in the default constructor, which may throw; finish() gives the verdict
/// on its run, and may take its time as long as it asks nothing of the ROS master. It is called
/// before ROS is shut down: a master that hangs delays the end by EndWatch::kPatience, and turns it
/// into kFailed, but delays nothing that finish() does. What a callback throws ends the node in the
/// same order, with kFailed.
template <class Node>
int runNode(int argc, char** argv, const char* name) {
  std::setvbuf(stdout, nullptr, _IOLBF, BUFSIZ);  // lines show at once in pipes and files, too
  ClockGate::init(argc, argv, name);
  EndWatch end_watch;
  const ros::NodeHandle started;  // waits for a master; keeps ROS up until faults are printed
  if (!ros::ok()) return kDone;
  const EndRequest takes_over;
  return guarded([&end_watch]() -> int {
    const ClockGate clock;
    MasterWatch master;
    Node node;
    const int thrown = guarded([&] {
      spinUntilEnd(end_watch, [&node] { return mayEnd(node); });
      return kDone;
    });
    EndRequest::make();  // whatever ended it: what is left is watched
    end_watch.waits(true);
    const int verdict = node.finish();
    end_watch.waits(false);
    if (master.lost()) end_watch.hurry();
    ros::shutdown();
    return thrown != kDone || master.lost() ? kFailed : verdict;
  });
}

}  // namespace helix_arm::ros_bridge
