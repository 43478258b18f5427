// No message, whatever it holds, ends a node: every topic that any node subscribes to gets messages
// whose fields are extreme, one by one and all at once, and the nodes go on; so do the services of
// visual_servo. follow_path alone may end, in order, where a message says that its goal has ended.
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <thread>

#include <actionlib_msgs/GoalID.h>
#include <actionlib_msgs/GoalStatusArray.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <gtest/gtest.h>
#include <ros/master.h>
#include <ros/message_traits.h>
#include <ros/node_handle.h>
#include <ros/serialization.h>
#include <ros/this_node.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>
#include <visualization_msgs/InteractiveMarkerFeedback.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/ClearSamples.h"
#include "helix_arm/FollowTipPathAction.h"
#include "helix_arm/ModelError.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/Reload.h"
#include "helix_arm/RunCalibrationAction.h"
#include "helix_arm/SafetyState.h"
#include "helix_arm/ShapeTarget.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/TargetStatus.h"
#include "helix_arm/TipTarget.h"
#include "helix_arm/VisionStatus.h"
#include "support/message_fields.hpp"
#include "support/process.hpp"
#include "support/ros_rig.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {

/// A message of any type, as the bytes on the wire.
struct RawMessage {
  std::string bytes;
};

}  // namespace helix_arm::test

namespace ros {
namespace message_traits {

template <>
struct MD5Sum<helix_arm::test::RawMessage> {
  static const char* value(const helix_arm::test::RawMessage&) { return value(); }
  static const char* value() { return "*"; }
};
template <>
struct DataType<helix_arm::test::RawMessage> {
  static const char* value(const helix_arm::test::RawMessage&) { return value(); }
  static const char* value() { return "*"; }
};
template <>
struct Definition<helix_arm::test::RawMessage> {
  static const char* value(const helix_arm::test::RawMessage&) { return value(); }
  static const char* value() { return ""; }
};

}  // namespace message_traits

namespace serialization {

template <>
struct Serializer<helix_arm::test::RawMessage> {
  template <class Stream>
  static void write(Stream& stream, const helix_arm::test::RawMessage& message) {
    const auto length = static_cast<std::uint32_t>(message.bytes.size());
    if (length > 0) std::memcpy(stream.advance(length), message.bytes.data(), length);
  }
  template <class Stream>
  static void read(Stream& stream, helix_arm::test::RawMessage& message) {
    const std::uint32_t length = stream.getLength();
    message.bytes.assign(reinterpret_cast<const char*>(stream.advance(length)), length);
  }
  static std::uint32_t serializedLength(const helix_arm::test::RawMessage& message) {
    return static_cast<std::uint32_t>(message.bytes.size());
  }
};

}  // namespace serialization
}  // namespace ros

