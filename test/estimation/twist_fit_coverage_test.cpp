// The ellipsoids that a fit's covariances draw around its answer hold the truth as often as they
// are said to.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/curve.hpp"
#include "support/sample_view.hpp"

namespace helix_arm::estimation {
namespace {

using test::Random;

// 95 % quantiles of the chi-square of 6 and of 3.
constexpr double kChiSquare6 = 12.5916, kChiSquare3 = 7.8147;
constexpr int kDraws = 1000;
constexpr int kMostUnfinished = 5;  // a warm search may end early
// Of tags on one side, what is not determined is refused, not measured.
constexpr int kLeastOneSided = 600;

struct Case {
  int tags;
  double noise;  // of the expected one
  bool free_base;
  double position_noise = 0.002;  // expected [m]
  int sides = 4;                  // of the arm that have tags
};

class TwistFitCoverage : public ::testing::TestWithParam<Case> {
 protected:
  TwistFitCoverage() : arm_(test::ringArm(test::helicalRing())) {
    options_.free_base = GetParam().free_base;
    options_.position_noise = GetParam().position_noise;
    options_.base_prior = {0.002, 0.0087};
  }

  // What the model expects, and what the arm really does.
  void draw() {
    model_ = arm_.twists(test::randomInput(arm_, random_));
    truth_ = model_;
    for (int i = 0; i < 6; ++i) truth_(i, 0) += (i < 3 ? 0.01 : 0.2) * random_.normal();
    lie::Vector6 offset = lie::Vector6::Zero();
    for (int i = 0; GetParam().free_base && i < 6; ++i) {
      const BasePrior& prior = options_.base_prior;
      offset[i] = (i < 3 ? prior.translation : prior.rotation) * random_.normal();
    }
    X_B0B_ = lie::SE3::exp(offset);
  }

  void count(const TwistFit& fit) {
    if (fit.status != FitStatus::kConverged) return;
    ++fits_;
    const lie::Vector6 error = fit.twists.col(0) - truth_.col(0);
    if (error.dot(fit.covariance.ldlt().solve(error)) <= kChiSquare6) ++twists_;
    const Eigen::Vector3d off = (fit.X_B0B * model::tipPose(fit.twists)).translation -
                                (X_B0B_ * model::tipPose(truth_)).translation;
    if (off.dot(fit.tip_covariance.ldlt().solve(off)) <= kChiSquare3) ++tips_;
  }

  void expectCoverage(const char* readings) {
    ASSERT_GE(fits_, GetParam().sides > 1 ? kDraws - kMostUnfinished : kLeastOneSided);
    const double twists = static_cast<double>(twists_) / fits_;
    const double tips = static_cast<double>(tips_) / fits_;
    std::printf("%d tags, %s, noise x%g, base %s, %d fits: twists %.3f, tips %.3f\n",
                GetParam().tags, readings, GetParam().noise,
                GetParam().free_base ? "free" : "fixed", fits_, twists, tips);
    for (const double coverage : {twists, tips}) {
      EXPECT_GE(coverage, 0.93);
      EXPECT_LE(coverage, 0.97);
    }
  }

  model::Arm arm_;
  TwistFitOptions options_;
  Random random_{31};
  model::Twists model_, truth_;
  lie::SE3 X_B0B_;
  int fits_ = 0, twists_ = 0, tips_ = 0;
};

class TwistFitCoverageOfPlaces : public TwistFitCoverage {};

TEST_P(TwistFitCoverageOfPlaces, EllipsoidsOf95PercentHoldTheTruthIn95Percent) {
  const int tags = GetParam().tags;
  const double noise = GetParam().noise;
  const TagLayout layout = test::sampleLayout(1, tags, GetParam().sides);
  TwistFitter fitter(layout, 1, options_);
  for (int i = 0; i < kDraws; ++i) {
    draw();
    std::vector<PoseObservation> seen;
    const std::vector<lie::SE3> poses = tagPoses(layout, truth_);
    for (int tag = 0; tag < tags; ++tag) {
      seen.push_back({tag, X_B0B_ * poses[tag]});
      for (int k = 0; k < 3; ++k) {
        seen.back().X_BT.translation[k] += noise * options_.position_noise * random_.normal();
      }
    }
    count(fitter.fitCold(seen, model_));
  }
  expectCoverage("places");
}

TEST_P(TwistFitCoverage, EllipsoidsOf95PercentOfCornersHoldTheTruthIn95Percent) {
  const int tags = GetParam().tags;
  const double noise = GetParam().noise;
  const ArmView view = test::sampleView();
  TwistFitter fitter(view.layout, 1, options_);
  for (int i = 0; i < kDraws; ++i) {
    draw();
    ArmView moved = view;
    moved.X_CB = view.X_CB * X_B0B_;
    const std::vector<TagImage> visible = visibleTags(moved, truth_, 0.3);
    // As many as there are where the arm turns others away.
    const int some = std::min(tags / 2, static_cast<int>(visible.size()));
    const auto seen =
        test::observe(moved, test::spread(visible, some), noise * options_.corner_noise, random_);
    count(fitter.fit(seen, view.X_CB, view.camera.fx, model_));
  }
  expectCoverage("corners of half as many");
}

const auto kCases =
    ::testing::Values(Case{4, 1, false}, Case{4, 1, true}, Case{4, 3, false}, Case{4, 3, true},
                      Case{8, 1, false}, Case{8, 1, true}, Case{8, 3, false}, Case{8, 3, true},
                      Case{21, 1, false}, Case{21, 1, true}, Case{21, 3, false}, Case{21, 3, true});
INSTANTIATE_TEST_SUITE_P(Cases, TwistFitCoverage, kCases);
INSTANTIATE_TEST_SUITE_P(Cases, TwistFitCoverageOfPlaces, kCases);
// As noisy as tags that common detectors find, around the arm and on one side of it: there they
// leave its rotation about them open to some tenths of a radian.
INSTANTIATE_TEST_SUITE_P(Noisy, TwistFitCoverageOfPlaces,
                         ::testing::Values(Case{6, 1, false, 0.010}, Case{6, 1, true, 0.010},
                                           Case{6, 1, false, 0.010, 1},
                                           Case{6, 1, true, 0.010, 1}));

}  // namespace
}  // namespace helix_arm::estimation
