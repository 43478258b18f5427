#include "visual_servo_node.hpp"

#include <utility>
#include <variant>

#include <ros/this_node.h>

#include "helix_arm/basics/requirement.hpp"
#include "ros_bridge/common/conversions.hpp"

namespace helix_arm::ros_bridge {
namespace {

// Covariance of the twists of a `measured`, or why it cannot be used.
control::Checked<Eigen::MatrixXd> covarianceOf(const ArmShape& shape, int sections) {
  const auto size = static_cast<Eigen::Index>(6) * sections;
  if (shape.twist_covariance.size() != static_cast<std::size_t>(size * size)) {
    return control::Refusal{control::Fault::kWrongSize,
                            std::to_string(shape.twist_covariance.size()) +
                                " numbers in twist_covariance; send " +
                                std::to_string(size * size) + ", the covariance of `twist`"};
  }
  return Eigen::Map<const Eigen::MatrixXd>(shape.twist_covariance.data(), size, size).eval();
}

using follow::LoopState;

constexpr double kFreshReading = 1.0;  // pressures silent for longer end a command [s]

ros::console::Level levelOf(LoopState state, LoopState before) {
  if (state == LoopState::kDiverging) return ros::console::levels::Error;
  const bool lost = state == LoopState::kCoasting || state == LoopState::kDoubtful ||
                    (state == LoopState::kOpen && before != LoopState::kIdle);
  return lost ? ros::console::levels::Warn : ros::console::levels::Info;
}

}  // namespace

VisualServoNode::VisualServoNode() {
  logInfo("%s: closes the loop of %d actuators over vision", scene_.name.c_str(),
          scene_.arm.actuatorCount());
}

void VisualServoNode::onReading(const PressureArrayConstPtr& message) {
  if (EndRequest::made()) return;
  const auto checked = control::checkReading(scene_.arm, message->name, message->pressure);
  if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
    if (!bad_readings_.add()) return;
    logWarning("a pressure_measured was dropped (%lu so far): %s", bad_readings_.total(),
               refusal->message.c_str());
    return;
  }
  last_reading_ = ros::SteadyTime::now();
  const ros::Time& stamp = message->header.stamp;
  turn(stamp.isZero() ? ros::Time::now() : stamp, std::get<Eigen::VectorXd>(checked));
}

void VisualServoNode::onMeasured(const ArmShapeConstPtr& message) {
  const auto shape = fromMsg(*message, scene_.arm, frames_.baseFrame());
  const auto covariance = covarianceOf(*message, scene_.arm.sectionCount());
  for (const auto* refusal :
       {std::get_if<control::Refusal>(&shape), std::get_if<control::Refusal>(&covariance)}) {
    if (refusal == nullptr) continue;
    pictures_.sawForeign(refusal->message);
    return;
  }
  matcher_.add(
      {message->header.stamp, std::get<model::Shape>(shape), std::get<Eigen::MatrixXd>(covariance)},
      ros::SteadyTime::now().toSec());
  look();
}

void VisualServoNode::onTags(const TagDetectionsConstPtr& detections) {
  if (!scene_.tags) return;
  matcher_.addTags(detections->header.stamp, fittedTags(*detections, *scene_.tags),
                   ros::SteadyTime::now().toSec());
  look();
}

void VisualServoNode::look() {
  while (const auto seen = matcher_.take(ros::SteadyTime::now().toSec())) onSeen(*seen);
}

void VisualServoNode::onSeen(const SeenArm& seen) {
  // Simulated time may reach this node later than the readings that it stamps.
  const double now = std::max(ros::Time::now().toSec(), stamp_.toSec());
  const estimation::Observation observation =
      loop_.picture(seen.stamp.toSec(), now, seen.shape.twists(), seen.covariance, seen.tags);
  pictures_.saw(now, secondsBetween(stamp_, seen.stamp), observation, loop_.tracker(),
                seen.tags.has_value());
  if (suspects_->see(loop_, observation)) tellSuspect();
  if (!observation.accepted()) return;
  last_picture_ = seen.stamp;
  publisher_.publishLoad(seen.stamp, moved_);
  if (action_.runs()) {
    lie::SE3 tip = model::tipPose(seen.shape);
    tip.translation += loop_.load().tip_beyond_fit;
    const auto prediction = loop_.prediction();
    action_.picture(
        seen.stamp, tip,
        prediction ? prediction->tip_covariance : Eigen::Matrix3d(Eigen::Matrix3d::Zero()));
  }
}