namespace helix_arm::test {
namespace {

// A type of messages, with a sound one.
struct Type {
  std::string name, md5sum, definition;
  std::string bytes;  // of a sound message
};

// Of a message, without its length.
std::string bytesOf(const ros::SerializedMessage& message) {
  return {reinterpret_cast<const char*>(message.message_start),
          message.num_bytes - static_cast<std::size_t>(message.message_start - message.buf.get())};
}

// A sound message.
template <class Message>
Message sample() {
  return {};
}
template <>
ShapeTarget sample() {
  ShapeTarget out;
  out.twist = {0.4, 0, 0, 0, 0.1, 0};
  return out;
}
template <>
TipTarget sample() {
  TipTarget out;
  out.pose.position.x = 0.35;
  out.pose.orientation.w = 1;
  return out;
}
template <>
geometry_msgs::WrenchStamped sample() {
  geometry_msgs::WrenchStamped out;
  out.wrench.force.y = 0.3;
  return out;
}
template <>
RunCalibrationActionGoal sample() {
  RunCalibrationActionGoal out;
  out.goal.fit = {"stiffness"};
  out.goal.plan = {0, 0, 0, 1e5, 0, 0};
  return out;
}
template <>
visualization_msgs::InteractiveMarkerFeedback sample() {
  visualization_msgs::InteractiveMarkerFeedback out;
  out.client_id = "/rviz";
  out.marker_name = "tip";
  out.event_type = visualization_msgs::InteractiveMarkerFeedback::POSE_UPDATE;
  out.pose.position.x = 0.35;
  out.pose.orientation.w = 1;
  return out;
}

template <>
geometry_msgs::PoseStamped sample() {
  geometry_msgs::PoseStamped out;
  out.pose.position.x = 0.35;
  return out;
}
template <>
tf2_msgs::TFMessage sample() {
  geometry_msgs::TransformStamped transform;
  transform.header.frame_id = "arm_base";
  transform.child_frame_id = "table";
  transform.transform.rotation.w = 1;
  tf2_msgs::TFMessage out;
  out.transforms = {transform};
  return out;
}
template <>
FollowTipPathActionGoal sample() {
  FollowTipPathActionGoal out;
  out.goal.path.joint_names = {"tip"};
  for (const double y : {0.0035, 0.0185}) {
    trajectory_msgs::MultiDOFJointTrajectoryPoint point;
    point.transforms.resize(1);
    point.transforms[0].translation.x = 0.366;
    point.transforms[0].translation.y = y;
    point.transforms[0].translation.z = 0.0088;
    point.transforms[0].rotation.w = 1;
    point.velocities.resize(1);
    point.time_from_start = ros::Duration(1 + 1000 * (y - 0.0035));
    out.goal.path.points.push_back(point);
  }
  out.goal.hold_s = 0.1;
  return out;
}

template <class... Messages>
std::map<std::string, Type> typesOf() {
  namespace traits = ros::message_traits;
  std::map<std::string, Type> out;
  (out.emplace(traits::datatype<Messages>(),
               Type{traits::datatype<Messages>(), traits::md5sum<Messages>(),
                    traits::definition<Messages>(),
                    bytesOf(ros::serialization::serializeMessage(sample<Messages>()))}),
   ...);
  return out;
}

// All that the nodes subscribe to; a new one belongs in here.
const std::map<std::string, Type>& knownTypes() {
  static const auto kTypes =
      typesOf<ArmShape, ModelError, PressureArray, SafetyState, ShapeTarget, TagDetections,
              TargetStatus, TipTarget, VisionStatus, FollowTipPathActionFeedback,
              FollowTipPathActionGoal, FollowTipPathActionResult, RunCalibrationActionGoal,
              actionlib_msgs::GoalID, actionlib_msgs::GoalStatusArray,
              diagnostic_msgs::DiagnosticArray, geometry_msgs::PoseStamped,
              geometry_msgs::WrenchStamped, rosgraph_msgs::Clock, sensor_msgs::CameraInfo,
              sensor_msgs::CompressedImage, sensor_msgs::Image, tf2_msgs::TFMessage,
              visualization_msgs::InteractiveMarkerFeedback>();
  return kTypes;
}

// Requests of the services of visual_servo, by the names of these below the node's.
const std::map<std::string, Type>& knownRequests() {
  static const auto kTypes = [] {
    const auto types = typesOf<ReloadRequest, std_srvs::SetBoolRequest, std_srvs::TriggerRequest>();
    return std::map<std::string, Type>{{"reload", types.at("helix_arm/ReloadRequest")},
                                       {"close_loop", types.at("std_srvs/SetBoolRequest")},
                                       {"reset", types.at("std_srvs/TriggerRequest")}};
  }();
  return kTypes;
}

// An action follow_tip_path whose goals run without end: says that the last one is active, with a
// feedback, ten times a second, from a thread of its own. Its callbacks are of the global queue.
class SilentPathServer {
 public:
  explicit SilentPathServer(const std::string& action)
      : node_(action),
        status_publisher_(advertise<actionlib_msgs::GoalStatusArray>("status")),
        feedback_publisher_(advertise<FollowTipPathActionFeedback>("feedback")),
        result_publisher_(advertise<FollowTipPathActionResult>("result")),
        goal_subscriber_(node_.subscribe("goal", 10, &SilentPathServer::onGoal, this)),
        cancel_subscriber_(node_.subscribe<actionlib_msgs::GoalID>(
            "cancel", 10, [](const actionlib_msgs::GoalIDConstPtr&) {})),
        thread_([this] { beat(); }) {}
  ~SilentPathServer() {
    stop_ = true;
    thread_.join();
  }

  // Whether a goal has come since the last call.
  bool takeGoal() { return new_.exchange(false); }

