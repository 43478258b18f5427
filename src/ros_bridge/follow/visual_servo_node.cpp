#include "visual_servo_node.hpp"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <variant>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/this_node.h>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/follow/path_check.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/budget_table.hpp"
#include "helix_arm/procedures/follow_run.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/model_history.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

std::optional<std::vector<int>> fittedTags(const TagDetections& detections,
                                           const estimation::TagLayout& layout) {
  std::vector<int> out;
  for (const TagDetection& tag : detections.tags) {
    if (!tag.fitted) continue;
    const int index = layout.find(tag.id);
    if (index < 0) return std::nullopt;
    // Of a message with any number of tags, no more than the layout has are kept.
    const auto place = std::lower_bound(out.begin(), out.end(), index);
    if (place == out.end() || *place != index) out.insert(place, index);
  }
  if (out.empty()) return std::nullopt;
  return out;
}

void TagMatcher::add(SeenArm seen, double now) { shapes_.push_back({std::move(seen), now}); }

void TagMatcher::addTags(const ros::Time& stamp, std::optional<std::vector<int>> tags, double now) {
  if (!tags_.empty() && stamp < tags_.back().stamp) tags_.clear();  // a jump back in time
  tags_.push_back({stamp, std::move(tags)});
  if (tags_.size() > kMost) tags_.pop_front();
  last_tags_ = now;
}

bool TagMatcher::mayGetTags(const Waiting& shape, double now) const {
  const bool come = last_tags_ && now - *last_tags_ <= kSilence;
  const bool passed = !tags_.empty() && tags_.back().stamp > shape.seen.stamp;
  return come && !passed && now - shape.since <= kPatience && shapes_.size() <= kMost;
}

std::optional<SeenArm> TagMatcher::take(double now) {
  if (shapes_.empty()) return std::nullopt;
  Waiting& first = shapes_.front();
  const auto of_it = std::find_if(tags_.begin(), tags_.end(), [&first](const Tags& tags) {
    return tags.stamp == first.seen.stamp;
  });
  if (of_it == tags_.end() && mayGetTags(first, now)) return std::nullopt;
  std::optional<SeenArm> out = std::move(first.seen);
  shapes_.pop_front();
  if (of_it != tags_.end()) out->tags = of_it->fitted;
  return out;
}

void TagMatcher::clear() {
  shapes_.clear();
  tags_.clear();
}

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
  return Eigen::MatrixXd(
      Eigen::Map<const Eigen::MatrixXd>(shape.twist_covariance.data(), size, size));
}

double now() { return ros::SteadyTime::now().toSec(); }

}  // namespace

ObservationIntake::ObservationIntake(ros::NodeHandle& node, const io::Scene& scene,
                                     std::string base_frame, LoopDiagnostics& pictures,
                                     OnSeen on_seen)
    : scene_(scene),
      base_frame_(std::move(base_frame)),
      pictures_(pictures),
      on_seen_(std::move(on_seen)),
      measured_subscriber_(
          listen(node, names::kMeasured, 10, &ObservationIntake::onMeasured, this)),
      tags_subscriber_(listen(node, names::kTagDetections, 10, &ObservationIntake::onTags, this)) {}

void ObservationIntake::poll() {
  while (const auto seen = matcher_.take(now())) on_seen_(*seen);
}

void ObservationIntake::onMeasured(const ArmShapeConstPtr& shape) {
  const auto checked = fromMsg(*shape, scene_.arm, base_frame_);
  const auto covariance = covarianceOf(*shape, scene_.arm.sectionCount());
  for (const auto* refusal :
       {std::get_if<control::Refusal>(&checked), std::get_if<control::Refusal>(&covariance)}) {
    if (refusal == nullptr) continue;
    pictures_.sawForeign(refusal->message);
    return;
  }
  matcher_.add(
      {shape->header.stamp, std::get<model::Shape>(checked), std::get<Eigen::MatrixXd>(covariance)},
      now());
  poll();
}

void ObservationIntake::onTags(const TagDetectionsConstPtr& detections) {
  if (!scene_.tags) return;
  matcher_.addTags(detections->header.stamp, fittedTags(*detections, *scene_.tags), now());
  poll();
}

