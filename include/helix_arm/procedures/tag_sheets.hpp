#pragma once

#include <array>
#include <string>
#include <vector>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/vision/charuco_board.hpp"

namespace helix_arm::procedures {

/// Where one tag is mounted, in the measures of the arm at rest as if its skin were unrolled: along
/// the section, around it and outwards. All angles grow from the y axis of the base curve's frame
/// towards its z axis; the first muscle of a ring is at 0.
struct UnrolledTag {
  int id;
  int section;       ///< index, counted from 0 at the base
  double s;          ///< in [0, 1] along the section
  double from_base;  ///< from the base of the section, along its base curve [m]
  int actuator;      ///< index in the arm of the section's actuator that is nearest
  double angle;      ///< around the base curve, in [0, 2 pi) [rad]
  double radius;     ///< from the base curve to the tag's centre [m]
  double standoff;   ///< from the centre line of the actuator to the tag's centre, outwards [m]
  double aside;      ///< the same around the arm, towards larger angles [m]
  /// Direction of the tag's upper edge, seen from outside with the base on the left: 0 upwards,
  /// which is towards smaller angles; counter-clockwise, in (-pi, pi] [rad].
  double turn;
  double tilt;  ///< of the face from outwards, in [0, pi] [rad]
};

/// All tags, in their order.
/// @param layout  valid for this arm.
std::vector<UnrolledTag> unrolled(const model::Arm& arm, const estimation::TagLayout& layout);

/// Angle of an actuator around the base curve, in [0, 2 pi) [rad]; 0 at the centre.
double angleAround(const model::Actuator& actuator);

// Pages to print as plain data. All lengths are in millimetres on paper; positions are seen from
// the top left corner of the page, x to the right and y down.

struct Paper {
  const char* name;
  double width, height;  ///< upright [mm]
};
inline constexpr std::array<Paper, 2> kPapers = {{{"a4", 210.0, 297.0}, {"letter", 215.9, 279.4}}};

/// Width of the edge that stays empty: many printers cannot print there [mm].
inline constexpr double kPageMargin = 10.0;

struct Point {
  double x, y;  ///< [mm]
};

struct Box {
  double x, y, width, height;  ///< top left corner and extent [mm]

  double right() const { return x + width; }
  double bottom() const { return y + height; }
};

/// A straight line.
struct Stroke {
  Point from, to;
  double width = 0.15;  ///< [mm]
  double gray = 0.0;    ///< 0 black, 1 white
  bool dashed = false;
};

/// A filled polygon, drawn above all strokes.
struct Area {
  std::vector<Point> corners;
  double gray = 0.0;  ///< 0 black, 1 white
};

enum class Align { kLeft, kCentre, kRight };

/// One line of text, as high as its box and made smaller where it would be wider.
struct Label {
  Box box;
  std::string text;  ///< UTF-8
  Align align = Align::kLeft;
  bool bold = false;
};

/// A tag with its white border, or a marker of a ChArUco board with its square.
struct PrintedTag {
  int id;
  Box square;  ///< whose corners a detector finds
  Box card;    ///< what is cut out; on a board of tags, the tag with its white border
  std::vector<Box> black;
};

struct Page {
  std::vector<PrintedTag> tags;
  std::vector<Stroke> strokes;
  std::vector<Area> areas;
  std::vector<Label> labels;
};

/// The tags of a scene to cut out, each at its exact size with id, place on the arm, up mark and
/// cut line. Every page has two rulers of 100 mm that show whether the printer scaled it.
///
/// @param scene  with tags.
/// @throws std::invalid_argument on a scene without tags, or with tags too large for the paper.
std::vector<Page> tagSheets(const io::Scene& scene, const Paper& paper);

/// Where the tags are mounted: each section that has tags as if its skin were unrolled, and a table
/// of positions. Not to scale. @throws as tagSheets() on a scene without tags.
std::vector<Page> placementSheets(const io::Scene& scene, const Paper& paper);

/// A board for the calibration of a camera, at its exact size, with the rulers of tagSheets().
/// @throws std::invalid_argument on a board too large for the paper.
Page boardSheet(const vision::TagBoard& board, const Paper& paper);
/// @param board  valid. @throws likewise.
Page boardSheet(const vision::CharucoBoard& board, const Paper& paper);

/// Adds "page 1 of 3" and so on, in the order of the pages.
void numberPages(const Paper& paper, std::vector<Page>& pages);

}  // namespace helix_arm::procedures