  actionlib_msgs::GoalStatusArray status() const {
    actionlib_msgs::GoalStatusArray out;
    out.header.stamp = ros::Time::now();
    out.status_list = {goalStatus()};
    return out;
  }
  FollowTipPathActionFeedback feedback() const {
    FollowTipPathActionFeedback out;
    out.header.stamp = ros::Time::now();
    out.status = goalStatus();
    out.feedback.state = "closed";
    return out;
  }
  FollowTipPathActionResult result() const {
    FollowTipPathActionResult out;
    out.header.stamp = ros::Time::now();
    out.status = goalStatus();
    out.status.status = actionlib_msgs::GoalStatus::ABORTED;
    return out;
  }

 private:
  // A test may publish damaged messages on the same topics: roscpp would read their headers, and
  // end the process where they are cut off.
  template <class Message>
  ros::Publisher advertise(const std::string& topic) {
    ros::AdvertiseOptions options;
    options.init<Message>(topic, 100);
    options.has_header = false;
    return node_.advertise(options);
  }
  void onGoal(const FollowTipPathActionGoalConstPtr& goal) {
    const std::lock_guard<std::mutex> lock(mutex_);
    goal_ = goal->goal_id;
    new_ = true;
  }

  actionlib_msgs::GoalStatus goalStatus() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    actionlib_msgs::GoalStatus out;
    out.goal_id = goal_;
    out.status = actionlib_msgs::GoalStatus::ACTIVE;
    return out;
  }

  void beat() {
    while (!stop_) {
      status_publisher_.publish(status());
      feedback_publisher_.publish(feedback());
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
  }

  ros::NodeHandle node_;
  ros::Publisher status_publisher_, feedback_publisher_, result_publisher_;
  mutable std::mutex mutex_;
  actionlib_msgs::GoalID goal_;
  std::atomic<bool> new_ = false, stop_ = false;
  ros::Subscriber goal_subscriber_, cancel_subscriber_;
  std::thread thread_;
};

// What comes on a topic from others than this test, as bytes: no claim in it costs memory here.
class Heard {
 public:
  Heard(ros::NodeHandle& node, const std::string& topic)
      : subscriber_(node.subscribe(topic, 10, &Heard::onMessage, this)) {}

  // Waits for one more, for which the condition holds.
  bool more(
      const std::function<bool(const std::string&)>& condition =
          [](const std::string&) { return true; },
      double deadline = 20.0) {
    std::uint64_t seen = count_;
    return waitFor(
        [&] {
          if (count_ == seen) return false;
          seen = count_;
          return condition(last_);
        },
        deadline);
  }
  const std::string& last() const { return last_; }

 private:
  void onMessage(const ros::MessageEvent<const RawMessage>& event) {
    if (event.getPublisherName() == ros::this_node::getName()) return;
    ++count_;
    last_ = event.getConstMessage()->bytes;
  }

  std::uint64_t count_ = 0;
  std::string last_;
  ros::Subscriber subscriber_;
};

// Gives the time, in a thread of its own, at its true pace.
class TestClock {
 public:
  TestClock() : publisher_(node_.advertise<rosgraph_msgs::Clock>(names::kClock, 100)) {
    thread_ = std::thread([this] {
      const auto start = std::chrono::steady_clock::now();
      while (!stop_) {
        const std::chrono::duration<double> past = std::chrono::steady_clock::now() - start;
        rosgraph_msgs::Clock now;
        now.clock = ros::Time(kStart + past.count());
        publisher_.publish(now);
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
      }
    });
  }
  ~TestClock() {
    stop_ = true;
    thread_.join();
  }

