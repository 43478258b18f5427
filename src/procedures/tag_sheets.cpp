#include "helix_arm/procedures/tag_sheets.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>
#include <vector>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::procedures {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kAtCentre = 1e-9;  // below it, a point has no direction from the base curve [m]

// In [0, 2 pi). Rounding just below 0 would otherwise appear almost a whole turn away.
double positiveAngle(const Vector2d& yz) {
  constexpr double kRounding = 1e-9;
  const double angle = std::atan2(yz.y(), yz.x());
  if (angle > -kRounding) return std::max(angle, 0.0);
  return angle + 2 * basics::kPi;
}

int nearestActuator(const model::Arm& arm, int section, double s, const Vector3d& point) {
  int nearest = arm.firstActuator(section);
  const auto distance = [&](int i) {
    return (model::poseAlong(arm.actuator(i), s).translation - point).tail<2>().norm();
  };
  for (int i = nearest; i < arm.firstActuator(section + 1); ++i) {
    if (distance(i) < distance(nearest)) nearest = i;
  }
  return nearest;
}

// Direction from the base curve to a point, in the cross-section.
Vector2d outwardsAt(const Vector2d& point, const Vector2d& otherwise) {
  if (point.norm() > kAtCentre) return point.normalized();
  return otherwise.norm() > kAtCentre ? Vector2d(otherwise.normalized())
                                      : Vector2d(Vector2d::UnitX());
}

UnrolledTag unroll(const model::Arm& arm, const estimation::TagPlacement& tag) {
  const Vector3d& centre = tag.X_ST.translation;
  const Vector3d up = tag.X_ST.rotation.col(1), face = tag.X_ST.rotation.col(2);
  const Vector2d outwards = outwardsAt(centre.tail<2>(), face.tail<2>());
  const Vector2d around(-outwards.y(), outwards.x());

  UnrolledTag out{};
  out.id = tag.id;
  out.section = tag.section;
  out.s = tag.s;
  out.from_base = tag.s * arm.restLength(tag.section) + centre.x();
  out.actuator = nearestActuator(arm, tag.section, tag.s, centre);
  out.angle = positiveAngle(outwards);
  out.radius = centre.tail<2>().norm();
  const Vector2d muscle = model::poseAlong(arm.actuator(out.actuator), tag.s).translation.tail<2>();
  const Vector2d muscle_outwards = outwardsAt(muscle, outwards);
  const Vector2d from_muscle = centre.tail<2>() - muscle;
  out.standoff = from_muscle.dot(muscle_outwards);
  out.aside = muscle_outwards.x() * from_muscle.y() - muscle_outwards.y() * from_muscle.x();
  // On the page, s runs to the right and the angle downwards.
  out.turn = std::atan2(-up.x(), -up.tail<2>().dot(around));
  out.tilt = std::acos(std::clamp(face.tail<2>().dot(outwards), -1.0, 1.0));
  return out;
}

}  // namespace

std::vector<UnrolledTag> unrolled(const model::Arm& arm, const estimation::TagLayout& layout) {
  std::vector<UnrolledTag> tags;
  tags.reserve(layout.tags.size());
  for (const estimation::TagPlacement& tag : layout.tags) tags.push_back(unroll(arm, tag));
  return tags;
}

double angleAround(const model::Actuator& actuator) {
  return positiveAngle(outwardsAt(actuator.X_O.translation.tail<2>(), Vector2d::Zero()));
}