namespace {

using follow::LoopState;

constexpr double kFresh = 1.0;  // pressures silent for longer end a command [s]

ros::console::Level levelOf(LoopState state, LoopState before) {
  if (state == LoopState::kDiverging) return ros::console::levels::Error;
  const bool lost = state == LoopState::kCoasting || state == LoopState::kDoubtful ||
                    (state == LoopState::kOpen && before != LoopState::kIdle);
  return lost ? ros::console::levels::Warn : ros::console::levels::Info;
}

}  // namespace

VisualServoNode::VisualServoNode()
    : options_(VisualServoOptions::load()),
      scene_(requirePneumatic(io::loadScene(options_.scene))),
      loop_(scene_.model, procedures::loopConfigOf(scene_)),
      frames_(node_, options_.frame_prefix + names::kBaseFrame),
      link_(node_, scene_),
      targets_(node_, scene_, frames_),
      publisher_(node_, scene_, options_, frames_.baseFrame(),
                 [this](const TipTarget& target) { targets_.takeFromHandle(target); }),
      load_publisher_(node_, frames_.baseFrame()),
      action_(private_node_, scene_, frames_, targets_, [this] { return pathCheck(); }),
      diagnostics_publisher_(
          node_.advertise<diagnostic_msgs::DiagnosticArray>(names::kDiagnostics, 10)),
      reading_subscriber_(
          listen(node_, names::kPressureMeasured, 10, &VisualServoNode::onReading, this)),
      observation_(node_, scene_, frames_.baseFrame(), pictures_,
                   [this](const SeenArm& seen) { onSeen(seen); }),
      close_server_(serve(private_node_, names::kCloseLoop, &VisualServoNode::onCloseLoop, this)),
      reset_server_(serve(private_node_, names::kReset, &VisualServoNode::onReset, this)),
      reload_(private_node_, options_.scene, options_.scene_folder,
              [this](io::Scene next) { adopt(std::move(next)); }),
      draw_timer_(
          repeat(node_, "the drawing", 1.0 / options_.draw_rate, &VisualServoNode::onDraw, this)),
      diagnose_timer_(repeat(node_, "the diagnostics", 1.0, &VisualServoNode::onDiagnose, this)) {
  logInfo("%s: closes the loop of %d actuators over vision", scene_.name.c_str(),
          scene_.arm.actuatorCount());
}

VisualServoNode::~VisualServoNode() = default;

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

