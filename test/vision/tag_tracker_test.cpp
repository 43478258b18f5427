#include "vision/tag_tracker.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "basics/pi.hpp"
#include "support/allocation_counter.hpp"
#include "support/random.hpp"
#include "support/tag_picture.hpp"
#include "support/test_size.hpp"

namespace helix_arm::test {
namespace {

using Eigen::Vector2d;
using estimation::Corners;
using namespace vision;

using basics::kPi;
constexpr double kFalseLock = 0.5;  // [px]

const TagFamily& family() {
  static const TagFamily family("36h11");
  return family;
}

TagTracker tracker(TrackingMode mode = TrackingMode::kEdges) { return {DetectorConfig(), mode}; }

/// A tag drawn at these corners.
struct Drawn {
  int id;
  Corners corners;
};

Corners moved(const Corners& corners, const Vector2d& by) { return corners.colwise() + by; }

/// Turned in the picture, seen from aside and a little in perspective.
Corners randomTag(Random& random, const Vector2d& middle, double size) {
  const Corners square = squareCorners(0, 0, size, random.uniform(-kPi, kPi));
  const Vector2d aside = random.direction<2>();
  const double foreshortening = random.uniform(0.0, 0.35);
  Corners corners = square - foreshortening * aside * (aside.transpose() * square);
  for (int k = 0; k < 4; ++k) {
    corners.col(k) +=
        middle + 0.006 * size * Vector2d(random.uniform(-1, 1), random.uniform(-1, 1));
  }
  return corners;
}

cv::Mat picture(const std::vector<Drawn>& tags, const cv::Size& size) {
  cv::Mat gray(size, CV_8UC1, cv::Scalar(110));
  for (const Drawn& tag : tags) drawTag(family(), family().cells(tag.id), tag.corners, gray);
  return gray;
}

/// Objects with straight edges of any brightness.
cv::Mat cluttered(Random& random, const cv::Size& size) {
  cv::Mat gray(size, CV_8UC1, cv::Scalar(random.integer(40, 200)));
  for (int i = 0; i < 150; ++i) {
    const cv::RotatedRect box(cv::Point2f(static_cast<float>(random.uniform(0, size.width)),
                                          static_cast<float>(random.uniform(0, size.height))),
                              cv::Size2f(static_cast<float>(random.uniform(5, 90)),
                                         static_cast<float>(random.uniform(5, 90))),
                              static_cast<float>(random.uniform(0, 180)));
    cv::Point2f p[4];
    box.points(p);
    cv::fillConvexPoly(gray, std::vector<cv::Point>(p, p + 4), cv::Scalar(random.integer(0, 255)));
  }
  return gray;
}

void cover(cv::Mat& gray, const Corners& region, int level) {
  std::vector<cv::Point> outline;
  for (int k = 0; k < 4; ++k) {
    outline.emplace_back(cvRound(region(0, k) * 16), cvRound(region(1, k) * 16));
  }
  cv::fillConvexPoly(gray, outline, cv::Scalar(level), cv::LINE_8, 4);
}

/// As a lens and a sensor leave it.
void spoil(cv::Mat& gray, Random& random, double blur = 0.7, double noise = 2.0) {
  cv::GaussianBlur(gray, gray, {0, 0}, blur, blur, cv::BORDER_REPLICATE);
  for (int y = 0; y < gray.rows; ++y) {
    for (int x = 0; x < gray.cols; ++x) {
      auto& pixel = gray.at<std::uint8_t>(y, x);
      pixel = cv::saturate_cast<std::uint8_t>(pixel + noise * random.normal());
    }
  }
}

cv::Mat photograph(Random& random, const std::vector<Drawn>& tags, const cv::Size& size) {
  cv::Mat gray = picture(tags, size);
  spoil(gray, random);
  return gray;
}

double error(const Corners& corners, const Corners& truth) {
  return (corners - truth).colwise().norm().maxCoeff();
}

const TagDetection* find(const TrackResult& result, int id) {
  for (const TagDetection& tag : result.tags) {
    if (tag.id == id) return &tag;
  }
  return nullptr;
}

double shorterSide(const Corners& corners) {
  double side = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 4; ++k) {
    side = std::min(side, (corners.col((k + 1) % 4) - corners.col(k)).norm());
  }
  return side;
}

TEST(EdgeTracking, CornersAreTrueAndWithoutBias) {
  TagTracker edges = tracker();
  Random random(1);
  double squares = 0, outward = 0;
  Vector2d sum = Vector2d::Zero();
  constexpr int kTags = 150;
  for (int i = 0; i < kTags; ++i) {
    const int id = random.integer(0, family().count() - 1);
    const Vector2d middle(80 + random.uniform(0, 1), 80 + random.uniform(0, 1));
    const Corners truth = randomTag(random, middle, random.uniform(30, 80));
    const cv::Mat gray = photograph(random, {{id, truth}}, {160, 160});
    const Vector2d off(random.uniform(-3, 3), random.uniform(-3, 3));
    edges.search(gray);  // so that it is not due
    const TrackResult& result = edges.track(gray, {{id, moved(truth, off), true}});
    ASSERT_EQ(result.by_edges, 1) << i;
    const Corners difference = result.tags[0].corners - truth;
    ASSERT_LT(error(result.tags[0].corners, truth), 0.2) << i;
    squares += difference.squaredNorm() / 8;
    sum += difference.rowwise().mean();
    for (int k = 0; k < 4; ++k) {
      const Vector2d out = truth.col(k) - truth.rowwise().mean();
      outward += difference.col(k).dot(out.normalized()) / 4;
    }
  }
  EXPECT_LT(std::sqrt(squares / kTags), 0.04);
  EXPECT_LT((sum / kTags).norm(), 0.02);
  EXPECT_LT(std::abs(outward / kTags), 0.02);
}

TEST(EdgeTracking, CatchesTagsAQuarterOfTheirSideOff) {
  TagTracker edges = tracker();
  Random random(2);
  int caught = 0, tags = 0;
  for (const double size : {28.0, 40.0, 55.0, 75.0}) {
    for (int i = 0; i < 24; ++i) {
      const int id = random.integer(0, family().count() - 1);
      const Corners truth = randomTag(random, {120, 120}, size);
      cv::Mat gray = cluttered(random, {240, 240});
      drawTag(family(), family().cells(id), truth, gray);
      spoil(gray, random);
      const double far = std::min(12.0, 0.25 * shorterSide(truth)), angle = 2 * kPi * i / 24;
      const Corners expected = moved(truth, far * Vector2d(std::cos(angle), std::sin(angle)));
      const TrackResult& result = edges.track(gray, {{id, expected, true}});
      ASSERT_NE(find(result, id), nullptr);
      EXPECT_LT(error(find(result, id)->corners, truth), kFalseLock);
      caught += result.by_edges;
      ++tags;
    }
  }
  EXPECT_GE(caught, 0.97 * tags);
}

TEST(EdgeTracking, AnotherTagAtTheExpectedPlaceIsRefused) {
  TagTracker edges = tracker();
  Random random(4);
  for (int i = 0; i < 60; ++i) {
    const int there = random.integer(0, family().count() - 2);
    const int wanted = random.integer(there + 1, family().count() - 1);
    const Corners truth = randomTag(random, {80, 80}, random.uniform(40, 70));
    const cv::Mat gray = photograph(random, {{there, truth}}, {160, 160});
    const TrackResult& result = edges.track(gray, {{wanted, truth, true}});
    EXPECT_EQ(result.by_edges + result.by_regions, 0);
    EXPECT_EQ(find(result, wanted), nullptr);
    EXPECT_NE(find(result, there), nullptr);
  }
}

TEST(EdgeTracking, PartlyHiddenTagsAreTrueOrLeftOut) {
  TagTracker edges = tracker();
  Random random(7);
  int by_edges = 0, refused = 0, reported = 0, off = 0;
  for (int i = 0; i < 400; ++i) {
    const int id = random.integer(0, family().count() - 1);
    const double size = random.uniform(40, 75);
    const Corners truth = randomTag(random, {80, 80}, size);
    cv::Mat gray = picture({{id, truth}}, {160, 160});
    // Over a corner, across the middle, or over a side.
    const int k = random.integer(0, 3);
    const Vector2d corner = truth.col(k), middle = truth.rowwise().mean();
    const Vector2d place = i % 3 == 0   ? corner
                           : i % 3 == 1 ? Vector2d(0.5 * (corner + truth.col((k + 1) % 4)))
                                        : Vector2d(0.5 * (corner + middle));
    cover(gray, randomTag(random, place, random.uniform(0.1, 0.6) * size), random.integer(0, 255));
    spoil(gray, random);
    const TrackResult& result = edges.track(gray, {{id, moved(truth, {1.5, -2}), true}});
    by_edges += result.by_edges;
    refused += result.tags.empty();
    for (const TagDetection& tag : result.tags) {
      EXPECT_EQ(tag.id, id);
      const double worst = error(tag.corners, truth);
      EXPECT_LT(worst, 1.5) << i;
      off += worst > kFalseLock;
      ++reported;
    }
  }
  // What hides a tag and looks like its own edge, a fraction of a pixel away, cannot be told.
  EXPECT_LE(off, 0.02 * reported);
  EXPECT_GT(by_edges, 40);
  EXPECT_GT(refused, 40);
}

TEST(EdgeTracking, DoesNotAllocate) {
  TagTracker edges = tracker();
  Random random(8);
  std::vector<Drawn> tags;
  std::vector<ExpectedTag> expected;
  for (int i = 0; i < 8; ++i) {
    tags.push_back({i, randomTag(random, {100.0 + 150 * (i % 4), 100.0 + 150 * (i / 4)}, 60)});
    expected.push_back({i, moved(tags[i].corners, {2, -3}), true});
  }
  const cv::Mat gray = photograph(random, tags, {650, 350});
  ASSERT_EQ(edges.track(gray, expected).by_edges, 8);
  const AllocationCounter counter;
  edges.track(gray, expected);
  EXPECT_EQ(counter.count(), 0U);
}

class TrackingIn : public ::testing::TestWithParam<TrackingMode> {};
INSTANTIATE_TEST_SUITE_P(Modes, TrackingIn,
                         ::testing::Values(TrackingMode::kRegions, TrackingMode::kEdges));

TEST_P(TrackingIn, JumpsBumpsAndHiddenTagsAreRecoveredInTheSamePicture) {
  TagTracker finder = tracker(GetParam());
  Random random(14);
  const cv::Size size(1280, 720);
  cv::Mat background = cluttered(random, size);
  std::vector<Drawn> tags;
  for (int i = 0; i < 8; ++i) {
    const Vector2d middle(400 + 160 * (i % 4), 260 + 160 * (i / 4));
    tags.push_back({3 * i, randomTag(random, middle, random.uniform(45, 70))});
  }
  std::vector<bool> seen(tags.size(), false);
  std::vector<ExpectedTag> expected;
  Vector2d last = Vector2d::Zero();
  int recovered = 0, hidden = 0, events = test::draws(16, 120);
  for (int event = 0; event < events; ++event) {
    // All jump, then a bump moves them a little, then some are hidden, then all jump again.
    Vector2d to = last + Vector2d(random.uniform(-4, 4), random.uniform(-4, 4));
    if (event % 4 == 0) to = {random.uniform(-250, 250), random.uniform(-150, 150)};
    if (event % 4 == 1) to = last + Vector2d(random.uniform(-30, 30), random.uniform(-30, 30));
    if (event % 4 == 3) to = {random.uniform(-100, 100), random.uniform(-100, 100)};
    std::vector<Drawn> now = tags;
    for (Drawn& tag : now) tag.corners = moved(tag.corners, to);
    cv::Mat gray = background.clone();
    for (const Drawn& tag : now) drawTag(family(), family().cells(tag.id), tag.corners, gray);
    std::vector<bool> is_hidden(tags.size(), false);
    for (std::size_t i = 0; i < now.size() && event % 4 == 2; ++i) {
      is_hidden[i] = random.uniform(0, 1) < 0.4;
      if (!is_hidden[i]) continue;
      const Vector2d middle = now[i].corners.rowwise().mean();
      cover(gray, squareCorners(middle.x(), middle.y(), 75, random.uniform(-kPi, kPi)),
            random.integer(0, 255));
    }
    spoil(gray, random);
    expected.clear();
    for (std::size_t i = 0; i < tags.size(); ++i) {
      expected.push_back({tags[i].id, moved(tags[i].corners, last), seen[i]});
    }
    const TrackResult& result = finder.track(gray, expected);
    for (const TagDetection& tag : result.tags) {
      const auto truth = std::find_if(now.begin(), now.end(),
                                      [&tag](const Drawn& drawn) { return drawn.id == tag.id; });
      ASSERT_NE(truth, now.end()) << event;
      EXPECT_LT(error(tag.corners, truth->corners), kFalseLock) << event;
    }
    for (std::size_t i = 0; i < now.size(); ++i) {
      seen[i] = find(result, now[i].id) != nullptr;
      EXPECT_EQ(seen[i], !is_hidden[i]) << "event " << event << " tag " << i;
      recovered += seen[i];
      hidden += is_hidden[i];
    }
    last = to;
  }
  EXPECT_EQ(recovered + hidden, events * 8);
  EXPECT_GT(hidden, events / 2);
}

}  // namespace
}  // namespace helix_arm::test
