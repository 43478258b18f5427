#include "helix_arm/vision/camera_start.hpp"

#include <limits>

#include <opencv2/calib3d.hpp>

#include "helix_arm/basics/median.hpp"
#include "helix_arm/estimation/camera_placement.hpp"
#include "helix_arm/model/curve.hpp"

namespace helix_arm::vision {
namespace {

// Both poses X_CT of a tag that fit its corners.
std::vector<lie::SE3> posesOfTag(const estimation::Corners& plane,
                                 const estimation::Corners& direction) {
  std::vector<cv::Point3d> object;
  std::vector<cv::Point2d> picture;
  for (const int c : {3, 2, 1, 0}) {  // the order that OpenCV asks for: from the top left
    object.emplace_back(plane(0, c), plane(1, c), 0.0);
    picture.emplace_back(direction(0, c), direction(1, c));
  }
  std::vector<cv::Mat> rotations, translations;
  try {
    cv::solvePnPGeneric(object, picture, cv::Matx33d::eye(), cv::noArray(), rotations, translations,
                        false, cv::SOLVEPNP_IPPE_SQUARE);
  } catch (const cv::Exception&) {
    return {};  // corners on a line
  }
  std::vector<lie::SE3> poses;
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    cv::Matx33d rotation;
    cv::Rodrigues(rotations[i], rotation);
    lie::SE3 pose;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) pose.rotation(row, column) = rotation(row, column);
      pose.translation[row] = translations[i].at<double>(row);
    }
    if (pose.rotation.allFinite() && pose.translation.allFinite()) poses.push_back(pose);
  }
  return poses;
}

}  // namespace

std::optional<lie::SE3> startOfPlacement(const estimation::TagLayout& layout,
                                         const model::Shape& shape,
                                         const std::vector<estimation::CornerObservation>& seen,
                                         double focal) {
  const estimation::Corners plane = layout.corners();
  std::optional<lie::SE3> best;
  double least = std::numeric_limits<double>::infinity();
  for (const estimation::CornerObservation& one : seen) {
    const estimation::TagPlacement& tag = layout.tags[static_cast<std::size_t>(one.tag)];
    const lie::SE3 X_BT = model::poseAt(shape, tag.section, tag.s) * tag.X_ST;
    for (const lie::SE3& X_CT : posesOfTag(plane, one.direction)) {
      const lie::SE3 X_CB = X_CT * X_BT.inverse();
      std::vector<double> errors;
      for (const estimation::CornerObservation& other : seen) {
        errors.push_back(estimation::cornerError(layout, shape, X_CB, other, focal));
      }
      const double median = basics::medianOf(errors);
      if (!(median < least)) continue;
      least = median;
      best = X_CB;
    }
  }
  return best;
}

}  // namespace helix_arm::vision
