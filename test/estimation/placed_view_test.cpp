#include "helix_arm/localization/placed_view.hpp"

#include <algorithm>
#include <string>

#include <gtest/gtest.h>

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
                         ::testing::Values(Case{"TwoSections", 2, true, false},
                                           Case{"UnderALoad", 1, true, true}),
                         nameOfCase);

// Of the same misplaced rig, with all tags and with some.
TEST(Placements, DifferenceIsThatOfRepeatedFits) {
  const model::Arm arm = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView();
  const model::Shape shape = arm.twists(arm.inputAt(0.4));
  TwistFitOptions fit;
  fit.robust_scale = 100;
  const PlacedView placed = viewOf(view, fit, {0.0002, 0.2 * kDegree}, {0.001, 0.3 * kDegree});
  std::vector<int> all;
  for (const TagImage& one : visibleTags(view, shape, 0.3)) all.push_back(one.tag);
  const std::vector<int> some(all.begin(), all.end() - 1);
  const auto difference = placementDifference(placed, arm, shape, all, some);
  ASSERT_TRUE(difference);
  EXPECT_LT(difference->trace(), placementCovariance(placed, arm, shape, all)->trace());
  EXPECT_TRUE(placementDifference(placed, arm, shape, all, all)->isZero(0));
  TwistFitter fitter(view.layout, 1, fit);
  Random random(5);
  const Eigen::Matrix3d sampled = test::spreadOf(1500, [&] {
    const ArmView truth = misplaced(placed, arm, random);
    const auto tipOf = [&](const std::vector<int>& tags) {
      const TwistFit& result =
          fitter.fit(lookAgain(truth, shape, tags), view.X_CB, view.camera.focal(), shape);
      return Eigen::Vector3d(model::tipPose(result.shape).translation);
    };
    return Eigen::Vector3d(tipOf(some) - tipOf(all));
  });
  test::expectSpread(sampled, tipCovariance(shape, *difference), 0.2);
}

}  // namespace
}  // namespace helix_arm::estimation
