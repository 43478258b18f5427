#include "page_parts.hpp"

#include <cmath>
#include <cstdio>

#include "helix_arm/basics/pi.hpp"

namespace helix_arm::procedures {
namespace {

constexpr double kHeading = 15.0, kFooter = 13.0;
constexpr double kRulerColumn = 11.0;  // width of the ruler on the left
constexpr int kRulerLength = 100;
constexpr double kNumberHeight = 2.6;

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
    page.labels.push_back({{zero.x + i - half, y, 2 * half, kNumberHeight},
                           std::to_string(i) + (last ? " mm" : ""),
                           Align::kCentre});
  }
}

void addUprightRuler(const Point& zero, Page& page) {
  addRuler(zero, {0, -1}, {-1, 0}, page);
  const double width = zero.x - tickLength(0) - 0.3 - kPageMargin;
  for (int i = 0; i <= kRulerLength; i += 10) {
    page.labels.push_back({{kPageMargin, zero.y - i - 0.5 * kNumberHeight, width, kNumberHeight},
                           std::to_string(i),
                           Align::kRight});
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

}  // namespace

Box printableArea(const Paper& paper) {
  return {kPageMargin, kPageMargin, paper.width - 2 * kPageMargin, paper.height - 2 * kPageMargin};
}

Box areaBelowHeading(const Paper& paper) {
  const Box whole = printableArea(paper);
  return {whole.x, whole.y + kHeading, whole.width, whole.height - kHeading};
}

Box areaBesideRulers(const Paper& paper) {
  const Box whole = areaBelowHeading(paper);
  return {whole.x + kRulerColumn, whole.y, whole.width - kRulerColumn, whole.height - kFooter};
}

Page headedPage(const Paper& paper, const std::string& title,
                const std::vector<std::string>& notes) {
  constexpr double kNumberWidth = 30.0, kTitleHeight = 5.5;
  const Box area = printableArea(paper);
  Page page;
  page.labels.push_back(
      {{area.x, area.y, area.width - kNumberWidth, kTitleHeight}, title, Align::kLeft, true});
  addLines(notes, {area.x, area.y + kTitleHeight + 0.6, area.width, 0}, page);
  return page;
}

double addLines(const std::vector<std::string>& lines, const Box& area, Page& page) {
  double y = area.y;
  for (const std::string& line : lines) {
    page.labels.push_back({{area.x, y, area.width, kTextHeight}, line});
    y += kLineHeight;
  }
  return y;
}

void addRulers(const Paper& paper, const std::vector<std::string>& notes, Page& page) {
  const Box area = areaBesideRulers(paper);
  const Point zero{area.x, area.bottom() + 4.0};
  addAcrossRuler(zero, page);
  addUprightRuler({area.x - 1.5, area.bottom()}, page);
  const double x = zero.x + kRulerLength + 8.0;
  addLines(notes, {x, area.bottom() + 2.0, area.right() - x, 0}, page);
}

void addOutline(const Box& box, Page& page) {
  const Point corners[] = {
      {box.x, box.y}, {box.right(), box.y}, {box.right(), box.bottom()}, {box.x, box.bottom()}};
  for (int i = 0; i < 4; ++i) page.strokes.push_back({corners[i], corners[(i + 1) % 4], 0.15, 0.4});
}

Area upMark(const Point& middle, double size, double angle) {
  const auto at = [&](double right, double up) {
    return Point{middle.x + size * (right * std::cos(angle) - up * std::sin(angle)),
                 middle.y - size * (right * std::sin(angle) + up * std::cos(angle))};
  };
  return {{at(0, 0.5), at(0.6, -0.5), at(-0.6, -0.5)}, 0.0};
}

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

PrintedTag printedTag(const vision::TagFamily& family, int id, const Point& corner, double side) {
  const double cell = side / family.borderCells();
  const double quiet = family.quietCells() * cell;
  const cv::Mat cells = family.cells(id);
  PrintedTag tag{id, {corner.x, corner.y, side, side}, {}, {}};
  tag.card = {corner.x - quiet, corner.y - quiet, cells.cols * cell, cells.rows * cell};
  tag.black = blackBoxes(cells, {tag.card.x, tag.card.y}, cell);
  return tag;
}

std::string rounded(double value, int digits) {
  char text[32];
  const int size = std::snprintf(text, sizeof text, "%.*f", digits, value);
  std::string out(text, static_cast<std::size_t>(size));
  if (digits > 0) {
    out.erase(out.find_last_not_of('0') + 1);
    if (out.back() == '.') out.pop_back();
  }
  return out == "-0" ? "0" : out;
}

std::string millimetres(double length, int digits) { return rounded(length, digits) + " mm"; }

}  // namespace helix_arm::procedures