namespace {

constexpr double kTextHeight = 3.2;  // of text of the usual size [mm]
constexpr double kLineHeight = 3.6;  // from one line of it to the next [mm]
constexpr double kMapHeight = 72.0;  // of the drawing of addUnrolledMap() [mm]
constexpr double kHeading = 15.0, kFooter = 13.0;
constexpr double kRulerColumn = 11.0;  // width of the ruler on the left
constexpr int kRulerLength = 100;
constexpr double kNumberHeight = 2.6;

void write(Page& page, const Box& box, const std::string& text, Align align = Align::kLeft,
           bool bold = false) {
  page.labels.push_back({box, text, align, bold});
}

double tickLength(int millimetre) {
  if (millimetre % 10 == 0) return 4.5;
  return millimetre % 5 == 0 ? 3.2 : 2.0;
}

// `along` is the direction of the ruler, `aside` that of its ticks.
void addRuler(const Point& zero, const Point& along, const Point& aside, Page& page) {
  const auto at = [&](double s, double t) {
    return Point{zero.x + s * along.x + t * aside.x, zero.y + s * along.y + t * aside.y};
  };
  for (int i = 0; i <= kRulerLength; ++i) {
    page.strokes.push_back({at(i, 0), at(i, tickLength(i)), 0.1});
  }
  page.strokes.push_back({at(0, 0), at(kRulerLength, 0), 0.1});
}

void addAcrossRuler(const Point& zero, Page& page) {
  addRuler(zero, {1, 0}, {0, 1}, page);
  const double y = zero.y + tickLength(0) + 0.3;
  for (int i = 0; i <= kRulerLength; i += 10) {
    const bool last = i == kRulerLength;
    const double half = last ? 4.9 : 3.0;
    write(page, {zero.x + i - half, y, 2 * half, kNumberHeight},
          std::to_string(i) + (last ? " mm" : ""), Align::kCentre);
  }
}

void addUprightRuler(const Point& zero, Page& page) {
  addRuler(zero, {0, -1}, {-1, 0}, page);
  const double width = zero.x - tickLength(0) - 0.3 - kPageMargin;
  for (int i = 0; i <= kRulerLength; i += 10) {
    write(page, {kPageMargin, zero.y - i - 0.5 * kNumberHeight, width, kNumberHeight},
          std::to_string(i), Align::kRight);
  }
}

// A horizontal run of adjacent black cells.
struct Run {
  int begin, end;
  bool operator==(const Run& other) const { return begin == other.begin && end == other.end; }
};

std::vector<Run> blackRuns(const cv::Mat& cells, int row) {
  std::vector<Run> runs;
  for (int column = 0; column < cells.cols; ++column) {
    if (cells.at<unsigned char>(row, column) != 0) continue;
    if (!runs.empty() && runs.back().end == column) {
      ++runs.back().end;
    } else {
      runs.push_back({column, column + 1});
    }
  }
  return runs;
}

// What the margins leave.
Box printableArea(const Paper& paper) {
  return {kPageMargin, kPageMargin, paper.width - 2 * kPageMargin, paper.height - 2 * kPageMargin};
}

// What the margins and the heading leave.
Box areaBelowHeading(const Paper& paper) {
  const Box whole = printableArea(paper);
  return {whole.x, whole.y + kHeading, whole.width, whole.height - kHeading};
}

// What the margins, the heading and the rulers leave.
Box areaBesideRulers(const Paper& paper) {
  const Box whole = areaBelowHeading(paper);
  return {whole.x + kRulerColumn, whole.y, whole.width - kRulerColumn, whole.height - kFooter};
}

// Adds lines of text from the top of an area down. Returns where the next line would be [mm].
double addLines(const std::vector<std::string>& lines, const Box& area, Page& page) {
  double y = area.y;
  for (const std::string& line : lines) {
    write(page, {area.x, y, area.width, kTextHeight}, line);
    y += kLineHeight;
  }
  return y;
}

// A page with a title and up to two lines of notes.
Page headedPage(const Paper& paper, const std::string& title,
                const std::vector<std::string>& notes) {
  constexpr double kNumberWidth = 30.0, kTitleHeight = 5.5;
  const Box area = printableArea(paper);
  Page page;
  write(page, {area.x, area.y, area.width - kNumberWidth, kTitleHeight}, title, Align::kLeft, true);
  addLines(notes, {area.x, area.y + kTitleHeight + 0.6, area.width, 0}, page);
  return page;
}

// Adds a ruler of 100 mm across and one upright, and notes beside them.
void addRulers(const Paper& paper, const std::vector<std::string>& notes, Page& page) {
  const Box area = areaBesideRulers(paper);
  const Point zero{area.x, area.bottom() + 4.0};
  addAcrossRuler(zero, page);
  addUprightRuler({area.x - 1.5, area.bottom()}, page);
  const double x = zero.x + kRulerLength + 8.0;
  addLines(notes, {x, area.bottom() + 2.0, area.right() - x, 0}, page);
}

std::vector<Point> cornersOf(const Box& box) {
  return {{box.x, box.y}, {box.right(), box.y}, {box.right(), box.bottom()}, {box.x, box.bottom()}};
}

void addOutline(const Box& box, Page& page) {
  const std::vector<Point> corners = cornersOf(box);
  for (int i = 0; i < 4; ++i) page.strokes.push_back({corners[i], corners[(i + 1) % 4], 0.15, 0.4});
}

// A black triangle that points in a direction, about the middle of its height.
// @param angle  counter-clockwise from upwards [rad].
Area upMark(const Point& middle, double size, double angle = 0.0) {
  const auto at = [&](double right, double up) {
    return Point{middle.x + size * (right * std::cos(angle) - up * std::sin(angle)),
                 middle.y - size * (right * std::sin(angle) + up * std::cos(angle))};
  };
  return {{at(0, 0.5), at(0.6, -0.5), at(-0.6, -0.5)}, 0.0};
}

// The black cells of a grid (CV_8UC1, 0 or 255) as few boxes.
// @param corner  top left of the grid.
// @param cell    side of a cell [mm].
std::vector<Box> blackBoxes(const cv::Mat& cells, const Point& corner, double cell) {
  std::vector<Box> black;
  std::vector<Run> above;
  std::vector<std::size_t> boxes_above;
  for (int row = 0; row < cells.rows; ++row) {
    const std::vector<Run> runs = blackRuns(cells, row);
    std::vector<std::size_t> boxes;
    for (const Run& run : runs) {
      std::size_t same = 0;
      while (same < above.size() && !(above[same] == run)) ++same;
      if (same < above.size()) {
        boxes.push_back(boxes_above[same]);
        black[boxes.back()].height += cell;
      } else {
        boxes.push_back(black.size());
        black.push_back({corner.x + run.begin * cell, corner.y + row * cell,
                         (run.end - run.begin) * cell, cell});
      }
    }
    above = runs;
    boxes_above = boxes;
  }
  return black;
}

// A tag of which the detected square has its top left corner and side here. Its card is the tag
// with its white border.
PrintedTag printedTag(const vision::TagFamily& family, int id, const Point& corner, double side) {
  const double cell = side / family.borderCells();
  const double quiet = family.quietCells() * cell;
  const cv::Mat cells = family.cells(id);
  PrintedTag tag{id, {corner.x, corner.y, side, side}, {}, {}};
  tag.card = {corner.x - quiet, corner.y - quiet, cells.cols * cell, cells.rows * cell};
  tag.black = blackBoxes(cells, {tag.card.x, tag.card.y}, cell);
  return tag;
}

// With up to so many decimals, without zeros at its end.
std::string rounded(double value, int digits) {
  std::string out = basics::format("%.*f", digits, value);
  if (digits > 0) {
    out.erase(out.find_last_not_of('0') + 1);
    if (out.back() == '.') out.pop_back();
  }
  return out == "-0" ? "0" : out;
}

std::string millimetres(double length, int digits = 2) { return rounded(length, digits) + " mm"; }

constexpr double kWholeTurn = 2 * basics::kPi;
constexpr double kNames = 32.0;  // on the left, for the names of the actuators
constexpr double kScale = 6.0;   // below, for s
constexpr double kEdge = 7.0;    // beside the first and last s
constexpr double kMostSquare = 9.0, kLeastSquare = 2.5;

// The angle at which the skin is cut open: in the middle of the widest strip without tags or
// actuators, preferably the one before the angle 0.
double cutOf(std::vector<double> angles) {
  constexpr double kClearlyWider = 1e-3;
  std::sort(angles.begin(), angles.end());
  double widest = angles.front() + kWholeTurn - angles.back();
  double cut = angles.front() - 0.5 * widest;
  for (std::size_t i = 1; i < angles.size(); ++i) {
    const double gap = angles[i] - angles[i - 1];
    if (gap <= widest + kClearlyWider) continue;
    widest = gap;
    cut = angles[i] - 0.5 * gap;
  }
  return cut;
}

// Layout of one section on the page.
struct Skin {
  Box field;
  double cut;  // angle at the upper edge [rad]

