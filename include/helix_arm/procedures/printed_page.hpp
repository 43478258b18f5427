#pragma once

#include <array>
#include <string>
#include <vector>

/// Pages to print as plain data. All lengths are in millimetres on paper; positions are seen from
/// the top left corner of the page, x to the right and y down.
namespace helix_arm::procedures {

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

}  // namespace helix_arm::procedures
