// Bending and shear of a tilted arm do nearly the same. What its captures know is a combination of
// both: it is reported with an error that holds, and predictions that use it are as certain as they
// claim.
#include <cstdio>

#include <gtest/gtest.h>

#include "estimation/calibration_data.hpp"

namespace helix_arm::estimation {
namespace {

constexpr int kRigs = 100;
constexpr int kCaptures = 21;
constexpr double kSharpNoise = 0.003;  // of twists [m], [rad]: both parameters are determined
constexpr double kDullNoise = 0.01;    // K_kappa is not

// Stiffness of true arms about the scene's.
const test::RigErrors kStiffnessErrors{0.3, 0.4, 0, 0, 0, 0, 0, 0};

// Bending and shear have comparable parts in the bending of this arm.
model::Arm tiltedArm() {
  test::Ring ring = test::helicalRing();
  ring.stiffness.gamma = 30;
  return test::ringArm(ring);
}

test::RigTruth drawTruth(const model::Arm& known, Random& random) {
  return test::drawRig(known, test::sampleView(0.8, 1, 8), kStiffnessErrors, random);
}

ArmCaptures noisyTwists(const model::Arm& known, const test::RigTruth& truth, double noise,
                        Random& random) {
  return twists(known, truth, randomPressures(known, kCaptures, random), noise, noise, random);
}

Calibration calibrationOf(const model::Arm& known, const test::RigTruth& truth, double noise,
                          Random& random, bool held_out) {
  CalibrationOptions options;
  options.held_out = held_out;
  options.next_pressures = 0;
  return calibrate({noisyTwists(known, truth, noise, random)}, options);
}

std::string twoDigits(double number) {
  char text[16];
  std::snprintf(text, sizeof text, "%.2f", number);
  return text;
}

// Log of the reported value over the true one.
double logError(const Combination& one, const test::RigTruth& truth) {
  double log = std::log(one.value);
  for (const Combination::Power& power : one.powers) {
    log -= power.exponent * std::log(truth.parameters.at(power.parameter));
  }
  return log;
}

double relativeErrorOf(const Parameter& one) { return one.standard_error / one.value; }

class CombinationOfATiltedArm : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Noise, CombinationOfATiltedArm, testing::Values(kSharpNoise, kDullNoise));

TEST_P(CombinationOfATiltedArm, IsFoundWithinItsErrors) {
  const double noise = GetParam();
  const model::Arm known = tiltedArm();
  int told = 0, covered = 0, bad_covered = 0, both_told = 0;
  std::vector<double> gains;
  for (int rig = 0; rig < kRigs; ++rig) {
    Random random(5000 + rig);
    const test::RigTruth truth = drawTruth(known, random);
    const Calibration found = calibrationOf(known, truth, noise, random, rig % 10 == 0);
    // Where neither stiffness is told alone, the calibration is refused.
    if (noise == kDullNoise && found.status == CalibrationStatus::kNotIdentifiable) continue;
    ASSERT_EQ(found.status, CalibrationStatus::kCalibrated) << rig << ": " << found.reason;
    // Where the data tell no combination, there is none.
    if (noise == kDullNoise && found.combinations.empty()) continue;
    ASSERT_EQ(found.combinations.size(), 2u) << rig;
    ++told;
    const Combination &well = found.combinations[0], &badly = found.combinations[1];
    EXPECT_TRUE(well.identifiable) << rig;
    EXPECT_LE(well.relative_error, badly.relative_error) << rig;
    EXPECT_GT(well.powers[1].exponent, 0) << rig << ": " << well.name;
    EXPECT_LT(badly.powers[1].exponent, 0) << rig << ": " << badly.name;
    EXPECT_EQ(well.name, well.powers[0].parameter + "^" + twoDigits(well.powers[0].exponent) + " " +
                             well.powers[1].parameter + "^" + twoDigits(well.powers[1].exponent));
    EXPECT_NEAR(std::hypot(well.powers[0].exponent, well.powers[1].exponent), 1, 1e-12);
    covered += std::abs(logError(well, truth)) < 2 * well.relative_error;
    bad_covered += std::abs(logError(badly, truth)) < 2 * badly.relative_error;
    both_told += parameter(found, "K_kappa").identifiable;
    const double single = std::min(relativeErrorOf(parameter(found, "K_gamma")),
                                   relativeErrorOf(parameter(found, "K_kappa")));
    gains.push_back(single / well.relative_error);
  }
  std::sort(gains.begin(), gains.end());
  std::printf(
      "noise %.3f: within 2 errors: well known %d, badly known %d of %d; K_kappa told %d; smallest "
      "single error over that of the combination: least %.2f, median %.2f\n",
      noise, covered, bad_covered, told, both_told, gains.front(), gains[gains.size() / 2]);
  EXPECT_GE(told, 0.8 * kRigs);
  EXPECT_GE(covered, 0.93 * told);
  EXPECT_GE(bad_covered, 0.93 * told);
  if (noise == kSharpNoise) {
    EXPECT_GE(gains.front(), 3);
  }
}

TEST(CalibrationCombinations, AnUntiltedArmHasNone) {
  const model::Arm known = test::ringArm(test::straightRing());
  for (int rig = 0; rig < 10; ++rig) {
    Random random(6000 + rig);
    const test::RigTruth truth = drawTruth(known, random);
    const Calibration found = calibrationOf(known, truth, kSharpNoise, random, true);
    ASSERT_EQ(found.status, CalibrationStatus::kCalibrated) << rig << ": " << found.reason;
    EXPECT_FALSE(parameter(found, "K_gamma").identifiable) << rig;
    EXPECT_TRUE(found.combinations.empty()) << rig << ": " << found.combinations.front().name;
  }
}

TEST(CalibrationCombinations, OneStiffnessAloneHasNone) {
  const model::Arm known = tiltedArm();
  Random random(1);
  const test::RigTruth truth = drawTruth(known, random);
  CalibrationOptions options;
  options.K_kappa = false;
  const Calibration found = calibrated({noisyTwists(known, truth, kDullNoise, random)}, options);
  EXPECT_TRUE(found.combinations.empty());
}

}  // namespace
}  // namespace helix_arm::estimation
