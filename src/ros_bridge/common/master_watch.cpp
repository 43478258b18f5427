#include "helix_arm/ros_bridge/common/master_watch.hpp"

#include <string>

#include <poll.h>
#include <ros/init.h>
#include <ros/master.h>
#include <ros/this_node.h>
#include <xmlrpcpp/XmlRpc.h>

#include "helix_arm/ros_bridge/common/end_request.hpp"
#include "helix_arm/ros_bridge/common/log.hpp"

namespace helix_arm::ros_bridge {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kSuccess = 1;  // code of an answer, by ROS's Master API

enum class Answer { kKnowsUs, kForgotUs, kHangs, kIsGone };

const char* textOf(Answer answer) {
  switch (answer) {
    case Answer::kForgotUs:
      return "was restarted and does not know this node";
    case Answer::kHangs:
      return "does not answer: it hangs, or is cut off";
    default:
      return "is gone";
  }
}

// After a restart, the master answers but does not know this node, which nobody can then find.
// ros::master::execute() would wait forever for a master that hangs.
Answer askMaster() {
  XmlRpc::XmlRpcValue question, answer;
  question[0] = ros::this_node::getName();
  question[1] = ros::this_node::getName();
  XmlRpc::XmlRpcClient client(ros::master::getHost().c_str(),
                              static_cast<int>(ros::master::getPort()), "/");
  if (!client.executeNonBlock("lookupNode", question)) return Answer::kIsGone;
  using XmlRpc::XmlRpcDispatch;
  const auto end = Clock::now() + std::chrono::duration<double>(MasterWatch::kPatience);
  unsigned awaited = XmlRpcDispatch::WritableEvent;
  while (awaited != 0) {
    const std::chrono::duration<double, std::milli> left = end - Clock::now();
    if (left.count() <= 0) return Answer::kHangs;
    pollfd line{client.getfd(), POLLIN, 0};
    if (awaited == XmlRpcDispatch::WritableEvent) line.events = POLLOUT;
    if (poll(&line, 1, 1 + static_cast<int>(left.count())) <= 0) continue;
    const bool ready = (line.revents & line.events) != 0;
    awaited = client.handleEvent(ready ? awaited : unsigned{XmlRpcDispatch::Exception});
  }
  // A refused connection also counts as done, without an answer.
  if (!client.executeCheckDone(answer) || !answer.valid()) return Answer::kIsGone;
  const bool sound = !client.isFault() && answer.getType() == XmlRpc::XmlRpcValue::TypeArray &&
                     answer.size() > 0 && answer[0].getType() == XmlRpc::XmlRpcValue::TypeInt;
  return sound && static_cast<int>(answer[0]) == kSuccess ? Answer::kKnowsUs : Answer::kForgotUs;
}

}  // namespace

bool masterAnswers() {
  const Answer answer = askMaster();
  return answer == Answer::kKnowsUs || answer == Answer::kForgotUs;
}

MasterWatch::MasterWatch(std::chrono::milliseconds period, int misses)
    : thread_([this, period, misses] { watch(period, misses); }) {}

MasterWatch::~MasterWatch() {
  {
    const basics::MutexLock lock(mutex_);
    stop_ = true;
  }
  wake_.notifyAll();
  thread_.join();
}

void MasterWatch::watch(std::chrono::milliseconds period, int misses) {
  int missed = 0;
  basics::MutexLock lock(mutex_);
  while (!wake_.waitFor(lock, period, [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_; })) {
    lock.unlock();
    const Answer answer = askMaster();
    missed = answer == Answer::kKnowsUs ? 0 : missed + 1;
    if (missed >= misses && ros::ok()) {
      lost_ = true;
      EndRequest::make();
      logFatal("the ROS master at %s %s: this node exits", ros::master::getURI().c_str(),
               textOf(answer));
      return;
    }
    lock.lock();
  }
}

}  // namespace helix_arm::ros_bridge
