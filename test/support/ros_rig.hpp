#pragma once

#include <algorithm>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/TargetStatus.h"
#include "helix_arm/TipTarget.h"
#include "ros_bridge/names.hpp"
#include "support/eventually.hpp"
#include "support/has.hpp"

namespace helix_arm::test {

namespace names = ros_bridge::names;

/// Handles callbacks until the condition holds; false when it did not within the deadline [s].
inline bool waitFor(const std::function<bool()>& condition, double deadline = 20.0) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(deadline);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end || !ros::ok()) return false;
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.01));
  }
  return true;
}

/// All messages of a topic, in the order they came.
template <class Message>
class Inbox {
 public:
  Inbox(ros::NodeHandle& node, const std::string& topic)
      : subscriber_(node.subscribe<Message>(
            topic, 1000, [this](const typename Message::ConstPtr& m) { messages_.push_back(m); })) {
  }

  const std::vector<typename Message::ConstPtr>& all() const { return messages_; }
  const Message& last() const { return *messages_.back(); }
  std::uint32_t publishers() const { return subscriber_.getNumPublishers(); }

  /// Waits for a message that came after this call and for which the predicate holds; null when
  /// none did.
  typename Message::ConstPtr next(const std::function<bool(const Message&)>& predicate) {
    std::size_t looked_at = messages_.size();
    typename Message::ConstPtr found;
    waitFor([&] {
      for (; looked_at < messages_.size() && !found; ++looked_at) {
        if (predicate(*messages_[looked_at])) found = messages_[looked_at];
      }
      return found != nullptr;
    });
    return found;
  }

 private:
  std::vector<typename Message::ConstPtr> messages_;
  ros::Subscriber subscriber_;
};

/// Repeats a target from a thread of its own, so that a test may do what takes long.
class Heartbeat {
 public:
  explicit Heartbeat(ros::Publisher publisher)
      : publisher_(std::move(publisher)), thread_([this] { beat(); }) {}
  ~Heartbeat() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stop_ = true;
    }
    wake_.notify_all();
    thread_.join();
  }

  /// From now on this one, or none.
  void repeat(std::optional<PressureArray> target) {
    const std::lock_guard<std::mutex> lock(mutex_);
    target_ = std::move(target);
  }

 private:
  void beat() {
    std::unique_lock<std::mutex> lock(mutex_);
    while (!wake_.wait_for(lock, std::chrono::milliseconds(200), [this] { return stop_; })) {
      if (!target_) continue;
      target_->header.stamp = ros::Time::now();
      publisher_.publish(*target_);
    }
  }

  const ros::Publisher publisher_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool stop_ = false;
  std::optional<PressureArray> target_;
  std::thread thread_;
};

/// A user of one pressure_command node: sends targets and reads the answers.
class Rig {
 public:
  /// @param ns  namespace of the node.
  explicit Rig(const std::string& ns = "")
      : node_(ns),
        pressure_target_(node_.advertise<PressureArray>(names::kPressureTarget, 10)),
        tip_target_(node_.advertise<TipTarget>(names::kTipTarget, 10)),
        command(node_, names::kPressureCommand),
        measured(node_, names::kPressureMeasured),
        model(node_, names::kModel),
        status(node_, names::kTargetStatus),
        diagnostics(node_, names::kDiagnostics) {}

  /// True when every topic is connected both ways, and the arm is enabled.
  bool connect() {
    return waitFor([this] {
      return pressure_target_.getNumSubscribers() > 0 && tip_target_.getNumSubscribers() > 0 &&
             !command.all().empty() && !measured.all().empty() && !model.all().empty() &&
             answered();
    });
  }

  /// From now on pressures that were taken are repeated, as the watchdog of targets wants it.
  /// Called before connect(), the pressures at which it enabled the arm are repeated too.
  void keepOn() { keeps_on_ = true; }
  void fallSilent() { heartbeat_.repeat({}); }

  /// Sends a target and returns the node's answer to it; an answer without outcome (255) when none
  /// came.
  TargetStatus send(PressureArray target) { return sendOn(pressure_target_, target); }
  TargetStatus send(TipTarget target) { return sendOn(tip_target_, target); }

  TargetStatus sendPressures(const std::vector<double>& pressure) {
    PressureArray target;
    target.pressure = pressure;
    const TargetStatus answer = send(target);
    if (keeps_on_ && answer.outcome == TargetStatus::REACHED) heartbeat_.repeat(target);
    return answer;
  }

 private:
  // The node may not have accepted the first subscription yet, so the first target is sent more
  // than once.
  bool answered() {
    if (taken()) return true;
    std_srvs::Trigger enable;  // refused where it is enabled already, or not vented yet
    const std::string node = node_.resolveName(names::kPressureCommandNode);
    ros::service::call(node + "/" + names::kEnable, enable);
    PressureArray same = command.last();
    same.header.stamp = ros::Time::now();
    pressure_target_.publish(same);
    if (!waitFor([this] { return taken(); }, 0.2)) return false;
    if (keeps_on_) heartbeat_.repeat(same);
    return true;
  }
  bool taken() const {
    return !status.all().empty() && status.last().outcome != TargetStatus::DROPPED;
  }

  template <class Target>
  TargetStatus sendOn(const ros::Publisher& publisher, Target& target) {
    // Stamps identify targets, so no two may be equal.
    last_stamp_ = std::max(ros::Time::now(), last_stamp_ + ros::Duration(0, 1000));
    target.header.stamp = last_stamp_;
    publisher.publish(target);
    const auto answer =
        status.next([&](const TargetStatus& s) { return s.target_stamp == last_stamp_; });
    if (answer) return *answer;
    ADD_FAILURE() << "no answer to a target on " << publisher.getTopic();
    TargetStatus none;
    none.outcome = 255;
    return none;
  }

  ros::NodeHandle node_;
  ros::Publisher pressure_target_, tip_target_;
  Heartbeat heartbeat_{pressure_target_};
  bool keeps_on_ = false;
  ros::Time last_stamp_;

 public:
  Inbox<PressureArray> command, measured;
  Inbox<ArmShape> model;
  Inbox<TargetStatus> status;
  Inbox<diagnostic_msgs::DiagnosticArray> diagnostics;
};

/// The main of a rostest.
inline int runRostest(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test", ros::init_options::AnonymousName);
  const ros::NodeHandle started;
  return RUN_ALL_TESTS();
}

}  // namespace helix_arm::test
