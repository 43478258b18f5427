#include "client_watch.hpp"

#include <chrono>

#include <poll.h>
#include <ros/master.h>
#include <ros/network.h>
#include <ros/this_node.h>
#include <xmlrpcpp/XmlRpc.h>

#include "basics/quote.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kAnswerPatience = 2;  // longest wait for an answer [s]
constexpr int kSuccessCode = 1;        // of an answer, by ROS's Master and Slave API

double steadySeconds() { return ros::SteadyTime::now().toSec(); }

// Calls and waits for at most kAnswerPatience; ros::master::execute() waits without end.
// @param answer  the value of a success.
Reply callXmlRpc(const std::string& host, int port, const char* method,
                 const XmlRpc::XmlRpcValue& question, XmlRpc::XmlRpcValue& answer) {
  XmlRpc::XmlRpcClient client(host.c_str(), port, "/");
  if (!client.executeNonBlock(method, question)) return Reply::kIsGone;
  using XmlRpc::XmlRpcDispatch;
  const auto end =
      std::chrono::steady_clock::now() + std::chrono::duration<double>(kAnswerPatience);
  unsigned awaited = XmlRpcDispatch::WritableEvent;
  while (awaited != 0) {
    const std::chrono::duration<double, std::milli> left = end - std::chrono::steady_clock::now();
    if (left.count() <= 0) return Reply::kHangs;
    pollfd line{client.getfd(), POLLIN, 0};
    if (awaited == XmlRpcDispatch::WritableEvent) line.events = POLLOUT;
    if (poll(&line, 1, 1 + static_cast<int>(left.count())) <= 0) continue;
    const bool ready = (line.revents & line.events) != 0;
    awaited = client.handleEvent(ready ? awaited : unsigned{XmlRpcDispatch::Exception});
  }
  // A refused connection also counts as done, without an answer.
  XmlRpc::XmlRpcValue all;
  if (!client.executeCheckDone(all) || !all.valid()) return Reply::kIsGone;
  const bool sound = !client.isFault() && all.getType() == XmlRpc::XmlRpcValue::TypeArray &&
                     all.size() == 3 && all[0].getType() == XmlRpc::XmlRpcValue::TypeInt;
  if (!sound || static_cast<int>(all[0]) != kSuccessCode) return Reply::kFailure;
  answer = all[2];
  return Reply::kSuccess;
}

// Asks the master for a node.
Reply lookUp(const std::string& node, XmlRpc::XmlRpcValue& uri) {
  XmlRpc::XmlRpcValue question;
  question[0] = ros::this_node::getName();
  question[1] = node;
  return callXmlRpc(ros::master::getHost(), static_cast<int>(ros::master::getPort()), "lookupNode",
                    question, uri);
}

}  // namespace

Reply askMaster() {
  XmlRpc::XmlRpcValue answer;
  return lookUp(ros::this_node::getName(), answer);
}

void ClientWatch::watch(const std::string& node) {
  const basics::MutexLock lock(mutex_);
  node_ = node;
  ++number_;
  last_answer_ = steadySeconds();
  gone_ = node.empty();
}

void ClientWatch::release() {
  const basics::MutexLock lock(mutex_);
  node_.clear();
  ++number_;
  last_answer_ = kInfinity;
  gone_ = false;
}

// The silence counts here, too: a name that cannot be resolved may hold up the thread.
bool ClientWatch::isGone() const {
  return gone_ || steadySeconds() - last_answer_ > kLongestSilence;
}

std::string ClientWatch::whyGone() const {
  const basics::MutexLock lock(mutex_);
  return "the node that sent the goal" + (node_.empty() ? "" : ", " + basics::quoted(node_) + ",") +
         " is gone or does not answer; keep it running until the goal has ended";
}

void ClientWatch::ask() {
  basics::MutexLock lock(mutex_);
  if (node_.empty() || gone_) return;
  const std::string node = node_;
  if (std::exchange(asked_, number_) != number_) {
    uri_.clear();
    misses_ = 0;
  }
  lock.unlock();
  misses_ = answers(node, uri_) ? 0 : misses_ + 1;
  lock.lock();
  if (asked_ != number_) return;
  if (misses_ == 0) last_answer_ = steadySeconds();
  if (misses_ >= kMisses) gone_ = true;
}

// The address is looked up once: a node that was restarted has another one, and knows no goal of
// the one before it. A master that does not answer tells nothing of the node.
bool ClientWatch::answers(const std::string& node, std::string& uri) {
  XmlRpc::XmlRpcValue caller, answer;
  caller[0] = ros::this_node::getName();
  if (uri.empty()) {
    const Reply reply = lookUp(node, answer);
    if (reply == Reply::kHangs || reply == Reply::kIsGone) return true;
    if (reply == Reply::kFailure || answer.getType() != XmlRpc::XmlRpcValue::TypeString) {
      return false;
    }
    uri = static_cast<std::string&>(answer);
  }
  std::string host;
  std::uint32_t port = 0;
  return ros::network::splitURI(uri, host, port) &&
         callXmlRpc(host, static_cast<int>(port), "getPid", caller, answer) == Reply::kSuccess;
}

}  // namespace helix_arm::ros_bridge