 private:
  static constexpr double kStart = 1.7e9;
  std::atomic<bool> stop_ = false;
  ros::NodeHandle node_;
  ros::Publisher publisher_;
  std::thread thread_;
};

// The nodes of one arm on the demo scene.
class AnyMessage : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    clock_ = std::make_unique<TestClock>();
    const auto start = [](const char* name, const char* program, std::vector<std::string> more) {
      std::vector<std::string> command = {program, "_scene:=demo"};
      command.insert(command.end(), more.begin(), more.end());
      nodes_[name] = std::make_unique<Process>(command);
    };
    start("pressure_command", HELIX_ARM_PRESSURE_COMMAND, {"_regulator:=topic"});
    start("simulated_rig", HELIX_ARM_SIMULATED_RIG, {"_camera_rate:=5"});
    start("vision", HELIX_ARM_VISION, {"_source:=image/compressed"});
    start("raw_vision", HELIX_ARM_VISION,
          {"_source:=image", "__name:=raw_vision", "_frame_prefix:=raw_"});
    start("calibration", HELIX_ARM_CALIBRATION, {});
    start("monitor", HELIX_ARM_MONITOR, {});
    start("pressure_series", HELIX_ARM_SERIES, {"_loop:=true", "_ramp_s:=0.5"});
    start("workspace_cloud", HELIX_ARM_WORKSPACE_CLOUD, {"_count:=1000"});
    start("visual_servo", HELIX_ARM_VISUAL_SERVO, {});
    walk_ = std::make_unique<SilentPathServer>(kWalk);
    startPathClient();
  }
  static void TearDownTestSuite() {
    nodes_.clear();
    walk_.reset();
    clock_.reset();
  }

  static void startPathClient() {
    nodes_[kPathClient] = std::make_unique<Process>(std::vector<std::string>{
        HELIX_ARM_FOLLOW_PATH, "_path:=" + path_.path(), std::string("_action:=") + kWalk,
        "_record:=" + (folder_ / "run.csv")});
  }
  // Starts follow_path again where it has ended in order. False: its goal does not come.
  static bool revivePathClient() {
    const int code = nodes_[kPathClient]->exitCode(0.0);
    if (code != 0 && code != 1) return true;
    walk_->takeGoal();
    startPathClient();
    return waitFor([] { return walk_->takeGoal(); });
  }

  void SetUp() override { ASSERT_TRUE(works("the start")); }

  // The nodes run, hear and answer.
  ::testing::AssertionResult works(const std::string& after) {
    const auto ended = [&](double patience) {
      std::string out;
      for (auto& [name, process] : nodes_) {
        const int code = process->exitCode(patience);
        if (code == -1) continue;
        out +=
            "; " + name + " ended with " + std::to_string(code) + ":\n" + lastOf(process->output());
      }
      return out;
    };
    const auto missing = [&](const std::string& what) {
      return ::testing::AssertionFailure() << what << " after " << after << ended(0.5);
    };
    if (!revivePathClient()) return missing("no goal of follow_path");
    if (!ended(0).empty()) return missing("nodes have ended");
    if (!measured_.more()) return missing("no pressure_measured");
    if (!target_.more()) return missing("no target of the series");
    if (!detections_.more()) return missing("no tag_detections");
    // Whatever came may have vented the arm, rightly; it can be enabled again.
    const bool taken = waitFor(
        [&] {
          std_srvs::Trigger enable;
          ros::service::call("pressure_command/enable", enable);
          return status_.more(
              [](const std::string& bytes) {
                TargetStatus status;
                std::string copy = bytes;
                ros::serialization::IStream stream(reinterpret_cast<std::uint8_t*>(copy.data()),
                                                   static_cast<std::uint32_t>(copy.size()));
                try {
                  ros::serialization::deserialize(stream, status);
                } catch (const ros::serialization::StreamOverrunException&) {
                  return false;  // one that this test has sent
                }
                return status.outcome == TargetStatus::REACHED;
              },
              0.5);
        },
        30.0);
    if (!taken) return missing("the arm takes no target");
    ClearSamples clear;
    if (!ros::service::call("calibration/clear_samples", clear)) return missing("no calibration");
    Reload reload;
    if (!ros::service::call("workspace_cloud/reload", reload)) return missing("no workspace_cloud");
    std_srvs::Trigger reset;
    if (!ros::service::call("visual_servo/reset", reset)) return missing("no visual_servo");
    if (!loop_.more()) return missing("no loop_status");
    const std::size_t printed = nodes_["monitor"]->outputNow().size();
    const bool prints = waitFor([&] { return nodes_["monitor"]->outputNow().size() > printed; });
    return prints ? ::testing::AssertionSuccess() : missing("no line of the monitor");
  }

  static std::string lastOf(const std::string& output) {
    return output.substr(output.size() - std::min<std::size_t>(output.size(), 2000));
  }

