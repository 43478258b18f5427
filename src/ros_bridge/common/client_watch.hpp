#pragma once

#include <atomic>
#include <limits>
#include <list>
#include <string>
#include <utility>

#include <boost/weak_ptr.hpp>
#include <ros/message_event.h>
#include <ros/node_handle.h>
#include <ros/this_node.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include "guarded_callbacks.hpp"
#include "helix_arm/TargetStatus.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/control/target_check.hpp"
#include "run_node.hpp"

/// A commander, whether the master and the sender of a goal are there, and how the commander ends.
namespace helix_arm::ros_bridge {

/// Longest wait for an answer [s].
inline constexpr double kAnswerPatience = 2;

/// Outcome of a call of the XML-RPC interface of the master or of a node.
enum class Reply {
  kSuccess,
  kFailure,  ///< it answers that it failed
  kHangs,    ///< no answer within kAnswerPatience
  kIsGone,   ///< nobody is there, or it ended
};

/// Calls and waits for at most kAnswerPatience; ros::master::execute() waits without end.
///
/// @param answer  the value of a success.
Reply callXmlRpc(const std::string& host, int port, const char* method,
                 const XmlRpc::XmlRpcValue& question, XmlRpc::XmlRpcValue& answer);

/// Asks the master for this node, which a restarted one does not know and nobody can then find.
Reply askMaster();

/// Whether the ROS master answers within kAnswerPatience; unlike ros::master::check(), which
/// waits for one that hangs without end.
inline bool masterAnswers() {
  const Reply answer = askMaster();
  return answer == Reply::kSuccess || answer == Reply::kFailure;
}

/// Whether another node is still there: an arm that it set in motion has a living commander.
///
/// Asks the node itself (getPid of its XML-RPC interface) from a thread of its own, kPeriod after
/// each answer. It is gone after kMisses questions in a row without an answer, which is within 1 s
/// after its process has ended, since nobody listens on its port; and kLongestSilence after its
/// last answer, where it was stopped, or its machine or the network was cut off. Thread-safe.
class ClientWatch {
 public:
  static constexpr double kPeriod = 0.25;  ///< [s]
  static constexpr int kMisses = 3;
  static constexpr double kLongestSilence = 7.0;  ///< [s]

  /// Watches this node from now on, in place of another. @param node  its name; empty: gone.
  void watch(const std::string& node);
  /// Watches no node.
  void release();

  /// Whether the watched node is gone. Takes no lock.
  bool isGone() const;
  /// The fault, and the remedy.
  std::string whyGone() const;

 private:
  /// One question.
  void ask() HELIX_ARM_EXCLUDES(mutex_);
  /// Asks it. @param uri  of its interface; empty: still to be looked up.
  static bool answers(const std::string& node, std::string& uri);

  static constexpr double kInfinity = std::numeric_limits<double>::infinity();

  mutable basics::Mutex mutex_;
  std::string node_ HELIX_ARM_GUARDED_BY(mutex_);     ///< empty: none
  unsigned number_ HELIX_ARM_GUARDED_BY(mutex_) = 0;  ///< of watched nodes so far
  std::atomic<bool> gone_{false};
  /// Time of the last answer on the steady clock; infinite while no node is watched [s].
  std::atomic<double> last_answer_{kInfinity};
  // State of the thread that asks.
  std::string uri_;
  unsigned asked_ = 0;  ///< number of the node
  int misses_ = 0;
  Ticker ticker_{kPeriod, [this] {  // last: its end waits for at most kAnswerPatience
                   ask();
                   return true;
                 }};
};

/// Watches the node that sent the goal of an action. Thread-safe.
///
/// actionlib does not tell who sent a goal: this hears the same messages. It is made before the
/// server of the action with the same node handle, so that it hears each of them first.
template <class ActionGoal>
class GoalClient {
 public:
  using Goal = typename ActionGoal::_goal_type;

  GoalClient(ros::NodeHandle& node, const std::string& action) {
    subscriber_ = listen(node, action + "/goal", kQueue, &GoalClient::onGoal, this);
  }

  /// Watches the sender of the next goal, which the server has handed out and not copied, beside
  /// that of the present one: a goal may be checked for long before it begins.
  void watchNext(const Goal& goal) { next().watch(senderOf(goal)); }
  /// The next goal becomes the present one.
  void beginNext() {
    present().release();
    present_ = 1 - present_;
  }

  ClientWatch& present() { return watches_[present_]; }
  ClientWatch& next() { return watches_[1 - present_]; }

 private:
  using Event = ros::MessageEvent<const ActionGoal>;

  static constexpr int kQueue = 50;  // that of actionlib

  void onGoal(const Event& event) {
    const basics::MutexLock lock(mutex_);
    senders_.remove_if([](const auto& sender) { return sender.first.expired(); });
    senders_.emplace_back(event.getConstMessage(), event.getPublisherName());
  }
  std::string senderOf(const Goal& goal) {
    const basics::MutexLock lock(mutex_);
    for (const auto& [message, sender] : senders_) {
      const auto held = message.lock();
      if (held && &held->goal == &goal) return sender;
    }
    return {};
  }

  basics::Mutex mutex_;
  /// Senders of the goals that somebody still has.
  std::list<std::pair<boost::weak_ptr<const ActionGoal>, std::string>> senders_
      HELIX_ARM_GUARDED_BY(mutex_);
  ClientWatch watches_[2];
  int present_ = 0;
  ros::Subscriber subscriber_;
};

// A commander ends without a fault: it waits until its last target is answered, since a target that
// comes later would cancel the request, and asks pressure_command to bring the arm to rest.

/// Follows this node's targets and the answers to them. For one thread, or behind one lock.
class CommandTrace {
 public:
  static constexpr double kPatience = 1;  ///< longest wait for the answer to a target [s]

  /// Notes a target of this node.
  void sent(const ros::Time& stamp) {
    last_stamp_ = stamp;
    last_sent_ = ros::SteadyTime::now();
    waits_ = true;
  }
  /// Notes an answer on target_status, to whomever.
  void answered(const TargetStatus& status) {
    const bool accepted = status.outcome != TargetStatus::DROPPED;
    if (status.commander != ros::this_node::getName()) {
      accepted_ = accepted_ && !accepted;
      rested_ = rested_ && !accepted;
      return;
    }
    accepted_ = accepted;
    rested_ = status.fault == control::nameOf(control::Fault::kRested);
    if (status.target_stamp == last_stamp_) waits_ = false;
  }

  /// Whether the arm follows this node: its newest answer accepted a target, no target of another
  /// was accepted since, and the last target has not waited for longer than kPatience.
  bool commands() const { return accepted_ && (!waits_ || awaitsAnswer()); }
  /// Whether the last target may still be answered: it has waited for less than kPatience.
  bool awaitsAnswer() const {
    return waits_ && ros::SteadyTime::now() - last_sent_ <= ros::WallDuration(kPatience);
  }
  /// Whether the newest answer refused a target since somebody else had asked for rest, and no
  /// target of another was accepted since. Once no target of this node is under way, requestRest()
  /// tells pressure_command that it knows: its next target counts.
  bool wasRested() const { return rested_; }

 private:
  ros::Time last_stamp_;
  ros::SteadyTime last_sent_;
  bool waits_ = false;  ///< for the answer to the last target
  bool accepted_ = false;
  bool rested_ = false;
};

/// Calls pressure_command/rest, waits for the answer and logs it. Without such a service it only
/// warns: the arm then vents when no targets come. Not to be called with a lock held.
void requestRest();

}  // namespace helix_arm::ros_bridge
