#include "unrolled_map.hpp"

#include <algorithm>
#include <cmath>

#include "helix_arm/basics/pi.hpp"
#include "page_parts.hpp"

namespace helix_arm::procedures {
namespace {

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
    page.labels.push_back(
        {{skin.field.x - kNames, y - 0.5 * height, kNames - 2.0, height},
         arm.actuator(i).name + ", " + rounded(angle * 180 / basics::kPi, 1) + " deg",
         Align::kRight});
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
    page.labels.push_back(
        {{left, y, kWidth, kTextHeight},
         end + "s " + rounded(s, 2) + ": " + millimetres(1e3 * s * rest_length, 0),
         i == kSteps ? Align::kRight : Align::kCentre});
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
  page.labels.push_back(
      {{centre.x - 0.3 * side, centre.y - 0.5 * kText * side, 0.6 * side, kText * side},
       std::to_string(tag.id),
       Align::kCentre,
       true});
}

}  // namespace

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

}  // namespace helix_arm::procedures