  Point at(double s, double angle) const {
    double down = std::fmod(angle - cut, kWholeTurn);
    if (down < 0) down += kWholeTurn;
    return {field.x + kEdge + s * (field.width - 2 * kEdge),
            field.y + down / kWholeTurn * field.height};
  }
};

Skin skinOf(const model::Arm& arm, const std::vector<UnrolledTag>& tags, const Box& box) {
  std::vector<double> angles;
  angles.reserve(tags.size());
  for (const UnrolledTag& tag : tags) angles.push_back(tag.angle);
  const int section = tags.front().section;
  for (int i = arm.firstActuator(section); i < arm.firstActuator(section + 1); ++i) {
    angles.push_back(angleAround(arm.actuator(i)));
  }
  return {{box.x + kNames, box.y, box.width - kNames, box.height - kScale}, cutOf(angles)};
}

// Side of the squares: as large as the distances between tags allow.
double squareSide(const std::vector<Point>& centres) {
  constexpr double kShare = 0.9;
  double least = kMostSquare / kShare;
  for (std::size_t i = 0; i < centres.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      least = std::min(least, std::max(std::abs(centres[i].x - centres[j].x),
                                       std::abs(centres[i].y - centres[j].y)));
    }
  }
  return std::max(kShare * least, kLeastSquare);
}