void VisualServoNode::turn(const ros::Time& stamp, const Eigen::VectorXd& reading) {
  observation_.poll();
  const LoopState before = loop_.state();
  stamp_ = stamp;
  const double time = stamp.toSec();
  loop_.enable(link_.follows());
  if (link_.takeEnabling()) targets_.enabled();
  action_.prepare(time, loop_, link_);
  aim();
  const follow::Turn& turn = loop_.reading(time, link_.setPoint().value_or(reading), reading);
  command(turn);
  if (turn.commands) action_.watch(time, turn);
  tellState(before);
  load_publisher_.publishChange(stamp, loop_);
  publisher_.publish(view());
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
    if (targets_.areUnanswered()) {
      targets_.answer({turn.status, turn.residual, turn.position_error, turn.limits});
    }
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

void VisualServoNode::onSeen(const SeenArm& seen) {
  // Simulated time may reach this node later than the readings that it stamps.
  const double now = std::max(ros::Time::now().toSec(), stamp_.toSec());
  const estimation::Observation observation =
      loop_.picture(seen.stamp.toSec(), now, seen.shape.twists(), seen.covariance, seen.tags);
  pictures_.saw(now, secondsBetween(stamp_, seen.stamp), observation, loop_.tracker(),
                seen.tags.has_value());
  if (!observation.accepted()) return;
  last_picture_ = seen.stamp;
  load_publisher_.publish(seen.stamp, loop_);
  if (action_.runs()) {
    lie::SE3 tip = model::tipPose(seen.shape);
    tip.translation += loop_.load().tip_beyond_fit;
    action_.picture(seen.stamp, tip, LoopPublisher::tipCovariance(view()));
  }
}

// With copies of the present state, since the check runs in another thread.
PathCheck VisualServoNode::pathCheck() const {
  Eigen::VectorXd slew(scene_.arm.actuatorCount());
  for (int i = 0; i < scene_.arm.actuatorCount(); ++i) {
    slew[i] = scene_.safety.channels[static_cast<std::size_t>(i)].slew;
  }
  const Eigen::VectorXd start =
      scene_.arm.clamped(link_.setPoint().value_or(scene_.arm.inputAt(0)));
  return [slew, start, model = scene_.model, correction = loop_.tracker().correction()](
             const control::TipPath& path, double tolerance,
             const std::atomic<bool>& stop) -> std::string {
    statics::InverseSolver solver(model);
    solver.correct(correction);
    const auto refusal = follow::checkPath(path, model.arm(), solver, start, {tolerance, slew},
                                           [&stop] { return stop.load(); });
    return refusal ? refusal->reason : std::string();
  };
}

bool VisualServoNode::onCloseLoop(SetBool::Request& request, SetBool::Response& response) {
  closes_ = request.data;
  loop_.close(closes_);
  response.success = true;
  response.message = closes_ ? "the loop closes when the arm is seen"
                             : "the loop stays open: the correction fades out within a second";
  logInfo("close_loop: %s", response.message.c_str());
  return true;
}

bool VisualServoNode::onReset(Trigger::Request&, Trigger::Response& response) {
  loop_.reset();
  load_publisher_.publish(stamp_, loop_);
  response.success = true;
  response.message =
      "what was learnt from pictures is cleared: the correction fades out within a second";
  logInfo("reset: %s", response.message.c_str());
  return true;
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
  targets_.adopt();
  observation_.adopt();
  load_publisher_.publish(stamp_, loop_);
}

LoopPublisher::View VisualServoNode::view() {
  return {stamp_, loop_, last_picture_, commander(), reason(), pictures_};
}

std::string VisualServoNode::commander() {
  if (action_.wants()) return names::kFollowTipPath;
  return targets_.commander();
}

std::string VisualServoNode::reason() {
  const LoopState state = loop_.state();
  const bool unseen = state == LoopState::kCoasting || (state == LoopState::kOpen && closes_);
  if (loop_.turn().held && unseen) {
    return "contact with the arm, and no picture of it since then: path and correction are held "
           "until the arm is seen to be free; check the camera (vision_status)";
  }
  if (unseen && !pictures_.wrongStamp().empty()) return pictures_.wrongStamp();
  switch (state) {
    case LoopState::kIdle:
      return isWanted() ? "waits for the arm: " + link_.whyNot() : "the loop has no target";
    case LoopState::kOpen:
      if (!closes_) return "kept open by ~close_loop";
      return last_picture_ ? "the arm is not seen; check vision_status, and the refused "
                             "pictures in the diagnostics"
                           : "no message on measured was used yet; is vision running?";
    case LoopState::kClosed:
      return closedReason();
    case LoopState::kCoasting:
      return "the arm is not seen for the moment: the correction is held";
    case LoopState::kYielding:
      return "contact with the arm: path and correction are held; clear the arm";
    case LoopState::kDoubtful:
      return "the correction is held, since " + procedures::driftText(loop_.drift());
    case LoopState::kDiverging:
      break;
  }
  return "the tip moves away from a target within the model's reach: the arm does not bend "
         "as its model does; check for swapped hoses, tags and signs, then call ~reset";
}

// Forces and budget are doubts: a camera that has moved looks like them.
std::string VisualServoNode::closedReason() const {
  const std::string out = "follows the measured shape";
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

void VisualServoNode::giveUp(const std::string& reason) {
  targets_.refuse({control::Fault::kNotEnabled, reason});
  action_.abandon(reason);
}

void VisualServoNode::onDraw(const ros::SteadyTimerEvent&) {
  const bool measures =
      !last_reading_.isZero() && ros::SteadyTime::now() - last_reading_ < ros::WallDuration(kFresh);
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

void VisualServoNode::onDiagnose(const ros::SteadyTimerEvent&) {
  const std::string& node = ros::this_node::getName();
  diagnostic_msgs::DiagnosticArray msg;
  msg.header.stamp = ros::Time::now();
  msg.status = {pictures_.loop(node, loop_, reason()), pictures_.correction(node, loop_),
                targets_.status(node)};
  for (auto& status : msg.status) status.hardware_id = scene_.name;
  diagnostics_publisher_.publish(msg);
}

}  // namespace helix_arm::ros_bridge
