#include "helix_arm/vision/tag_detector.hpp"

#include <gtest/gtest.h>

#include "support/random.hpp"
#include "support/tag_picture.hpp"
#include "support/test_size.hpp"

namespace helix_arm::test {
namespace {

using estimation::Corners;
using namespace vision;

cv::Mat paper(int width = 240, int height = 200) {
  return cv::Mat(height, width, CV_8UC1, cv::Scalar(230));
}

// A view of a tag from aslant: the corners of a square, each moved by up to a part of its size.
Corners aslant(Random& random, double size) {
  Corners corners = squareCorners(120 + random.uniform(-5, 5), 100 + random.uniform(-5, 5), size,
                                  random.uniform(-M_PI, M_PI));
  for (int i = 0; i < corners.size(); ++i) {
    corners(i) += random.uniform(-0.08, 0.08) * size;
  }
  return corners;
}

DetectorConfig configOf(const std::string& family, double decimate, bool refine = true) {
  DetectorConfig config;
  config.family = family;
  config.quad_decimate = decimate;
  config.refine_edges = refine;
  config.max_hamming = 0;
  return config;
}

class EveryFamily : public testing::TestWithParam<std::string> {};

TEST_P(EveryFamily, TagsAreFoundWithTheirCornersInReadingOrder) {
  const TagFamily family(GetParam());
  Random random(11);
  for (const double decimate : {1.0, 1.5, 2.0}) {
    TagDetector detector(configOf(GetParam(), decimate));
    for (int round = 0; round < test::draws(3, 8); ++round) {
      const int id = random.integer(0, family.count() - 1);
      const double cell = 9;
      const Corners corners = aslant(random, cell * family.borderCells());
      cv::Mat picture = paper();
      drawTag(family, family.cells(id), corners, picture);
      bool found = false;
      for (const TagDetection& tag : detector.detect(picture)) {
        if (tag.id != id) continue;
        found = true;
        EXPECT_EQ(tag.hamming, 0);
        EXPECT_GT(tag.margin, 20);
        EXPECT_LT((tag.corners - corners).cwiseAbs().maxCoeff(), 0.5)
            << "id " << id << " decimate " << decimate;
      }
      EXPECT_TRUE(found) << "id " << id << " decimate " << decimate << "\n" << corners;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(TagDetector, EveryFamily, testing::ValuesIn(TagFamily::names()),
                         [](const auto& family) { return family.param; });

// Error of the corners of many tags, drawn where they are known to be and blurred a little.
struct CornerError {
  int found = 0;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  double rms = 0;
};

const int kRounds = test::draws(20, 60);

CornerError cornerError(double decimate, bool refine) {
  TagDetector detector(configOf("36h11", decimate, refine));
  Random random(5);
  CornerError error;
  for (int round = 0; round < kRounds; ++round) {
    const Corners corners = aslant(random, random.uniform(40, 90));
    cv::Mat picture = paper();
    drawTag(detector.family(), detector.family().cells(round), corners, picture);
    cv::GaussianBlur(picture, picture, {}, random.uniform(0.1, 1.0));
    for (const TagDetection& tag : detector.detect(picture)) {
      EXPECT_EQ(tag.id, round);
      error.mean += (tag.corners - corners).rowwise().mean();
      error.rms += (tag.corners - corners).squaredNorm() / 8;
      ++error.found;
    }
  }
  error.mean /= error.found;
  error.rms = std::sqrt(error.rms / error.found);
  return error;
}

// libapriltag puts pixel centres at halves, this library at whole numbers.
TEST(TagDetector, CornersAreGoodToAFewHundredthsOfAPixelAndNotBiased) {
  for (const double decimate : {1.0, 1.5, 2.0, 3.0}) {
    SCOPED_TRACE(decimate);
    const CornerError refined = cornerError(decimate, true), plain = cornerError(decimate, false);
    EXPECT_GE(refined.found, decimate < 3 ? kRounds : kRounds * 5 / 6);
    EXPECT_LT(refined.mean.cwiseAbs().maxCoeff(), 0.01);
    EXPECT_LT(refined.rms, 0.03);
    EXPECT_LT(refined.rms, plain.rms / 3);
  }
}

TEST(TagDetector, WrongBitsArePutRightUpToTheirLimit) {
  for (int limit = 0; limit <= 2; ++limit) {
    DetectorConfig config = configOf("36h11", 1);
    config.max_hamming = limit;
    TagDetector detector(config);
    const TagFamily& family = detector.family();
    for (int wrong = 0; wrong <= 3; ++wrong) {
      cv::Mat cells = family.cells(42);
      for (int i = 0; i < wrong; ++i) {
        // Inside the border: the middle of the tag.
        auto& cell = cells.at<std::uint8_t>(cells.rows / 2 - 1 + i, cells.cols / 2);
        cell = static_cast<std::uint8_t>(255 - cell);
      }
      cv::Mat picture = paper();
      drawTag(family, cells, squareCorners(120, 100, 90, 0.3), picture);
      const std::vector<TagDetection> tags = detector.detect(picture);
      if (wrong > limit) {
        EXPECT_TRUE(tags.empty());
        continue;
      }
      ASSERT_EQ(tags.size(), 1u) << limit << " " << wrong;
      EXPECT_EQ(tags[0].id, 42);
      EXPECT_EQ(tags[0].hamming, wrong);
    }
  }
}

}  // namespace
}  // namespace helix_arm::test
