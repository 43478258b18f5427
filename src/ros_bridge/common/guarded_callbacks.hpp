#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <tuple>
#include <type_traits>
#include <typeinfo>
#include <utility>
#include <vector>

#include <actionlib_msgs/GoalID.h>
#include <actionlib_msgs/GoalStatusArray.h>
#include <boost/array.hpp>
#include <boost/make_shared.hpp>
#include <ros/message_event.h>
#include <ros/message_traits.h>
#include <ros/node_handle.h>
#include <ros/serialization.h>
#include <ros/steady_timer.h>
#include <ros/time.h>

#include "diagnostics.hpp"

/// What others send, whatever it holds: stamps, ROS time, messages.
namespace helix_arm::ros_bridge {

/// Exact difference of any two stamps [s]; that of ros::Time throws if they are far apart.
inline double secondsBetween(const ros::Time& from, const ros::Time& to) {
  return 1e-9 * static_cast<double>(static_cast<std::int64_t>(to.toNSec()) -
                                    static_cast<std::int64_t>(from.toNSec()));
}

/// Whether ROS can compute with a time: it is below 2^31 s, with less than 10^9 ns.
inline bool isSound(const ros::Time& time) {
  constexpr std::uint32_t kEndOfTime = 1U << 31U;  // [s]
  constexpr std::uint32_t kNanosecondsASecond = 1000000000;
  return time.sec < kEndOfTime && time.nsec < kNanosecondsASecond;
}

/// Reads a ROS message from bytes, without allocating more elements than these bytes can hold.
///
/// roscpp's own stream allocates whatever length an array claims before reading its elements: 32
/// bytes that claim 2^29 numbers cost 4 GB and 10 s. This one compares the claim with the bytes
/// left first. Every fault throws ros::serialization::StreamOverrunException.
class CheckedStream {
 public:
  static constexpr ros::serialization::StreamType stream_type =
      ros::serialization::stream_types::Input;

  /// @param data  `length` bytes, which outlive the stream.
  CheckedStream(const std::uint8_t* data, std::uint32_t length)
      : data_(const_cast<std::uint8_t*>(data)), left_(length) {}

  template <class T>
  void next(T& value) {
    ros::serialization::Serializer<T>::read(*this, value);
  }

  template <class T, class Allocator>
  void next(std::vector<T, Allocator>& values) {
    std::uint32_t count = 0;
    next(count);
    // The shortest element: empty strings and arrays consist of their counts.
    const std::uint64_t shortest = std::max(1U, ros::serialization::serializationLength(T()));
    if (count * shortest > left_) ros::serialization::throwStreamOverrun();
    values.resize(count);
    if constexpr (std::is_arithmetic_v<T>) {
      if (count > 0) std::memcpy(values.data(), advance(count * sizeof(T)), count * sizeof(T));
    } else {
      for (T& value : values) next(value);
    }
  }

  template <class T, std::size_t N>
  void next(boost::array<T, N>& values) {
    for (T& value : values) next(value);
  }

  /// The next bytes, for the serializers of roscpp.
  std::uint8_t* advance(std::uint64_t bytes) {
    if (bytes > left_) ros::serialization::throwStreamOverrun();
    std::uint8_t* const out = data_;
    data_ += bytes;
    left_ -= bytes;
    return out;
  }

  std::uint64_t left() const { return left_; }  ///< bytes

 private:
  std::uint8_t* data_;
  std::uint64_t left_;
};

// How the servers and clients of actions read what the other side sends: a server makes the
// Serializer of its goals a GoalSerializer.

/// Serializer of a message by its fields, which reads it as all messages are read (CheckedStream).
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

// Guarded callbacks for all nodes: no message can end a node.
//
// Exceptions of callbacks, and messages that cannot be deserialised, are dropped, counted and
// warned of with their sender: at the first one, then once every five seconds. Arrays get no more
// memory than their messages have bytes for (CheckedStream).

/// Passes the messages of one topic from roscpp to a callback.
template <class Message>
class GuardedSubscription : public ros::SubscriptionCallbackHelper {
 public:
  using Event = ros::MessageEvent<const Message>;
  using Callback = std::function<void(const Event&)>;

  GuardedSubscription(const std::string& topic, Callback callback)
      : guard_("a message on " + topic), callback_(std::move(callback)) {}

  ros::VoidConstPtr deserialize(
      const ros::SubscriptionCallbackHelperDeserializeParams& params) override {
    if (wasRefusedEmpty(params)) return nullptr;
    boost::shared_ptr<Message> message;
    const auto& header = params.connection_header;
    const bool sound = guard_.run(header ? (*header)["callerid"] : "", [&] {
      message = boost::make_shared<Message>();
      CheckedStream stream(params.buffer, params.length);
      stream.next(*message);
    });
    return sound ? message : nullptr;
  }

  void call(ros::SubscriptionCallbackHelperCallParams& params) override {
    const Event event(params.event, ros::DefaultMessageCreator<Message>());
    guard_.run(event.getPublisherName(), [&] { callback_(event); });
  }

  const std::type_info& getTypeInfo() override { return typeid(Message); }
  bool isConst() override { return true; }
  bool hasHeader() override { return ros::message_traits::hasHeader<Message>(); }

