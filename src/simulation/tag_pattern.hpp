#pragma once

#include <vector>

#include "helix_arm/simulation/card_print.hpp"

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

}  // namespace helix_arm::simulation
