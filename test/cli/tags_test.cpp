// The PDF of `helix_arm tags`, rendered as a printer would and read back.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <numeric>
#include <sstream>
#include <tuple>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "command.hpp"
#include "helix_arm/vision/tag_detector.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_size.hpp"
#include "vision/charuco_board.hpp"

namespace helix_arm::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using vision::TagDetection;

const int kDotsPerInch = test::isFullSize() ? 300 : 150;
const double kMillimetresPerPixel = 25.4 / kDotsPerInch;
constexpr double kTolerance = 0.2;  // of sizes on paper [mm]

const std::map<std::string, cv::Size2d> kPaperSizes = {{"a4", {210, 297}},
                                                       {"letter", {215.9, 279.4}}};
const auto kPapers = test::isFullSize() ? kPaperSizes : decltype(kPaperSizes){*kPaperSizes.begin()};

void runTool(const std::string& command) {
  if (std::system(command.c_str()) != 0) throw std::runtime_error("failed: " + command);
}

// A PDF that the command wrote.
class Printed {
 public:
  explicit Printed(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "tags");
    arguments.insert(arguments.end(), {"--all-tags", "--out", path(), "--format", "json"});
    const Outcome outcome = runCommand(arguments);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    report = outcome.json();
    runTool("pdftoppm -gray -r " + std::to_string(kDotsPerInch) + " '" + path() + "' '" +
            (folder_ / "page") + "'");
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(folder_.path())) {
      if (entry.path().extension() == ".pgm") files.push_back(entry.path());
    }
    std::sort(files.begin(), files.end());
    for (const fs::path& file : files) {
      pages.push_back(cv::imread(file.string(), cv::IMREAD_GRAYSCALE));
    }
  }

  std::string path() const { return folder_ / "tags.pdf"; }
  json report;
  std::vector<cv::Mat> pages;

 private:
  TemporaryFolder folder_;
};

// Corners [mm] from the top left of the page, y up.
estimation::Corners onPaper(const TagDetection& tag) {
  estimation::Corners corners = (tag.corners.array() + 0.5) * kMillimetresPerPixel;
  corners.row(1) *= -1;
  return corners;
}

void expectUprightSquare(const TagDetection& tag, double side, double& worst) {
  const estimation::Corners corners = onPaper(tag);
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < i; ++j) {
      const double expected = (i - j == 2) ? std::sqrt(2) * side : side;
      const double error = (corners.col(i) - corners.col(j)).norm() - expected;
      EXPECT_NEAR(error, 0, kTolerance) << "tag " << tag.id;
      worst = std::max(worst, std::abs(error));
    }
  }
  EXPECT_NEAR(corners(1, 0), corners(1, 1), kTolerance) << "tag " << tag.id << " is not upright";
  EXPECT_GT(corners(1, 2), corners(1, 1)) << "tag " << tag.id << " is upside down";
}

// Reads all tags of all pages, of this side [mm]. @return ids in order, repeated as they are read.
std::vector<int> idsRead(const Printed& printed, const std::string& family, double side) {
  vision::DetectorConfig config;
  config.family = family;
  config.max_hamming = 0;
  vision::TagDetector detector(config);
  std::vector<int> ids;
  double worst = 0;
  for (const cv::Mat& page : printed.pages) {
    for (const TagDetection& tag : detector.detect(page)) {
      expectUprightSquare(tag, side, worst);
      ids.push_back(tag.id);
    }
  }
  std::cout << ids.size() << " tags " << family << " of " << side << " mm, off by at most " << worst
            << " mm\n";
  std::sort(ids.begin(), ids.end());
  return ids;
}

// The demo's scene with so many tags of a size [m], spread over its muscles, in this file.
void writeCrowded(const std::string& path, int tags, double size, const std::string& family) {
  std::string demo = contentOf(scenePath("demo"));
  const std::size_t begin = demo.find("\ntags:") + 1;
  std::ostringstream text;
  text << "tags:\n  family: " << family << "\n  size_m: " << size << "\n  groups:\n";
  for (int i = 0; i < tags; ++i) {
    text << "    - {actuator: muscle_" << i % 3 + 1 << ", ids: [" << tags - 1 - i << "], s: ["
         << static_cast<double>(i / 3) / (tags / 3 + 1) << "], position_m: [0, 0, 0.016]}\n";
  }
  std::ofstream(path) << demo.replace(begin, demo.find("\n\n", begin) - begin, text.str());
}

TEST(Tags, ManyOrLargeTagsAreReadBackFromAllPages) {
  const TemporaryFolder folder;
  const std::string path = folder / "crowded.yaml";
  int number = 0;
  for (const auto& [count, size, family] :
       {std::tuple(64, 0.006, "36h11"), std::tuple(5, 0.14, "36h11"),
        std::tuple(64, 0.02, "Standard41h12"), std::tuple(38, 0.02, "Circle21h7")}) {
    writeCrowded(path, count, size, family);
    for (const auto& [paper, sheet] : kPapers) {
      if (!test::isDrawn(number++, 2)) continue;
      SCOPED_TRACE(std::to_string(size) + " " + family + " on " + paper);
      std::vector<int> expected(static_cast<std::size_t>(count));
      std::iota(expected.begin(), expected.end(), 0);
      EXPECT_EQ(idsRead(Printed({path, "--paper", paper}), family, 1e3 * size), expected);
    }
  }
}

TEST(Tags, TheBoardIsReadBackFromThePrintOnBothPapers) {
  const vision::TagBoard board;
  for (const auto& [paper, size] : kPapers) {
    const Printed printed({"--board", "--paper", paper});
    ASSERT_EQ(printed.pages.size(), 1u);
    vision::DetectorConfig config;
    config.family = board.family;
    const auto tags = vision::TagDetector(config).detect(printed.pages[0]);
    ASSERT_EQ(tags.size(), 30u);
    Eigen::Matrix2Xd read(2, 120), expected(2, 120);
    for (int i = 0; i < 30; ++i) {
      EXPECT_EQ(tags[static_cast<std::size_t>(i)].id, board.first_id + i);
      read.middleCols<4>(4 * i) = onPaper(tags[static_cast<std::size_t>(i)]);
      expected.middleCols<4>(4 * i) = 1e3 * board.corners(board.first_id + i);
    }
    read.colwise() -= read.rowwise().mean().eval();
    const double worst = (read - expected).colwise().norm().maxCoeff();
    std::cout << "corners of the board off by at most " << worst << " mm\n";
    EXPECT_LT(worst, kTolerance);
  }
}

}  // namespace
}  // namespace helix_arm::test