  // Topics and their subscribers, of the nodes under test.
  static std::map<std::string, std::set<std::string>> subscriptions() {
    XmlRpc::XmlRpcValue request, response, state;
    request[0] = ros::this_node::getName();
    EXPECT_TRUE(ros::master::execute("getSystemState", request, response, state, true));
    std::map<std::string, std::set<std::string>> out;
    for (int i = 0; i < state[1].size(); ++i) {
      for (int k = 0; k < state[1][i][1].size(); ++k) {
        const std::string node = static_cast<std::string>(state[1][i][1][k]).substr(1);
        if (nodes_.count(node) > 0) out[static_cast<std::string>(state[1][i][0])].insert(node);
      }
    }
    return out;
  }

  static std::map<std::string, std::string> typesOfTopics() {
    XmlRpc::XmlRpcValue request, response, types;
    request[0] = ros::this_node::getName();
    EXPECT_TRUE(ros::master::execute("getTopicTypes", request, response, types, true));
    std::map<std::string, std::string> out;
    for (int i = 0; i < types.size(); ++i) {
      out[static_cast<std::string>(types[i][0])] = static_cast<std::string>(types[i][1]);
    }
    return out;
  }

  // A message of the topic as the nodes send it; where none does, the sample. Answers to the goal
  // of follow_path are of this goal.
  Field soundMessage(const std::string& topic, const Type& type) {
    std::string bytes = type.bytes;
    if (isAnswer(topic)) {
      const std::string answer = topic.substr(topic.rfind('/') + 1);
      bytes = answer == "status" ? bytesOf(ros::serialization::serializeMessage(walk_->status()))
              : answer == "feedback"
                  ? bytesOf(ros::serialization::serializeMessage(walk_->feedback()))
                  : bytesOf(ros::serialization::serializeMessage(walk_->result()));
    } else if (topic != names::kClock) {
      Heard heard(node_, topic);
      if (heard.more([](const std::string&) { return true; }, 1.0)) bytes = heard.last();
    }
    return MessageFields("MSG: \n" + type.definition).read(bytes);
  }

  static bool isAnswer(const std::string& topic) {
    return topic.compare(0, std::strlen(kWalk), kWalk) == 0;
  }

  void sendExtremes(const std::string& topic, const Type& type, std::size_t subscribers) {
    ros::AdvertiseOptions options(topic, 100, type.md5sum, type.name, type.definition);
    ros::Publisher publisher = node_.advertise(options);
    ASSERT_TRUE(waitFor([&] { return publisher.getNumSubscribers() >= subscribers; })) << topic;
    auto extremes = extremesOf(soundMessage(topic, type));
    ASSERT_GT(extremes.size(), 10U) << topic;
    // A look takes a while. What follows the end of a goal says nothing to follow_path.
    const std::size_t between_looks = isAnswer(topic) ? 4 : 40;
    std::string sent;  // since the last look
    for (std::size_t k = 0; k < extremes.size(); ++k) {
      const auto& [what, bytes] = extremes[k];
      publisher.publish(RawMessage{bytes});
      sent += "\n" + what;
      // Time to take it, so that the queue of the node need not drop it.
      waitFor([] { return false; }, 0.002 + 1e-8 * static_cast<double>(bytes.size()));
      for (auto& node : nodes_) node.second->outputNow();
      if (k % between_looks > 0 && k + 1 < extremes.size()) continue;
      for (auto& [name, process] : nodes_) {
        const int code = process->exitCode(0.0);
        if (name == kPathClient && (code == 0 || code == 1)) continue;
        ASSERT_EQ(code, -1) << name << " ended after one of " << topic << ":" << sent << "\n"
                            << lastOf(process->output());
      }
      sent.clear();
      if (!isAnswer(topic)) continue;
      // The client may be about to end when it is looked at.
      const auto listens = [&] {
        return revivePathClient() && publisher.getNumSubscribers() >= subscribers;
      };
      ASSERT_TRUE(waitFor(listens, 60.0)) << topic;
      const std::size_t count = extremes.size();
      extremes = extremesOf(soundMessage(topic, type));  // of the new goal
      ASSERT_EQ(extremes.size(), count);
    }
    std::printf("%s (%s): %zu messages\n", topic.c_str(), type.name.c_str(), extremes.size());
  }

