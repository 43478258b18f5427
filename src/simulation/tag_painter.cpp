#include "tag_painter.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::simulation {
namespace {

constexpr double kOutside = 1e4;  // beyond all points in use [units]

// The cells that a strip between two lines overlaps.
struct Strip {
  int first, last;
};

// A strip around every line between cells, as wide as the bleed on both sides, is white if either
// cell is. The outermost strips are the surroundings of the card.
struct Strips {
  std::vector<Strip> cells;
  std::vector<double> lines;  // where they begin and end
};

Strips stripsOf(const std::vector<double>& widths, double bleed) {
  Strips strips{{{-1, -1}}, {-kOutside, 0.0}};
  const int size = static_cast<int>(widths.size());
  double line = 0;
  for (int i = 0; i < size; ++i) {
    line += widths[static_cast<std::size_t>(i)];
    strips.cells.push_back({i, i});
    if (i + 1 == size) break;
    if (bleed > 0) {
      strips.lines.push_back(line - bleed);
      strips.cells.push_back({i, i + 1});
    }
    strips.lines.push_back(line + bleed);
  }
  strips.cells.push_back({-1, -1});
  strips.lines.push_back(line);
  strips.lines.push_back(kOutside);
  return strips;
}

}  // namespace

TagPattern::Areas& TagPattern::Areas::operator+=(const Areas& other) {
  white += other.white;
  card += other.card;
  whole += other.whole;
  return *this;
}

TagPattern::Areas& TagPattern::Areas::operator-=(const Areas& other) {
  white -= other.white;
  card -= other.card;
  whole -= other.whole;
  return *this;
}

TagPattern::TagPattern(const CardPrint& print, double bleed) {
  Strips across = stripsOf(print.across, bleed), down = stripsOf(print.down, bleed);
  across_ = std::move(across.lines);
  down_ = std::move(down.lines);
  columns_ = across.cells.size();
  const cv::Mat& cells = print.cells;
  rectangles_.reserve(down.cells.size() * columns_);
  for (const Strip& row : down.cells) {
    double white_before = 0, card_before = 0;
    for (std::size_t column = 0; column < columns_; ++column) {
      const Strip& here = across.cells[column];
      const bool card = here.first >= 0 && row.first >= 0;
      const bool white = card && (cells.at<uchar>(row.first, here.first) != 0 ||
                                  cells.at<uchar>(row.first, here.last) != 0 ||
                                  cells.at<uchar>(row.last, here.first) != 0 ||
                                  cells.at<uchar>(row.last, here.last) != 0);
      rectangles_.push_back({white ? 1.0 : 0.0, card ? 1.0 : 0.0, white_before, card_before});
      const double width = across_[column + 1] - across_[column];
      if (white) white_before += width;
      if (card) card_before += width;
    }
  }
}

TagPattern::Point TagPattern::at(double x, double y, const Point& hint) const {
  const auto find = [](const std::vector<double>& lines, double value, int i) {
    while (value < lines[i]) --i;
    while (value >= lines[i + 1]) ++i;
    return i;
  };
  return {x, y, find(across_, x, hint.column), find(down_, y, hint.row)};
}

// By Green's theorem, an area is the integral of x dy around it; its white part is the integral of
// the white width to the left of the contour. Both are linear in x within a rectangle, so the
// midpoint of each piece of the line gives its integral.
TagPattern::Areas TagPattern::along(const Point& a, const Point& b) const {
  const double dx = b.x - a.x, dy = b.y - a.y;
  Areas areas;
  areas.whole = 0.5 * (a.x + b.x) * dy;
  const auto crossing = [](const std::vector<double>& lines, double from, double step, int i) {
    if (step > 0) return (lines[i + 1] - from) / step;
    if (step < 0) return (lines[i] - from) / step;
    return std::numeric_limits<double>::infinity();
  };
  int column = a.column, row = a.row;
  for (double begin = 0.0;;) {
    double end = 1.0;
    bool sideways = false;
    if (column != b.column || row != b.row) {
      const double across = crossing(across_, a.x, dx, column);
      const double down = crossing(down_, a.y, dy, row);
      sideways = across <= down;
      end = std::min(1.0, sideways ? across : down);
    }
    const Rectangle& here = rectangles_[static_cast<std::size_t>(row) * columns_ + column];
    const double into = a.x + 0.5 * (begin + end) * dx - across_[column];
    const double height = (end - begin) * dy;
    areas.white += (here.white_before + here.white * into) * height;
    areas.card += (here.card_before + here.card * into) * height;
    if (!(end < 1.0)) return areas;
    begin = end;
    if (sideways) {
      column += dx > 0 ? 1 : -1;
    } else {
      row += dy > 0 ? 1 : -1;
    }
  }
}

