#include <gtest/gtest.h>

#include "ros_bridge/follow/loop_reports.hpp"

namespace helix_arm::ros_bridge {
namespace {

using Indices = std::vector<int>;

constexpr double kNow = 100.0;  // [s]
constexpr double kMoment = 1e-6;

ros::Time stampOf(int picture) { return ros::Time(50 + picture, 0); }

SeenArm shapeOf(int picture) {
  return {stampOf(picture), model::Shape(model::Twists::Constant(6, 1, picture)),
          Eigen::MatrixXd::Identity(6, 6)};
}

class TagMatching : public testing::Test {
 protected:
  // Its picture, -1 without one.
  int take(double now = kNow) {
    seen = matcher.take(now);
    return seen ? static_cast<int>(seen->stamp.sec) - 50 : -1;
  }

  TagMatcher matcher;
  std::optional<SeenArm> seen;
};

TEST_F(TagMatching, AShapeGetsTheTagsOfItsStampInEitherOrder) {
  matcher.addTags(stampOf(0), Indices{7}, kNow);
  matcher.add(shapeOf(1), kNow);
  EXPECT_EQ(take(), -1) << "its tags may still come";
  matcher.addTags(stampOf(1), Indices{1, 3}, kNow);
  EXPECT_EQ(take(), 1);
  EXPECT_EQ(seen->tags, (Indices{1, 3}));
  EXPECT_EQ(seen->shape.twists()(0, 0), 1);
  matcher.addTags(stampOf(2), Indices{2}, kNow);
  matcher.add(shapeOf(2), kNow);
  EXPECT_EQ(take(), 2);
  EXPECT_EQ(seen->tags, Indices{2});
  EXPECT_EQ(take(), -1);
}

TEST_F(TagMatching, WhereNoTagsComeNothingWaits) {
  matcher.add(shapeOf(1), kNow);
  EXPECT_EQ(take(), 1);
  EXPECT_FALSE(seen->tags);
  matcher.addTags(stampOf(1), Indices{1}, kNow);
  matcher.add(shapeOf(2), kNow + TagMatcher::kSilence - kMoment);
  EXPECT_EQ(take(kNow + TagMatcher::kSilence - kMoment), -1);
  EXPECT_EQ(take(kNow + TagMatcher::kSilence + kMoment), 2);
  EXPECT_FALSE(seen->tags);
}

TEST_F(TagMatching, AShapeWaitsForItsTimeAndNoLonger) {
  matcher.addTags(stampOf(0), Indices{7}, kNow);
  matcher.add(shapeOf(1), kNow);
  EXPECT_EQ(take(kNow + TagMatcher::kPatience - kMoment), -1);
  EXPECT_EQ(take(kNow + TagMatcher::kPatience + kMoment), 1);
  EXPECT_FALSE(seen->tags);
}

TEST_F(TagMatching, LaterTagsEndTheWait) {
  matcher.addTags(stampOf(0), Indices{7}, kNow);
  matcher.add(shapeOf(1), kNow);
  matcher.addTags(stampOf(2), Indices{2}, kNow);
  EXPECT_EQ(take(), 1);
  EXPECT_FALSE(seen->tags);
}

TEST_F(TagMatching, ShapesKeepTheirOrder) {
  matcher.addTags(stampOf(3), Indices{7}, kNow);
  matcher.add(shapeOf(4), kNow);
  matcher.add(shapeOf(3), kNow);
  EXPECT_EQ(take(), -1);
  EXPECT_EQ(take(kNow + 1.0), 4);
  EXPECT_EQ(take(kNow + 1.0), 3);
  EXPECT_EQ(seen->tags, Indices{7});
}

TEST_F(TagMatching, TagsWithoutAFitLeaveTheShapeWithoutTags) {
  matcher.addTags(stampOf(1), std::nullopt, kNow);
  matcher.add(shapeOf(1), kNow);
  EXPECT_EQ(take(), 1);
  EXPECT_FALSE(seen->tags);
}

TEST_F(TagMatching, AJumpBackInTimeForgetsTheTags) {
  matcher.addTags(stampOf(5), Indices{5}, kNow);
  matcher.addTags(stampOf(1), Indices{1}, kNow);
  matcher.add(shapeOf(2), kNow);
  EXPECT_EQ(take(), -1) << "tags of before the jump count as later ones";
  matcher.addTags(stampOf(2), Indices{2}, kNow);
  EXPECT_EQ(take(), 2);
  EXPECT_EQ(seen->tags, Indices{2});
}

TEST_F(TagMatching, ItsBuffersAreBounded) {
  constexpr int kMost = TagMatcher::kMost;
  for (int k = 1; k <= kMost + 1; ++k) matcher.addTags(stampOf(k), Indices{k}, kNow);
  for (const int picture : {2, 1}) matcher.add(shapeOf(picture), kNow);
  EXPECT_EQ(take(), 2);
  EXPECT_EQ(seen->tags, Indices{2});
  EXPECT_EQ(take(), 1);
  EXPECT_FALSE(seen->tags) << "forgotten";
  int taken = 0;
  for (int k = 0; k < 100; ++k) {
    matcher.add(shapeOf(200 + k), kNow);
    while (take() >= 0) ++taken;
  }
  EXPECT_EQ(taken, 100 - kMost);
  matcher.clear();
  EXPECT_EQ(take(kNow + 10), -1);
}

TagDetection detection(int id, bool fitted) {
  TagDetection out;
  out.id = id;
  out.fitted = fitted;
  return out;
}

TEST(FittedTags, AreIndicesOfTheLayoutInAscendingOrder) {
  estimation::TagLayout layout;
  for (const int id : {30, 10, 20}) layout.tags.push_back({id, 0, 0.5, {}});
  TagDetections detections;
  EXPECT_FALSE(fittedTags(detections, layout)) << "nothing was fitted";
  detections.tags = {detection(10, true), detection(15, false), detection(20, false),
                     detection(30, true), detection(30, true)};
  EXPECT_EQ(fittedTags(detections, layout), (Indices{0, 1}));
  detections.tags.push_back(detection(40, true));
  EXPECT_FALSE(fittedTags(detections, layout)) << "of another layout";
}

}  // namespace
}  // namespace helix_arm::ros_bridge