  // Sends extremes on all topics of a kind; their number, or -1 after a failure.
  int sendToAll(const std::function<bool(const std::string&)>& is_wanted) {
    int topics = 0;
    const auto types = typesOfTopics();
    for (const auto& [topic, nodes] : subscriptions()) {
      if (topic == names::kClock || !is_wanted(topic)) continue;
      const auto type = knownTypes().find(types.at(topic));
      EXPECT_NE(type, knownTypes().end()) << topic << " is of the type " << types.at(topic);
      if (type == knownTypes().end()) return -1;
      sendExtremes(topic, type->second, nodes.size());
      const auto after = works(topic);
      EXPECT_TRUE(after);
      if (HasFatalFailure() || !after) return -1;
      ++topics;
    }
    return topics;
  }

  // The services of visual_servo, without those of roscpp.
  static std::set<std::string> services() {
    const std::string prefix = "/visual_servo/";
    XmlRpc::XmlRpcValue request, response, state;
    request[0] = ros::this_node::getName();
    EXPECT_TRUE(ros::master::execute("getSystemState", request, response, state, true));
    std::set<std::string> out;
    for (int i = 0; i < state[2].size(); ++i) {
      const std::string name = static_cast<std::string>(state[2][i][0]);
      if (name.compare(0, prefix.size(), prefix) != 0) continue;
      const std::string service = name.substr(prefix.size());
      if (service != "get_loggers" && service != "set_logger_level") out.insert(service);
    }
    return out;
  }

  static constexpr char kWalk[] = "/walk";  // the action of follow_path
  static constexpr char kPathClient[] = "follow_path";
  static inline std::unique_ptr<TestClock> clock_;
  static inline std::map<std::string, std::unique_ptr<Process>> nodes_;
  static inline std::unique_ptr<SilentPathServer> walk_;
  static inline const TemporaryFolder folder_;
  static inline const TemporaryFile path_{
      "time_s,x_m,y_m,z_m\n0,0.366,0.0035,0.0088\n1,0.366,0.0185,0.0088\n", ".csv"};
  ros::NodeHandle node_;
  Heard measured_{node_, names::kPressureMeasured}, target_{node_, names::kPressureTarget};
  Heard detections_{node_, names::kTagDetections}, status_{node_, names::kTargetStatus};
  Heard loop_{node_, names::kVisualServoStatus};
};

TEST_F(AnyMessage, EveryFieldOfEveryTopicMayBeExtreme) {
  EXPECT_GE(sendToAll([](const std::string& topic) { return !isAnswer(topic); }), 24);
}

TEST_F(AnyMessage, EveryFieldOfEveryAnswerMayBeExtreme) { EXPECT_EQ(sendToAll(isAnswer), 3); }

TEST_F(AnyMessage, EveryRequestToVisualServoMayBeExtreme) {
  std::size_t services = 0;
  for (const std::string& service : AnyMessage::services()) {
    const auto type = knownRequests().find(service);
    ASSERT_NE(type, knownRequests().end()) << service;
    Field sound;
    if (!type->second.bytes.empty()) {
      sound = MessageFields("MSG: \n" + type->second.definition).read(type->second.bytes);
    }
    auto requests = extremesOf(sound);
    requests.emplace_back("a long tail", type->second.bytes + std::string(1000000, 'x'));
    ros::ServiceClientOptions options("/visual_servo/" + service, "*", false, {});
    ros::ServiceClient client = node_.serviceClient(options);
    for (const auto& [what, bytes] : requests) {
      RawMessage response;
      client.call(RawMessage{bytes}, response, "*");
      ASSERT_EQ(nodes_["visual_servo"]->exitCode(0.0), -1)
          << service << ": " << what << "\n"
          << lastOf(nodes_["visual_servo"]->output());
    }
    ASSERT_TRUE(works(service));
    ++services;
  }
  EXPECT_EQ(services, knownRequests().size());
}

