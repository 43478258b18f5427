#pragma once

#include <Eigen/Core>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/estimation/tag_sight.hpp"
#include "helix_arm/vision/tag_family.hpp"
#include "tag_pattern.hpp"

namespace helix_arm::simulation {

/// Subject of error messages.
inline constexpr char kSimulatedCamera[] = "simulated camera";

inline constexpr double kFarOff = 2e4;  ///< limit of pixel coordinates that are drawn [px]

/// Paints the tags of an arm as a camera with distortion sees them. Each pixel is computed from the
/// exact area of the card that it covers.
class TagPainter {
 public:
  /// @param view   valid.
  /// @param bleed  width by which white bleeds into black at each edge [m].
  /// @throws std::invalid_argument on a bleed of half a cell or more, or a tag that the family does
  /// not have.
  TagPainter(const estimation::ArmView& view, const vision::TagFamily& family, double bleed);

  /// Paints tag `tag` of the layout over a picture (CV_8UC1) of the camera's size.
  /// @param X_CT  its pose seen from the camera.
  void draw(int tag, const lie::SE3& X_CT, cv::Mat& picture);

 private:
  // Intersection of the ray through a pixel's corner with a tag's plane.
  struct PlanePoint {
    bool valid = false;
    TagPattern::Point point{};
  };

  cv::Rect boxOf(const lie::SE3& X_CT) const;
  void lookThrough(int y, const cv::Rect& box, const Eigen::Matrix3d& cells_of_direction,
                   const TagPattern& pattern, std::vector<PlanePoint>& out) const;

  estimation::Camera camera_;
  double cell_;         // side of a tag's cell [m]
  double cells_;        // across a card
  cv::Mat directions_;  // (CV_32FC2) (x/z, y/z) seen at the corners of the pixels
  std::vector<TagPattern> patterns_;
  // Of the current tag.
  std::vector<PlanePoint> above_, below_;
  std::vector<TagPattern::Areas> lines_above_, lines_below_;
};

}  // namespace helix_arm::simulation