void addActuators(const model::Arm& arm, int section, const Skin& skin, Page& page) {
  const int first = arm.firstActuator(section), end = arm.firstActuator(section + 1);
  const double height = std::min(kTextHeight, 0.9 * skin.field.height / (end - first));
  for (int i = first; i < end; ++i) {
    const double angle = angleAround(arm.actuator(i));
    const double y = skin.at(0, angle).y;
    page.strokes.push_back({{skin.field.x, y}, {skin.field.right(), y}, 0.2, 0.6});
    write(page, {skin.field.x - kNames, y - 0.5 * height, kNames - 2.0, height},
          arm.actuator(i).name + ", " + rounded(angle * 180 / basics::kPi, 1) + " deg",
          Align::kRight);
  }
}

void addScale(double rest_length, const Skin& skin, Page& page) {
  constexpr int kSteps = 4;
  constexpr double kWidth = 25.5;
  const double y = skin.field.bottom() + 1.2;
  for (int i = 0; i <= kSteps; ++i) {
    const double s = static_cast<double>(i) / kSteps, x = skin.at(s, skin.cut).x;
    page.strokes.push_back(
        {{x, skin.field.y}, {x, skin.field.bottom() + 1.0}, 0.1, 0.7, i > 0 && i < kSteps});
    const std::string end = i == 0 ? "base, " : i == kSteps ? "end, " : "";
    const double left = std::min(x - 0.5 * kWidth, skin.field.right() - kWidth);
    write(page, {left, y, kWidth, kTextHeight},
          end + "s " + rounded(s, 2) + ": " + millimetres(1e3 * s * rest_length, 0),
          i == kSteps ? Align::kRight : Align::kCentre);
  }
}

// The white square hides the lines behind it.
void addTag(const UnrolledTag& tag, const Point& centre, double side, Page& page) {
  constexpr double kText = 0.42;  // height of the id, as a share of the side
  constexpr double kEdgeWidth = 0.2;
  const double c = std::cos(tag.turn), s = std::sin(tag.turn);
  const auto at = [&](double right, double up) {
    return Point{centre.x + right * c - up * s, centre.y - right * s - up * c};
  };
  const auto square = [&at](double half) {
    return std::vector<Point>{at(-half, -half), at(half, -half), at(half, half), at(-half, half)};
  };
  page.areas.push_back({square(0.5 * side), 0.0});
  page.areas.push_back({square(0.5 * side - kEdgeWidth), 1.0});
  page.areas.push_back(upMark(at(0, 0.36 * side), 0.16 * side, tag.turn));
  write(page, {centre.x - 0.3 * side, centre.y - 0.5 * kText * side, 0.6 * side, kText * side},
        std::to_string(tag.id), Align::kCentre, true);
}