namespace {

using Areas = TagPattern::Areas;

// Gray levels of paper and ink in full light.
constexpr double kWhite = 222, kBlack = 34;
// Light on a face that is turned away from the camera, which carries the light source.
constexpr double kAmbientLight = 0.65;
constexpr double kMostUnits = 1e3;      // from a card's corner to a pixel that may show it
constexpr int kOutlinePoints = 8;       // per side of a card, which distortion bends
constexpr double kOutlineMargin = 2.0;  // error of the outline between these points [px]

cv::Mat directionsAtPixelCorners(const estimation::Camera& camera) {
  cv::Mat out(camera.height + 1, camera.width + 1, CV_32FC2);
  const float unseen = std::numeric_limits<float>::quiet_NaN();
  for (int y = 0; y < out.rows; ++y) {
    auto* row = out.ptr<cv::Vec2f>(y);
    for (int x = 0; x < out.cols; ++x) {
      const auto direction = camera.directionOf({x - 0.5, y - 0.5});
      row[x] = direction ? cv::Vec2f(static_cast<float>(direction->x()),
                                     static_cast<float>(direction->y()))
                         : cv::Vec2f(unseen, unseen);
    }
  }
  return out;
}

// Paints the mean of the card over a pixel; if the card covers it only in part, mixes it with the
// background.
void paintPixel(const Areas& areas, double light, uchar& pixel) {
  if (areas.whole == 0) return;
  const double card = std::clamp(areas.card / areas.whole, 0.0, 1.0);
  const double white = std::clamp(areas.white / areas.whole, 0.0, card);
  const double gray = light * (kWhite * white + kBlack * (card - white)) + (1 - card) * pixel;
  pixel = static_cast<uchar>(gray + 0.5);
}

}  // namespace

TagPainter::TagPainter(const estimation::Camera& camera, const std::vector<CardPrint>& prints,
                       double bleed)
    : camera_(camera), directions_(directionsAtPixelCorners(camera)) {
  for (const CardPrint& print : prints) {
    const double least = std::min(*std::min_element(print.across.begin(), print.across.end()),
                                  *std::min_element(print.down.begin(), print.down.end()));
    basics::requireValue(bleed < 0.5 * least * print.unit, kSimulatedCamera, "the bleed [m]", bleed,
                         "less than half a cell of what is printed");
    cards_.push_back(
        {TagPattern(print, bleed / print.unit), print.unit, print.width(), print.height()});
  }
}

cv::Rect TagPainter::boxOf(const Card& card, const lie::SE3& X_CT) const {
  const cv::Rect whole(0, 0, camera_.width, camera_.height);
  const Eigen::Vector3d half(0.5 * card.width * card.unit, 0.5 * card.height * card.unit, 0);
  Eigen::Vector2d least = Eigen::Vector2d::Constant(kFarOff), most = -least;
  for (int i = 0; i < 4 * kOutlinePoints; ++i) {
    const double along = 2.0 * (i % kOutlinePoints) / kOutlinePoints - 1;
    const Eigen::Vector3d side[] = {{along, -1, 0}, {1, along, 0}, {-along, 1, 0}, {-1, -along, 0}};
    const auto pixel = camera_.project(X_CT * half.cwiseProduct(side[i / kOutlinePoints]));
    if (!pixel) return whole;  // it extends beyond what the camera can see
    least = least.cwiseMin(*pixel);
    most = most.cwiseMax(*pixel);
  }
  least = (least.array() - kOutlineMargin).max(-1.0);
  most = (most.array() + kOutlineMargin).min(kFarOff);
  if (!(least.x() < whole.width && least.y() < whole.height && most.x() >= 0 && most.y() >= 0)) {
    return {};
  }
  const cv::Point first(static_cast<int>(std::floor(least.x())),
                        static_cast<int>(std::floor(least.y())));
  const cv::Point last(static_cast<int>(std::ceil(most.x())),
                       static_cast<int>(std::ceil(most.y())));
  return cv::Rect(first, last + cv::Point(1, 1)) & whole;
}

