#pragma once

#include <vector>

#include <opencv2/core.hpp>

namespace helix_arm::simulation {

/// Black and white of one printed tag, with its quiet zone, and exact areas of it.
///
/// Its plane is measured in cells from the top left corner of the card, x to the right and y down
/// as one reads the tag. The card is made of rectangles of one colour each, between lines that run
/// through all of it.
class TagPattern {
 public:
  /// Of the plane, what lies on one rectangle.
  struct Point {
    double x, y;      ///< [cells]
    int column, row;  ///< of the rectangle that holds it
  };

  /// Contour integrals along a line; those around an area are the area's own [cells^2].
  struct Areas {
    double white = 0;  ///< that is white
    double card = 0;   ///< that is card at all
    double whole = 0;  ///< all of it

    Areas& operator+=(const Areas& other);
    Areas& operator-=(const Areas& other);
  };

  /// @param cells  (CV_8UC1, square) 0 or 255 a cell.
  /// @param bleed  that white bleeds into black at each edge, in [0, 0.5) [cells].
  TagPattern(const cv::Mat& cells, double bleed);

  /// The point at (x, y), neither beyond 1e3; `hint` is one near it.
  Point at(double x, double y, const Point& hint) const;

  /// Along the straight line from a to b.
  Areas along(const Point& a, const Point& b) const;

 private:
  struct Rectangle {
    double white, card;                // 0 or 1
    double white_before, card_before;  // widths in this row on its left
  };

  int count_;                          // of rectangles, across and down
  std::vector<double> lines_;          // (count + 1) where they begin, the same in x and y
  std::vector<Rectangle> rectangles_;  // (count x count) by rows
};

}  // namespace helix_arm::simulation
