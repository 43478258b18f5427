#include "tag_pattern.hpp"

#include <algorithm>
#include <limits>
#include <utility>

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

}  // namespace helix_arm::simulation