// Draws a section as if its skin were unrolled and seen from outside: its base on the left, angles
// growing downwards, a line per actuator, a square per tag with its id and up mark.
// @param tags  of this section, at least one.
// @param box   kMapHeight high.
void addUnrolledMap(const model::Arm& arm, const std::vector<UnrolledTag>& tags, const Box& box,
                    Page& page) {
  const Skin skin = skinOf(arm, tags, box);
  const int section = tags.front().section;
  addOutline(skin.field, page);
  addActuators(arm, section, skin, page);
  addScale(arm.restLength(section), skin, page);
  std::vector<Point> centres;
  centres.reserve(tags.size());
  for (const UnrolledTag& tag : tags) centres.push_back(skin.at(tag.s, tag.angle));
  const double side = squareSide(centres);
  for (std::size_t i = 0; i < tags.size(); ++i) addTag(tags[i], centres[i], side, page);
}

struct Column {
  const char* title;
  double share;  // of the page's width
  const char* meaning;
};
constexpr Column kColumns[] = {
    {"id", 0.06, "the number on the tag's strip"},
    {"s", 0.08,
     "place along the section, 0 at its base, 1 at its end: of its centre line and of each muscle"},
    {"from base", 0.12, "the same along the centre line [mm]"},
    {"muscle", 0.2, "the nearest one"},
    {"angle", 0.1,
     "around the centre line, from its y axis (first muscle of a ring) towards z [deg]"},
    {"radius", 0.1, "from the centre line to the middle of the tag [mm]"},
    {"stand-off", 0.11, "from the middle of the muscle to the middle of the tag, outwards [mm]"},
    {"aside", 0.09, "the same towards larger angles [mm]"},
    {"turn", 0.07, "of the up mark from upwards as drawn here, counter-clockwise [deg]"},
    {"tilt", 0.07, "between where the tag faces and outwards [deg]"}};
constexpr double kRowHeight = 4.2;
constexpr double kTitleHeight = 4.6, kSectionGap = 6.0;
constexpr double kMillimetres = 1e3;  // per m

// Without 360, which is 0.
std::string degrees(double angle) {
  const double deg = std::round(angle * 1800 / basics::kPi) / 10;
  return rounded(deg >= 360 ? deg - 360 : deg, 1);
}

std::vector<std::string> rowOf(const model::Arm& arm, const UnrolledTag& tag) {
  return {std::to_string(tag.id),
          rounded(tag.s, 4),
          rounded(kMillimetres * tag.from_base, 1),
          arm.actuator(tag.actuator).name,
          degrees(tag.angle),
          rounded(kMillimetres * tag.radius, 1),
          rounded(kMillimetres * tag.standoff, 1),
          rounded(kMillimetres * tag.aside, 1),
          degrees(tag.turn),
          degrees(tag.tilt)};
}

// Lays out the drawings and tables of placementSheets() from the top down, over as many pages as
// they need.
class PlacementSheet {
 public:
  // @param scene  kept by reference.
  PlacementSheet(const io::Scene& scene, const std::vector<UnrolledTag>& tags, const Paper& paper)
      : scene_(scene), tags_(tags), paper_(paper) {
    beginPage();
    addLegend();
    for (int section = 0; section < scene.arm.sectionCount(); ++section) addSection(section);
  }

  const std::vector<Page>& pages() const { return pages_; }

 private:
  void beginPage() {
    pages_.push_back(headedPage(
        paper_, scene_.name + ": where the tags are mounted",
        {"The arm at rest as if its skin were unrolled, seen from outside. Not to scale."}));
    y_ = areaBelowHeading(paper_).y;
  }

  void addLegend() {
    constexpr double kTerms = 20.0;
    const Box area = printableArea(paper_);
    double y = y_;
    for (const Column& column : kColumns) {
      Page& page = pages_.back();
      write(page, {area.x, y, kTerms, kTextHeight}, column.title, Align::kLeft, true);
      y = addLines({column.meaning}, {area.x + kTerms, y, area.width - kTerms, 0}, page);
    }
    y_ = y + kTextHeight;
  }

