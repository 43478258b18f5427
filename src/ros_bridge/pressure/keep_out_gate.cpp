#include "keep_out_gate.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <variant>
#include <vector>

#include "basics/text.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

visualization_msgs::MarkerArray ZoneMarkers::draw(const clearance::KeepOut& keep_out, int nearest,
                                                  bool used_up, const ros::Time& stamp) {
  begin(stamp);
  const lie::SE3 X_BW = keep_out.X_WB.inverse();
  for (int i = 0; i < static_cast<int>(keep_out.zones.size()); ++i) {
    const clearance::Zone& zone = keep_out.zones[static_cast<std::size_t>(i)];
    const bool red = used_up && i == nearest;
    addZone(zone, X_BW * zone.X_WZ, red ? color(1.0, 0.2, 0.15, 0.7) : color(0.7, 0.7, 0.75, 0.35),
            i);
  }
  return end();
}

void ZoneMarkers::addZone(const clearance::Zone& zone, const lie::SE3& X_BZ,
                          const std_msgs::ColorRGBA& color, int id) {
  const auto place = [&](int type, double x, double y, double z) -> Marker& {
    Marker& marker = add("zones", type, color, id);
    marker.pose = toPoseMsg(X_BZ);
    marker.scale = toVectorMsg({x, y, z});
    return marker;
  };
  if (const auto* box = std::get_if<clearance::Box>(&zone.form)) {
    place(Marker::CUBE, box->size.x(), box->size.y(), box->size.z());
  } else if (const auto* round = std::get_if<clearance::Cylinder>(&zone.form)) {
    place(Marker::CYLINDER, 2 * round->radius, 2 * round->radius, round->length);
  } else if (const auto* ball = std::get_if<clearance::Sphere>(&zone.form)) {
    place(Marker::SPHERE, 2 * ball->radius, 2 * ball->radius, 2 * ball->radius);
  } else if (const auto* mesh = std::get_if<clearance::Mesh>(&zone.form)) {
    Marker& marker = place(Marker::TRIANGLE_LIST, 1, 1, 1);
    for (const auto& triangle : mesh->triangles) {
      for (const int corner : triangle) {
        marker.points.push_back(toPointMsg(mesh->corners[static_cast<std::size_t>(corner)]));
      }
    }
  } else {
    place(Marker::CUBE, kPlate, kPlate, kPlateHeight);
  }
}

KeepOutGate::KeepOutGate(ros::NodeHandle node, const io::Scene& scene,
                         const std::string& base_frame, double draw_period,
                         const model::ArmResponse& response, std::function<void()> stop)
    : scene_(scene),
      base_frame_(base_frame),
      response_(response),
      stop_(std::move(stop)),
      node_(std::move(node)),
      markers_(base_frame, draw_period) {
  adopt();
}

void KeepOutGate::adopt() {
  check_.reset();
  close_.reset();
  nearest_ = {};
  measured_.shutdown();
  if (!scene_.keep_out) return;
  check_.emplace(scene_.model, *scene_.keep_out);
  measured_ = listen(node_, names::kMeasured, 1, &KeepOutGate::onMeasured, this);
  if (!marker_publisher_) {
    marker_publisher_ = node_.advertise<visualization_msgs::MarkerArray>(names::kMarkers, 2);
  }
}

std::optional<control::Refusal> KeepOutGate::refusalOf(const PressureLoop& loop,
                                                       const Eigen::VectorXd& target) {
  if (!check_) return std::nullopt;
  // Where the arm has moved on meanwhile, its way is another.
  for (int k = 0; k < kMostChecks; ++k) {
    const PressureLoop::Snapshot path = loop.snapshot();
    const Eigen::VectorXd& from = path.orders.set_point;
    if (const auto blocked = sweep(from, path.reading, target)) return refuse(*blocked);
    if ((loop.snapshot().orders.set_point - from).cwiseAbs().maxCoeff() > kMoved) continue;
    const auto at = check_->at(scene_.arm.clamped(response_.effectiveAt(target, kTargetAt)));
    nearest_ = {};
    if (at) nearest_ = {at->distance, check_->clearance().nameOf(at->zone), std::nullopt};
    return std::nullopt;
  }
  return control::Refusal{control::Fault::kBlocked,
                          "the arm moves on faster than its way is checked for zones; lower "
                          "safety.slew_kpa_s, or give the scene a faster tier"};
}

