#include "ros_bridge/follow/observation_intake.hpp"

#include <cstddef>
#include <optional>
#include <utility>
#include <variant>

#include "helix_arm/control/target_check.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/names.hpp"

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

}  // namespace helix_arm::ros_bridge
