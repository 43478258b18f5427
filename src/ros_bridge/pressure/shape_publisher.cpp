#include "ros_bridge/pressure/shape_publisher.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "helix_arm/ArmShape.h"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/model_history.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using diagnostic_msgs::DiagnosticStatus;

constexpr double kFresh = 1.0;  // a longer silence of the regulator is an error [s]

}  // namespace

ShapePublisher::ShapePublisher(ros::NodeHandle node, const io::Scene& scene,
                               const PressureCommandOptions& options, TipHandle::OnTarget on_target)
    : scene_(scene),
      frames_(options.world_frame, options.frame_prefix, names::kModelFrames, options.frames),
      readings_per_tf_(static_cast<std::uint64_t>(std::lround(options.rate / options.tf_rate))),
      own_regulator_(options.regulator == "scene"),
      markers_(scene, frames_.base, std::max(1.0, 3.0 / options.draw_rate)),
      measured_(scene.arm.inputAt(0)),
      response_(scene.arm),
      solution_(scene.model.solve(measured_)),
      model_publisher_(node.advertise<ArmShape>(names::kModel, 10)),
      marker_publisher_(node.advertise<visualization_msgs::MarkerArray>(names::kMarkers, 2)) {
  sendBaseFrame();
  if (options.handle) {
    const double size = std::clamp(4.0 * scene.looks.back().separator_radius, 0.1, 0.15);
    handle_ = std::make_unique<TipHandle>(frames_.base, scene.planar.has_value(), size,
                                          std::move(on_target));
  }
}

void ShapePublisher::adopt() {
  sendBaseFrame();
  response_.adopt(scene_.arm);
  solve();
}

void ShapePublisher::sendBaseFrame() {
  static_tf_.sendTransform(worldTransform(frames_.world, frames_.base, scene_.X_WB));
}

void ShapePublisher::solve() {
  const bool rests = last_reading_.isZero();  // before the first reading
  const Eigen::VectorXd pressure = scene_.arm.clamped(rests ? measured_ : response_.effective());
  solution_ = scene_.model.solve(pressure);
  if (solution_.converged() || !unsolved_.add()) return;
  std::ostringstream at;
  at << (1e-3 * pressure).transpose();
  logWarning(
      "%s: the %s model finds no shape that balances the load at %s kPa (%s, residual %.2g; %lu "
      "times "
      "so far): no model is published there; check the scene's load and arm.stiffness.K_eps_n",
      scene_.name.c_str(), scene_.model.choice().setting.name().c_str(), at.str().c_str(),
      statics::nameOf(solution_.status), solution_.residual,
      static_cast<unsigned long>(unsolved_.total()));
}

void ShapePublisher::take(const Eigen::VectorXd& measured, const ros::Time& stamp) {
  measured_ = measured;
  const ros::Time at = stamp.isZero() ? ros::Time::now() : stamp;
  if (response_.follow(at.toSec(), measured) && !response_.instant() && restarts_.add()) {
    logWarning(
        "pressure_measured is stamped earlier than the reading before (%lu times so far): the "
        "actuators' responses start anew, and their memory is unknown until the pressures have "
        "moved by twice the largest play_kpa",
        static_cast<unsigned long>(restarts_.total()));
  }
  last_reading_ = ros::SteadyTime::now();
  solve();
  ++readings_;
  if (!solution_.converged()) return;
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = frames_.base;
  model_publisher_.publish(toShapeMsg(header, scene_.model.choice(), solution_.shape));
  if (readings_ % readings_per_tf_ == 0) sendFrames(stamp);
}

bool ShapePublisher::measures() const {
  return !last_reading_.isZero() &&
         ros::SteadyTime::now() - last_reading_ < ros::WallDuration(kFresh);
}

void ShapePublisher::sendFrames(const ros::Time& stamp) {
  if (stamp == last_tf_stamp_) return;  // under a paused clock, tf would warn of repeated stamps
  if (endsTf(stamp)) {
    if (far_stamps_.add()) {
      logWarning(
          "pressure_measured is stamped %.1f s ahead of ROS time (%lu times so far): no tf is "
          "published for it; synchronise the clocks",
          secondsBetween(ros::Time::now(), stamp), static_cast<unsigned long>(far_stamps_.total()));
    }
    return;
  }
  last_tf_stamp_ = stamp;
  tf_.sendTransform(curveTransforms(frames_, solution_.shape, stamp));
}

std::string ShapePublisher::unmeasuredText() const {
  return own_regulator_ ? "the regulator has given no readings (see its diagnostics)"
                        : "no pressure_measured is received; is the regulator's node running?";
}

void ShapePublisher::moveHandle(const Eigen::VectorXd& goal) {
  if (!handle_) return;
  const statics::Tip commanded = scene_.model.tip(scene_.arm.clamped(response_.effectiveAt(goal)));
  if (commanded.converged()) handle_->follow(commanded.tip);
}

void ShapePublisher::draw() {
  if (!measures() || !solution_.converged()) {
    if (drawn_) {
      marker_publisher_.publish(markers_.remove(ros::Time::now()));
      if (!measures() && losses_.add()) {
        logWarning(
            "no pressures were measured for %g s (%lu times so far): %s; the arm is not drawn "
            "until "
            "they are",
            kFresh, static_cast<unsigned long>(losses_.total()), unmeasuredText().c_str());
      }
    }
    drawn_ = false;
    return;
  }
  drawn_ = true;
  marker_publisher_.publish(markers_.draw(solution_.shape, measured_, ros::Time::now()));
}

DiagnosticStatus ShapePublisher::status(const std::string& node) const {
  DiagnosticStatus out;
  out.name = statusName(node, names::kModelStatus);
  const statics::TierChoice& choice = scene_.model.choice();
  const bool solved = solution_.converged();
  out.level = solved ? DiagnosticStatus::OK : DiagnosticStatus::ERROR;
  out.message = solved
                    ? "the model finds the arm's shape"
                    : "the model finds no shape that balances the load: none is published; check "
                      "the scene's load and arm.stiffness.K_eps_n";
  addValue(out, names::kTierKey, statics::nameOf(choice.setting.tier));
  addValue(out, names::kOrderKey, std::to_string(choice.setting.order));
  addValue(out, names::kTierReasonKey, choice.reason);
  addValue(out, names::kSolveStatusKey, statics::nameOf(solution_.status));
  addValue(out, names::kUnsolvedKey, std::to_string(unsolved_.total()));
  if (response_.instant()) return out;
  addValue(out, names::kMemoryKnownKey, response_.known() ? "true" : "false");
  addValue(out, names::kEffectiveUncertaintyKey, fixed(1e-3 * response_.uncertainty().maxCoeff()));
  return out;
}

void ShapePublisher::reportSilence(DiagnosticStatus& status) const {
  if (measures()) return;
  const bool never = last_reading_.isZero();
  status.level = never ? DiagnosticStatus::WARN : DiagnosticStatus::ERROR;
  status.message = never ? "waits for the first pressure_measured" : unmeasuredText();
}

}  // namespace helix_arm::ros_bridge
