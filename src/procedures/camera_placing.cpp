#include "camera_placing.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "basics/pi.hpp"
#include "basics/text.hpp"
#include "calibration_job.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "io/document/number.hpp"
#include "vision/camera_calibration.hpp"

namespace helix_arm::procedures {
namespace {

using estimation::Corners;
using estimation::PlacementStatus;
using vision::TagDetection;

constexpr int kLeastTags = 3;
// Deviations of the shape from the model's beyond which the arm is hardly at rest.
constexpr double kMostShapeDeviations = 3.0;
constexpr double kMostRms = 1.0;  // [px]

using Observations = std::map<int, std::vector<Corners>>;  // by index in the layout

bool isUnique(const std::vector<TagDetection>& tags, const TagDetection& tag) {
  return std::count_if(tags.begin(), tags.end(),
                       [&tag](const TagDetection& one) { return one.id == tag.id; }) == 1;
}

Observations observationsOf(const io::Scene& scene,
                            const std::vector<std::vector<TagDetection>>& pictures) {
  Observations out;
  for (const std::vector<TagDetection>& tags : pictures) {
    for (const TagDetection& tag : tags) {
      const int index = scene.tags->find(tag.id);
      if (index >= 0 && tag.hamming == 0 && isUnique(tags, tag)) out[index].push_back(tag.corners);
    }
  }
  return out;
}

Corners meanOf(const std::vector<Corners>& seen) {
  Corners sum = Corners::Zero();
  for (const Corners& one : seen) sum += one;
  return sum / static_cast<double>(seen.size());
}

// Why the pictures do not show one pose; empty if they do.
std::string whyMoved(const io::Scene& scene, const Observations& seen) {
  for (const auto& [tag, observations] : seen) {
    const Corners mean = meanOf(observations);
    for (const Corners& one : observations) {
      const double off = (one - mean).norm() / std::sqrt(8.0);
      if (off <= kMostCornerMotion) continue;
      return basics::format(
          "tag %d is %.2g px off its mean over the pictures; expected at most %.2g px: keep camera "
          "and arm still, and use pictures of one pose only",
          scene.tags->tags[static_cast<std::size_t>(tag)].id, off, kMostCornerMotion);
    }
  }
  return "";
}

std::string whyNotFitted(const CameraPlacing& placing) {
  const estimation::CameraPlacement& fit = placing.fit;
  switch (fit.status) {
    case PlacementStatus::kPlaced:
      break;
    case PlacementStatus::kUnexplained:
      return "no pose of the camera fits more than half of the tags; those that do not fit: " +
             io::listOf(placing.outliers) +
             ". Check tags.groups, tags.size_m and the camera's calibration, and that the arm is "
             "at the stated pressures";
    case PlacementStatus::kNotConverged:
      return "the search for the pose did not converge; check tags.groups and tags.size_m";
  }
  const Eigen::Matrix<double, 6, 1> error = placing.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  const double position = error.head<3>().maxCoeff(), rotation = error.tail<3>().maxCoeff();
  if (position <= kMostPositionError && rotation <= kMostRotationError) return "";
  constexpr double kDegrees = 180 / basics::kPi;
  return basics::format(
      "the tags in sight place the camera to %.2g mm and %.2g deg only; expected %.2g mm and %.2g "
      "deg: bring more tags into sight, or move the camera closer",
      1e3 * position, rotation * kDegrees, 1e3 * kMostPositionError, kMostRotationError * kDegrees);
}

// Takes the outliers of a fit out of the tags, unless no pose fits most of them: even with little
// weight, a misplaced tag bends the arm's shape towards itself.
void leaveOutOutliers(const io::Scene& scene, std::vector<estimation::CornerObservation>& seen,
                      CameraPlacing& out) {
  std::vector<estimation::CornerObservation> kept;
  std::vector<int> tags;
  for (std::size_t i = 0; i < out.fit.tags.size(); ++i) {
    const int id = scene.tags->tags[static_cast<std::size_t>(seen[i].tag)].id;
    if (out.fit.tags[i].outlier) {
      out.outliers.push_back(id);
    } else {
      kept.push_back(seen[i]);
      tags.push_back(id);
    }
  }
  if (out.fit.status != PlacementStatus::kPlaced) return;
  seen = std::move(kept);
  out.tags = std::move(tags);
}

// Names the usual mistakes that explain why the tags do not fit, seen from where the camera was
// placed or else from where the scene has it. One that is certain refuses the place; others count
// only where no tag is left out, since a misplaced one looks a little like many of them.
void suspect(io::Scene scene, const std::vector<estimation::CornerObservation>& seen,
             CameraPlacing& out) {
  const bool placed = out.fit.status == PlacementStatus::kPlaced;
  if (placed) scene.camera->X_WC = out.X_WC;
  out.suspects = tagSuspectsOf(scene, {{1, scene.arm.inputAt(0.0), seen}});
  if (out.suspects.empty()) return;
  const bool certain = estimation::isCertain(out.suspects, 1.0);
  if (placed && !out.outliers.empty() && !certain) return out.suspects.clear();
  const std::vector<std::string> texts = textsOf(out.suspects);
  if (out.reason.empty() && certain) {
    out.reason = "a usual mistake explains the tags far better than any place of the camera";
  }
  if (!out.reason.empty()) out.reason += "; " + texts.front();
  out.warnings.insert(out.warnings.end(), texts.begin(), texts.end());
}

void advise(CameraPlacing& out) {
  if (!out.outliers.empty()) {
    out.warnings.push_back("these tags do not fit: " + io::listOf(out.outliers) +
                           "; check their places in tags.groups");
  }
  if (out.fit.rms > kMostRms) {
    out.warnings.push_back(
        basics::format("the corners' RMS is %.2g px; expected 1 px: calibrate the camera at this "
                       "focus and size, and check tags.size_m",
                       out.fit.rms));
  }
  if (out.fit.shape_deviations > kMostShapeDeviations) {
    out.warnings.push_back(
        basics::format("the arm's shape is %.2g standard deviations off the model's; expected 3: "
                       "let it come to rest without pressure and without contact",
                       out.fit.shape_deviations));
  }
}

}  // namespace

CameraPlacing placeCamera(const io::Scene& scene, const model::Shape& shape,
                          const std::vector<std::vector<TagDetection>>& pictures) {
  basics::require(scene.camera.has_value() && scene.tags.has_value(), "scene ", scene.name,
                  " has no ", scene.camera ? "tags" : "camera",
                  "; expected a scene with the sections camera and tags");
  CameraPlacing out;
  const estimation::Camera& camera = scene.camera->model;
  const Observations observations = observationsOf(scene, pictures);
  std::vector<estimation::CornerObservation> seen;
  for (const auto& [tag, corners] : observations) {
    const auto direction = estimation::directionsOf(camera, meanOf(corners));
    if (!direction) continue;
    seen.push_back({tag, *direction});
    out.tags.push_back(scene.tags->tags[static_cast<std::size_t>(tag)].id);
  }
  if (static_cast<int>(seen.size()) < kLeastTags) {
    out.reason = std::to_string(seen.size()) + " tags of scene " + scene.name +
                 " can be used; expected " + std::to_string(kLeastTags) +
                 ": bring more of them into sight, in focus and in even light";
    return out;
  }
  out.reason = whyMoved(scene, observations);
  if (!out.reason.empty()) return out;

  estimation::CameraPlacementOptions options;
  options.corner_noise = scene.vision.fit.corner_noise;
  options.tag_prior = scene.tag_prior;
  options.border_shift_prior = scene.vision.fit.border_shift_prior;
  const auto start = vision::startOfPlacement(*scene.tags, shape, seen, camera.focal());
  if (!start) {
    out.reason = "no pose of the camera has most of the tags before it; check tags.groups";
    return out;
  }
  const auto fit = [&](const lie::SE3& from) {
    out.fit = estimation::fitCameraPlacement(scene.arm, *scene.tags, shape, seen, camera.focal(),
                                             from, options);
  };
  fit(*start);
  const std::vector<estimation::CornerObservation> all = seen;
  leaveOutOutliers(scene, seen, out);
  if (!out.outliers.empty() && out.fit.status == PlacementStatus::kPlaced) fit(*start);
  out.X_WC = scene.X_WB * out.fit.X_CB.inverse();
  out.covariance = estimation::cameraCovariance(scene.X_WB, out.fit.X_CB, out.fit.covariance);
  const lie::SE3 change = scene.camera->X_WC.inverse() * out.X_WC;
  out.moved = change.translation.norm();
  out.turned = change.log().tail<3>().norm();
  out.reason = whyNotFitted(out);
  suspect(scene, all, out);
  out.success = out.reason.empty();
  if (out.success) advise(out);
  return out;
}

}  // namespace helix_arm::procedures
