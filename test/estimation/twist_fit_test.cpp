#include "helix_arm/localization/twist_fit.hpp"

#include <cmath>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "support/allocation_counter.hpp"
#include "support/linked_arm.hpp"
#include "support/sample_load.hpp"
#include "support/sample_view.hpp"

namespace helix_arm::estimation {
namespace {

using test::Random;

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

TEST_P(TwistFitOfSections, ExactCornersOfALoadedArmGiveTheExactMeanTwists) {
  // The load bends the arm as the model says, but its twists are others.
  const int sections = GetParam();
  const model::Arm arm = test::ringArm(test::helicalRing(), sections);
  const ArmView view = test::sampleView(0.8 * sections, sections, 64 / sections);
  TwistFitOptions options;
  options.corner_noise = 0.01;  // converged is what this noise would hide
  options.model_prior = {1e6, 1e6};
  TwistFitter fitter(view.layout, sections, options);
  Random random(24);
  for (int i = 0; i < 20; ++i) {
    const model::Shape model = sagging(arm, test::randomInput(arm, random));
    ASSERT_GT(model.piecesPerSection(), 1);
    const model::Twists twists = nearby(model.twists(), 0.005, 0.05, random);
    const model::Shape shape = model.about(twists);
    const TwistFit& fit = fitter.fit(exactly(view, shape), view.X_CB, view.camera.fx, model);
    ASSERT_EQ(fit.status, FitStatus::kConverged);
    EXPECT_LT((fit.twists - twists).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_LT((fit.shape.pieces() - shape.pieces()).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_LT((fit.shape.twists() - fit.twists).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_LT(fit.rms, 1e-3);
    // Where start and model deviate otherwise, it is the model that counts.
    const TwistFit& other = fitter.fit(exactly(view, shape), view.X_CB, view.camera.fx,
                                       model::Shape(model.twists()), model);
    EXPECT_LT((other.shape.pieces() - shape.pieces()).cwiseAbs().maxCoeff(), 1e-6);
  }
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

TEST_P(TwistFitOfSections, NoNeighbourOfTheAnswerIsBetterUnderLoad) {
  const int sections = GetParam();
  const model::Arm arm = test::ringArm(test::helicalRing(), sections);
  const ArmView view = test::sampleView(0.8 * sections, sections, 64 / sections);
  TwistFitter fitter(view.layout, sections, tagsAlone());
  Random random(25);
  for (int i = 0; i < 10; ++i) {
    const model::Shape model = sagging(arm, test::randomInput(arm, random));
    const auto seen = test::observe(view, visibleTags(view, model, 0.3), 0.5, random);
    const TwistFit& fit = fitter.fit(seen, view.X_CB, view.camera.fx, model);
    ASSERT_NO_FATAL_FAILURE(expectNoBetterNeighbour(view, tagsAlone(), seen, model, fit));
  }
}

TEST_P(TwistFitOfSections, NoNeighbourOfTheAnswerIsBetter) {
  const int sections = GetParam();
  const model::Arm arm = test::ringArm(test::helicalRing(), sections);
  const ArmView view = test::sampleView(0.8 * sections, sections, 64 / sections);
  TwistFitter fitter(view.layout, sections, tagsAlone());
  Random random(5);
  for (int i = 0; i < 20; ++i) {
    const model::Twists twists = arm.twists(test::randomInput(arm, random));
    auto seen = test::observe(view, visibleTags(view, twists, 0.3), 0.5, random);
    seen[1].direction.array() += 0.01;  // ten pixels off: in the bend of the loss
    const TwistFit& fit =
        fitter.fit(seen, view.X_CB, view.camera.fx, nearby(twists, 0.002, 0.02, random));
    ASSERT_NO_FATAL_FAILURE(expectNoBetterNeighbour(view, tagsAlone(), seen, twists, fit));
  }
}

INSTANTIATE_TEST_SUITE_P(Sections, TwistFitOfSections, ::testing::Values(1, 2, 3));

// How many pictures say how large their errors are.
struct Honesty {
  int tags;
  double noise;  // [px], of expected 0.3
  bool free_base;
};

class TwistFitHonesty : public ::testing::TestWithParam<Honesty> {};

TEST_P(TwistFitHonesty, ErrorsAreAsLargeAsTheyAreSaidToBe) {
  // In units of their covariance, e' C^-1 e, the twist's errors are chi-squared with a mean of 6
  // and the tip's of 3; a fit that sees few tags knows its own noise only roughly.
  const auto [tags, noise, free_base] = GetParam();
  const model::Arm arm = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView();
  TwistFitOptions options;
  options.free_base = free_base;
  options.base_prior = {0.005, 0.02};
  TwistFitter fitter(view.layout, 1, options);
  Random random(6);
  double twist_sum = 0, tip_sum = 0;
  const int scenes = 500;
  for (int i = 0; i < scenes; ++i) {
    const model::Twists twists = arm.twists(test::randomInput(arm, random));
    ArmView moved = view;
    lie::Vector6 offset = lie::Vector6::Zero();
    if (free_base) {
      for (int k = 0; k < 3; ++k) {
        offset[k] = options.base_prior.translation * random.normal();
        offset[3 + k] = options.base_prior.rotation * random.normal();
      }
    }
    const lie::SE3 X_B0B = lie::SE3::exp(offset);
    moved.X_CB = view.X_CB * X_B0B;
    const auto seen =
        test::observe(moved, test::spread(visibleTags(moved, twists, 0.3), tags), noise, random);
    const TwistFit& fit = fitter.fit(seen, view.X_CB, view.camera.fx, twists);
    ASSERT_EQ(fit.status, FitStatus::kConverged);
    const lie::Vector6 error = fit.twists.col(0) - twists.col(0);
    twist_sum += error.dot(fit.covariance.ldlt().solve(error));
    const Eigen::Vector3d tip_error = (fit.X_B0B * model::tipPose(fit.twists)).translation -
                                      (X_B0B * model::tipPose(twists)).translation;
    tip_sum += tip_error.dot(fit.tip_covariance.ldlt().solve(tip_error));
  }
  EXPECT_GT(twist_sum / scenes, 4.0);
  EXPECT_LT(twist_sum / scenes, 9.0);
  EXPECT_GT(tip_sum / scenes, 2.0);
  EXPECT_LT(tip_sum / scenes, 4.5);
}

INSTANTIATE_TEST_SUITE_P(Cases, TwistFitHonesty,
                         ::testing::Values(Honesty{8, 0.3, false}, Honesty{8, 0.6, false},
                                           Honesty{8, 1.0, false}, Honesty{4, 0.3, false},
                                           Honesty{2, 0.3, false}, Honesty{8, 0.3, true},
                                           Honesty{8, 1.0, true}, Honesty{4, 0.3, true},
                                           Honesty{2, 0.3, true}));

// In units of their covariance the errors are chi-squared with a mean of 6 and 3: no unbiased fit
// can do better (Cramer and Rao). What takes the arm for unloaded is wrong by far more than it
// says.
TEST(TwistFit, UnderLoadErrorsAreAsLargeAsTheyAreSaidToBeAndWithoutItInTheModelTheyAreNot) {
  const model::Arm arm = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView();
  TwistFitOptions options;
  options.model_prior = {1e6, 1e6};
  TwistFitter fitter(view.layout, 1, options);
  Random random(26);
  double twist_sum = 0, tip_sum = 0, ignorant_sum = 0, rms = 0, ignorant_rms = 0, curve = 0,
         ignorant_curve = 0;
  const int scenes = 300;
  for (int i = 0; i < scenes; ++i) {
    const model::Shape model = sagging(arm, test::randomInput(arm, random), 400.0);
    const model::Shape shape = model.about(nearby(model.twists(), 0.003, 0.03, random));
    const auto seen =
        test::observe(view, test::spread(visibleTags(view, shape, 0.3), 10), 0.3, random);
    const auto errorsOf = [&](const TwistFit& fit, double& twist, double& at_tip, double& worst) {
      const lie::Vector6 error = fit.twists.col(0) - shape.twists().col(0);
      twist += error.dot(fit.covariance.ldlt().solve(error));
      const Eigen::Vector3d off =
          model::tipPose(fit.shape).translation - model::tipPose(shape).translation;
      at_tip += off.dot(fit.tip_covariance.ldlt().solve(off));
      const auto fitted = model::sampleCurve(fit.shape, 17), real = model::sampleCurve(shape, 17);
      for (int k = 0; k < 17; ++k) {
        worst = std::max(worst, (fitted[k].X.translation - real[k].X.translation).norm());
      }
    };
    const TwistFit& fit = fitter.fit(seen, view.X_CB, view.camera.fx, model);
    ASSERT_EQ(fit.status, FitStatus::kConverged);
    errorsOf(fit, twist_sum, tip_sum, curve);
    rms += fit.rms / scenes;
    double unused = 0;
    const TwistFit& ignorant = fitter.fit(seen, view.X_CB, view.camera.fx, model.twists());
    errorsOf(ignorant, ignorant_sum, unused, ignorant_curve);
    ignorant_rms += ignorant.rms / scenes;
  }
  EXPECT_GT(twist_sum / scenes, 4.0);
  EXPECT_LT(twist_sum / scenes, 9.0);
  EXPECT_GT(tip_sum / scenes, 2.0);
  EXPECT_LT(tip_sum / scenes, 4.5);
  EXPECT_GT(ignorant_sum, 3 * twist_sum);
  EXPECT_GT(ignorant_rms, 1.5 * rms);
  EXPECT_GT(ignorant_curve, 3 * curve);
}

TEST(TwistFit, TipCovarianceIsThatOfTheTipsOfDrawnTwistsUnderLoad) {
  const model::Arm arm = test::ringArm(test::helicalRing(), 2);
  const model::Shape shape = sagging(arm, arm.inputAt(0.4));
  Random random(27);
  Eigen::MatrixXd root = Eigen::MatrixXd::NullaryExpr(12, 12, [&] { return random.normal(); });
  const Eigen::MatrixXd covariance = 1e-8 * root * root.transpose();
  root = covariance.llt().matrixL();
  const Eigen::Vector3d tip = model::tipPose(shape).translation;
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  const int draws = 40000;
  for (int i = 0; i < draws; ++i) {
    const Eigen::VectorXd step =
        root * Eigen::VectorXd::NullaryExpr(12, [&] { return random.normal(); });
    model::Twists moved = shape.twists();
    for (int k = 0; k < 12; ++k) moved.data()[k] += step[k];
    const Eigen::Vector3d d = model::tipPose(shape.about(moved)).translation - tip;
    sum += d * d.transpose();
  }
  const Eigen::Matrix3d drawn = sum / draws, linear = tipCovariance(shape, covariance);
  EXPECT_LT((drawn - linear).norm(), 0.04 * linear.norm());
}

TEST(TwistFit, ALoadedArmIsFoundFromTheModelAlone) {
  const model::Arm arm = test::ringArm(test::helicalRing(), 2);
  const TagLayout layout = test::sampleLayout(2, 8);
  TwistFitOptions options;
  options.position_noise = 1e-4;
  options.model_prior = {1e6, 1e6};
  TwistFitter fitter(layout, 2, options);
  Random random(28);
  for (int i = 0; i < 5; ++i) {
    const model::Shape model = sagging(arm, test::randomInput(arm, random));
    const model::Shape shape = model.about(nearby(model.twists(), 0.01, 0.3, random));
    const std::vector<lie::SE3> poses = tagPoses(layout, shape);
    std::vector<PoseObservation> seen;
    for (int tag = 0; tag < 16; ++tag) seen.push_back({tag, poses[tag]});
    const TwistFit& fit = fitter.fitCold(seen, model);
    ASSERT_EQ(fit.status, FitStatus::kConverged);
    EXPECT_LT((fit.shape.pieces() - shape.pieces()).cwiseAbs().maxCoeff(), 1e-4);
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
  options.model_prior = {1e6, 1e6};
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

TEST(TwistFit, ManyTagsALittleOffAreNoOutliers) {
  // Glued on 2 mm and 3 degrees off, all of them: the shape is a little wrong, the tags are not to
  // blame one by one.
  const model::Arm arm = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView();
  TwistFitter fitter(view.layout, 1, {});
  Random random(13);
  int unexplained = 0;
  double outliers = 0, tip2 = 0;
  const int scenes = 100;
  for (int i = 0; i < scenes; ++i) {
    ArmView glued = view;
    for (TagPlacement& tag : glued.layout.tags) {
      lie::Vector6 offset;
      for (int k = 0; k < 3; ++k) {
        offset[k] = 0.002 / std::sqrt(3.0) * random.normal();
        offset[3 + k] = 0.052 / std::sqrt(3.0) * random.normal();
      }
      tag.X_ST = tag.X_ST * lie::SE3::exp(offset);
    }
    const model::Twists twists = arm.twists(test::randomInput(arm, random));
    const auto seen = test::observe(glued, visibleTags(glued, twists, 0.35), 0.2, random);
    const TwistFit& fit = fitter.fit(seen, view.X_CB, view.camera.fx, twists);
    unexplained += fit.status == FitStatus::kConverged ? 0 : 1;
    outliers += static_cast<double>(fit.outliers()) / static_cast<double>(seen.size());
    tip2 +=
        (model::tipPose(fit.twists).translation - model::tipPose(twists).translation).squaredNorm();
  }
  EXPECT_EQ(unexplained, 0);
  EXPECT_LT(outliers / scenes, 0.05);
  EXPECT_LT(std::sqrt(tip2 / scenes), 0.006);
}

TEST(TwistFit, TagsThatBelongElsewhereAreUnexplained) {
  const model::Arm arm = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView();
  const model::Twists twists = arm.twists(arm.inputAt(0.2));
  std::vector<CornerObservation> seen = exactly(view, twists);
  const Corners first = seen.front().direction;
  for (std::size_t i = 0; i + 1 < seen.size(); ++i) seen[i].direction = seen[i + 1].direction;
  seen.back().direction = first;
  TwistFitter fitter(view.layout, 1, {});
  EXPECT_EQ(fitter.fitCold(seen, view.X_CB, view.camera.fx, twists).status,
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
  std::vector<PoseObservation> seen;
  Random random(14);
  const std::vector<lie::SE3> poses = tagPoses(layout, twists);
  for (int i = 0; i < 6; ++i) {
    seen.push_back({i, poses[i]});
    for (int k = 0; k < 3; ++k) seen.back().X_BT.translation[k] += 0.01 * random.normal();
  }
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
  EXPECT_THROW(fitter.fit(seen, view.X_CB, 930, model::Twists(model::Twists::Zero(6, 2))),
               std::invalid_argument);
  EXPECT_THROW(fitter.fit(seen, view.X_CB, -1, twists), std::invalid_argument);
  std::vector<CornerObservation> wrong = seen;
  wrong[0].tag = 64;
  EXPECT_THROW(fitter.fit(wrong, view.X_CB, 930, twists), std::invalid_argument);
  wrong = seen;
  wrong[1].tag = wrong[0].tag;
  EXPECT_THROW(fitter.fit(wrong, view.X_CB, 930, twists), std::invalid_argument);
  wrong = seen;
  wrong[0].direction(1, 2) = std::nan("");
  EXPECT_THROW(fitter.fit(wrong, view.X_CB, 930, twists), std::invalid_argument);
  TwistFitOptions options;
  options.corner_noise = 0;
  EXPECT_THROW(TwistFitter(view.layout, 1, options), std::invalid_argument);
  EXPECT_THROW(TwistFitter(view.layout, 0, {}), std::invalid_argument);
}

TEST(TwistFit, PlatesAndAToolAreWhereTheModelHasThem) {
  const model::Arm arm = test::linkedArm();
  ArmView view = test::sampleView(1.6, 2, 32);
  TwistFitter fitter(view.layout, 2, tagsAlone());
  Random random(36);
  for (int i = 0; i < 10; ++i) {
    const model::Shape model = model::shapeOf(arm, arm.twists(test::randomInput(arm, random)));
    const model::Shape shape = model.about(nearby(model.twists(), 0.005, 0.05, random));
    const TwistFit& exact = fitter.fit(exactly(view, shape), view.X_CB, view.camera.fx, model);
    ASSERT_EQ(exact.status, FitStatus::kConverged);
    EXPECT_LT((exact.twists - shape.twists()).cwiseAbs().maxCoeff(), 1e-5);
    EXPECT_LT((model::tipPose(exact.shape).translation - model::tipPose(shape).translation).norm(),
              1e-5);
    const auto seen = test::observe(view, visibleTags(view, shape, 0.3), 0.5, random);
    const TwistFit& fit = fitter.fit(seen, view.X_CB, view.camera.fx, model);
    ASSERT_NO_FATAL_FAILURE(expectNoBetterNeighbour(view, tagsAlone(), seen, model, fit));
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
      options.free_base = options.free_bleed = free;
      TwistFitter fitter(view.layout, 2, options);
      fitter.fit(seen, view.X_CB, view.camera.fx, shape);
      const test::AllocationCounter allocations;
      const TwistFit& fit = fitter.fit(seen, view.X_CB, view.camera.fx, shape);
      EXPECT_EQ(allocations.count(), 0u);
      EXPECT_EQ(fit.status, FitStatus::kConverged);
    }
  }
}

}  // namespace
}  // namespace helix_arm::estimation
