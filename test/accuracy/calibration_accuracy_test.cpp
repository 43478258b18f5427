// How well a calibration finds a rig that is wrong in everything: 100 helical arms whose stiffness,
// muscles, camera pose, tags and print are all off, seen at the paper's twelve pressures.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/calibration/calibration.hpp"
#include "helix_arm/model/curve.hpp"
#include "support/sample_rig.hpp"

namespace helix_arm {
namespace {

using namespace estimation;
using namespace test;

constexpr int kRigs = 100;
constexpr int kMostMisses = 5;
constexpr double kNoise = 0.2;  // [px]
constexpr int kTips = 30;
constexpr double kOff = 0.006;  // of the tip, before [m]

const RigErrors kErrors{0.25, 0.4, 0.03, 0.01, 0.02, 0.002, 0.052, 0.0003};

CalibrationOptions everything() {
  CalibrationOptions options;
  options.base = options.tags = options.bleed = true;
  options.length_scale = estimation::LengthScaling::kCommon;
  options.corner_floor = 0;  // these have none
  return options;
}

// Mean square distance of the tips that two models of the arm have [m^2].
double tipError2(const RigTruth& truth, const model::Arm& arm, const Eigen::VectorXd& scale,
                 Random& random) {
  double sum = 0;
  for (int i = 0; i < kTips; ++i) {
    const Eigen::VectorXd pressure = test::randomInput(arm, random);
    const model::Twists twists = arm.twistsOfLengths(arm.lengths(pressure).cwiseProduct(scale));
    sum += (model::tipPose(twists).translation -
            model::tipPose(test::shapeOf(truth, pressure)).translation)
               .squaredNorm();
  }
  return sum / kTips;
}

ArmCaptures photograph(const model::Arm& known, const ArmView& view, const RigTruth& truth,
                       Random& random) {
  ArmCaptures data{"rig", known, false, view.layout, view.X_CB, view.camera.fx, {}};
  for (const Eigen::VectorXd& pressure : test::twelvePressures(known)) {
    test::addCapture(data, pressure, test::observe(truth, pressure, kNoise, random));
  }
  return data;
}

TEST(CalibrationAccuracy, EveryParameterIsWithinThreeOfItsErrorsAndTheTipThreeTimesCloser) {
  const model::Arm known = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView(0.8, 1, 21, 3);
  const CalibrationOptions options = everything();

  struct Tally {
    int misses = 0;
    double square = 0;
  };
  std::map<std::string, Tally> tallies;
  std::vector<double> ratios;
  double sum_before = 0, sum_after = 0;
  for (int rig = 0; rig < kRigs; ++rig) {
    Random random(1000 + rig);
    const RigTruth truth = test::drawRig(known, view, kErrors, random);
    const Calibration found = calibrate({photograph(known, view, truth, random)}, options);
    ASSERT_EQ(found.status, CalibrationStatus::kCalibrated) << rig << ": " << found.reason;
    for (const Parameter& one : found.parameters) {
      const double z = (one.value - truth.parameters.at(one.name)) / one.standard_error;
      tallies[one.name].misses += std::abs(z) > 3;
      tallies[one.name].square += z * z;
    }
    model::Stiffness stiffness = found.stiffness.value_or(known.actuator(0).stiffness);
    Random tips(2000 + rig), same_tips(2000 + rig);
    const double before = tipError2(truth, known, Eigen::VectorXd::Ones(3), tips);
    const double after =
        tipError2(truth, known.withStiffness(stiffness), found.length_scale, same_tips);
    sum_before += before;
    sum_after += after;
    // A rig that happens to be right from the start has nothing to gain.
    if (std::sqrt(before) > kOff) ratios.push_back(std::sqrt(after / before));
  }
  int worst = 0;
  double square = 0;
  for (const auto& [name, tally] : tallies) {
    EXPECT_LE(tally.misses, kMostMisses) << name;
    EXPECT_LT(std::sqrt(tally.square / kRigs), 1.5) << name;
    worst = std::max(worst, tally.misses);
    square += tally.square / kRigs;
  }
  EXPECT_GE(tallies.size(), 130u);
  std::sort(ratios.begin(), ratios.end());
  ASSERT_GE(ratios.size(), 75u);
  EXPECT_LE(ratios.back(), 1.0 / 3);
  EXPECT_LE(std::sqrt(sum_after / sum_before), 1.0 / 3);
  std::printf(
      "%d rigs, %zu parameters: at most %d of %d beyond 3 standard errors, RMS %.2f of them\n"
      "tip, RMS: %.1f mm before, %.1f mm after; of %zu rigs that were off by more than %.0f mm, "
      "the "
      "worst ratio is %.3f\n",
      kRigs, tallies.size(), worst, kRigs, std::sqrt(square / static_cast<double>(tallies.size())),
      1e3 * std::sqrt(sum_before / kRigs), 1e3 * std::sqrt(sum_after / kRigs), ratios.size(),
      1e3 * kOff, ratios.back());
}

// In a tilted arm bending and shear do nearly the same, and K_kappa is held: here it is seen.
TEST(CalibrationAccuracy, StiffnessOfUntiltedArmsIsFoundWithinItsErrors) {
  const model::Arm known = test::ringArm(test::straightRing());
  const ArmView view = test::sampleView(0.8, 1, 21, 3);
  const CalibrationOptions options = everything();
  int misses = 0;
  double square = 0;
  for (int rig = 0; rig < kRigs; ++rig) {
    Random random(3000 + rig);
    const RigTruth truth = test::drawRig(known, view, kErrors, random);
    const Calibration found = calibrate({photograph(known, view, truth, random)}, options);
    ASSERT_EQ(found.status, CalibrationStatus::kCalibrated) << rig << ": " << found.reason;
    for (const Parameter& one : found.parameters) {
      if (one.name == "K_gamma") {
        EXPECT_FALSE(one.identifiable);
        EXPECT_EQ(one.value, one.initial);
      }
      if (one.name != "K_kappa") continue;
      EXPECT_TRUE(one.identifiable);
      EXPECT_LT(one.standard_error, 0.1 * one.value);
      const double z = (one.value - truth.parameters.at("K_kappa")) / one.standard_error;
      misses += std::abs(z) > 3;
      square += z * z / kRigs;
    }
  }
  EXPECT_LE(misses, kMostMisses);
  EXPECT_GT(std::sqrt(square), 0.5);
  EXPECT_LT(std::sqrt(square), 1.3);
  std::printf("K_kappa of %d untilted arms: %d beyond 3 standard errors, RMS %.2f of them\n", kRigs,
              misses, std::sqrt(square));
}

}  // namespace
}  // namespace helix_arm
