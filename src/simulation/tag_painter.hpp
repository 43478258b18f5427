#pragma once

#include <Eigen/Core>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/localization/camera.hpp"
#include "helix_arm/simulation/camera.hpp"

namespace helix_arm::simulation {

/// Black and white areas of a printed card, such as a tag with its quiet zone.
///
/// Coordinates are in units of the print from the top left corner of the card, x to the right and y
/// down as one reads the tag. The card consists of rectangles of one colour each, between lines
/// that cross the whole card.
class TagPattern {
 public:
  /// A point of the plane and its rectangle.
  struct Point {
    double x, y;      ///< [units]
    int column, row;  ///< of the rectangle that contains it
  };

  /// Contour integrals along a line; around an area they sum to the area itself [units^2].
  struct Areas {
    double white = 0;  ///< white area
    double card = 0;   ///< area on the card
    double whole = 0;  ///< total area

    Areas& operator+=(const Areas& other);
    Areas& operator-=(const Areas& other);
  };

  /// @param bleed  width by which white bleeds into black at each edge, >= 0, less than half the
  ///     least cell [units].
  TagPattern(const CardPrint& print, double bleed);

  /// The point at (x, y), |x| and |y| at most 1e3; `hint` is a point near it.
  Point at(double x, double y, const Point& hint) const;

  /// Along the straight line from a to b.
  Areas along(const Point& a, const Point& b) const;

 private:
  struct Rectangle {
    double white, card;                // 0 or 1
    double white_before, card_before;  // widths in this row on its left
  };

  std::vector<double> across_, down_;  // (count + 1) where the rectangles begin
  std::size_t columns_;                // of rectangles
  std::vector<Rectangle> rectangles_;  // by rows
};

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
