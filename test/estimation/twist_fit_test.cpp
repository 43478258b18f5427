#include "helix_arm/localization/twist_fit.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include <gtest/gtest.h>

#include "estimation/calibration_data.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "support/allocation_counter.hpp"
#include "support/loaded_arm.hpp"
#include "support/sample_view.hpp"
#include "support/test_size.hpp"

namespace helix_arm::estimation {
namespace {

// Under its own weight and one at its tip.
model::Shape sagging(const model::Arm& arm, const Eigen::VectorXd& pressure,
                     double K_eps = 1000.0) {
  const statics::LoadedArm loaded(arm, test::horizontalLoad(arm.sectionCount(), 0.25, K_eps), 5);
  const statics::Solution solution = loaded.solve(arm.twists(pressure));
  if (!solution.converged()) throw std::runtime_error("the sample load is too heavy");
  return solution.shape;
}

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

std::vector<CornerObservation> exactly(const ArmView& view, const model::Shape& shape) {
  Random unused(0);
  return test::observe(view, visibleTags(view, shape, 0.3), 0.0, unused);
}

// The objective by its definition: Cauchy's loss of each tag's squared distances in pixels.
double costByDefinition(const ArmView& view, const TwistFitOptions& options,
                        const std::vector<CornerObservation>& seen, const model::Shape& shape) {
  const double threshold = 8 * options.robust_scale * options.robust_scale;
  const std::vector<lie::SE3> poses = tagPoses(view.layout, shape);
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

TwistFitOptions tagsAlone() {
  TwistFitOptions options;
  options.corner_noise = 0.5;
  options.model_prior = {1e6, 1e6};
  return options;
}

// The pieces of a section deviate as the model's do.
void expectNoBetterNeighbour(const ArmView& view, const TwistFitOptions& options,
                             const std::vector<CornerObservation>& seen, const model::Shape& model,
                             const TwistFit& fit) {
  ASSERT_EQ(fit.status, FitStatus::kConverged);
  const double least = costByDefinition(view, options, seen, model.about(fit.twists));
  EXPECT_NEAR(fit.cost, least, 1e-9 * least);
  for (int k = 0; k < fit.twists.size(); ++k) {
    const double deviation = std::sqrt(fit.covariance(k, k));
    for (const double step : {-0.1 * deviation, 0.1 * deviation}) {
      model::Twists neighbour = fit.twists;
      neighbour.data()[k] += step;
      EXPECT_GT(costByDefinition(view, options, seen, model.about(neighbour)), least)
          << "entry " << k;
    }
  }
}

struct Scene {
  int sections;
  bool loaded;  // bent as the model says, but with other twists
};

class TwistFitOf : public ::testing::TestWithParam<Scene> {
 protected:
  model::Shape randomShape() {
    const Eigen::VectorXd pressure = test::randomInput(arm_, random_);
    return loaded_ ? sagging(arm_, pressure) : model::Shape(arm_.twists(pressure));
  }
  const int sections_ = GetParam().sections;
  const bool loaded_ = GetParam().loaded;
  const model::Arm arm_ = test::ringArm(test::helicalRing(), sections_);
  const ArmView view_ = test::sampleView(0.8 * sections_, sections_, 64 / sections_);
  Random random_{4};
};

TEST_P(TwistFitOf, ExactCornersGiveTheExactMeanTwists) {
  TwistFitOptions options;
  options.corner_noise = 0.01;  // converged is what this noise would hide
  if (loaded_) options.model_prior = {1e6, 1e6};
  TwistFitter fitter(view_.layout, sections_, options);
  for (int i = 0; i < 20; ++i) {
    const model::Shape model = randomShape();
    ASSERT_EQ(model.piecesPerSection() > 1, loaded_);
    const model::Twists twists = nearby(model.twists(), 0.005, 0.05, random_);
    const model::Shape shape = model.about(twists);
    const TwistFit& fit = fitter.fit(exactly(view_, shape), view_.X_CB, view_.camera.fx, model);
    ASSERT_EQ(fit.status, FitStatus::kConverged);
    EXPECT_LT((fit.twists - twists).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_LT((fit.shape.pieces() - shape.pieces()).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_LT((fit.shape.twists() - fit.twists).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_LT(fit.rms, 1e-3);
    EXPECT_EQ(fit.outliers(), 0);
  }
}

TEST_P(TwistFitOf, NoNeighbourOfTheAnswerIsBetter) {
  TwistFitter fitter(view_.layout, sections_, tagsAlone());
  for (int i = 0; i < 20; ++i) {
    const model::Shape shape = randomShape();
    auto seen = test::observe(view_, visibleTags(view_, shape, 0.3), 0.5, random_);
    seen[1].direction.array() += 0.01;  // ten pixels off: in the bend of the loss
    const model::Shape model = shape.about(nearby(shape.twists(), 0.002, 0.02, random_));
    const TwistFit& fit = fitter.fit(seen, view_.X_CB, view_.camera.fx, model);
    ASSERT_NO_FATAL_FAILURE(expectNoBetterNeighbour(view_, tagsAlone(), seen, model, fit));
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, TwistFitOf,
                         ::testing::Values(Scene{1, false}, Scene{3, false}, Scene{2, true}));

// What most tests fit: one section, and 32 tags around it.
class TwistFitTest : public ::testing::Test {
 protected:
  const model::Arm arm_ = test::ringArm(test::helicalRing());
  const ArmView view_ = test::sampleView();
};

TEST_F(TwistFitTest, ADisplacedTagIsNamedAndLosesItsSay) {
  TwistFitter fitter(view_.layout, 1, {});
  Random random(9);
  for (int i = 0; i < 30; ++i) {
    const model::Twists twists = arm_.twists(test::randomInput(arm_, random));
    auto seen = test::observe(view_, test::spread(visibleTags(view_, twists, 0.3), 8), 0.2, random);
    const int displaced = random.integer(0, 7);
    const Eigen::Vector2d shift = 0.02 * random.direction<2>();
    seen[displaced].direction.colwise() += shift;
    const TwistFit& fit = fitter.fit(seen, view_.X_CB, view_.camera.fx, twists);
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

TEST_F(TwistFitTest, TagsThatBelongElsewhereAreUnexplained) {
  const model::Twists twists = arm_.twists(arm_.inputAt(0.2));
  std::vector<CornerObservation> seen = exactly(view_, twists);
  const Corners first = seen.front().direction;
  for (std::size_t i = 0; i + 1 < seen.size(); ++i) seen[i].direction = seen[i + 1].direction;
  seen.back().direction = first;
  TwistFitter fitter(view_.layout, 1, {});
  EXPECT_EQ(fitter.fitCold(seen, view_.X_CB, view_.camera.fx, twists).status,
            FitStatus::kUnexplained);
}

TEST(TwistFit, APlanarArmStaysInItsPlane) {
  // A row of tags along the arm says next to nothing of torsion.
  TagLayout layout;
  layout.size = 0.031;
  for (int i = 0; i < 6; ++i) layout.tags.push_back({i, 0, (i + 1) / 6.0, {}});
  model::Twists twists(6, 1), start(6, 1);
  twists << 0.42, 0.01, 0, 0, 0, 0.8;
  start << 0.42, 0, 0.01, 0.2, 0.1, 0;
  Random random(14);
  const std::vector<PoseObservation> seen = posesOf(layout, twists, {}, 0.01, random);
  TwistFitOptions options;
  TwistFitter spatial(layout, 1, options);
  EXPECT_EQ(spatial.fitCold(seen, start).status, FitStatus::kUnderdetermined);
  options.planar = true;
  TwistFitter planar(layout, 1, options);
  const TwistFit& fit = planar.fitCold(seen, start);
  ASSERT_EQ(fit.status, FitStatus::kConverged);
  for (const int entry : {2, 3, 4}) {
    EXPECT_EQ(fit.twists(entry, 0), 0);
    EXPECT_EQ(fit.covariance(entry, entry), 0);
  }
  for (const int entry : {0, 1, 5}) {
    EXPECT_LT(std::abs(fit.twists(entry, 0) - twists(entry, 0)),
              5 * std::sqrt(fit.covariance(entry, entry)));
  }
}

TEST(TwistFit, WarmFitsDoNotAllocate) {
  const model::Arm arm = test::ringArm(test::helicalRing(), 2);
  const ArmView view = test::sampleView(1.6, 2);
  const model::Twists twists = arm.twists(arm.inputAt(0.2));
  Random random(11);
  for (const model::Shape& shape : {model::Shape(twists), sagging(arm, arm.inputAt(0.2))}) {
    const auto seen = test::observe(view, visibleTags(view, shape, 0.3), 0.3, random);
    for (const bool free : {false, true}) {
      TwistFitOptions options;
      options.free_base = options.free_border_shift = free;
      TwistFitter fitter(view.layout, 2, options);
      fitter.fit(seen, view.X_CB, view.camera.fx, shape);
      const test::AllocationCounter allocations;
      const TwistFit& fit = fitter.fit(seen, view.X_CB, view.camera.fx, shape);
      EXPECT_EQ(allocations.count(), 0u);
      EXPECT_EQ(fit.status, FitStatus::kConverged);
    }
  }
}

// 95 % quantiles of the chi-square of 6 and of 3.
constexpr double kChiSquare6 = 12.5916, kChiSquare3 = 7.8147;
const int kDraws = test::draws(250, 1000);
constexpr int kMostUnfinished = 5;  // a warm search may end early

// The ellipsoids that a fit's covariances draw around its answer hold the truth as often as they
// are said to.
struct Case {
  int tags;
  double noise;  // of the expected one
  bool free_base;
  double position_noise = 0.002;  // expected [m]
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

  void expectCoverage() {
    ASSERT_GE(fits_, kDraws - kMostUnfinished);
    const double twists = static_cast<double>(twists_) / fits_;
    const double tips = static_cast<double>(tips_) / fits_;
    std::printf("%d tags, noise x%g, base %s, %d fits: twists %.3f, tips %.3f\n", GetParam().tags,
                GetParam().noise, GetParam().free_base ? "free" : "fixed", fits_, twists, tips);
    for (const int inside : {twists_, tips_}) {
      EXPECT_GE(inside, test::isFullSize() ? 0.93 * fits_ : test::leastOf(fits_, 0.93));
      EXPECT_LE(inside, test::isFullSize() ? 0.97 * fits_ : test::mostOf(fits_, 0.97));
    }
  }

  model::Arm arm_;
  TwistFitOptions options_;
  Random random_{31};
  model::Twists model_, truth_;
  lie::SE3 X_B0B_;
  int fits_ = 0, twists_ = 0, tips_ = 0;
};

TEST_P(TwistFitCoverage, EllipsoidsOf95PercentHoldTheTruthIn95Percent) {
  const int tags = GetParam().tags;
  const double noise = GetParam().noise;
  const TagLayout layout = test::sampleLayout(1, tags);
  TwistFitter fitter(layout, 1, options_);
  for (int i = 0; i < kDraws; ++i) {
    draw();
    count(fitter.fitCold(posesOf(layout, truth_, X_B0B_, noise * options_.position_noise, random_),
                         model_));
  }
  expectCoverage();
}

INSTANTIATE_TEST_SUITE_P(Cases, TwistFitCoverage,
                         ::testing::Values(Case{4, 1, false}, Case{4, 3, true}, Case{21, 1, true},
                                           Case{21, 3, false}));
// As noisy as tags that common detectors find.
INSTANTIATE_TEST_SUITE_P(Noisy, TwistFitCoverage, ::testing::Values(Case{6, 1, true, 0.010}));

}  // namespace
}  // namespace helix_arm::estimation
