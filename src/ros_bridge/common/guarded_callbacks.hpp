#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include <boost/function.hpp>
#include <ros/message_event.h>
#include <ros/node_handle.h>
#include <ros/service_callback_helper.h>
#include <ros/steady_timer.h>
#include <ros/time.h>

#include "diagnostics.hpp"

/// Callbacks that do not end a node, and differences of the stamps that others send.
namespace helix_arm::ros_bridge {

/// Exact difference of any two stamps [s]; that of ros::Time throws if they are far apart.
inline double secondsBetween(const ros::Time& from, const ros::Time& to) {
  return 1e-9 * static_cast<double>(static_cast<std::int64_t>(to.toNSec()) -
                                    static_cast<std::int64_t>(from.toNSec()));
}

// Callbacks of all nodes. What one throws is counted and warned of with the sender of its message:
// at the first one, then once every five seconds.

/// Subscribes with TCP_NODELAY.
/// @param callback  takes a ros::MessageEvent<const Message>, which also has the sender.
template <class Message, class Callback>
ros::Subscriber listen(ros::NodeHandle& node, const std::string& topic, std::uint32_t queue,
                       Callback callback) {
  using Event = ros::MessageEvent<const Message>;
  const auto guard = std::make_shared<FaultGuard>("a message on " + node.resolveName(topic));
  const boost::function<void(const Event&)> guarded = [guard, callback](const Event& event) {
    guard->run(event.getPublisherName(), [&] { callback(event); });
  };
  return node.subscribe<Message, const Event&>(topic, queue, guarded, {},
                                               ros::TransportHints().tcpNoDelay());
}

/// The same for a method that takes the message.
template <class Node, class Message>
ros::Subscriber listen(ros::NodeHandle& node, const std::string& topic, std::uint32_t queue,
                       void (Node::*callback)(const boost::shared_ptr<const Message>&),
                       Node* owner) {
  return listen<Message>(node, topic, queue, [owner, callback](const auto& event) {
    (owner->*callback)(event.getConstMessage());
  });
}

/// Advertises a service, whose call fails where the callback throws.
/// @param callback  takes a ros::ServiceEvent<Request, Response>, which also has the caller.
template <class Request, class Response, class Callback>
ros::ServiceServer serve(ros::NodeHandle& node, const std::string& service, Callback callback) {
  using Event = ros::ServiceEvent<Request, Response>;
  const auto guard = std::make_shared<FaultGuard>("a call of " + node.resolveName(service));
  const boost::function<bool(Event&)> guarded = [guard, callback](Event& event) {
    bool ok = false;
    guard->run(event.getCallerName(), [&] { ok = callback(event); });
    return ok;
  };
  return node.advertiseService(service, guarded);
}

/// The same for a method that takes request and response.
template <class Node, class Request, class Response>
ros::ServiceServer serve(ros::NodeHandle& node, const std::string& service,
                         bool (Node::*callback)(const Request&, Response&), Node* owner) {
  return serve<Request, Response>(node, service, [owner, callback](auto& event) {
    return (owner->*callback)(event.getRequest(), event.getResponse());
  });
}

/// Calls back periodically, on a steady clock.
/// @param what    activity named in the warnings, such as "drawing".
/// @param period  [s]
template <class Callback>
ros::SteadyTimer repeat(ros::NodeHandle& node, const std::string& what, double period,
                        Callback callback) {
  // Caught here: roscpp removes a timer whose callback throws.
  const auto guard = std::make_shared<FaultGuard>("a turn of " + what);
  return node.createSteadyTimer(
      ros::WallDuration(period),
      [guard, callback](const ros::SteadyTimerEvent&) { guard->run("", callback); });
}

}  // namespace helix_arm::ros_bridge
