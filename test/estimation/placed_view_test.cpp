#include "helix_arm/localization/placed_view.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include "helix_arm/localization/camera_placement.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "support/loaded_arm.hpp"
#include "support/sample_view.hpp"
#include "support/tip_spread.hpp"

namespace helix_arm::estimation {
namespace {

using test::Random;

constexpr double kDegree = test::kPi / 180;

PlacedView viewOf(const ArmView& view, const TwistFitOptions& fit, const TagPrior& tag,
                  const BasePrior& base) {
  return {view, fit, {view.layout, tag, base}};
}

// A rig whose placements are off by what a PlacedView says of them.
ArmView misplaced(const PlacedView& placed, const model::Arm& arm, Random& random) {
  const auto draw = [&random](const lie::Vector6& deviations) {
    lie::Vector6 out;
    for (int i = 0; i < 6; ++i) out[i] = deviations[i] * random.normal();
    return out;
  };
  ArmView out = placed.view;
  out.X_CB = out.X_CB * lie::SE3::exp(draw(placed.deviations.base));
  for (std::size_t i = 0; i < out.layout.tags.size(); ++i) {
    TagPlacement& tag = out.layout.tags[i];
    tag = movedBy(tag, draw(placed.deviations.tags[i]), arm.restLength(tag.section));
  }
  return out;
}

// The tags `seen` as an exact camera sees them on another rig.
std::vector<CornerObservation> lookAgain(const ArmView& view, const model::Shape& shape,
                                         const std::vector<int>& seen) {
  Random unused(0);
  std::vector<TagImage> observations;
  for (const TagImage& one : visibleTags(view, shape, 0.0)) {
    if (std::find(seen.begin(), seen.end(), one.tag) != seen.end()) observations.push_back(one);
  }
  return test::observe(view, observations, 0.0, unused);
}

struct Case {
  const char* name;
  int sections;
  bool free_base;
  bool loaded;
};
std::string nameOfCase(const ::testing::TestParamInfo<Case>& info) { return info.param.name; }

class PlacementCovariance : public ::testing::TestWithParam<Case> {};

// Misplaced tags are fitted with the nominal placements; the errors are small enough for the linear
// propagation and for the weights to stay near 1.
TEST_P(PlacementCovariance, IsThatOfRepeatedFits) {
  const auto [name, sections, free_base, loaded] = GetParam();
  const model::Arm arm =
      loaded ? test::softHelicalArm() : test::ringArm(test::helicalRing(), sections);
  const statics::ArmModel model =
      loaded
          ? statics::ArmModel(arm, std::nullopt, test::weight(test::Posture::kHorizontal, 0.1, 900),
                              statics::TierSetting{statics::Tier::kLoaded, 5})
          : statics::ArmModel(arm);
  TwistFitOptions fit;
  fit.free_base = free_base;
  fit.base_prior = {0.001, 0.3 * kDegree};
  fit.robust_scale = 100;
  const ArmView view = test::sampleView(0.8 * sections, sections, 32 / sections);
  const PlacedView placed = viewOf(view, fit, {0.0005, 0.5 * kDegree}, fit.base_prior);
  placed.validate();
  const model::Shape shape = model.solve(arm.inputAt(0.4)).shape;
  EXPECT_EQ(shape.piecesPerSection() > 1, loaded);
  std::vector<int> tags;
  for (const TagImage& one : visibleTags(view, shape, 0.3)) tags.push_back(one.tag);
  ASSERT_GE(tags.size(), 6U);
  const auto covariance = placementCovariance(placed, arm, shape, tags);
  ASSERT_TRUE(covariance);

  TwistFitter fitter(view.layout, sections, fit);
  Random random(11);
  int fits = 0;
  const Eigen::Matrix3d sampled = test::spreadOf(1500, [&] {
    const ArmView truth = misplaced(placed, arm, random);
    const auto seen = lookAgain(truth, shape, tags);
    const TwistFit& result = fitter.fit(seen, view.X_CB, view.camera.focal(), shape);
    fits += result.status == FitStatus::kConverged && seen.size() == tags.size() ? 1 : 0;
    return model::tipPose(result.shape).translation;
  });
  EXPECT_EQ(fits, 1500);
  test::expectSpread(sampled, tipCovariance(shape, *covariance), 0.15);
}

INSTANTIATE_TEST_SUITE_P(All, PlacementCovariance,
                         ::testing::Values(Case{"FixedBase", 1, false, false},
                                           Case{"FreeBase", 1, true, false},
                                           Case{"TwoSections", 2, true, false},
                                           Case{"UnderALoad", 1, true, true}),
                         nameOfCase);

class Placements : public ::testing::Test {
 protected:
  const model::Arm arm_ = test::ringArm(test::helicalRing());
  const ArmView view_ = test::sampleView();
  const model::Shape shape_ = arm_.twists(arm_.inputAt(0.4));
  std::vector<int> seenTags() const {
    std::vector<int> out;
    for (const TagImage& one : visibleTags(view_, shape_, 0.3)) out.push_back(one.tag);
    return out;
  }
};

// Of the same misplaced rig, with all tags and with some.
TEST_F(Placements, DifferenceIsThatOfRepeatedFits) {
  TwistFitOptions fit;
  fit.robust_scale = 100;
  const PlacedView placed = viewOf(view_, fit, {0.0002, 0.2 * kDegree}, {0.001, 0.3 * kDegree});
  const std::vector<int> all = seenTags();
  const std::vector<int> some(all.begin(), all.end() - 1);
  const auto difference = placementDifference(placed, arm_, shape_, all, some);
  ASSERT_TRUE(difference);
  EXPECT_LT(difference->trace(), placementCovariance(placed, arm_, shape_, all)->trace());
  EXPECT_TRUE(placementDifference(placed, arm_, shape_, all, all)->isZero(0));
  TwistFitter fitter(view_.layout, 1, fit);
  Random random(5);
  const Eigen::Matrix3d sampled = test::spreadOf(1500, [&] {
    const ArmView truth = misplaced(placed, arm_, random);
    const auto tipOf = [&](const std::vector<int>& tags) {
      const TwistFit& result =
          fitter.fit(lookAgain(truth, shape_, tags), view_.X_CB, view_.camera.focal(), shape_);
      return Eigen::Vector3d(model::tipPose(result.shape).translation);
    };
    return Eigen::Vector3d(tipOf(some) - tipOf(all));
  });
  test::expectSpread(sampled, tipCovariance(shape_, *difference), 0.2);
}

// Of a base that is fitted with hardly any prior, on rigs whose base is where it is thought.
TEST_F(Placements, RigByPlacementsIsThatOfRepeatedFits) {
  TwistFitOptions fit;
  fit.free_base = fit.free_border_shift = true;
  fit.robust_scale = 100;
  PlacedView placed = viewOf(view_, fit, {0.0003, 0.3 * kDegree}, fit.base_prior);
  const std::vector<int> tags = seenTags();
  const auto covariance = rigByPlacements(placed, arm_, shape_, tags);
  ASSERT_TRUE(covariance);
  placed.deviations.base.setZero();
  TwistFitOptions wide = fit;
  wide.base_prior.translation *= 30;
  wide.base_prior.rotation *= 30;
  wide.border_shift_prior *= 30;
  TwistFitter fitter(view_.layout, 1, wide);
  Random random(6);
  const Eigen::Matrix3d sampled = test::spreadOf(1500, [&] {
    const ArmView truth = misplaced(placed, arm_, random);
    const TwistFit& result =
        fitter.fit(lookAgain(truth, shape_, tags), view_.X_CB, view_.camera.focal(), shape_);
    return Eigen::Vector3d(result.rig.mean.head<3>());
  });
  test::expectSpread(sampled, covariance->topLeftCorner<3, 3>(), 0.2);
  fit.free_base = false;
  const auto border_shift = rigByPlacements({view_, fit, placed.deviations}, arm_, shape_, tags);
  EXPECT_TRUE(border_shift->topRows<6>().isZero(0));
  EXPECT_GT((*border_shift)(6, 6), 0);
}

TEST(PlacementDeviations, AreThePriorsExceptOfTheBaseTag) {
  TagLayout layout = test::sampleLayout(1, 4);
  std::swap(layout.tags[0], layout.tags[2]);
  ASSERT_EQ(layout.baseTag(), 2);
  const PlacementDeviations deviations(layout, {0.002, 0.05}, {0.001, 0.01});
  lie::Vector6 tag, base;
  tag << 0.002, 0.002, 0.002, 0.05, 0.05, 0.05;
  base << 0.001, 0.001, 0.001, 0.01, 0.01, 0.01;
  for (const std::size_t i : {0U, 1U, 3U}) EXPECT_EQ(deviations.tags[i], tag);
  EXPECT_TRUE(deviations.tags[2].isZero(0));
  EXPECT_EQ(deviations.base, base);
}

// Placing the camera by the tags of an arm at rest.
struct Bench {
  model::Arm arm = test::ringArm({});
  model::Shape shape = arm.twists(arm.inputAt(0));
  ArmView view = test::sampleView();
  Random random{1};