void KeepOutGate::draw(const model::Shape* shape) {
  if (!check_ || marker_publisher_.getNumSubscribers() == 0) return;
  const clearance::Clearance now =
      shape == nullptr ? clearance::Clearance() : check_->clearance().of(*shape);
  const bool used_up = now.distance < scene_.keep_out->clearance;
  marker_publisher_.publish(markers_.draw(*scene_.keep_out,
                                          close_ ? close_->clearance.zone : now.zone,
                                          used_up || close_.has_value(), ros::Time::now()));
}

void KeepOutGate::onMeasured(const ArmShapeConstPtr& shape) {
  const auto checked = fromMsg(*shape, scene_.arm, base_frame_);
  if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
    if (bad_shapes_.add()) {
      logWarning("a message on measured was not used to watch the zones (%lu so far): %s",
                 bad_shapes_.total(), refusal->message.c_str());
    }
    return;
  }
  const clearance::Clearance seen = check_->clearance().of(std::get<model::Shape>(checked));
  const double least = scene_.keep_out->clearance;
  if (seen.distance >= least) {
    close_.reset();
    return;
  }
  // A command that leads away is not stopped, unless the arm comes closer all the same.
  const double nearest = close_ ? close_->nearest : least;
  if (!close_ || seen.distance < nearest - kCloser) stop_();
  close_ = Sight{seen, std::min(nearest, seen.distance), ros::SteadyTime::now()};
  if (!close_sights_.add()) return;
  logError(
      "the arm is seen %.1f mm from %s, and clearance_m asks for %.1f mm (%lu pictures so far): "
      "it stays where it is until a command leads away",
      1e3 * seen.distance, check_->clearance().nameOf(seen.zone).c_str(), 1e3 * least,
      close_sights_.total());
}

double KeepOutGate::shortfall(const Eigen::VectorXd& input) const {
  const bool fresh = close_ && (ros::SteadyTime::now() - close_->time).toSec() < kFreshSight;
  if (!fresh) return 0;
  const auto by_model = check_->at(scene_.arm.clamped(input));
  if (!by_model) return 0;
  return std::max(0.0, by_model->distance - close_->clearance.distance);
}

std::optional<clearance::Blocked> KeepOutGate::sweep(const Eigen::VectorXd& set_point,
                                                     const Eigen::VectorXd& reading,
                                                     const Eigen::VectorXd& target) const {
  const io::SafetyConfig& safety = scene_.safety;
  // A reading within its noise of the set point is there.
  Eigen::VectorXd now = set_point;
  for (Eigen::Index i = 0; i < now.size(); ++i) {
    if (std::abs(reading[i] - now[i]) > safety.rules.vented_below) now[i] = reading[i];
  }
  std::vector<Eigen::VectorXd> corners =
      clearance::pressuresOnTheWay(safety.channels, safety.rules, set_point, now, target);
  if (!response_.instant()) {
    for (Eigen::VectorXd& corner : corners) corner = response_.effectiveAt(corner, kTargetAt);
  }
  return check_->sweep(corners, shortfall(corners.front()));
}

control::Refusal KeepOutGate::refuse(const clearance::Blocked& blocked) {
  nearest_ = {blocked.clearance, blocked.zone, std::nullopt};
  std::string remedy = "move the target, or plan a way around: helix_arm plan";
  if (blocked.last_clear.size() > 0) {
    nearest_.clear_tip = blocked.clear_tip;
    remedy = basics::format("the nearest clear tip on the way is (%.3f, %.3f, %.3f) m; ",
                            blocked.clear_tip.x(), blocked.clear_tip.y(), blocked.clear_tip.z()) +
             remedy;
  }
  return {control::Fault::kBlocked, "the arm " + blocked.text() + ", so it stays; " + remedy};
}

}  // namespace helix_arm::ros_bridge
