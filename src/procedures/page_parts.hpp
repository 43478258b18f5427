#pragma once

#include <string>
#include <vector>

#include "helix_arm/procedures/printed_page.hpp"
#include "helix_arm/vision/tag_family.hpp"

namespace helix_arm::procedures {

/// Height of text of the usual size [mm].
inline constexpr double kTextHeight = 3.2;
/// From one line of it to the next [mm].
inline constexpr double kLineHeight = 3.6;

/// What the margins leave.
Box printableArea(const Paper& paper);
/// What the margins and the heading leave.
Box areaBelowHeading(const Paper& paper);
/// What the margins, the heading and the rulers leave.
Box areaBesideRulers(const Paper& paper);

/// A page with a title and up to two lines of notes.
Page headedPage(const Paper& paper, const std::string& title,
                const std::vector<std::string>& notes);

/// Adds a ruler of 100 mm across and one upright, and notes beside them.
void addRulers(const Paper& paper, const std::vector<std::string>& notes, Page& page);

/// Adds lines of text from the top of an area down. @return where the next line would be [mm].
double addLines(const std::vector<std::string>& lines, const Box& area, Page& page);

/// The outline of a box.
void addOutline(const Box& box, Page& page);

/// A black triangle that points in a direction, about the middle of its height.
/// @param angle  counter-clockwise from upwards [rad].
Area upMark(const Point& middle, double size, double angle = 0.0);

/// The black cells of a grid as few boxes.
/// @param cells   (CV_8UC1) 0 or 255.
/// @param corner  top left of the grid.
/// @param cell    side of a cell [mm].
std::vector<Box> blackBoxes(const cv::Mat& cells, const Point& corner, double cell);

/// A tag of which the detected square has its top left corner and side here. Its card is the tag
/// with its white border.
PrintedTag printedTag(const vision::TagFamily& family, int id, const Point& corner, double side);

/// "31 mm" and the like: a length with up to `digits` decimals, without zeros at its end.
/// @param length  [mm].
std::string millimetres(double length, int digits = 2);
/// The number alone.
std::string rounded(double value, int digits);

}  // namespace helix_arm::procedures
