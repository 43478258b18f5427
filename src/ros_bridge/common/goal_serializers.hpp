#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <type_traits>

#include <actionlib_msgs/GoalID.h>
#include <actionlib_msgs/GoalStatusArray.h>
#include <ros/serialization.h>

#include "guarded_callbacks.hpp"
#include "ros_time.hpp"

/// How the servers and clients of actions read what the other side sends. Every source that
/// instantiates one includes it; a server makes the Serializer of its goals a GoalSerializer.
namespace helix_arm::ros_bridge {

/// Serializer of a message by its fields, which reads it with the checks of all other messages
/// (CheckedStream).
template <class Message, auto... fields>
struct CheckedSerializer {
  template <class Stream>
  static void read(Stream& stream, Message& message) {
    if constexpr (std::is_same_v<Stream, CheckedStream>) {
      (stream.next(message.*fields), ...);
    } else {
      CheckedStream checked(stream.getData(), stream.getLength());
      checked.next(message);
      stream.advance(stream.getLength() - static_cast<std::uint32_t>(checked.left()));
    }
  }
  template <class Stream>
  static void write(Stream& stream, const Message& message) {
    (stream.next(message.*fields), ...);
  }
  static std::uint32_t serializedLength(const Message& message) {
    return (ros::serialization::serializationLength(message.*fields) + ...);
  }
};

/// Of the goals of an action.
template <class Goal>
using GoalSerializer = CheckedSerializer<Goal, &Goal::header, &Goal::goal_id, &Goal::goal>;

}  // namespace helix_arm::ros_bridge

namespace ros::serialization {

// actionlib subscribes by itself, and nothing catches what its callbacks throw. A goal or
// cancellation whose stamp would make them throw is therefore refused while it is read.
template <>
struct Serializer<actionlib_msgs::GoalID>
    : helix_arm::ros_bridge::CheckedSerializer<
          actionlib_msgs::GoalID, &actionlib_msgs::GoalID::stamp, &actionlib_msgs::GoalID::id> {
  template <class Stream>
  static void read(Stream& stream, actionlib_msgs::GoalID& goal) {
    CheckedSerializer::read(stream, goal);
    if (helix_arm::ros_bridge::isSound(goal.stamp)) return;
    throw std::runtime_error("its stamp is " + std::to_string(goal.stamp.sec) + " s and " +
                             std::to_string(goal.stamp.nsec) + " ns; expected less than 2^31 s");
  }
};

// A client gets the states of all goals: an array, which may claim any length.
template <>
struct Serializer<actionlib_msgs::GoalStatusArray>
    : helix_arm::ros_bridge::CheckedSerializer<actionlib_msgs::GoalStatusArray,
                                               &actionlib_msgs::GoalStatusArray::header,
                                               &actionlib_msgs::GoalStatusArray::status_list> {};

}  // namespace ros::serialization