 private:
  // Where a node has two subscriptions of a topic, roscpp asks a second time for an empty message
  // that was refused: with its freed buffer, whose address it has subtracted from the length 0.
  static bool wasRefusedEmpty(const ros::SubscriptionCallbackHelperDeserializeParams& params) {
    const auto address = reinterpret_cast<std::uintptr_t>(params.buffer);
    return address != 0 && params.length == static_cast<std::uint32_t>(0 - address);
  }

  FaultGuard guard_;
  const Callback callback_;
};

/// Passes a service's calls from roscpp to a callback; callers get the message of what it throws.
template <class Request, class Response>
class GuardedService : public ros::ServiceCallbackHelper {
 public:
  using Callback = std::function<bool(const std::string& caller, Request&, Response&)>;

  GuardedService(const std::string& service, Callback callback, FaultGuard::Log log = {})
      : guard_("a call of " + service, std::move(log)), callback_(std::move(callback)) {}

  bool call(ros::ServiceCallbackHelperCallParams& params) override {
    Request request;
    Response response;
    bool ok = false;
    std::string why;
    const auto& header = params.connection_header;
    const std::string caller = header ? (*header)["callerid"] : "";
    const bool sound = guard_.run(
        caller,
        [&] {
          const ros::SerializedMessage& bytes = params.request;
          CheckedStream stream(bytes.message_start,
                               static_cast<std::uint32_t>(bytes.num_bytes -
                                                          (bytes.message_start - bytes.buf.get())));
          stream.next(request);
          ok = callback_(caller, request, response);
        },
        &why);
    params.response = sound ? ros::serialization::serializeServiceResponse(ok, response)
                            : ros::serialization::serializeServiceResponse(false, why);
    // roscpp sends this response only if this returns true; the response says that the call failed.
    return !sound || ok;
  }

 private:
  FaultGuard guard_;
  const Callback callback_;
};

// What a callback takes.
template <class Message>
Message contentOf(const ros::MessageEvent<const Message>& event);
template <class Message>
Message contentOf(const boost::shared_ptr<const Message>& message);

/// Subscribes with TCP_NODELAY.
template <class Message>
ros::Subscriber listen(ros::NodeHandle& node, const std::string& topic, std::uint32_t queue,
                       std::function<void(const ros::MessageEvent<const Message>&)> callback) {
  ros::SubscribeOptions options(topic, queue, ros::message_traits::md5sum<Message>(),
                                ros::message_traits::datatype<Message>());
  options.helper = boost::make_shared<GuardedSubscription<Message>>(node.resolveName(topic),
                                                                    std::move(callback));
  options.transport_hints = ros::TransportHints().tcpNoDelay();
  return node.subscribe(options);
}

/// The same for a method that takes the message, or the event, which also has its sender.
template <class Node, class Taken>
ros::Subscriber listen(ros::NodeHandle& node, const std::string& topic, std::uint32_t queue,
                       void (Node::*callback)(const Taken&), Node* owner) {
  using Message = decltype(contentOf(std::declval<const Taken&>()));
  using Event = ros::MessageEvent<const Message>;
  return listen<Message>(node, topic, queue, [owner, callback](const Event& event) {
    if constexpr (std::is_same_v<Taken, Event>) {
      (owner->*callback)(event);
    } else {
      (owner->*callback)(event.getConstMessage());
    }
  });
}

/// Advertises a service. The callback takes request and response, or the caller before them.
template <class Node, class... Taken>
ros::ServiceServer serve(ros::NodeHandle& node, const std::string& service,
                         bool (Node::*callback)(Taken&...), Node* owner) {
  constexpr std::size_t kCount = sizeof...(Taken);
  using Request = std::tuple_element_t<kCount - 2, std::tuple<Taken...>>;
  using Response = std::tuple_element_t<kCount - 1, std::tuple<Taken...>>;
  ros::AdvertiseServiceOptions options;
  options.service = service;
  options.md5sum = ros::service_traits::md5sum<Request>();
  options.datatype = ros::service_traits::datatype<Request>();
  options.req_datatype = ros::message_traits::datatype<Request>();
  options.res_datatype = ros::message_traits::datatype<Response>();
  options.helper = boost::make_shared<GuardedService<Request, Response>>(
      node.resolveName(service),
      [owner, callback](const std::string& caller, Request& request, Response& response) {
        if constexpr (kCount == 3) {
          return (owner->*callback)(caller, request, response);
        } else {
          return (owner->*callback)(request, response);
        }
      });
  return node.advertiseService(options);
}

/// Calls back periodically, on a steady clock.
/// @param what    activity named in the warnings, such as "drawing".
/// @param period  [s]
template <class Node>
ros::SteadyTimer repeat(ros::NodeHandle& node, const std::string& what, double period,
                        void (Node::*callback)(const ros::SteadyTimerEvent&), Node* owner) {
  // Caught here: roscpp removes a timer whose callback throws.
  const auto guard = std::make_shared<FaultGuard>("a turn of " + what);
  return node.createSteadyTimer(ros::WallDuration(period),
                                [guard, owner, callback](const ros::SteadyTimerEvent& event) {
                                  guard->run("", [&] { (owner->*callback)(event); });
                                });
}

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
