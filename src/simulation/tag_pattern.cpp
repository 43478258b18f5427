#include "tag_pattern.hpp"

#include <algorithm>
#include <limits>

namespace helix_arm::simulation {
namespace {

constexpr double kOutside = 1e4;  // beyond all points in use [cells]

// The cells that a strip between two lines overlaps.
struct Strip {
  int first, last;
};

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

TagPattern::TagPattern(const cv::Mat& cells, double bleed) {
  // A strip around every line between cells, as wide as the bleed on both sides, is white if either
  // cell is. The outermost strips are the surroundings of the card.
  const int size = cells.rows;
  std::vector<Strip> strips{{-1, -1}};
  lines_ = {-kOutside, 0.0};
  for (int i = 0; i < size; ++i) {
    strips.push_back({i, i});
    if (i + 1 == size) break;
    if (bleed > 0) {
      lines_.push_back(i + 1 - bleed);
      strips.push_back({i, i + 1});
    }
    lines_.push_back(i + 1 + bleed);
  }
  strips.push_back({-1, -1});
  lines_.push_back(size);
  lines_.push_back(kOutside);

  count_ = static_cast<int>(strips.size());
  rectangles_.reserve(static_cast<std::size_t>(count_) * count_);
  for (const Strip& down : strips) {
    double white_before = 0, card_before = 0;
    for (int column = 0; column < count_; ++column) {
      const Strip& across = strips[column];
      const bool card = across.first >= 0 && down.first >= 0;
      const bool white = card && (cells.at<uchar>(down.first, across.first) != 0 ||
                                  cells.at<uchar>(down.first, across.last) != 0 ||
                                  cells.at<uchar>(down.last, across.first) != 0 ||
                                  cells.at<uchar>(down.last, across.last) != 0);
      rectangles_.push_back({white ? 1.0 : 0.0, card ? 1.0 : 0.0, white_before, card_before});
      const double width = lines_[column + 1] - lines_[column];
      if (white) white_before += width;
      if (card) card_before += width;
    }
  }
}

TagPattern::Point TagPattern::at(double x, double y, const Point& hint) const {
  const auto find = [this](double value, int i) {
    while (value < lines_[i]) --i;
    while (value >= lines_[i + 1]) ++i;
    return i;
  };
  return {x, y, find(x, hint.column), find(y, hint.row)};
}

// By Green's theorem, an area is the integral of x dy around it; its white part is the integral of
// the white width to the left of the contour. Both are linear in x within a rectangle, so the
// midpoint of each piece of the line gives its integral.
TagPattern::Areas TagPattern::along(const Point& a, const Point& b) const {
  const double dx = b.x - a.x, dy = b.y - a.y;
  Areas areas;
  areas.whole = 0.5 * (a.x + b.x) * dy;
  const auto crossing = [this](double from, double step, int i) {
    if (step > 0) return (lines_[i + 1] - from) / step;
    if (step < 0) return (lines_[i] - from) / step;
    return std::numeric_limits<double>::infinity();
  };
  int column = a.column, row = a.row;
  for (double begin = 0.0;;) {
    double end = 1.0;
    bool sideways = false;
    if (column != b.column || row != b.row) {
      const double across = crossing(a.x, dx, column), down = crossing(a.y, dy, row);
      sideways = across <= down;
      end = std::min(1.0, sideways ? across : down);
    }
    const Rectangle& here = rectangles_[static_cast<std::size_t>(row) * count_ + column];
    const double into = a.x + 0.5 * (begin + end) * dx - lines_[column];
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
