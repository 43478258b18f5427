#include "helix_arm/estimation/twist_fit.hpp"

#include <cmath>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "support/allocation_counter.hpp"
#include "support/sample_view.hpp"

namespace helix_arm::estimation {
namespace {

using test::Random;

model::Twists nearby(const model::Twists& twists, double length, double angle, Random& random) {
  model::Twists out = twists;
  for (int k = 0; k < out.cols(); ++k) {
    for (int i = 0; i < 3; ++i) {
      out(i, k) += length * random.normal();
      out(3 + i, k) += angle * random.normal();
    }
  }
  return out;
}

std::vector<CornerObservation> exactly(const ArmView& view, const model::Twists& twists) {
  Random unused(0);
  return test::observe(view, visibleTags(view, twists, 0.3), 0.0, unused);
}

// The objective by its definition: Cauchy's loss of each tag's squared distances in pixels.
double costByDefinition(const ArmView& view, const TwistFitOptions& options,
                        const std::vector<CornerObservation>& seen, const model::Twists& twists) {
  const double threshold = 8 * options.robust_scale * options.robust_scale;
  const std::vector<lie::SE3> poses = tagPoses(view.layout, twists);
  const Corners plane = view.layout.corners();
  double cost = 0;
  for (const CornerObservation& tag : seen) {
    double square = 0;
    for (int c = 0; c < 4; ++c) {
      const Eigen::Vector3d p =
          view.X_CB * (poses[tag.tag] * Eigen::Vector3d(plane(0, c), plane(1, c), 0));
      square += (p.head<2>() / p.z() - tag.direction.col(c)).squaredNorm();
    }
    square *= std::pow(view.camera.fx / options.corner_noise, 2);
    cost += threshold * std::log(1 + square / threshold);
  }
  return cost;
}

class TwistFitOfSections : public ::testing::TestWithParam<int> {};

TEST_P(TwistFitOfSections, ExactCornersGiveTheExactTwists) {
  const int sections = GetParam();
  const model::Arm arm = test::ringArm(test::helicalRing(), sections);
  const ArmView view = test::sampleView(0.8 * sections, sections, 64 / sections);
  TwistFitOptions options;
  options.corner_noise = 0.01;  // converged is what this noise would hide
  TwistFitter fitter(view.layout, sections, options);
  Random random(4);
  for (int i = 0; i < 20; ++i) {
    const model::Twists twists = arm.twists(test::randomInput(arm, random));
    const TwistFit& fit = fitter.fit(exactly(view, twists), view.X_CB, view.camera.fx,
                                     nearby(twists, 0.005, 0.05, random));
    ASSERT_EQ(fit.status, FitStatus::kConverged);
    EXPECT_LT((fit.twists - twists).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_LT(fit.rms, 1e-3);
    EXPECT_EQ(fit.outliers(), 0);
  }
}

TEST_P(TwistFitOfSections, NoNeighbourOfTheAnswerIsBetter) {
  const int sections = GetParam();
  const model::Arm arm = test::ringArm(test::helicalRing(), sections);
  const ArmView view = test::sampleView(0.8 * sections, sections, 64 / sections);
  TwistFitOptions options;
  options.corner_noise = 0.5;
  TwistFitter fitter(view.layout, sections, options);
  Random random(5);
  for (int i = 0; i < 20; ++i) {
    const model::Twists twists = arm.twists(test::randomInput(arm, random));
    auto seen = test::observe(view, visibleTags(view, twists, 0.3), 0.5, random);
    seen[1].direction.array() += 0.01;  // ten pixels off: in the bend of the loss
    const TwistFit& fit =
        fitter.fit(seen, view.X_CB, view.camera.fx, nearby(twists, 0.002, 0.02, random));
    ASSERT_EQ(fit.status, FitStatus::kConverged);
    const double least = costByDefinition(view, options, seen, fit.twists);
    EXPECT_NEAR(fit.cost, least, 1e-9 * least);
    for (int k = 0; k < 6 * sections; ++k) {
      const double deviation = std::sqrt(fit.covariance(k, k));
      for (const double step : {-0.1 * deviation, 0.1 * deviation}) {
        model::Twists neighbour = fit.twists;
        neighbour.data()[k] += step;
        EXPECT_GT(costByDefinition(view, options, seen, neighbour), least) << "entry " << k;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Sections, TwistFitOfSections, ::testing::Values(1, 2, 3));

TEST(TwistFit, CovarianceIsThatOfManyPictures) {
  // The error in units of the covariance, e' C^-1 e, is chi-squared: 6 on average.
  const model::Arm arm = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView();
  Random random(6);
  for (const double noise : {0.15, 0.3, 0.6}) {
    TwistFitter fitter(view.layout, 1, {});  // which expects 0.3 px
    double sum = 0;
    const int scenes = 600;
    for (int i = 0; i < scenes; ++i) {
      const model::Twists twists = arm.twists(test::randomInput(arm, random));
      const auto seen =
          test::observe(view, test::spread(visibleTags(view, twists, 0.3), 8), noise, random);
      const TwistFit& fit = fitter.fit(seen, view.X_CB, view.camera.fx, twists);
      ASSERT_EQ(fit.status, FitStatus::kConverged);
      const lie::Vector6 error = fit.twists.col(0) - twists.col(0);
      sum += error.dot(fit.covariance.ldlt().solve(error));
    }
    EXPECT_NEAR(sum / scenes, 6.0, 1.2) << noise << " px";
  }
}

TEST(TwistFit, TipCovarianceIsThatOfTheTipsOfDrawnTwists) {
  const model::Arm arm = test::ringArm(test::helicalRing(), 2);
  const model::Twists twists = arm.twists(arm.inputAt(0.4));
  Random random(7);
  Eigen::MatrixXd root = Eigen::MatrixXd::NullaryExpr(12, 12, [&] { return random.normal(); });
  const Eigen::MatrixXd covariance = 1e-8 * root * root.transpose();
  root = covariance.llt().matrixL();
  const Eigen::Vector3d tip = model::tipPose(twists).translation;
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  const int draws = 40000;
  for (int i = 0; i < draws; ++i) {
    const Eigen::VectorXd step =
        root * Eigen::VectorXd::NullaryExpr(12, [&] { return random.normal(); });
    model::Twists moved = twists;
    for (int k = 0; k < 12; ++k) moved.data()[k] += step[k];
    const Eigen::Vector3d d = model::tipPose(moved).translation - tip;
    sum += d * d.transpose();
  }
  const Eigen::Matrix3d drawn = sum / draws, linear = tipCovariance(twists, covariance);
  EXPECT_LT((drawn - linear).norm(), 0.04 * linear.norm());
}

TEST(TwistFit, AMovedBaseIsFoundAndLeavesTheTwistsAlone) {
  const model::Arm arm = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView();
  lie::Vector6 offset;
  offset << 0.004, -0.003, 0.002, 0.01, -0.015, 0.008;
  ArmView moved = view;
  moved.X_CB = view.X_CB * lie::SE3::exp(offset);
  const model::Twists twists = arm.twists(arm.inputAt(0.2));
  TwistFitOptions options;
  options.free_base = true;
  options.base_prior = {1.0, 1.0};  // says nothing: the tags alone decide
  options.corner_noise = 0.01;
  TwistFitter fitter(view.layout, 1, options);
  const TwistFit& fit = fitter.fit(exactly(moved, twists), view.X_CB, view.camera.fx, twists);
  ASSERT_EQ(fit.status, FitStatus::kConverged);
  EXPECT_LT((fit.X_B0B.log() - offset).cwiseAbs().maxCoeff(), 1e-5);
  EXPECT_LT((fit.twists - twists).cwiseAbs().maxCoeff(), 1e-5);
}

TEST(TwistFit, ATightPriorHoldsTheBase) {
  const model::Arm arm = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView();
  const model::Twists twists = arm.twists(arm.inputAt(0.2));
  TwistFitOptions options;
  options.free_base = true;
  options.base_prior = {1e-9, 1e-9};
  Random random(8);
  const auto seen = test::observe(view, visibleTags(view, twists, 0.3), 0.5, random);
  TwistFitter held(view.layout, 1, options), fixed(view.layout, 1, {});
  const model::Twists with = held.fit(seen, view.X_CB, view.camera.fx, twists).twists;
  const TwistFit& without = fixed.fit(seen, view.X_CB, view.camera.fx, twists);
  EXPECT_LT((with - without.twists).cwiseAbs().maxCoeff(), 1e-6);
}

TEST(TwistFit, BleedIsFoundBesideTheTwists) {
  const model::Arm arm = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView();
  const model::Twists twists = arm.twists(arm.inputAt(0.2));
  ArmView bled = view;
  bled.layout.size = view.layout.size - 2 * 0.0004;
  const auto seen = exactly(bled, twists);
  TwistFitOptions options;
  options.corner_noise = 0.01;
  TwistFitter ignorant(view.layout, 1, options);
  options.free_bleed = true;
  TwistFitter aware(view.layout, 1, options);
  const TwistFit& fit = aware.fit(seen, view.X_CB, view.camera.fx, twists);
  ASSERT_EQ(fit.status, FitStatus::kConverged);
  EXPECT_NEAR(fit.bleed, 0.0004, 1e-6);
  EXPECT_LT((fit.twists - twists).cwiseAbs().maxCoeff(), 1e-5);
  const TwistFit& biased = ignorant.fit(seen, view.X_CB, view.camera.fx, twists);
  EXPECT_GT((biased.twists - twists).cwiseAbs().maxCoeff(), 1e-3);
}

TEST(TwistFit, ADisplacedTagIsNamedAndLosesItsSay) {
  const model::Arm arm = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView();
  TwistFitter fitter(view.layout, 1, {});
  Random random(9);
  for (int i = 0; i < 30; ++i) {
    const model::Twists twists = arm.twists(test::randomInput(arm, random));
    auto seen = test::observe(view, test::spread(visibleTags(view, twists, 0.3), 8), 0.2, random);
    const int displaced = random.integer(0, 7);
    const Eigen::Vector2d shift = 0.02 * random.direction<2>();
    seen[displaced].direction.colwise() += shift;
    const TwistFit& fit = fitter.fit(seen, view.X_CB, view.camera.fx, twists);
    ASSERT_EQ(fit.status, FitStatus::kConverged);
    for (int k = 0; k < 8; ++k) {
      EXPECT_EQ(fit.tags[k].outlier, k == displaced);
      EXPECT_EQ(fit.tags[k].tag, seen[k].tag);
    }
    EXPECT_LT(fit.tags[displaced].weight, 0.15);
    EXPECT_LT((model::tipPose(fit.twists).translation - model::tipPose(twists).translation).norm(),
              0.005);
  }
}

TEST(TwistFit, PosesGiveTheTwistsToo) {
  const model::Arm arm = test::ringArm(test::helicalRing(), 2);
  const TagLayout layout = test::sampleLayout(2, 8);
  Random random(10);
  for (const double rotation_noise : {0.0, 5e-4}) {
    TwistFitOptions options;
    options.position_noise = 1e-4;  // converged is what this noise would hide
    options.rotation_noise = rotation_noise;
    TwistFitter fitter(layout, 2, options);
    for (int i = 0; i < 20; ++i) {
      const model::Twists twists = arm.twists(test::randomInput(arm, random));
      const std::vector<lie::SE3> poses = tagPoses(layout, twists);
      std::vector<PoseObservation> seen;
      for (int tag = 0; tag < 16; ++tag) seen.push_back({tag, poses[tag]});
      const TwistFit& fit = fitter.fit(seen, nearby(twists, 0.01, 0.1, random));
      ASSERT_EQ(fit.status, FitStatus::kConverged);
      EXPECT_LT((fit.twists - twists).cwiseAbs().maxCoeff(), 1e-4);
    }
  }
}

TEST(TwistFit, TooFewTagsAreNoMeasurement) {
  const model::Arm arm = test::ringArm(test::helicalRing(), 2);
  const ArmView view = test::sampleView(1.6, 2);
  const model::Twists twists = arm.twists(arm.inputAt(0.2));
  TwistFitter fitter(view.layout, 2, {});
  std::vector<CornerObservation> seen = exactly(view, twists);
  EXPECT_EQ(fitter.fit({}, view.X_CB, view.camera.fx, twists).status, FitStatus::kUnderdetermined);
  // Many tags on the first section say nothing of the second.
  std::vector<CornerObservation> first;
  for (const auto& tag : seen) {
    if (view.layout.tags[tag.tag].section == 0) first.push_back(tag);
  }
  ASSERT_GT(first.size(), 4u);
  EXPECT_EQ(fitter.fit(first, view.X_CB, view.camera.fx, twists).status,
            FitStatus::kUnderdetermined);
  EXPECT_EQ(fitter.fitCold(first, view.X_CB, view.camera.fx, twists).status,
            FitStatus::kUnderdetermined);
}

TEST(TwistFit, AnArmBehindTheCameraDoesNotConverge) {
  const model::Arm arm = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView();
  const model::Twists twists = arm.twists(arm.inputAt(0.2));
  lie::SE3 behind = view.X_CB;
  behind.translation.z() = -0.8;
  TwistFitter fitter(view.layout, 1, {});
  EXPECT_EQ(fitter.fit(exactly(view, twists), behind, view.camera.fx, twists).status,
            FitStatus::kNotConverged);
}

TEST(TwistFit, CallsThatMakeNoSenseAreRefused) {
  const ArmView view = test::sampleView();
  TwistFitter fitter(view.layout, 1, {});
  model::Twists twists(6, 1);
  twists << 0.4, 0, 0, 0, 0, 0;
  std::vector<CornerObservation> seen = exactly(view, twists);
  EXPECT_THROW(fitter.fit(seen, view.X_CB, 930, model::Twists::Zero(6, 2)), std::invalid_argument);
  seen[0].tag = 64;
  EXPECT_THROW(fitter.fit(seen, view.X_CB, 930, twists), std::invalid_argument);
  TwistFitOptions options;
  options.corner_noise = 0;
  EXPECT_THROW(TwistFitter(view.layout, 1, options), std::invalid_argument);
  EXPECT_THROW(TwistFitter(view.layout, 0, {}), std::invalid_argument);
}

TEST(TwistFit, WarmFitsDoNotAllocate) {
  const model::Arm arm = test::ringArm(test::helicalRing(), 2);
  const ArmView view = test::sampleView(1.6, 2);
  const model::Twists twists = arm.twists(arm.inputAt(0.2));
  Random random(11);
  const auto seen = test::observe(view, visibleTags(view, twists, 0.3), 0.3, random);
  for (const bool free : {false, true}) {
    TwistFitOptions options;
    options.free_base = options.free_bleed = free;
    TwistFitter fitter(view.layout, 2, options);
    fitter.fit(seen, view.X_CB, view.camera.fx, twists);
    const test::AllocationCounter allocations;
    const TwistFit& fit = fitter.fit(seen, view.X_CB, view.camera.fx, twists);
    EXPECT_EQ(allocations.count(), 0u);
    EXPECT_EQ(fit.status, FitStatus::kConverged);
  }
}

}  // namespace
}  // namespace helix_arm::estimation
