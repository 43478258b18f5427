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

void expectSame(const std::vector<TagDetection>& a, const std::vector<TagDetection>& b,
                double tolerance) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].id, b[i].id);
    EXPECT_EQ(a[i].hamming, b[i].hamming);
    EXPECT_LE((a[i].corners - b[i].corners).cwiseAbs().maxCoeff(), tolerance) << a[i].id;
  }
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

// Nine tags on a page, each turned otherwise.
cv::Mat page(const TagFamily& family) {
  cv::Mat picture = paper(480, 360);
  for (int i = 0; i < 9; ++i) {
    const Corners corners =
        squareCorners(90 + 150 * (i % 3), 60 + 120 * (i / 3), 45 + 3 * i, 0.1 + 0.7 * i);
    drawTag(family, family.cells(20 - i), corners, picture);
  }
  return picture;
}

TEST(TagDetector, RegionsGiveWhatTheWholePictureGives) {
  for (const double decimate : {1.0, 1.5, 2.0, 3.0}) {
    TagDetector detector(configOf("36h11", decimate));
    const cv::Mat picture = page(detector.family());
    const std::vector<TagDetection> whole = detector.detect(picture);
    ASSERT_EQ(whole.size(), 9u);
    for (const TagDetection& tag : whole) {
      const Eigen::Vector2d low = tag.corners.rowwise().minCoeff();
      const Eigen::Vector2d high = tag.corners.rowwise().maxCoeff();
      const int margin = 24;
      const cv::Rect region(static_cast<int>(low.x()) - margin, static_cast<int>(low.y()) - margin,
                            static_cast<int>(high.x() - low.x()) + 2 * margin,
                            static_cast<int>(high.y() - low.y()) + 2 * margin);
      // libapriltag's floats round otherwise in another place, and its samples with them.
      expectSame(detector.detect(picture, region), {tag}, 5e-3);
    }
    expectSame(detector.detect(picture, {-100, -100, 2000, 2000}), whole, 0);
    EXPECT_TRUE(detector.detect(picture, {100, 100, -10, 10}).empty());
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