  std::vector<CornerObservation> look(double noise) {
    return test::observe(view, visibleTags(view, shape, 0.3), noise, random);
  }
};

TEST(CameraPlacement, CovarianceOfTheCameraIsThatOfItsSmallMotions) {
  Random random(2);
  const auto pose = [&random] {
    lie::Vector6 xi;
    for (int i = 0; i < 6; ++i) xi[i] = random.normal();
    return lie::SE3::exp(xi);
  };
  const lie::SE3 X_WB = pose(), X_CB = pose();
  lie::Matrix6 L = lie::Matrix6::Random();
  const lie::Matrix6 covariance = L * L.transpose();
  // Position and rotation of the camera by differences, from the definition of xi.
  lie::Matrix6 J;
  const lie::SE3 nominal = X_WB * X_CB.inverse();
  constexpr double kStep = 1e-6;
  for (int j = 0; j < 6; ++j) {
    const lie::SE3 moved = X_WB * (X_CB * lie::SE3::exp(kStep * lie::Vector6::Unit(j))).inverse();
    const lie::SE3 turn{moved.rotation * nominal.rotation.transpose(), Eigen::Vector3d::Zero()};
    J.col(j) << (moved.translation - nominal.translation) / kStep, turn.log().tail<3>() / kStep;
  }
  const lie::Matrix6 expected = J * covariance * J.transpose();
  EXPECT_TRUE(cameraCovariance(X_WB, X_CB, covariance).isApprox(expected, 1e-5));
}

TEST(CameraPlacement, CornerErrorIsInPixelsAndInfiniteBehindTheCamera) {
  Bench bench;
  auto seen = bench.look(0);
  const double focal = bench.view.camera.focal();
  EXPECT_NEAR(cornerError(bench.view.layout, bench.shape, bench.view.X_CB, seen[0], focal), 0,
              1e-9);
  seen[0].direction.row(0).array() += 2 / focal;  // 2 px along one of two axes
  EXPECT_NEAR(cornerError(bench.view.layout, bench.shape, bench.view.X_CB, seen[0], focal),
              std::sqrt(2.0), 1e-9);
  lie::SE3 behind = bench.view.X_CB;
  behind.translation.z() -= 5;
  EXPECT_TRUE(std::isinf(cornerError(bench.view.layout, bench.shape, behind, seen[0], focal)));
}

}  // namespace
}  // namespace helix_arm::estimation