  void addSection(int section) {
    std::vector<UnrolledTag> tags;
    std::copy_if(tags_.begin(), tags_.end(), std::back_inserter(tags),
                 [section](const UnrolledTag& tag) { return tag.section == section; });
    if (tags.empty()) return;
    if (roomLeft() < kTitleHeight + kMapHeight + 3 * kRowHeight) beginPage();
    const Box area = printableArea(paper_);
    Page& page = pages_.back();
    write(page, {area.x, y_, area.width, kTitleHeight},
          "Section " + scene_.looks[static_cast<std::size_t>(section)].name + ", " +
              millimetres(kMillimetres * scene_.arm.restLength(section), 1) + " long at rest",
          Align::kLeft, true);
    y_ += kTitleHeight + 1.0;
    addUnrolledMap(scene_.arm, tags, {area.x, y_, area.width, kMapHeight}, page);
    y_ += kMapHeight + 1.0;
    addTable(tags);
    y_ += kSectionGap;
  }

  void addTable(const std::vector<UnrolledTag>& tags) {
    std::vector<std::string> titles;
    for (const Column& column : kColumns) titles.emplace_back(column.title);
    bool begun = false;
    for (const UnrolledTag& tag : tags) {
      if (roomLeft() < 2 * kRowHeight) {
        beginPage();
        begun = false;
      }
      if (!begun) addRow(titles, true);
      begun = true;
      addRow(rowOf(scene_.arm, tag), false);
    }
  }

  void addRow(const std::vector<std::string>& cells, bool bold) {
    constexpr double kPad = 1.0;
    const Box area = printableArea(paper_);
    double x = area.x;
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const double width = kColumns[i].share * area.width;
      write(pages_.back(), {x, y_, width - kPad, kTextHeight}, cells[i], Align::kRight, bold);
      x += width;
    }
    y_ += kRowHeight;
    pages_.back().strokes.push_back(
        {{area.x, y_ - 0.5}, {area.right(), y_ - 0.5}, 0.1, bold ? 0.0 : 0.8});
  }

  // Below what is there already [mm].
  double roomLeft() const { return printableArea(paper_).bottom() - y_; }

  const io::Scene& scene_;
  std::vector<UnrolledTag> tags_;
  Paper paper_;
  std::vector<Page> pages_;
  double y_ = 0.0;  // where the next part begins [mm]
};

constexpr double kGap = 3.0;          // between cards
constexpr double kRim = 1.5;          // around its tag: room for marks, and for inaccurate cuts
constexpr double kMark = 1.0;         // size of the marks in it
constexpr double kStrip = 5.0;        // below the card, for its text
constexpr double kLeastBit = 0.5;     // of a marker: 2 pixels of a usual webcam at 0.25 m
constexpr double kMillimetre = 1e-3;  // [m]

// Grid of cards on a page.
struct CardGrid {
  double side;  // of a tag's square
  double card;  // side of the card, without its strip
  int columns, rows;
};

const estimation::TagLayout& tagsOf(const io::Scene& scene) {
  basics::require(scene.tags.has_value() && !scene.tags->tags.empty(), "scene ", scene.name,
                  " has no tags; expected a scene with a section tags");
  return *scene.tags;
}

CardGrid gridOf(double tag_size, const vision::TagFamily& family, const Paper& paper) {
  const Box area = areaBesideRulers(paper);
  const double cells = family.borderCells() + 2.0 * family.quietCells();
  const double side = tag_size / kMillimetre;
  const double card = side / family.borderCells() * cells + 2 * kRim;
  const double most = std::min(area.width, area.height - kStrip);
  basics::require(
      card <= most, "tags.size_m is ", io::formatNumber(tag_size), ": with its border a ",
      family.name(), " tag is ", rounded(card, 1), " mm wide, but ", paper.name, " has room for ",
      rounded(most, 1), " mm; expected at most ",
      rounded(std::floor((most - 2 * kRim) / cells * family.borderCells()) * kMillimetre, 3),
      " m. Print smaller tags");
  return {side, card, static_cast<int>((area.width + kGap) / (card + kGap)),
          static_cast<int>((area.height + kGap) / (card + kStrip + kGap))};
}

