#include "helix_arm/procedures/tag_sheets.hpp"

#include <algorithm>
#include <cmath>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/procedures/unrolled_tags.hpp"
#include "helix_arm/vision/tag_family.hpp"
#include "page_parts.hpp"
#include "placement_sheet.hpp"

namespace helix_arm::procedures {
namespace {

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
  page.labels.push_back({id_box, id, Align::kLeft, true});
  page.labels.push_back(
      {{id_box.right() + kPad, id_box.y + 0.3, (1 - kIdShare) * width, height - 0.6},
       place,
       Align::kRight});
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
        page.areas.push_back({{{box.x, box.y},
                               {box.right(), box.y},
                               {box.right(), box.bottom()},
                               {box.x, box.bottom()}},
                              0.0});
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
    pages[i].labels.push_back(
        {{area.right() - kWidth, area.y + 0.6, kWidth, kTextHeight},
         "page " + std::to_string(i + 1) + " of " + std::to_string(pages.size()),
         Align::kRight});
  }
}

}  // namespace helix_arm::procedures
