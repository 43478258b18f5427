#include "helix_arm/localization/capture_check.hpp"

#include <cstdio>

#include <gtest/gtest.h>

#include "support/sample_view.hpp"

namespace helix_arm::estimation {
namespace {

using test::Random;

constexpr double kNoise = 0.01;

// Data sets of a helical arm with 5 to 7 tags a capture, in sight of an instrument of 10 mm noise.
class CaptureCheckTest : public ::testing::Test {
 protected:
  static constexpr int kTags = 7, kCaptures = 10;

  CaptureCheckTest()
      : arm_(test::ringArm(test::helicalRing())), layout_(test::sampleLayout(1, kTags)) {
    options_.position_noise = kNoise;
  }

  // @param torn  capture whose tags are those of two shapes, half of each; -1: none.
  CaptureCheck checkOf(int torn) {
    TwistFitter fitter(layout_, 1, options_);
    std::vector<std::optional<CaptureScatter>> scatter;
    for (int c = 0; c < kCaptures; ++c) {
      const model::Twists model = arm_.twists(test::randomInput(arm_, random_));
      model::Twists other = model;
      for (int i = 0; i < 6; ++i) other(i, 0) += i < 3 ? 0.12 : 1.2;
      const std::vector<lie::SE3> poses = tagPoses(layout_, model),
                                  others = tagPoses(layout_, other);
      std::vector<PoseObservation> seen;
      const int tags = kTags - c % 3;
      for (int tag = 0; tag < tags; ++tag) {
        seen.push_back({tag, c == torn && tag % 2 == 1 ? others[tag] : poses[tag]});
        for (int k = 0; k < 3; ++k) seen.back().X_BT.translation[k] += kNoise * random_.normal();
      }
      const TwistFit& fit = fitter.fit(seen, model);
      scatter.emplace_back();
      if (fit.status == FitStatus::kConverged) scatter.back() = scatterOf(fit, 3, false);
    }
    return checkCaptures(scatter);
  }

  model::Arm arm_;
  TagLayout layout_;
  TwistFitOptions options_;
  Random random_{17};
};

TEST_F(CaptureCheckTest, OfAThousandSoundSetsNoneHasACaptureApart) {
  int wrong = 0;
  for (int set = 0; set < 1000; ++set) {
    const CaptureCheck check = checkOf(-1);
    ASSERT_TRUE(check.usual.has_value());
    for (const bool apart : check.apart) wrong += apart ? 1 : 0;
  }
  EXPECT_EQ(wrong, 0);
  std::printf("sound captures named: %d of %d\n", wrong, 1000 * kCaptures);
}

TEST_F(CaptureCheckTest, ATornCaptureIsNamed) {
  options_.position_noise = 0.04;  // so wide that no tag counts as wrong
  for (int set = 0; set < 20; ++set) {
    const CaptureCheck check = checkOf(0);
    for (int c = 0; c < kCaptures; ++c) EXPECT_EQ(check.apart[c], c == 0) << set << ", " << c;
  }
}

}  // namespace
}  // namespace helix_arm::estimation