// Marks in the middle of the card's sides: a triangle at the top, lines elsewhere.
void addCentreMarks(const Box& card, Page& page) {
  const double x = card.x + 0.5 * card.width, y = card.y + 0.5 * card.height;
  page.areas.push_back(upMark({x, card.y + 0.2 + 0.5 * kMark}, kMark));
  page.strokes.push_back({{card.x, y}, {card.x + kMark, y}});
  page.strokes.push_back({{card.right() - kMark, y}, {card.right(), y}});
  page.strokes.push_back({{x, card.bottom() - kMark}, {x, card.bottom()}});
}

// The id and the place on the arm, below the dashed line.
void addStrip(const Box& card, const std::string& id, const std::string& place, Page& page) {
  constexpr double kPad = 0.8, kIdShare = 0.25;
  page.strokes.push_back({{card.x, card.bottom()}, {card.right(), card.bottom()}, 0.15, 0.4, true});
  const double width = card.width - 3 * kPad, height = kStrip - 2 * kPad;
  const Box id_box{card.x + kPad, card.bottom() + kPad, kIdShare * width, height};
  write(page, id_box, id, Align::kLeft, true);
  write(page, {id_box.right() + kPad, id_box.y + 0.3, (1 - kIdShare) * width, height - 0.6}, place,
        Align::kRight);
}

void addCard(const vision::TagFamily& family, const CardGrid& grid, const Point& corner, int id,
             const std::string& place, Page& page) {
  const double inset = 0.5 * (grid.card - grid.side);
  PrintedTag tag = printedTag(family, id, {corner.x + inset, corner.y + inset}, grid.side);
  const Box square{corner.x, corner.y, grid.card, grid.card};
  tag.card = {corner.x, corner.y, grid.card, grid.card + kStrip};
  page.tags.push_back(tag);
  addOutline(tag.card, page);
  addCentreMarks(square, page);
  addStrip(square, std::to_string(id), place, page);
}

Page emptySheet(const io::Scene& scene, const CardGrid& grid, const Paper& paper) {
  Page page = headedPage(
      paper,
      scene.name + ": tags " + scene.vision.detector.family + " of " + millimetres(grid.side),
      {"Print at 100 % (\"actual size\"), on matt paper. Check both rulers, then cut along the "
       "solid lines.",
       "The triangle marks the upper edge, the lines the middle of the other edges. Fold the strip "
       "back or cut it off."});
  addRulers(paper,
            {"Both rulers must be 100 mm long on paper. If not,",
             "print again without scaling; or measure the tags and",
             "give their size as tags.size_m in the scene."},
            page);
  return page;
}

// Where a board lies on the paper: in the middle of what the rulers leave [mm].
Box boardPlace(double width, double height, const Paper& paper) {
  const Box area = areaBesideRulers(paper);
  basics::require(width <= area.width && height <= area.height, "a board of ", rounded(width, 1),
                  " x ", rounded(height, 1), " mm; expected at most ", rounded(area.width, 1),
                  " x ", rounded(area.height, 1), " mm, the printable area of ", paper.name);
  return {area.x + 0.5 * (area.width - width), area.y + 0.5 * (area.height - height), width,
          height};
}

Page boardPage(const Paper& paper, const std::string& title, const std::string& note) {
  Page page = headedPage(paper, title,
                         {"Print at 100 % (\"actual size\"), on matt paper. Glue it onto something "
                          "flat and stiff:",
                          note});
  addRulers(paper,
            {"Both rulers must be 100 mm long on paper.", "If not, print again without scaling."},
            page);
  return page;
}

}  // namespace