// A message of some bytes that claims 2^29 numbers, as a reading: as many as the queue takes. The
// stop is answered while they wait; each of them once cost 4 GB and 10 s before it.
TEST_F(AnyMessage, NoReadingDelaysTheEmergencyStop) {
  const Type& type = knownTypes().at(ros::message_traits::datatype<PressureArray>());
  Field message = MessageFields("MSG: \n" + type.definition).read(type.bytes);
  for (Field& part : message.parts) {
    if (part.path == "pressure") part.claim = 1U << 29U;
  }
  ASSERT_LE(message.written().size(), 32U);
  ros::AdvertiseOptions options(names::kPressureMeasured, 100, type.md5sum, type.name,
                                type.definition);
  ros::Publisher publisher = node_.advertise(options);
  ASSERT_TRUE(waitFor([&] { return publisher.getNumSubscribers() >= 3; }));
  for (int k = 0; k < 50; ++k) publisher.publish(RawMessage{message.written()});
  std_srvs::SetBool stop;
  stop.request.data = true;
  const ros::SteadyTime asked = ros::SteadyTime::now();
  ASSERT_TRUE(ros::service::call("pressure_command/emergency_stop", stop));
  EXPECT_TRUE(stop.response.success) << stop.response.message;
  EXPECT_LT((ros::SteadyTime::now() - asked).toSec(), 5.0);
  EXPECT_TRUE(target_.more()) << "the series continues";
  stop.request.data = false;
  ASSERT_TRUE(ros::service::call("pressure_command/emergency_stop", stop));
  EXPECT_TRUE(works("claims on pressure_measured"));
}

// Listeners of tf ignore what is older than their newest frame by more than 10 s: one frame from
// far ahead would be the last that they take.
TEST_F(AnyMessage, AStampFromFarAheadDoesNotEndTf) {
  tf2::BufferCore buffer;
  const ros::Subscriber tf = node_.subscribe<tf2_msgs::TFMessage>(
      "tf", 100, [&](const tf2_msgs::TFMessage::ConstPtr& message) {
        for (const auto& transform : message->transforms) buffer.setTransform(transform, "test");
      });
  // Of <prefix><frame>, seen from <prefix>arm_base.
  const auto newest = [&](const std::string& prefix, const std::string& frame) {
    const std::string base = prefix + names::kBaseFrame, tip = prefix + frame;
    std::string ignored;
    ros::Time out;
    const bool known =
        buffer._frameExists(base) && buffer._frameExists(tip) &&
        buffer._getLatestCommonTime(buffer._lookupFrameNumber(base), buffer._lookupFrameNumber(tip),
                                    out, &ignored) == 0;
    return known ? out : ros::Time();
  };
  struct Source {
    const char *topic, *prefix, *frame;
  };
  for (const auto& [topic, prefix, frame] : {Source{names::kPressureMeasured, "", "model_tip"},
                                             Source{names::kCompressedImage, "", "measured_tip"},
                                             Source{names::kImage, "raw_", "measured_tip"}}) {
    const auto last = [&, before = prefix, name = frame] { return newest(before, name); };
    ASSERT_TRUE(waitFor([&] { return !last().isZero(); })) << topic;
    const Type& type = knownTypes().at(typesOfTopics().at(node_.resolveName(topic)));
    Field message = soundMessage(topic, type);
    ros::AdvertiseOptions options(topic, 100, type.md5sum, type.name, type.definition);
    ros::Publisher publisher = node_.advertise(options);
    ASSERT_TRUE(waitFor([&] { return publisher.getNumSubscribers() > 0; }));
    for (const double ahead : {3600.0, 4e8}) {
      const ros::Time far = ros::Time::now() + ros::Duration(ahead);
      for (Field& part : message.parts[0].parts) {
        if (part.path != "header.stamp") continue;
        part.bytes.assign(reinterpret_cast<const char*>(&far.sec), sizeof far.sec);
        part.bytes.append(reinterpret_cast<const char*>(&far.nsec), sizeof far.nsec);
      }
      publisher.publish(RawMessage{message.written()});
      const ros::Time sent = ros::Time::now();
      EXPECT_TRUE(waitFor([&] { return last() > sent + ros::Duration(0.5); })) << topic;
      EXPECT_LT(last(), ros::Time::now() + ros::Duration(5)) << topic << ": it is of the future";
    }
  }
}

TEST_F(AnyMessage, TimeMayBeExtreme) {
  const std::size_t listeners = subscriptions()[names::kClock].size();
  EXPECT_EQ(listeners, nodes_.size());
  ASSERT_NO_FATAL_FAILURE(
      sendExtremes(names::kClock, knownTypes().at("rosgraph_msgs/Clock"), listeners));
  EXPECT_TRUE(works(names::kClock));
}

}  // namespace
}  // namespace helix_arm::test
