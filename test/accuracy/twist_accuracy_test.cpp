// How well tags tell the tip, against the Cramer-Rao bound: 300 random shapes of the helical arm at
// 0.8 m, tags of 31 mm, 0.5 px of noise on each coordinate of each corner.
#include <Eigen/Dense>
#include <cmath>
#include <cstdio>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/curve.hpp"
#include "support/sample_view.hpp"

namespace helix_arm {
namespace {

using namespace estimation;
using test::Random;

constexpr double kNoise = 0.5;  // [px]
constexpr int kScenes = 300;

Eigen::VectorXd pixelsOf(const ArmView& view, const std::vector<TagImage>& tags,
                         const model::Twists& twists) {
  const std::vector<lie::SE3> poses = estimation::tagPoses(view.layout, twists);
  const estimation::Corners plane = view.layout.corners();
  Eigen::VectorXd pixels(8 * tags.size());
  for (std::size_t i = 0; i < tags.size(); ++i) {
    for (int c = 0; c < 4; ++c) {
      const Eigen::Vector3d p(plane(0, c), plane(1, c), 0);
      const auto row = static_cast<int>(8 * i + 2 * c);
      pixels.segment<2>(row) = *view.camera.project(view.X_CB * (poses[tags[i].tag] * p));
    }
  }
  return pixels;
}

// Least variance that an unbiased estimate of the tip's position can have, from central
// differences of the camera's definition [m^2].
double cramerRaoBound(const ArmView& view, const std::vector<TagImage>& tags,
                      const model::Twists& twists) {
  constexpr double kStep = 1e-5;
  Eigen::MatrixXd J(8 * tags.size(), 6), J_tip(3, 6);
  for (int k = 0; k < 6; ++k) {
    model::Twists up = twists, down = twists;
    up(k, 0) += kStep;
    down(k, 0) -= kStep;
    J.col(k) = (pixelsOf(view, tags, up) - pixelsOf(view, tags, down)) / (2 * kStep);
    J_tip.col(k) =
        (model::tipPose(up).translation - model::tipPose(down).translation) / (2 * kStep);
  }
  const Eigen::MatrixXd information = J.transpose() * J / (kNoise * kNoise);
  return (J_tip * information.ldlt().solve(J_tip.transpose())).trace();
}

double tipError2(const TwistFit& fit, const model::Twists& twists) {
  return (model::tipPose(fit.twists).translation - model::tipPose(twists).translation)
      .squaredNorm();
}

// A scene: an arm's shape, some of its visible tags, and what is seen of them.
struct Scene {
  model::Twists twists;
  std::vector<TagImage> tags;
  std::vector<CornerObservation> seen;
};

class TwistAccuracy : public ::testing::TestWithParam<int> {
 protected:
  TwistAccuracy() : fitter_(view_.layout, 1, {}) {}

  Scene scene(int tags) {
    const model::Twists twists = arm_.twists(test::randomInput(arm_, random_));
    const auto visible = estimation::visibleTags(view_, twists, 0.35);
    EXPECT_GE(static_cast<int>(visible.size()), tags);
    const auto chosen = test::spread(visible, tags);
    return {twists, chosen, test::observe(view_, chosen, kNoise, random_)};
  }

  // The last picture's answer, a thirtieth of a second of brisk motion ago.
  model::Twists warmStart(const model::Twists& twists) {
    model::Twists start = twists;
    for (int i = 0; i < 3; ++i) {
      start(i, 0) += 0.003 * random_.normal();
      start(3 + i, 0) += 0.03 * random_.normal();
    }
    return start;
  }

  const TwistFit& fit(const std::vector<CornerObservation>& seen, const model::Twists& start) {
    return fitter_.fit(seen, view_.X_CB, view_.camera.fx, start);
  }

  const model::Arm arm_ = test::ringArm(test::helicalRing());
  const ArmView view_ = test::sampleView();
  TwistFitter fitter_;
  Random random_{42};
};

TEST_P(TwistAccuracy, WarmTipErrorIsNearTheCramerRaoBound) {
  double error2 = 0, bound2 = 0;
  for (int i = 0; i < kScenes; ++i) {
    const Scene s = scene(GetParam());
    const TwistFit& answer = fit(s.seen, warmStart(s.twists));
    ASSERT_EQ(answer.status, FitStatus::kConverged);
    error2 += tipError2(answer, s.twists);
    bound2 += cramerRaoBound(view_, s.tags, s.twists);
  }
  const double rms = std::sqrt(error2 / kScenes), bound = std::sqrt(bound2 / kScenes);
  std::printf("%d tags: tip RMS %.2f mm, Cramer-Rao bound %.2f mm, ratio %.2f\n", GetParam(),
              1e3 * rms, 1e3 * bound, rms / bound);
  EXPECT_LT(rms, 1.2 * bound);
}

INSTANTIATE_TEST_SUITE_P(Tags, TwistAccuracy, ::testing::Values(8, 4, 2));

using ColdStart = TwistAccuracy;

TEST_P(ColdStart, ReachesTheSameMinimum) {
  int same = 0, starts = 0;
  for (int i = 0; i < kScenes; ++i) {
    const Scene s = scene(GetParam());
    const TwistFit warm = fit(s.seen, s.twists);
    model::Twists straight(6, 1);
    straight << 0.42, 0, 0, 0, 0, 0;
    for (const model::Twists& start : {straight, arm_.twists(arm_.inputAt(0))}) {
      const TwistFit& cold = fitter_.fitCold(s.seen, view_.X_CB, view_.camera.fx, start);
      ++starts;
      // The model's prior may pull a little to where it started.
      const lie::Vector6 d = cold.twists.col(0) - warm.twists.col(0);
      const bool near = d.dot(warm.covariance.ldlt().solve(d)) < 0.01;
      if (cold.status == FitStatus::kConverged && near) ++same;
    }
  }
  std::printf("%d tags: %d of %d cold starts, straight or at rest, reached the same minimum\n",
              GetParam(), same, starts);
  EXPECT_GE(same, 0.99 * starts);
}

INSTANTIATE_TEST_SUITE_P(Tags, ColdStart, ::testing::Values(8, 4));

using DisplacedTag = TwistAccuracy;

TEST_P(DisplacedTag, OneOfEightAtMostDoublesTheTipError) {
  double clean2 = 0, disturbed2 = 0;
  for (int i = 0; i < kScenes; ++i) {
    Scene s = scene(8);
    const model::Twists start = warmStart(s.twists);
    clean2 += tipError2(fit(s.seen, start), s.twists);
    const Eigen::Vector2d shift = GetParam() / view_.camera.fx * random_.direction<2>();
    s.seen[random_.integer(0, 7)].direction.colwise() += shift;
    disturbed2 += tipError2(fit(s.seen, start), s.twists);
  }
  std::printf("a tag of eight off by %d px: tip RMS %.2f mm, without %.2f mm\n", GetParam(),
              1e3 * std::sqrt(disturbed2 / kScenes), 1e3 * std::sqrt(clean2 / kScenes));
  EXPECT_LT(disturbed2, 4 * clean2);
}

INSTANTIATE_TEST_SUITE_P(Pixels, DisplacedTag, ::testing::Values(5, 10, 20, 100));

}  // namespace
}  // namespace helix_arm
