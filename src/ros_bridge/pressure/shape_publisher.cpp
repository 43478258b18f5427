#include "shape_publisher.hpp"

#include <algorithm>
#include <cmath>

#include "basics/text.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

ShapePublisher::ShapePublisher(ros::NodeHandle node, const io::Scene& scene,
                               const PressureCommandOptions& options, TipHandle::OnTarget on_target)
    : scene_(scene),
      frames_(options.world_frame, options.frame_prefix, names::kModelFrames, options.frames),
      readings_per_tf_(static_cast<std::uint64_t>(std::lround(options.rate / options.tf_rate))),
      own_regulator_(options.regulator == "scene"),
      markers_(scene, frames_.base, 1.0 / options.draw_rate),
      measured_(scene.arm.inputAt(0)),
      response_(scene.arm),
      solution_(scene.model.solve(measured_)),
      model_publisher_(node.advertise<ArmShape>(names::kModel, 10)),
      tip_publisher_(node.advertise<geometry_msgs::PoseStamped>(names::kModelTip, 10)),
      joints_publisher_(node.advertise<sensor_msgs::JointState>(names::kJointStates, 10)),
      marker_publisher_(node.advertise<visualization_msgs::MarkerArray>(names::kMarkers, 2)) {
  sendBaseFrame();
  if (options.handle) {
    handle_ = std::make_unique<TipHandle>(frames_.base, scene, std::move(on_target));
  }
}

void ShapePublisher::adopt() {
  sendBaseFrame();
  response_.adopt(scene_.arm);
  solve();
}

void ShapePublisher::take(const Eigen::VectorXd& measured, const Eigen::VectorXd& command,
                          const ros::Time& stamp) {
  measured_ = measured;
  const ros::Time at = stamp.isZero() ? ros::Time::now() : stamp;
  if (response_.follow(at.toSec(), measured) && !response_.instant() && restarts_.add()) {
    const double rest = response_.restTime();
    logWarning(
        "pressure_measured is stamped earlier than the reading before (%lu times so far): the "
        "actuators' responses start anew, and their memory is unknown until the pressures have "
        "moved by twice the largest play_kpa%s",
        restarts_.total(), (rest > 0 ? basics::format(" and %g s have passed", rest) : "").c_str());
  }
  last_reading_ = ros::SteadyTime::now();
  solve();
  ++readings_;
  if (!solution_.converged()) return;
  const std_msgs::Header header = toHeaderMsg(stamp, frames_.base);
  model_publisher_.publish(toShapeMsg(header, scene_.model.choice(), solution_.shape));
  geometry_msgs::PoseStamped tip;
  tip.header = header;
  tip.pose = toPoseMsg(solution_.tip);
  tip_publisher_.publish(tip);
  if (joints_publisher_.getNumSubscribers() > 0) publishJoints(header, command);
  if (readings_ % readings_per_tf_ == 0) curve_frames_.send(solution_.shape, stamp);
}

void ShapePublisher::moveHandle(const Eigen::VectorXd& goal) {
  if (!handle_) return;
  const statics::Tip commanded =
      scene_.model.tip(scene_.arm.clamped(response_.effectiveAt(goal, kTargetAt)));
  if (commanded.converged()) handle_->follow(commanded.tip);
}

void ShapePublisher::draw(const control::SafetyReport& report, const std::string& reason) {
  markers_.tell(report, reason);
  const bool was_drawn = std::exchange(drawn_, measures() && solution_.converged());
  if (drawn_) {
    marker_publisher_.publish(markers_.draw(solution_.shape, measured_, ros::Time::now()));
  } else if (was_drawn) {
    marker_publisher_.publish(markers_.remove(ros::Time::now()));
    if (measures() || !losses_.add()) return;
    logWarning(
        "no pressures were measured for %g s (%lu times so far): %s; the arm is not drawn until "
        "they are",
        kFresh, losses_.total(), unmeasuredText().c_str());
  }
}

ShapePublisher::DiagnosticStatus ShapePublisher::status() const {
  const statics::TierChoice& choice = scene_.model.choice();
  const bool solved = solution_.converged();
  DiagnosticStatus out =
      makeStatus(names::kModelStatus, solved ? DiagnosticStatus::OK : DiagnosticStatus::ERROR,
                 solved ? "the model finds the arm's shape"
                        : "the model finds no shape that balances the load: none is published; "
                          "check the scene's load and arm.stiffness.K_eps_n",
                 {{"tier", statics::nameOf(choice.setting.tier)},
                  {"order", std::to_string(choice.setting.order)},
                  {"tier_reason", choice.reason},
                  {"solve_status", statics::nameOf(solution_.status)},
                  {"unsolved", std::to_string(unsolved_.total())}});
  if (response_.instant()) return out;
  addValue(out, "memory_known", response_.known() ? "true" : "false");
  if (response_.restTime() > 0) addValue(out, "rest_time_s", fixed(response_.restTime()));
  addValue(out, "effective_uncertainty_kpa",
           fixed(1e-3 * response_.uncertainty(scene_.arm).maxCoeff()));
  return out;
}

void ShapePublisher::reportSilence(DiagnosticStatus& status) const {
  if (measures()) return;
  const bool never = last_reading_.isZero();
  status.level = never ? DiagnosticStatus::WARN : DiagnosticStatus::ERROR;
  status.message = never ? "waits for the first pressure_measured" : unmeasuredText();
}

void ShapePublisher::solve() {
  const bool rests = last_reading_.isZero();  // before the first reading
  const Eigen::VectorXd pressure = scene_.arm.clamped(rests ? measured_ : response_.effective());
  solution_ = scene_.model.solve(pressure);
  if (solution_.converged() || !unsolved_.add()) return;
  const std::string at = basics::messageOf((1e-3 * pressure).transpose());
  logWarning(
      "%s: the %s model finds no shape that balances the load at %s kPa (%s, residual %.2g; %lu "
      "times so far): no model is published there; check the scene's load and "
      "arm.stiffness.K_eps_n",
      scene_.name.c_str(), scene_.model.choice().setting.name().c_str(), at.c_str(),
      statics::nameOf(solution_.status), solution_.residual, unsolved_.total());
}

void ShapePublisher::publishJoints(const std_msgs::Header& header,
                                   const Eigen::VectorXd& command) const {
  sensor_msgs::JointState out;
  out.header = header;
  const auto add = [&out](const std::string& name, double position, double effort) {
    out.name.push_back(name);
    out.position.push_back(position);
    out.effort.push_back(effort);
  };
  const model::Arm& arm = scene_.arm;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    add(arm.actuator(i).name, measured_[i], command[i]);
  }
  const model::Twists twists = solution_.shape.twists();
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const std::string& name = scene_.looks[static_cast<std::size_t>(k)].name;
    add(name + "_bend_y", twists(4, k), NAN);
    add(name + "_bend_z", twists(5, k), NAN);
    add(name + "_twist", twists(3, k), NAN);
  }
  joints_publisher_.publish(out);
}

bool ShapePublisher::measures() const {
  return !last_reading_.isZero() &&
         ros::SteadyTime::now() - last_reading_ < ros::WallDuration(kFresh);
}

std::string ShapePublisher::unmeasuredText() const {
  return own_regulator_ ? "the regulator has given no readings (see its diagnostics)"
                        : "no pressure_measured is received; is the regulator's node running?";
}

void ShapePublisher::sendBaseFrame() {
  static_tf_.sendTransform(worldTransform(frames_.world, frames_.base, scene_.X_WB));
}

}  // namespace helix_arm::ros_bridge
