#include "ros_bridge/tools/follow_path_node.hpp"

#include <cstddef>
#include <vector>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/io/tip_path_file.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/goal_serializers.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/names.hpp"
#include "ros_bridge/common/parameters.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kTick = 0.1;        // [s]
constexpr double kLastWords = 1.0;   // of the topics that are recorded, after the end [s]
constexpr double kWordPeriod = 1.0;  // between two lines of the log [s]

FollowTipPathGoal goalOf(const FollowPathOptions& options) {
  FollowTipPathGoal out;
  out.path.header.frame_id = options.frame;
  for (const control::TipWayPoint& point : io::loadTipPath(io::loadDataSet(options.path))) {
    trajectory_msgs::MultiDOFJointTrajectoryPoint place;
    place.transforms.push_back(toTransformMsg({Eigen::Matrix3d::Identity(), point.position}));
    place.time_from_start = ros::Duration(point.time);
    out.path.points.push_back(place);
  }
  out.mode = FollowTipPathGoal::POSITION;
  out.path_tolerance = options.path_tolerance;
  out.goal_tolerance = options.goal_tolerance;
  out.require_vision = options.require_vision;
  out.hold_s = options.hold;
  return out;
}

}  // namespace

FollowPathOptions FollowPathOptions::load() {
  ParameterReader reader{ros::NodeHandle("~")};
  FollowPathOptions out;
  out.path = reader.file("path", "config/paths", ".csv");
  out.action =
      reader.text("action", std::string(names::kVisualServoNode) + "/" + names::kFollowTipPath);
  out.frame = reader.frame("frame", "");
  out.path_tolerance = 1e-3 * reader.number("path_tolerance_mm", 0.0, {0.0, 1000.0});
  out.goal_tolerance = 1e-3 * reader.number("goal_tolerance_mm", 0.0, {0.0, 1000.0});
  out.require_vision = reader.flag("require_vision", out.require_vision);
  out.hold = reader.number("hold_s", out.hold, {0.0, 86400.0});
  out.patience = reader.number("patience_s", out.patience, {0.0, 3600.0});
  out.files = {reader.fileToWrite("record", ".csv"), reader.fileToWrite("figure", ".png")};
  reader.finish();
  return out;
}

FollowPathNode::FollowPathNode()
    : options_(FollowPathOptions::load()),
      goal_(goalOf(options_)),
      client_(node_, options_.action, false),
      timer_(repeat(node_, "the watch of the goal", kTick, &FollowPathNode::onTick, this)) {
  if (!options_.files.any()) return;
  recorder_.emplace(node_, options_.files, options_.path,
                    goal_.path.points.back().time_from_start.toSec());
}

void FollowPathNode::onTick(const ros::SteadyTimerEvent&) {
  if (sent_ && !done_ && !cancelled_ && EndRequest::made()) {
    cancelled_ = true;
    client_.cancelGoal();
  }
  if (isBusy() && !client_.isServerConnected()) {
    logFatal("%s has ended before the path", node_.resolveName(options_.action).c_str());
    endWith(kFailed, "the action has ended before the path");
  }
  if (done_) endOnceRecorded();
  if (sent_) return;
  if (client_.isServerConnected()) {
    send();
  } else if (ros::SteadyTime::now() - start_ > ros::WallDuration(options_.patience)) {
    logFatal("no action %s for %g s; is visual_servo up (closed_loop:=true of arm.launch)?",
             node_.resolveName(options_.action).c_str(), options_.patience);
    verdict_ = kFailed;
    EndRequest::make();
  }
}

void FollowPathNode::send() {
  sent_ = true;
  logInfo("%s: %zu points, %.1f s", options_.path.c_str(), goal_.path.points.size(),
          goal_.path.points.back().time_from_start.toSec());
  client_.sendGoal(
      goal_,
      [this](const actionlib::SimpleClientGoalState& state,
             const FollowTipPathResultConstPtr& result) {
        guard_.run("", [&] { onDone(state, result.get()); });
      },
      Client::SimpleActiveCallback(),
      [this](const FollowTipPathFeedbackConstPtr& feedback) {
        guard_.run("", [&] { onFeedback(*feedback); });
      });
}

void FollowPathNode::onFeedback(const FollowTipPathFeedback& feedback) {
  if (recorder_) recorder_->add(feedback);
  const ros::SteadyTime now = ros::SteadyTime::now();
  if (now - last_word_ < ros::WallDuration(kWordPeriod)) return;
  last_word_ = now;
  logInfo("%.1f s: the tip is %.2f mm off, the loop %s", feedback.time_from_start.toSec(),
          1e3 * feedback.error, basics::quoted(feedback.state).c_str());
}

void FollowPathNode::onDone(const actionlib::SimpleClientGoalState& state,
                            const FollowTipPathResult* result) {
  if (result == nullptr) {
    logFatal("the goal has ended without a result; is visual_servo still running?");
    return endWith(kFailed, "the goal has ended without a result");
  }
  const std::string message = basics::quoted(result->error_string, kLongestMessage);
  if (state == actionlib::SimpleClientGoalState::SUCCEEDED) {
    logInfo("the path was followed: %.2f mm RMS, at most %.2f mm, in %u pictures; %s",
            1e3 * result->rms_m, 1e3 * result->max_m, result->pictures, message.c_str());
    return endWith(kDone, message);
  }
  if (cancelled_) {
    logInfo("%s", message.c_str());
    return endWith(kDone, message);
  }
  logError("the path was not followed (%s, error_code %d): %s", state.toString().c_str(),
           result->error_code, message.c_str());
  endWith(kFailed, message);
}

void FollowPathNode::endWith(int verdict, const std::string& outcome) {
  done_ = true;
  done_since_ = ros::SteadyTime::now();
  verdict_ = verdict;
  outcome_ = outcome;
  endOnceRecorded();
}

// What the last pictures wait for comes within moments.
void FollowPathNode::endOnceRecorded() {
  const bool waits = recorder_ && !recorder_->isComplete() &&
                     ros::SteadyTime::now() - done_since_ < ros::WallDuration(kLastWords);
  if (!waits) EndRequest::make();
}

int FollowPathNode::finish() {
  if (!recorder_ || !sent_) return verdict_;
  const std::string fault = recorder_->write(outcome_);
  if (fault.empty()) return verdict_;
  logFatal("%s", fault.c_str());
  return kFailed;
}

}  // namespace helix_arm::ros_bridge
