#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>

#include <actionlib_msgs/GoalID.h>
#include <actionlib_msgs/GoalStatusArray.h>
#include <ros/serialization.h>

#include "guarded_callbacks.hpp"
#include "ros_time.hpp"

/// How the servers and clients of actions read what the other side sends. Every source that
/// instantiates one includes it; a server makes the Serializer of its goals a GoalSerializer.
namespace helix_arm::ros_bridge {

/// Reads the goals of an action with the checks of all other messages (CheckedStream).
template <class ActionGoal>
struct GoalSerializer {
  static void read(CheckedStream& stream, ActionGoal& goal) {
    stream.next(goal.header);
    stream.next(goal.goal_id);
    stream.next(goal.goal);
  }
  template <class Stream>
  static void read(Stream& stream, ActionGoal& goal) {
    CheckedStream checked(stream.getData(), stream.getLength());
    read(checked, goal);
    stream.advance(stream.getLength() - static_cast<std::uint32_t>(checked.left()));
  }
  template <class Stream>
  static void write(Stream& stream, const ActionGoal& goal) {
    stream.next(goal.header);
    stream.next(goal.goal_id);
    stream.next(goal.goal);
  }
  static std::uint32_t serializedLength(const ActionGoal& goal) {
    using ros::serialization::serializationLength;
    return serializationLength(goal.header) + serializationLength(goal.goal_id) +
           serializationLength(goal.goal);
  }
};

}  // namespace helix_arm::ros_bridge

namespace ros::serialization {

// actionlib subscribes by itself, and nothing catches what its callbacks throw. A goal or
// cancellation whose stamp would make them throw is therefore refused while it is read.
template <>
struct Serializer<actionlib_msgs::GoalID> {
  using GoalID = actionlib_msgs::GoalID;
  template <class Stream>
  static void read(Stream& stream, GoalID& goal) {
    stream.next(goal.stamp);
    stream.next(goal.id);
    if (helix_arm::ros_bridge::isSound(goal.stamp)) return;
    throw std::runtime_error("its stamp is " + std::to_string(goal.stamp.sec) + " s and " +
                             std::to_string(goal.stamp.nsec) + " ns; expected less than 2^31 s");
  }
  template <class Stream>
  static void write(Stream& stream, const GoalID& goal) {
    stream.next(goal.stamp);
    stream.next(goal.id);
  }
  static std::uint32_t serializedLength(const GoalID& goal) {
    return serializationLength(goal.stamp) + serializationLength(goal.id);
  }
};

// A client gets the states of all goals: an array, which may claim any length.
template <>
struct Serializer<actionlib_msgs::GoalStatusArray> {
  using GoalStatusArray = actionlib_msgs::GoalStatusArray;
  template <class Stream>
  static void read(Stream& stream, GoalStatusArray& array) {
    helix_arm::ros_bridge::CheckedStream checked(stream.getData(), stream.getLength());
    checked.next(array.header);
    checked.next(array.status_list);
    stream.advance(stream.getLength() - static_cast<std::uint32_t>(checked.left()));
  }
  template <class Stream>
  static void write(Stream& stream, const GoalStatusArray& array) {
    stream.next(array.header);
    stream.next(array.status_list);
  }
  static std::uint32_t serializedLength(const GoalStatusArray& array) {
    return serializationLength(array.header) + serializationLength(array.status_list);
  }
};

}  // namespace ros::serialization
