#pragma once

#include <Eigen/Core>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/estimation/camera.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/simulation/card_print.hpp"
#include "tag_pattern.hpp"

namespace helix_arm::simulation {

/// Subject of error messages.
inline constexpr char kSimulatedCamera[] = "simulated camera";

inline constexpr double kFarOff = 2e4;  ///< limit of pixel coordinates that are drawn [px]

/// Paints flat cards, such as the tags of an arm, as a camera with distortion sees them. Each pixel
/// is computed from the exact area of the card that it covers.
class TagPainter {
 public:
  /// @param bleed  width by which white bleeds into black at each edge [m].
  /// @throws std::invalid_argument on a bleed of half a cell or more.
  TagPainter(const estimation::Camera& camera, const std::vector<CardPrint>& prints, double bleed);

  /// Paints a card over a picture (CV_8UC1) of the camera's size.
  /// @param X_CT  its pose seen from the camera: origin in its centre, as of a tag.
  void draw(int number, const lie::SE3& X_CT, cv::Mat& picture);

 private:
  // Intersection of the ray through a pixel's corner with a card's plane.
  struct PlanePoint {
    bool valid = false;
    TagPattern::Point point{};
  };

  struct Card {
    TagPattern pattern;
    double unit;           // [m]
    double width, height;  // [units]
  };

  cv::Rect boxOf(const Card& card, const lie::SE3& X_CT) const;
  void lookThrough(int y, const cv::Rect& box, const Eigen::Matrix3d& units_of_direction,
                   const TagPattern& pattern, std::vector<PlanePoint>& out) const;

  estimation::Camera camera_;
  cv::Mat directions_;  // (CV_32FC2) (x/z, y/z) seen at the corners of the pixels
  std::vector<Card> cards_;
  // Of the current card.
  std::vector<PlanePoint> above_, below_;
  std::vector<TagPattern::Areas> lines_above_, lines_below_;
};

}  // namespace helix_arm::simulation