void TagPainter::lookThrough(int y, const cv::Rect& box, const Eigen::Matrix3d& units_of_direction,
                             const TagPattern& pattern, std::vector<PlanePoint>& out) const {
  const auto* direction = directions_.ptr<cv::Vec2f>(y) + box.x;
  TagPattern::Point hint{};
  for (int i = 0; i <= box.width; ++i) {
    const Eigen::Vector3d h =
        units_of_direction * Eigen::Vector3d(direction[i][0], direction[i][1], 1.0);
    const double reach = kMostUnits * h.z();  // negative behind the camera
    out[i].valid = std::abs(h.x()) < reach && std::abs(h.y()) < reach;
    if (!out[i].valid) continue;
    hint = pattern.at(h.x() / h.z(), h.y() / h.z(), hint);
    out[i].point = hint;
  }
}

// The corners of every pixel are projected onto the card's plane, and the quadrangle between them
// is integrated exactly. Pixels tile the plane, so edges are not displaced and no area is lost;
// each line between two pixels is integrated once.
void TagPainter::draw(int number, const lie::SE3& X_CT, cv::Mat& picture) {
  const Card& card = cards_[static_cast<std::size_t>(number)];
  const TagPattern& pattern = card.pattern;
  const cv::Rect box = boxOf(card, X_CT);
  if (box.empty()) return;

  Eigen::Matrix3d direction_of_units;
  direction_of_units.col(0) = card.unit * X_CT.rotation.col(0);
  direction_of_units.col(1) = -card.unit * X_CT.rotation.col(1);  // rows run downwards
  direction_of_units.col(2) =
      X_CT.translation -
      0.5 * card.width *
          (direction_of_units.col(0) + card.height / card.width * direction_of_units.col(1)).eval();
  const Eigen::Matrix3d units_of_direction = direction_of_units.inverse();
  const double facing = -X_CT.rotation.col(2).dot(X_CT.translation) / X_CT.translation.norm();
  const double light = kAmbientLight + (1 - kAmbientLight) * facing;

  const auto lineBetween = [&pattern](const PlanePoint& a, const PlanePoint& b) {
    return a.valid && b.valid ? pattern.along(a.point, b.point) : Areas{};
  };
  const std::size_t corners = static_cast<std::size_t>(box.width) + 1;
  for (auto* points : {&above_, &below_}) points->resize(std::max(points->size(), corners));
  for (auto* lines : {&lines_above_, &lines_below_})
    lines->resize(std::max(lines->size(), corners));

  for (int y = box.y; y <= box.y + box.height; ++y) {
    lookThrough(y, box, units_of_direction, pattern, below_);
    for (int i = 0; i < box.width; ++i) lines_below_[i] = lineBetween(below_[i], below_[i + 1]);
    if (y > box.y) {
      uchar* row = picture.ptr<uchar>(y - 1) + box.x;
      Areas left = lineBetween(above_[0], below_[0]);
      for (int i = 0; i < box.width; ++i) {
        const Areas right = lineBetween(above_[i + 1], below_[i + 1]);
        if (above_[i].valid && above_[i + 1].valid && below_[i].valid && below_[i + 1].valid) {
          Areas areas = lines_above_[i];
          areas += right;
          areas -= lines_below_[i];
          areas -= left;
          paintPixel(areas, light, row[i]);
        }
        left = right;
      }
    }
    std::swap(above_, below_);
    std::swap(lines_above_, lines_below_);
  }
}

}  // namespace helix_arm::simulation