bool VisualServoNode::onCloseLoop(const SetBool::Request& request, SetBool::Response& response) {
  closes_ = request.data;
  loop_.close(closes_);
  response.success = true;
  response.message = closes_ ? "the loop closes when the arm is seen"
                             : "the loop stays open: the correction fades out within a second";
  logInfo("close_loop: %s", response.message.c_str());
  return true;
}

bool VisualServoNode::onReset(const Trigger::Request&, Trigger::Response& response) {
  loop_.reset();
  loop_.distrustModel(false);
  suspects_.emplace(scene_);
  publisher_.publishLoad(stamp_, moved_);
  response.success = true;
  response.message =
      "what was learnt from pictures is cleared: the correction fades out within a second";
  logInfo("reset: %s", response.message.c_str());
  return true;
}

void VisualServoNode::draw() {
  const bool measures = !last_reading_.isZero() &&
                        ros::SteadyTime::now() - last_reading_ < ros::WallDuration(kFreshReading);
  if (!measures) {
    giveUp("no pressure_measured is received; is the regulator's node running?");
    letGo();
    publisher_.clear();
  }
  if (EndRequest::made()) {
    giveUp("the node of the loop is shutting down");
    link_.rest();
    letGo();
  }
  link_.restIfDue();
  publisher_.draw();
}

void VisualServoNode::diagnose() {
  diagnostics_.publish(ros::this_node::getName(), scene_,
                       {pictures_.loop(loop_, reason(), suspects()), pictures_.correction(loop_),
                        targets_.admission().status()});
}

void VisualServoNode::adopt(io::Scene next) {
  next = requirePneumatic(std::move(next));
  requireSameRig(scene_, next);
  basics::require(!action_.runs() && !targets_.target(),
                  "the loop commands the arm; cancel its goal, or send it no target for ",
                  scene_.safety.rules.target_timeout, " s, and reload again");
  follow::VisualServo loop(next.model, procedures::loopConfigOf(next));
  loop.close(closes_);
  if (action_.wants()) {  // the last place of a goal, which is the old model's
    action_.endHold();
    link_.rest();
  }
  scene_ = std::move(next);
  loop_ = std::move(loop);
  suspects_.emplace(scene_);
  targets_.admission().adopt();
  matcher_.clear();
  publisher_.publishLoad(stamp_, moved_);
}

void VisualServoNode::turn(const ros::Time& stamp, const Eigen::VectorXd& reading) {
  look();
  const LoopState before = loop_.state();
  stamp_ = stamp;
  const double time = stamp.toSec();
  loop_.enable(link_.follows());
  if (link_.takeEnabling()) targets_.enabled();
  if (const std::string other = diagnostics_.otherScene(scene_); !other.empty()) {
    giveUp(other);
    link_.rest();
  }
  action_.prepare(time);
  aim();
  const follow::Turn& turn = loop_.reading(time, link_.setPoint().value_or(reading), reading);
  command(turn);
  if (turn.commands) action_.watch(time, turn);
  tellState(before);
  publisher_.publish(stamp_, last_picture_,
                     action_.wants() ? names::kFollowTipPath : targets_.commander(), reason());
}

void VisualServoNode::aim() {
  const auto& target = targets_.target();
  const bool changed = targets_.takeChange();
  if (target && action_.runs()) {
    targets_.refuse({control::Fault::kOtherCommander,
                     "a goal of ~follow_tip_path commands the arm; cancel it first"});
  } else if (target && link_.follows() && (changed || !loop_.hasTarget())) {
    action_.endHold();
    loop_.aimAt(*target);
  }
  if (isWanted()) return;
  if (action_.takeEndOfHold()) link_.rest();
  letGo();
}

