#include <cmath>
#include <cstdint>

#include <gtest/gtest.h>

#include "helix_arm/vision/frame_source.hpp"

namespace helix_arm::vision {
namespace {

const Eigen::Vector3d kTip(0.3, 0.1, 0.2), kAside = Eigen::Vector3d::UnitY();

cv::Mat pictureOf(int level) { return cv::Mat(48, 64, CV_8UC1, cv::Scalar(level)); }

TEST(FrozenWatch, AnEqualPictureIsFrozenIffTheModelHasMovedFarEnough) {
  const double below = 0.99 * FrozenWatch::kMotion, above = 1.01 * FrozenWatch::kMotion;
  for (const double motion : {0.0, below, -below, above, -above}) {
    FrozenWatch watch;
    EXPECT_FALSE(watch.isFrozen(pictureOf(90), kTip));
    EXPECT_EQ(watch.isFrozen(pictureOf(90), kTip + motion * kAside), std::abs(motion) == above)
        << motion;
  }
}

// Slow motion adds up, and what is still is no longer frozen once the model is back.
TEST(FrozenWatch, TheMotionCountsFromTheFirstOfEqualPictures) {
  FrozenWatch watch;
  const double part = 0.4 * FrozenWatch::kMotion;
  for (const int k : {0, 1, 2, 3, 4, 3, 2, 1, 0}) {
    EXPECT_EQ(watch.isFrozen(pictureOf(90), kTip + k * part * kAside), k > 2) << k;
  }
}

TEST(FrozenWatch, OnePixelMakesAnotherPicture) {
  cv::Mat picture = pictureOf(90);
  for (const cv::Point& place : {cv::Point(0, 0), cv::Point(63, 47), cv::Point(31, 20)}) {
    FrozenWatch watch;
    EXPECT_FALSE(watch.isFrozen(picture, kTip));
    ++picture.at<std::uint8_t>(place);
    const Eigen::Vector3d far = kTip + kAside;
    EXPECT_FALSE(watch.isFrozen(picture, far)) << place;
    EXPECT_FALSE(watch.isFrozen(picture, far)) << "the model has not moved since";
    EXPECT_TRUE(watch.isFrozen(picture, kTip));
  }
}

// The caller may decode the next picture into the same memory; a part of a larger picture has gaps
// between its rows.
TEST(FrozenWatch, PicturesAreComparedByTheirPixels) {
  cv::Mat buffer = pictureOf(90), larger(100, 200, CV_8UC1, cv::Scalar(7));
  FrozenWatch watch;
  EXPECT_FALSE(watch.isFrozen(buffer, kTip));
  buffer.setTo(91);
  EXPECT_FALSE(watch.isFrozen(buffer, kTip + kAside));
  const cv::Mat part = larger(cv::Rect(5, 6, 64, 48));
  buffer.copyTo(part);
  EXPECT_TRUE(watch.isFrozen(part, kTip));
  EXPECT_FALSE(watch.isFrozen(pictureOf(91)(cv::Rect(0, 0, 64, 47)), kTip)) << "another size";
}

TEST(FrozenWatch, AfterAResetNothingIsKnown) {
  FrozenWatch watch;
  EXPECT_FALSE(watch.isFrozen(pictureOf(90), kTip));
  watch.reset();
  EXPECT_FALSE(watch.isFrozen(pictureOf(90), kTip + kAside));
  EXPECT_TRUE(watch.isFrozen(pictureOf(90), kTip));
}

TEST(FrozenWatch, NoPictureIsNone) {
  FrozenWatch watch;
  EXPECT_FALSE(watch.isFrozen({}, kTip));
  EXPECT_FALSE(watch.isFrozen({}, kTip + kAside));
}

}  // namespace
}  // namespace helix_arm::vision