std::vector<Page> tagSheets(const io::Scene& scene, const Paper& paper) {
  const estimation::TagLayout& layout = tagsOf(scene);
  const vision::TagFamily family(scene.vision.detector.family);
  const CardGrid grid = gridOf(layout.size, family, paper);
  const Box area = areaBesideRulers(paper);
  const std::vector<UnrolledTag> places = unrolled(scene.arm, layout);
  std::vector<Page> pages;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const int cell = static_cast<int>(i) % (grid.columns * grid.rows);
    if (cell == 0) pages.push_back(emptySheet(scene, grid, paper));
    const UnrolledTag& tag = places[i];
    const int column = cell % grid.columns, row = cell / grid.columns;
    const Point corner{area.x + column * (grid.card + kGap),
                       area.y + row * (grid.card + kStrip + kGap)};
    const std::string section = scene.arm.sectionCount() > 1
                                    ? scene.looks[static_cast<std::size_t>(tag.section)].name + ", "
                                    : "";
    addCard(family, grid, corner, tag.id,
            section + scene.arm.actuator(tag.actuator).name + ", s " + rounded(tag.s, 4),
            pages.back());
  }
  return pages;
}

std::vector<Page> placementSheets(const io::Scene& scene, const Paper& paper) {
  PlacementSheet sheet(scene, unrolled(scene.arm, tagsOf(scene)), paper);
  return sheet.pages();
}

Page boardSheet(const vision::TagBoard& board, const Paper& paper) {
  const vision::TagFamily family(board.family);
  const double side = board.tag_size / kMillimetre, pitch = board.pitch / kMillimetre;
  const double quiet = side / family.borderCells() * family.quietCells();
  const Box place = boardPlace(board.width() / kMillimetre + 2 * quiet,
                               board.height() / kMillimetre + 2 * quiet, paper);
  Page page = boardPage(paper,
                        "Calibration board: " + board.family + ", " +
                            std::to_string(board.columns) + " x " + std::to_string(board.rows) +
                            " tags of " + millimetres(side) + ", every " + millimetres(pitch),
                        "a board that bends spoils the calibration. Its tags are " +
                            std::to_string(board.first_id) + " to " +
                            std::to_string(board.first_id + board.count() - 1) + ".");
  for (int i = 0; i < board.count(); ++i) {
    const int column = i % board.columns, row = i / board.columns;
    const Point corner{place.x + quiet + column * pitch, place.y + quiet + row * pitch};
    page.tags.push_back(printedTag(family, board.first_id + i, corner, side));
  }
  return page;
}

Page boardSheet(const vision::CharucoBoard& board, const Paper& paper) {
  const double square = board.square_size / kMillimetre, side = board.marker_size / kMillimetre;
  const double inset = 0.5 * (square - side);
  const double bit = board.bitSize() / kMillimetre;
  basics::require(bit >= kLeastBit, "a marker ", board.dictionary, " of ", rounded(side, 2),
                  " mm has bits of ", rounded(bit, 2), " mm; expected ", rounded(kLeastBit, 1),
                  " mm or more, so that printer and camera resolve them. Choose larger markers "
                  "(--marker-size-m, --square-size-m), or a dictionary with fewer bits");
  const Box place = boardPlace(board.columns * square, board.rows * square, paper);
  Page page = boardPage(
      paper,
      "ChArUco board: " + board.dictionary + ", " + std::to_string(board.columns) + " x " +
          std::to_string(board.rows) + " squares of " + millimetres(square) + ", markers of " +
          millimetres(side),
      "a board that bends spoils the calibration. Read it with helix_arm camera calibrate --board "
      "charuco and the options it was printed with.");
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      const Box box{place.x + column * square, place.y + row * square, square, square};
      if (!board.isWhite(column, row)) {
        page.areas.push_back({cornersOf(box), 0.0});
        continue;
      }
      const int id = board.markerIn(column, row);
      const cv::Mat cells = vision::markerCells(board.dictionary, id);
      const Point corner{box.x + inset, box.y + inset};
      page.tags.push_back({id,
                           {corner.x, corner.y, side, side},
                           box,
                           blackBoxes(cells, corner, side / cells.cols)});
    }
  }
  return page;
}

void numberPages(const Paper& paper, std::vector<Page>& pages) {
  constexpr double kWidth = 28.0;
  const Box area = printableArea(paper);
  for (std::size_t i = 0; i < pages.size(); ++i) {
    write(pages[i], {area.right() - kWidth, area.y + 0.6, kWidth, kTextHeight},
          "page " + std::to_string(i + 1) + " of " + std::to_string(pages.size()), Align::kRight);
  }
}

}  // namespace helix_arm::procedures
