#include "observations.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "helix_arm/model/curve.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"

namespace helix_arm::ros_bridge {
namespace {

bool has(const std::vector<int>& ids, int id) {
  return std::find(ids.begin(), ids.end(), id) != ids.end();
}

std::string countText(int tags) { return std::to_string(tags) + (tags == 1 ? " tag" : " tags"); }

// Lists the ids that no fit can use, if there are any.
std::string unknownTags(const vision::Observation& observation) {
  std::string out;
  if (!observation.unknown_ids.empty())
    out += "; not of the scene: " + listOf(observation.unknown_ids);
  if (!observation.repeated_ids.empty()) out += "; seen twice: " + listOf(observation.repeated_ids);
  if (!observation.unusable_ids.empty()) {
    out += "; where the lens distortion cannot be inverted: " + listOf(observation.unusable_ids);
  }
  return out;
}

// Residual of the tag with this id; null if it was not used in the fit.
const estimation::TagResidual* residualOf(const vision::Observation& observation,
                                          const estimation::TagLayout& layout, int id) {
  if (observation.state != vision::ObservationState::kMeasured) return nullptr;
  const auto& tags = observation.fit.tags;
  const auto found = std::find_if(tags.begin(), tags.end(), [&](const auto& residual) {
    return layout.tags[residual.tag].id == id;
  });
  return found == tags.end() ? nullptr : &*found;
}

// Number of visible tags of the arm that were seen once.
int tagsOfArm(const vision::Observation& observation) {
  const auto& tags = observation.detections;
  return static_cast<int>(std::count_if(tags.begin(), tags.end(), [&](const auto& tag) {
    return !has(observation.unknown_ids, tag.id) && !has(observation.repeated_ids, tag.id);
  }));
}

TagDetections toMsg(const std_msgs::Header& header, const vision::Observation& observation,
                    const estimation::TagLayout& layout) {
  TagDetections msg;
  msg.header = header;
  msg.tags.reserve(observation.detections.size());
  for (const vision::TagDetection& detection : observation.detections) {
    TagDetection tag;
    tag.id = detection.id;
    std::copy(detection.corners.data(), detection.corners.data() + 8, tag.corners.begin());
    tag.hamming = static_cast<std::uint8_t>(detection.hamming);
    tag.margin = detection.margin;
    tag.known = layout.find(detection.id) >= 0;
    tag.repeated = has(observation.repeated_ids, detection.id);
    const auto* residual = residualOf(observation, layout, detection.id);
    tag.fitted = residual != nullptr && !tag.repeated;
    if (tag.fitted) {
      tag.residual = residual->rms;
      tag.weight = residual->weight;
      tag.outlier = residual->outlier;
    }
    msg.tags.push_back(tag);
  }
  return msg;
}

ModelError toMsg(const std_msgs::Header& header, const estimation::TwistFit& fit,
                 const ModelHistory::Entry& model) {
  ModelError msg;
  msg.header = header;
  msg.model_stamp = model.stamp;
  msg.sections = static_cast<std::uint32_t>(fit.twists.cols());
  const model::Twists expected = model.shape.twists(), difference = fit.twists - expected;
  msg.twist.assign(difference.data(), difference.data() + difference.size());
  const Eigen::Vector3d error =
      model::tipPose(fit.shape).translation - model::tipPose(model.shape).translation;
  msg.tip.x = error.x();
  msg.tip.y = error.y();
  msg.tip.z = error.z();
  msg.tip_error = error.norm();
  // The speed along a piece of constant twist is |v|.
  msg.tip_error_percent =
      100.0 * msg.tip_error / model.shape.pieces().topRows<3>().colwise().norm().sum();
  // The covariance is in the frame of the nominal base.
  const Eigen::Vector3d direction = fit.X_B0B.rotation * error.stableNormalized();
  msg.tip_sigma = std::sqrt(std::max(0.0, direction.dot(fit.tip_covariance * direction)));
  msg.tag_rms = fit.rms;
  return msg;
}

// Largest standard deviation of the measured tip over all directions [m].
double tipSigma(const estimation::TwistFit& fit) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(fit.tip_covariance,
                                                              Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues().maxCoeff()));
}

// `8 tags, 0.20 px, tip noise 0.5 mm`: summary of a measured shape. How well the tags are placed is
// not part of the noise: the error budget adds it.
std::string summarise(const vision::Observation& observation, int tags) {
  const int outliers = observation.fit.outliers();
  return countText(tags) + (outliers > 0 ? " (" + std::to_string(outliers) + " off)" : "") + ", " +
         fixed(observation.fit.rms, 2) + " px, tip noise " +
         fixed(1e3 * tipSigma(observation.fit)) + " mm";
}

std::string describe(const vision::Observation& observation, int tags,
                     const vision::LocalizerConfig& config) {
  switch (observation.state) {
    case vision::ObservationState::kMeasured:
      return summarise(observation, tags) + unknownTags(observation);
    case vision::ObservationState::kNoTags:
      return "no tag of the arm is in sight: check the view, the light, and the scene's "
             "tags.family" +
             unknownTags(observation);
    case vision::ObservationState::kTooFewTags:
      return countText(tags) + " in sight do not determine the shape; at least " +
             std::to_string(config.min_tags) +
             " are needed, on all sections: check occlusion and light" + unknownTags(observation);
    case vision::ObservationState::kNoFit:
      break;
  }
  return "no shape of the arm fits the " + countText(tags) +
         " in sight: check their size and poses in the scene, and the camera's calibration" +
         unknownTags(observation);
}

std::string tipText(const estimation::TwistFit& fit, const ModelError* error) {
  if (error == nullptr) return "tip noise " + fixed(1e3 * tipSigma(fit)) + " mm";
  return "model off by " + fixed(1e3 * error->tip_error) + " mm (" +
         fixed(error->tip_error_percent) + " %)";
}

}  // namespace

ObservationReport reportOf(const Measurement& measurement, const std::string& base_frame,
                           const std::string& camera_frame) {
  const vision::Observation& observation = measurement.observation;
  const std_msgs::Header header = toHeaderMsg(measurement.stamp, base_frame);

  ObservationReport out;
  out.tags = tagsOfArm(observation);
  out.account = describe(observation, out.tags, measurement.config);
  out.detections =
      toMsg(toHeaderMsg(measurement.stamp, camera_frame), observation, measurement.view.layout);
  if (!measurement.measured()) {
    out.lines = {out.account};
    return out;
  }
  out.shape = toShapeMsg(header, "measured", observation.fit.shape, observation.fit.covariance);
  if (measurement.model) out.error = toMsg(header, observation.fit, *measurement.model);
  out.tip = tipText(observation.fit, out.error ? &*out.error : nullptr);
  out.lines = {out.tip, summarise(observation, out.tags)};
  return out;
}

std::string listOf(const std::vector<int>& ids) {
  constexpr std::size_t kMost = 8;
  std::string out;
  for (std::size_t k = 0; k < std::min(ids.size(), kMost); ++k) {
    out += (k > 0 ? ", " : "") + std::to_string(ids[k]);
  }
  return ids.size() > kMost ? out + ", ..." : out;
}

}  // namespace helix_arm::ros_bridge
