#include "placement_sheet.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "helix_arm/basics/pi.hpp"
#include "page_parts.hpp"
#include "unrolled_map.hpp"

namespace helix_arm::procedures {
namespace {

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

}  // namespace

PlacementSheet::PlacementSheet(const io::Scene& scene, const std::vector<UnrolledTag>& tags,
                               const Paper& paper)
    : scene_(scene), tags_(tags), paper_(paper) {
  beginPage();
  addLegend();
  for (int section = 0; section < scene.arm.sectionCount(); ++section) addSection(section);
}

void PlacementSheet::beginPage() {
  pages_.push_back(headedPage(
      paper_, scene_.name + ": where the tags are mounted",
      {"The arm at rest as if its skin were unrolled, seen from outside. Not to scale."}));
  y_ = areaBelowHeading(paper_).y;
}

double PlacementSheet::roomLeft() const { return printableArea(paper_).bottom() - y_; }

void PlacementSheet::addLegend() {
  constexpr double kTerms = 20.0;
  const Box area = printableArea(paper_);
  double y = y_;
  for (const Column& column : kColumns) {
    Page& page = pages_.back();
    page.labels.push_back({{area.x, y, kTerms, kTextHeight}, column.title, Align::kLeft, true});
    y = addLines({column.meaning}, {area.x + kTerms, y, area.width - kTerms, 0}, page);
  }
  y_ = y + kTextHeight;
}

void PlacementSheet::addSection(int section) {
  std::vector<UnrolledTag> tags;
  std::copy_if(tags_.begin(), tags_.end(), std::back_inserter(tags),
               [section](const UnrolledTag& tag) { return tag.section == section; });
  if (tags.empty()) return;
  if (roomLeft() < kTitleHeight + kMapHeight + 3 * kRowHeight) beginPage();
  const Box area = printableArea(paper_);
  Page& page = pages_.back();
  page.labels.push_back({{area.x, y_, area.width, kTitleHeight},
                         "Section " + scene_.looks[static_cast<std::size_t>(section)].name + ", " +
                             millimetres(kMillimetres * scene_.arm.restLength(section), 1) +
                             " long at rest",
                         Align::kLeft,
                         true});
  y_ += kTitleHeight + 1.0;
  addUnrolledMap(scene_.arm, tags, {area.x, y_, area.width, kMapHeight}, page);
  y_ += kMapHeight + 1.0;
  addTable(tags);
  y_ += kSectionGap;
}

void PlacementSheet::addTable(const std::vector<UnrolledTag>& tags) {
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

void PlacementSheet::addRow(const std::vector<std::string>& cells, bool bold) {
  constexpr double kPad = 1.0;
  const Box area = printableArea(paper_);
  double x = area.x;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const double width = kColumns[i].share * area.width;
    pages_.back().labels.push_back(
        {{x, y_, width - kPad, kTextHeight}, cells[i], Align::kRight, bold});
    x += width;
  }
  y_ += kRowHeight;
  pages_.back().strokes.push_back(
      {{area.x, y_ - 0.5}, {area.right(), y_ - 0.5}, 0.1, bold ? 0.0 : 0.8});
}

}  // namespace helix_arm::procedures
