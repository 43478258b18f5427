#include "ros_bridge/common/client_watch.hpp"

#include <chrono>
#include <cstdint>
#include <limits>

#include <ros/master.h>
#include <ros/network.h>
#include <ros/this_node.h>
#include <ros/time.h>

#include "helix_arm/basics/quote.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

double steadySeconds() { return ros::SteadyTime::now().toSec(); }

}  // namespace

ClientWatch::ClientWatch() : last_answer_(kInfinity), thread_([this] { run(); }) {}

ClientWatch::~ClientWatch() {
  {
    const basics::MutexLock lock(mutex_);
    stop_ = true;
  }
  wake_.notifyAll();
  thread_.join();
}

void ClientWatch::watch(const std::string& node) {
  {
    const basics::MutexLock lock(mutex_);
    node_ = node;
    ++number_;
    last_answer_ = steadySeconds();
    gone_ = node.empty();
  }
  wake_.notifyAll();
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

void ClientWatch::run() {
  std::string uri;
  unsigned number = 0;
  int misses = 0;
  basics::MutexLock lock(mutex_);
  for (;;) {
    wake_.wait(lock,
               [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_ || (!node_.empty() && !gone_); });
    if (stop_) return;
    if (number != number_) {
      uri.clear();
      misses = 0;
    }
    number = number_;
    const std::string node = node_;
    lock.unlock();
    misses = answers(node, uri) ? 0 : misses + 1;
    lock.lock();
    if (number == number_ && misses == 0) last_answer_ = steadySeconds();
    if (number == number_ && misses >= kMisses) gone_ = true;
    wake_.waitFor(lock, std::chrono::duration<double>(kPeriod),
                  [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_; });
  }
}

// The address is looked up once: a node that was restarted has another one, and knows no goal of
// the one before it. A master that does not answer tells nothing of the node.
bool ClientWatch::answers(const std::string& node, std::string& uri) {
  XmlRpc::XmlRpcValue caller, answer;
  caller[0] = ros::this_node::getName();
  if (uri.empty()) {
    XmlRpc::XmlRpcValue question = caller;
    question[1] = node;
    const Reply reply = callXmlRpc(ros::master::getHost(), static_cast<int>(ros::master::getPort()),
                                   "lookupNode", question, answer);
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
