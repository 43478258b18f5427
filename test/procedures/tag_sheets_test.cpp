#include "helix_arm/procedures/tag_sheets.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include <gtest/gtest.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/vision/tag_detector.hpp"
#include "support/refusal.hpp"
#include "support/scene_text.hpp"

namespace helix_arm::procedures {
namespace {

constexpr double kRounding = 1e-9;  // [mm]

io::Scene shipped(const std::string& name) {
  return io::loadScene(std::string(HELIX_ARM_SOURCE_DIR) + "/config/scenes/" + name + ".yaml");
}

// The demo's arm with so many tags of a size [m], spread over its muscles.
io::Scene crowded(int tags, double size, const std::string& family = "36h11") {
  io::Scene scene = shipped("demo");
  const estimation::TagLayout shipped_tags = *scene.tags;
  scene.vision.detector.family = family;
  scene.tags->size = size;
  scene.tags->tags.clear();
  for (int i = 0; i < tags; ++i) {
    estimation::TagPlacement tag = shipped_tags.tags[static_cast<std::size_t>(7 * (i % 3))];
    tag.id = tags - 1 - i;
    tag.s = static_cast<double>(i / 3) / (tags / 3 + 1);
    scene.tags->tags.push_back(tag);
  }
  return scene;
}

std::vector<io::Scene> scenes() {
  std::vector<io::Scene> all;
  for (const char* name : {"demo", "loaded", "helical_50", "annotated"}) {
    all.push_back(shipped(name));
  }
  all.push_back(io::sceneOfText(test::kSpatialScene, "rig.yaml"));
  all.push_back(crowded(64, 0.031));
  all.push_back(crowded(64, 0.006));
  all.push_back(crowded(5, 0.14));
  all.push_back(crowded(64, 0.02, "Standard41h12"));
  all.push_back(crowded(38, 0.02, "Circle21h7"));
  return all;
}

bool inside(const Box& part, const Box& whole) {
  return part.x >= whole.x - kRounding && part.y >= whole.y - kRounding &&
         part.right() <= whole.right() + kRounding && part.bottom() <= whole.bottom() + kRounding;
}

bool apart(const Box& a, const Box& b) {
  return a.right() <= b.x + kRounding || b.right() <= a.x + kRounding ||
         a.bottom() <= b.y + kRounding || b.bottom() <= a.y + kRounding;
}

Box boxAround(const std::vector<Point>& points, double width = 0) {
  Box box{points[0].x, points[0].y, 0, 0};
  double right = box.x, bottom = box.y;
  for (const Point& point : points) {
    box.x = std::min(box.x, point.x);
    box.y = std::min(box.y, point.y);
    right = std::max(right, point.x);
    bottom = std::max(bottom, point.y);
  }
  const double half = width / 2;
  return {box.x - half, box.y - half, right - box.x + width, bottom - box.y + width};
}

void expectWithinMargins(const Page& page, const Paper& paper) {
  const Box printable{10, 10, paper.width - 20, paper.height - 20};
  for (const PrintedTag& tag : page.tags) EXPECT_TRUE(inside(tag.card, printable)) << tag.id;
  for (const Label& label : page.labels) {
    EXPECT_TRUE(inside(label.box, printable))
        << label.text << " at " << label.box.x << ", " << label.box.y;
    EXPECT_GT(label.box.width, 0.5) << label.text;
  }
  for (const Area& area : page.areas) EXPECT_TRUE(inside(boxAround(area.corners), printable));
  for (const Stroke& stroke : page.strokes) {
    EXPECT_TRUE(inside(boxAround({stroke.from, stroke.to}), printable))
        << stroke.from.x << ", " << stroke.from.y << " to " << stroke.to.x << ", " << stroke.to.y;
  }
}

void expectNothingOverlaps(const Page& page) {
  for (std::size_t i = 0; i < page.labels.size(); ++i) {
    const Label& label = page.labels[i];
    for (std::size_t j = 0; j < i; ++j) {
      EXPECT_TRUE(apart(label.box, page.labels[j].box))
          << label.text << ", " << page.labels[j].text;
    }
  }
  for (std::size_t i = 0; i < page.tags.size(); ++i) {
    const PrintedTag& tag = page.tags[i];
    for (std::size_t j = 0; j < i; ++j) EXPECT_TRUE(apart(tag.card, page.tags[j].card)) << tag.id;
    // Beside the card or in its strip, never on the tag's white border.
    for (const Label& label : page.labels) {
      EXPECT_TRUE(apart(label.box, tag.card) || inside(label.box, tag.card)) << label.text;
      for (const Box& black : tag.black) EXPECT_TRUE(apart(label.box, black)) << label.text;
    }
    for (const Stroke& stroke : page.strokes) {
      EXPECT_TRUE(apart(boxAround({stroke.from, stroke.to}, stroke.width), tag.square)) << tag.id;
    }
  }
}

TEST(TagSheets, EverythingLiesWithinTheMarginsAndNothingOverlaps) {
  for (const io::Scene& scene : scenes()) {
    for (const Paper& paper : kPapers) {
      SCOPED_TRACE(scene.name + ", " + std::to_string(scene.tags->size) + " m, " + paper.name);
      std::vector<Page> pages = tagSheets(scene, paper);
      const std::vector<Page> placement = placementSheets(scene, paper);
      pages.insert(pages.end(), placement.begin(), placement.end());
      pages.push_back(boardSheet(vision::TagBoard(), paper));
      pages.push_back(boardSheet(vision::CharucoBoard(), paper));
      numberPages(paper, pages);
      for (const Page& page : pages) {
        expectWithinMargins(page, paper);
        expectNothingOverlaps(page);
      }
    }
  }
}

TEST(TagSheets, EachTagIsPrintedOnceInItsSizeAndOrder) {
  for (const io::Scene& scene : scenes()) {
    for (const Paper& paper : kPapers) {
      SCOPED_TRACE(scene.name + ", " + paper.name);
      std::vector<int> printed, expected;
      for (const Page& page : tagSheets(scene, paper)) {
        EXPECT_FALSE(page.tags.empty());
        for (const PrintedTag& tag : page.tags) {
          printed.push_back(tag.id);
          EXPECT_NEAR(tag.square.width, 1e3 * scene.tags->size, kRounding);
          EXPECT_NEAR(tag.square.height, 1e3 * scene.tags->size, kRounding);
        }
      }
      for (const auto& tag : scene.tags->tags) expected.push_back(tag.id);
      EXPECT_EQ(printed, expected);
      for (const Page& page : placementSheets(scene, paper)) EXPECT_TRUE(page.tags.empty());
    }
  }
}

// Whether a point is black.
bool isBlack(const PrintedTag& tag, double x, double y) {
  return std::any_of(tag.black.begin(), tag.black.end(), [&](const Box& box) {
    return x > box.x && x < box.right() && y > box.y && y < box.bottom();
  });
}

TEST(TagSheets, BlackAreasAreTheCellsOfTheFamily) {
  for (const std::string& name : vision::TagFamily::names()) {
    const vision::TagFamily family(name);
    const io::Scene scene = crowded(std::min(9, family.count()), 0.02, name);
    const double cell = 20.0 / family.borderCells();
    for (const Page& page : tagSheets(scene, kPapers[0])) {
      for (const PrintedTag& tag : page.tags) {
        const cv::Mat cells = family.cells(tag.id);
        int wrong = 0;
        for (int row = 0; row < cells.rows; ++row) {
          for (int column = 0; column < cells.cols; ++column) {
            const double x = tag.square.x + (column + 0.5 - family.quietCells()) * cell;
            const double y = tag.square.y + (row + 0.5 - family.quietCells()) * cell;
            wrong += isBlack(tag, x, y) != (cells.at<unsigned char>(row, column) == 0);
          }
        }
        EXPECT_EQ(wrong, 0) << name << " " << tag.id;
      }
    }
  }
}

TEST(TagSheets, ACardHasItsIdAndPlaceBelowAndAnUpMarkAboveTheTag) {
  const Page page = tagSheets(shipped("annotated"), kPapers[0]).at(0);
  ASSERT_EQ(page.tags.size(), 20u);
  std::map<int, std::string> places;
  for (const PrintedTag& tag : page.tags) {
    std::vector<std::string> texts;
    for (const Label& label : page.labels) {
      if (!inside(label.box, tag.card)) continue;
      texts.push_back(label.text);
      EXPECT_GT(label.box.y, tag.square.bottom());
    }
    ASSERT_EQ(texts.size(), 2u);
    EXPECT_EQ(texts[0], std::to_string(tag.id));
    places[tag.id] = texts[1];
    int marks = 0;
    for (const Area& area : page.areas) {
      const Box mark = boxAround(area.corners);
      if (!inside(mark, tag.card)) continue;
      ++marks;
      EXPECT_LT(mark.bottom(), tag.square.y);
      EXPECT_NEAR(mark.x + mark.width / 2, tag.square.x + tag.square.width / 2, kRounding);
      ASSERT_EQ(area.corners.size(), 3u);
      EXPECT_NEAR(area.corners[0].y, mark.y, kRounding) << "it points upwards";
      EXPECT_NEAR(area.corners[1].y, area.corners[2].y, kRounding);
    }
    EXPECT_EQ(marks, 1);
  }
  EXPECT_EQ(places[6], "lower, muscle_2, s 0.7");
  EXPECT_EQ(places[13], "upper, bellows_left, s 0.62");
}

TEST(TagSheets, PagesToCutAndBoardsHaveTwoRulersOf100Mm) {
  for (const Paper& paper : kPapers) {
    std::vector<Page> pages = tagSheets(shipped("demo"), paper);
    pages.push_back(boardSheet(vision::TagBoard(), paper));
    for (const Page& page : pages) {
      int across = 0, upright = 0;
      for (const Stroke& stroke : page.strokes) {
        across += std::abs(std::abs(stroke.to.x - stroke.from.x) - 100) < kRounding &&
                  stroke.to.y == stroke.from.y;
        upright += std::abs(std::abs(stroke.to.y - stroke.from.y) - 100) < kRounding &&
                   stroke.to.x == stroke.from.x;
      }
      EXPECT_EQ(across, 1);
      EXPECT_EQ(upright, 1);
    }
  }
}

TEST(TagSheets, TheBoardIsTheSameOnAllPaper) {
  const vision::TagBoard board;
  for (const Paper& paper : kPapers) {
    const Page page = boardSheet(board, paper);
    ASSERT_EQ(page.tags.size(), 30u);
    const Box& first = page.tags.front().square;
    const double x = first.x + 0.5e3 * board.width(), y = first.y + 0.5e3 * board.height();
    for (const PrintedTag& tag : page.tags) {
      const estimation::Corners corners = 1e3 * board.corners(tag.id);
      EXPECT_NEAR(tag.square.x - x, corners(0, 3), 1e-6) << tag.id;
      EXPECT_NEAR(y - tag.square.y, corners(1, 3), 1e-6) << tag.id;
      EXPECT_NEAR(tag.square.right() - x, corners(0, 1), 1e-6) << tag.id;
      EXPECT_NEAR(y - tag.square.bottom(), corners(1, 1), 1e-6) << tag.id;
    }
  }
}

TEST(TagSheets, TheCharucoBoardIsTheSameOnAllPaper) {
  const vision::CharucoBoard board;
  for (const Paper& paper : kPapers) {
    const Page page = boardSheet(board, paper);
    ASSERT_EQ(page.tags.size(), 31u);
    ASSERT_EQ(page.areas.size(), 32u);
    const Point first = page.areas.front().corners.front();
    const double x = first.x + 0.5e3 * board.width(), y = first.y + 0.5e3 * board.height();
    for (int row = 0; row < board.rows; ++row) {
      for (int column = 0; column < board.columns; ++column) {
        if (!board.isWhite(column, row)) continue;
        const PrintedTag& tag = page.tags[static_cast<std::size_t>(board.markerIn(column, row))];
        EXPECT_EQ(tag.id, board.markerIn(column, row));
        const estimation::Corners corners = 1e3 * board.markerCorners(column, row);
        EXPECT_NEAR(tag.square.x - x, corners(0, 3), 1e-6) << tag.id;
        EXPECT_NEAR(y - tag.square.y, corners(1, 3), 1e-6) << tag.id;
        EXPECT_NEAR(tag.square.right() - x, corners(0, 1), 1e-6) << tag.id;
        EXPECT_NEAR(y - tag.square.bottom(), corners(1, 1), 1e-6) << tag.id;
      }
    }
  }
}

// The texts of all placement sheets, line by line from the left.
std::vector<std::vector<std::string>> linesOf(const std::vector<Page>& pages) {
  std::vector<std::vector<std::string>> lines;
  for (const Page& page : pages) {
    std::map<double, std::map<double, std::string>> by_place;
    for (const Label& label : page.labels) by_place[label.box.y][label.box.x] = label.text;
    for (const auto& line : by_place) {
      lines.emplace_back();
      for (const auto& cell : line.second) lines.back().push_back(cell.second);
    }
  }
  return lines;
}

int timesIn(const std::vector<Page>& pages, const std::vector<std::string>& row) {
  const auto lines = linesOf(pages);
  return static_cast<int>(std::count(lines.begin(), lines.end(), row));
}

TEST(PlacementSheets, ARowPerTagStatesItsPlacement) {
  for (const Paper& paper : kPapers) {
    const std::vector<Page> demo = placementSheets(shipped("demo"), paper);
    EXPECT_EQ(timesIn(demo, {"0", "0.04", "16.5", "muscle_1", "0", "41.4", "16", "0", "-15", "0"}),
              1);
    EXPECT_EQ(
        timesIn(demo, {"16", "0.36", "148.4", "muscle_3", "240", "41.4", "16", "0", "-15", "0"}),
        1);
    const std::vector<Page> two = placementSheets(shipped("annotated"), paper);
    EXPECT_EQ(timesIn(two, {"7", "0.95", "405.6", "muscle_2", "120", "46", "16", "0", "0", "0"}),
              1);
    EXPECT_EQ(timesIn(two, {"22", "0.62", "62", "bellows_right", "180", "40", "20", "0", "0", "0"}),
              1);
    EXPECT_EQ(
        timesIn(two, {"27", "0.25", "25", "bellows_left", "300", "40", "0", "-34.6", "0", "0"}), 1);
  }
}

TEST(PlacementSheets, EverySectionWithTagsIsDrawnWithItsMusclesAndTags) {
  const auto lines = linesOf(placementSheets(shipped("annotated"), kPapers[0]));
  const auto count = [&lines](const std::string& text) {
    int times = 0;
    for (const auto& line : lines) times += std::count(line.begin(), line.end(), text);
    return times;
  };
  EXPECT_EQ(count("Section lower, 427 mm long at rest"), 1);
  EXPECT_EQ(count("Section upper, 100 mm long at rest"), 1);
  for (const char* name : {"muscle_1, 0 deg", "muscle_3, 240 deg", "bellows_top, 90 deg"}) {
    EXPECT_EQ(count(name), 1) << name;
  }
  EXPECT_EQ(count("29"), 2) << "in the drawing and in the table";
}

TEST(PlacementSheets, ManyTagsGoOnOverPagesWithTheirTitles) {
  const std::vector<Page> pages = placementSheets(crowded(64, 0.01), kPapers[1]);
  ASSERT_GE(pages.size(), 2u);
  const auto lines = linesOf(pages);
  const auto titles = std::count_if(lines.begin(), lines.end(), [](const auto& line) {
    return line.size() == 10 && line[0] == "id" && line[9] == "tilt";
  });
  EXPECT_EQ(titles, static_cast<long>(pages.size()));
  const auto rows = std::count_if(lines.begin(), lines.end(), [](const auto& line) {
    return line.size() == 10 && line[0] != "id" && line[9] == "0";
  });
  EXPECT_EQ(rows, 64);
}

TEST(TagSheets, PagesAreNumberedThrough) {
  std::vector<Page> pages(3);
  numberPages(kPapers[0], pages);
  for (std::size_t i = 0; i < pages.size(); ++i) {
    ASSERT_EQ(pages[i].labels.size(), 1u);
    EXPECT_EQ(pages[i].labels[0].text, "page " + std::to_string(i + 1) + " of 3");
  }
}

TEST(TagSheets, WhatCannotBePrintedIsRefusedWithItsRule) {
  const std::string none = "scene planar_50 has no tags; expected a scene with a section tags";
  EXPECT_EQ(test::refusal([] { tagSheets(shipped("planar_50"), kPapers[0]); }), none);
  EXPECT_EQ(test::refusal([] { placementSheets(shipped("planar_50"), kPapers[0]); }), none);

  EXPECT_EQ(test::refusal([] { tagSheets(crowded(3, 0.14), kPapers[0]); }), "accepted");
  EXPECT_EQ(test::refusal([] { tagSheets(crowded(3, 0.1412), kPapers[0]); }),
            "tags.size_m is 0.1412: with its border a 36h11 tag is 179.5 mm wide, but a4 has room "
            "for 179 mm; expected at most 0.14 m. Print smaller tags");

  vision::TagBoard board;
  board.columns = 6;
  EXPECT_EQ(
      test::refusal([&board] { boardSheet(board, kPapers[1]); }),
      "a board of 215 x 215 mm; expected at most 184.9 x 231.4 mm, the printable area of letter");
  EXPECT_EQ(
      test::refusal([] {
        boardSheet(vision::CharucoBoard{7, 10}, kPapers[1]);
      }),
      "a board of 168 x 240 mm; expected at most 184.9 x 231.4 mm, the printable area of letter");
}

}  // namespace
}  // namespace helix_arm::procedures
