#include "helix_arm/vision/arm_localizer.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "support/picture_series.hpp"
#include "vision/frame_source.hpp"

namespace helix_arm::vision {
namespace {

using test::PictureSeries;

estimation::ArmView smallLayoutView() { return test::sampleView(0.8, 1, 20); }

double tipError(const Observation& observation, const model::Twists& truth) {
  return (model::tipPose(observation.fit.twists).translation - model::tipPose(truth).translation)
      .norm();
}

class EachMode : public ::testing::TestWithParam<TrackingMode> {};

TEST_P(EachMode, AMovingArmIsMeasuredInEveryPicture) {
  simulation::SimulatedCameraConfig clutter;
  clutter.clutter = 12;
  const PictureSeries series(smallLayoutView(), 30, clutter);
  LocalizerConfig config;
  config.tracking = GetParam();
  ArmLocalizer localizer(series.view, config);
  int whole = 0;
  for (std::size_t i = 0; i < series.pictures.size(); ++i) {
    const Observation& observation = localizer.locate(series.pictures[i], series.model[i]);
    ASSERT_EQ(observation.state, ObservationState::kMeasured) << "picture " << i;
    EXPECT_LT(tipError(observation, series.truth[i]), 0.0005);
    EXPECT_EQ(observation.fit.outliers(), 0);
    EXPECT_TRUE(observation.unknown_ids.empty());
    whole += observation.whole_picture ? 1 : 0;
  }
  if (GetParam() == TrackingMode::kFull) {
    EXPECT_EQ(whole, 30);
  } else {
    EXPECT_LT(whole, 10);
  }
}

INSTANTIATE_TEST_SUITE_P(Modes, EachMode,
                         ::testing::Values(TrackingMode::kFull, TrackingMode::kRegions,
                                           TrackingMode::kEdges));

// ---- Cameras that repeat a picture --------------------------------------------------------------

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

}  // namespace
}  // namespace helix_arm::vision
