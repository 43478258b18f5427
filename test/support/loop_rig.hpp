#pragma once

#include <actionlib/client/simple_action_client.h>
#include <geometry_msgs/PoseStamped.h>
#include <std_srvs/SetBool.h>

#include "helix_arm/FollowTipPathAction.h"
#include "helix_arm/LoopStatus.h"
#include "helix_arm/SafetyState.h"
#include "support/process.hpp"
#include "support/vision_rig.hpp"

namespace helix_arm::test {

inline Eigen::Vector3d tipOf(const geometry_msgs::Pose& pose) {
  return ros_bridge::fromMsg(pose).translation;
}

/// A user of visual_servo on the demo's simulated rig: repeats targets, sends goals, and reads what
/// the loop says. vision is its own.
class LoopRig : public ::testing::Test {
 protected:
  using Client = actionlib::SimpleActionClient<FollowTipPathAction>;

  static void SetUpTestSuite() { startVision(); }
  static void TearDownTestSuite() { vision_.reset(); }
  static void startVision() {
    vision_ = std::make_unique<Process>(
        std::vector<std::string>{HELIX_ARM_VISION, "_scene:=demo", "_source:=image/compressed"});
  }

  LoopRig()
      : eye_(""),
        node_(eye_.node),
        tip_target_(node_.advertise<TipTarget>(names::kTipTarget, 10)),
        tip_pose_(node_.advertise<geometry_msgs::PoseStamped>(names::kTipPose, 10)),
        pressure_target_(node_.advertise<PressureArray>(names::kPressureTarget, 10)),
        loop_(node_, names::kVisualServoStatus),
        estimate_(node_, names::kEstimate),
        sent_(node_, names::kPressureTarget),
        status_(node_, names::kTargetStatus),
        safety_(node_, names::kSafetyState),
        diagnostics_(node_, names::kDiagnostics) {}

  void SetUp() override {
    ASSERT_TRUE(waitFor([this] {
      return tip_target_.getNumSubscribers() > 0 && tip_pose_.getNumSubscribers() > 0 &&
             pressure_target_.getNumSubscribers() > 0 && !loop_.all().empty() &&
             !safety_.all().empty() && !eye_.measured.all().empty() && !ros::Time::now().isZero();
    })) << vision_->output();
    client_ = std::make_unique<Client>("visual_servo/follow_tip_path", false);
    ASSERT_TRUE(waitFor([this] { return client_->isServerConnected(); }));
    ASSERT_TRUE(comesTo(LoopStatus::IDLE));
    enableAnew();
  }

  /// Vents and enables the arm, so that no timeout of targets runs before the first one.
  void enableAnew() {
    const auto is = [this](const std::string& state) { return safety_.last().state == state; };
    ASSERT_TRUE(call("pressure_command/vent"));
    ASSERT_TRUE(waitFor([&] { return is(SafetyState::VENTED) || is(SafetyState::DISABLED); }));
    std_srvs::Trigger enable;  // refused while pressure remains
    ASSERT_TRUE(waitFor([&] {
      ros::service::call("pressure_command/enable", enable);
      return waitFor([&] { return is(SafetyState::ENABLED); }, 0.2);
    })) << enable.response.message;
  }

  /// Whether the loop comes to a state, while a target is repeated.
  bool comesTo(const std::string& state, const std::optional<TipTarget>& target = {},
               double deadline = 40) {
    return waitFor(
        [&] {
          repeat(target);
          return !loop_.all().empty() && loop_.last().state == state;
        },
        deadline);
  }
  /// Whether the measured tip comes within this of a place [m], while a target is repeated.
  bool tipComesTo(const Eigen::Vector3d& place, double distance, const TipTarget& target) {
    return waitFor(
        [&] {
          repeat(target);
          return (tipOf(eye_.measured.last().tip) - place).norm() < distance;
        },
        40);
  }

  /// At 20 Hz, as often as it is called.
  void repeat(const std::optional<TipTarget>& target) {
    const ros::SteadyTime now = ros::SteadyTime::now();
    if (!target || now - last_sent_ < ros::WallDuration(0.05)) return;
    last_sent_ = now;
    TipTarget next = *target;
    next.header.stamp = ros::Time::now();
    tip_target_.publish(next);
  }

  static TipTarget targetAt(const Eigen::Vector3d& position, const std::string& frame = "") {
    TipTarget out;
    out.header.frame_id = frame;
    out.mode = TipTarget::POSITION;
    out.pose.position = ros_bridge::toPointMsg(position);
    return out;
  }

  /// The next answer to a target of this topic and this node; without an outcome (255) if none
  /// came.
  TargetStatus answerOn(const std::string& topic) {
    const auto answer = status_.next([&](const TargetStatus& status) {
      return status.topic == topic && status.commander == ros::this_node::getName();
    });
    if (answer) return *answer;
    TargetStatus none;
    none.outcome = 255;
    return none;
  }

  /// A goal along points that are this far apart in time [s], base frame [m]; held for a moment.
  static FollowTipPathGoal goalAlong(const std::vector<Eigen::Vector3d>& points, double step) {
    FollowTipPathGoal goal;
    for (const Eigen::Vector3d& point : points) {
      trajectory_msgs::MultiDOFJointTrajectoryPoint place;
      place.transforms.push_back(ros_bridge::toTransformMsg({Eigen::Matrix3d::Identity(), point}));
      place.time_from_start = ros::Duration(step * static_cast<double>(goal.path.points.size()));
      goal.path.points.push_back(place);
    }
    goal.goal_tolerance = 0.005;
    goal.hold_s = 0.1;
    return goal;
  }
  /// Sends a goal; its feedback and its end are noted.
  void send(const FollowTipPathGoal& goal) {
    feedback_.clear();
    client_->sendGoal(
        goal, Client::SimpleDoneCallback(), Client::SimpleActiveCallback(),
        [this](const FollowTipPathFeedbackConstPtr& feedback) { feedback_.push_back(*feedback); });
  }
  /// The error_code with which the goal ends; -100 if it does not.
  int endOfGoal(double deadline = 60) {
    if (!waitFor([this] { return client_->getState().isDone(); }, deadline)) return -100;
    return client_->getResult() ? client_->getResult()->error_code : -101;
  }
  bool isUnderWay() {
    return waitFor([this] { return feedback_.size() > 2; }, 40);
  }

  bool call(const std::string& service) {
    std_srvs::Trigger trigger;
    return ros::service::call(service, trigger) && trigger.response.success;
  }
  bool closeLoop(bool closed) {
    std_srvs::SetBool call;
    call.request.data = closed;
    return ros::service::call("visual_servo/close_loop", call) && call.response.success;
  }

  /// Places around the middle of what the arm reaches, base frame [m].
  static inline const Eigen::Vector3d kMiddle{0.366, 0.0035, 0.0088};
  static inline const Eigen::Vector3d kBeside = kMiddle + Eigen::Vector3d(0, 0.015, 0);

  static inline std::unique_ptr<Process> vision_;
  VisionListener eye_;
  ros::NodeHandle& node_;
  ros::Publisher tip_target_, tip_pose_, pressure_target_;
  Inbox<LoopStatus> loop_;
  Inbox<ArmShape> estimate_;
  Inbox<PressureArray> sent_;
  Inbox<TargetStatus> status_;
  Inbox<SafetyState> safety_;
  Inbox<diagnostic_msgs::DiagnosticArray> diagnostics_;
  std::unique_ptr<Client> client_;
  std::vector<FollowTipPathFeedback> feedback_;
  ros::SteadyTime last_sent_;
};

}  // namespace helix_arm::test