void VisualServoNode::command(const follow::Turn& turn) {
  if (turn.commands) {
    link_.send(turn.pressure);
    targets_.answer({turn.status, turn.residual, turn.position_error, turn.limits});
    return;
  }
  if (!isWanted()) return;
  if (const auto refusal = link_.refusal()) {
    targets_.refuse(*refusal);
    letGo();
  } else {
    link_.ask();
  }
}

void VisualServoNode::letGo() {
  loop_.release();
  link_.fallSilent();
}

void VisualServoNode::giveUp(const std::string& reason) {
  targets_.refuse({control::Fault::kNotEnabled, reason});
  action_.abandon(reason);
}

std::string VisualServoNode::suspects() const {
  std::string out = moved_.empty() ? "" : "camera_moved: " + moved_;
  for (const std::string& one : procedures::textsOf(suspects_->suspects())) {
    out += (out.empty() ? "" : "; ") + one;
  }
  return out;
}

void VisualServoNode::tellSuspect() {
  const std::vector<estimation::Suspect>& found = suspects_->suspects();
  const std::string first = found.empty() ? "" : found.front().cause + found.front().where;
  if (std::exchange(suspect_, first) == first || first.empty()) return;
  logWarning("%s", procedures::textsOf(found).front().c_str());
}

std::string VisualServoNode::stateReason() {
  const LoopState state = loop_.state();
  if (!link_.blocked().empty()) return link_.blocked();
  const bool unseen = state == LoopState::kCoasting || (state == LoopState::kOpen && closes_);
  if (loop_.turn().held && unseen) {
    return "contact with the arm, and no picture of it since then: path and correction are held "
           "until the arm is seen to be free; " +
           std::string(kCheckVision);
  }
  if (unseen && !pictures_.wrongStamp().empty()) return pictures_.wrongStamp();
  switch (state) {
    case LoopState::kIdle:
      if (!targets_.refusal().empty()) return "waits for the arm: " + targets_.refusal();
      return isWanted() ? "waits for the arm: " + link_.whyNot() : "the loop has no target";
    case LoopState::kOpen:
      if (!closes_) return "kept open by ~close_loop";
      return std::string(last_picture_ ? "the arm is not seen; "
                                       : "no message on measured was used yet; ") +
             kCheckVision + ", and the refused pictures in the diagnostics";
    case LoopState::kClosed:
      return closedReason();
    case LoopState::kCoasting:
      return std::string("the arm is not seen for the moment: the correction is held; ") +
             kCheckVision;
    case LoopState::kYielding:
      return contactWords(*suspects_).what + ": path and correction are held; " +
             contactWords(*suspects_).remedy;
    case LoopState::kDoubtful:
      return "the correction is held, since " + procedures::driftText(loop_.drift());
    case LoopState::kDiverging:
      break;
  }
  return "the tip moves away from a target within the model's reach: the arm does not bend "
         "as its model does; check for swapped hoses, tags and signs, then call ~reset";
}

std::string VisualServoNode::closedReason() const {
  const std::string out = "follows the measured shape";
  if (!moved_.empty()) return out + ", but " + moved_;
  if (loop_.load().contact) {
    return out + ", which shows contact (external_load): a load, or the camera or base has moved";
  }
  if (loop_.budget() && loop_.budget()->state == estimation::BudgetState::kOutside) {
    return out +
           ", which the calibration does not explain (error_budget): check arm, load, camera "
           "and base, then calibrate again";
  }
  return out;
}

void VisualServoNode::tellState(LoopState before) {
  const LoopState state = loop_.state();
  if (state == before) return;
  logLine(levelOf(state, before), "%s: %s", follow::nameOf(state), reason().c_str());
}

std::unique_ptr<Node> makeVisualServo() { return std::make_unique<VisualServoNode>(); }

}  // namespace helix_arm::ros_bridge
