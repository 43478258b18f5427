// Verdicts and errors of calibrations, over many data sets drawn from what their priors say: what
// the captures determine is found, what is called identifiable is known, and errors hold whatever
// is left out of the fit.
#include <cstdio>
#include <map>

#include <gtest/gtest.h>

#include "estimation/calibration_data.hpp"
#include "support/test_size.hpp"

namespace helix_arm::estimation {
namespace {

constexpr double kCurvatureNoise = 0.02;  // [rad]
constexpr double kTwistNoise = 0.01;      // [m], [rad]
constexpr double kPoseNoise = 0.01;       // [m]
const int kRigs = test::draws(10, 100);
constexpr double kCornerNoise = 0.2;  // [px]

// 21 captures of twists, or of tags.
ArmCaptures readings(bool tags, const model::Arm& known, const ArmView& view,
                     const test::RigTruth& truth, Random& random) {
  const Pressures pressures = randomPressures(known, 21, random);
  return tags ? poses(known, view.layout, truth, pressures, kPoseNoise, random)
              : twists(known, truth, pressures, kTwistNoise, kTwistNoise, random);
}

// Of one parameter, over many data sets, in its standard errors.
struct Tally {
  int count = 0, covered = 0, told = 0;
  double square = 0, worst = 0;

  void add(const Parameter& one, double truth) {
    const double z = (one.value - truth) / one.standard_error;
    ++count;
    covered += std::abs(z) < 1.96;
    told += one.identifiable;
    square += z * z;
    worst = std::max(worst, std::abs(z));
  }
  double coverage() const { return static_cast<double>(covered) / count; }
  // Of all draws 95 % intervals cover this share at least, of a few what chance leaves.
  bool covers(double share) const {
    return covered >= (test::isFullSize() ? share * count : test::leastOf(count, 0.95));
  }
  double rms() const { return std::sqrt(square / count); }
};
using Tallies = std::map<std::string, Tally>;

// Verdict and error agree: see Parameter::identifiable.
void expectAgreement(const Calibration& found, int set) {
  for (const Parameter& one : found.parameters) {
    if (!one.identifiable || (one.name[0] != 'K' && one.name[0] != 'l')) continue;
    EXPECT_LE(one.standard_error, (kLargestRelativeError + 1e-9) * one.value)
        << set << ": " << one.name;
  }
}

void print(const char* what, const Tallies& tallies) {
  for (const auto& [name, tally] : tallies) {
    std::printf("%-10s %-12s %4d: told %4d, 95 %% intervals cover %.3f, RMS %.2f, worst %.1f\n",
                what, name.c_str(), tally.count, tally.told, tally.coverage(), tally.rms(),
                tally.worst);
  }
}

// Stiffness as far off as its prior says, and nothing else.
const test::RigErrors kStiffnessErrors{0.3, 0.4, 0, 0, 0, 0, 0, 0};
test::RigTruth drawTruth(const model::Arm& known, Random& random) {
  return test::drawRig(known, test::sampleView(0.8, 1, 8), kStiffnessErrors, random);
}

// Parameters that a combination of words does not request are as uncertain as their priors, except
// base and length scales, which count as exact.
TEST(CalibrationVerdict, ErrorsAreValidWhateverIsNotFitted) {
  test::Ring ring = test::helicalRing();
  ring.stiffness.tau = 5e-5;
  const model::Arm known = test::ringArm(ring);
  const ArmView view = test::sampleView(0.8, 1, 12, 3);
  constexpr double kStiffness = 0.25;
  Tallies tallies;
  // All combinations; by default one in five, which have each word with and without each other.
  for (int words = 1; words < 128; words += test::draws(5, 1)) {
    const auto has = [words](int bit) { return (words >> bit & 1) != 0; };
    CalibrationOptions options;
    options.fit.clear();
    int bit = 0;
    for (const FitParameter one :
         {FitParameter::kKappa, FitParameter::kGamma, FitParameter::kLengthScale,
          FitParameter::kBase, FitParameter::kTags, FitParameter::kBorderShift,
          FitParameter::kTau}) {
      if (has(bit++)) options.fit.insert(one);
    }
    options.free_shapes = (words & 71) == 0;
    options.stiffness_prior = kStiffness;
    options.length_scale_prior = 0.03;
    options.base_prior = {0.01, 0.02};
    options.tag_prior = {0.002, 0.05};
    options.border_shift_prior = 0.0003;
    options.corner_noise = kCornerNoise;
    options.corner_floor = 0;
    options.held_out = false;
    options.next_pressures = 0;
    const test::RigErrors errors{
        kStiffness, kStiffness, has(2) ? 0.03 : 0, has(3) ? 0.01 : 0, has(3) ? 0.02 : 0, 0.002,
        0.05,       0.0003,     kStiffness};
    for (int set = 0; set < test::draws(1, 2); ++set) {
      Random random(10000 + 100 * words + set);
      const test::RigTruth truth = test::drawRig(known, view, errors, random);
      const Calibration found = calibrate(
          {corners(known, view, truth, randomPressures(known, 8, random), kCornerNoise, random)},
          options);
      if (found.status == CalibrationStatus::kNotIdentifiable) continue;
      if (found.status != CalibrationStatus::kCalibrated) {
        ADD_FAILURE() << words << " " << set << nameOf(found.status);
        continue;
      }
      expectAgreement(found, words);
      for (const Parameter& one : found.parameters) {
        const std::string group = one.name.substr(0, one.name.find('_'));
        tallies[group == "K" ? one.name : group].add(one, truth.parameters.at(one.name));
      }
    }
  }
  print("words", tallies);
  EXPECT_EQ(tallies.size(), 7u);
  for (const auto& [name, tally] : tallies) {
    EXPECT_GT(tally.count, test::draws(5, 50)) << name;
    EXPECT_TRUE(tally.covers(0.91)) << name;
    if (!test::isFullSize()) continue;
    // The data never determine K_tau; far from its prior its error is not normal.
    EXPECT_LT(tally.rms(), name == "K_tau" ? 1.3 : 1.2) << name;
    EXPECT_GT(tally.rms(), 0.6) << name;
  }
}

// Parameters that are not fitted are named where captures contradict them: lengths, or a base, that
// are off, and none of sound sets.
TEST(CalibrationVerdict, WhatIsOffAndNotFittedIsNamed) {
  const model::Arm known = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView(0.8, 1, 8);
  CalibrationOptions options;
  options.tag_prior = {1e-6, 1e-6};
  options.held_out = false;
  options.next_pressures = 0;
  struct Case {
    const char* off;
    double length_scale, base_shift;  // [1], [m]
    int sets, least, most;            // in which it is named
  };
  const int sound = test::draws(50, 300), longer = test::draws(12, 60), moved = test::draws(6, 30);
  const auto least = [](int sets) {
    return test::isFullSize() ? 9 * sets / 10 : test::leastOf(sets, 0.95);
  };
  // At most 1 % of sound sets: more than 8 of 300 have a probability of 0.4 %.
  const int most = test::isFullSize() ? 8 : test::mostOf(sound, 0.01);
  for (const Case& one : {Case{"", 1, 0, sound, 0, most},
                          Case{"length_scale", 1.03, 0, longer, least(longer), longer},
                          Case{"base", 1, 0.01, moved, least(moved), moved}}) {
    int named = 0;
    for (int set = 0; set < one.sets; ++set) {
      Random random(20000 + set);
      test::RigTruth truth = test::drawRig(known, view, kStiffnessErrors, random);
      truth.length_scale = one.length_scale;
      truth.X_B0B.translation.z() += one.base_shift;
      const bool tags = set % 2 == 0 || one.base_shift > 0;
      const Calibration found =
          calibrated({readings(tags, known, view, truth, random)}, options, std::to_string(set));
      named += warns(found, std::string("the captures contradict the scene's ") + one.off);
    }
    std::printf("off: %s; named in %d of %d sets\n", one.off, named, one.sets);
    EXPECT_GE(named, one.least) << one.off;
    EXPECT_LE(named, one.most) << one.off;
  }
}

// Curvatures cannot tell the lengths from K_kappa: the error says so only where the scale is
// fitted.
TEST(CalibrationVerdict, KKappaOfCurvaturesWarnsOfLengthsThatItTakesAsExact) {
  const model::Arm known = test::ringArm(test::straightRing());
  Tally alone, together;
  int warned = 0;
  const int sets = test::draws(40, 200);
  for (int set = 0; set < sets; ++set) {
    Random random(30000 + set);
    test::RigTruth truth = drawTruth(known, random);
    truth.length_scale = set % 2 == 0 ? 1.01 : 0.99;
    const ArmCaptures data = curvatures(known, truth, kCurvatureNoise, random);
    CalibrationOptions options;
    options.fit.erase(FitParameter::kGamma);
    options.next_pressures = 0;
    Calibration found = calibrate({data}, options);
    ASSERT_EQ(found.status, CalibrationStatus::kCalibrated) << set << ": " << found.reason;
    warned += warns(found, "fit length_scale as well");
    alone.add(found.parameters.front(), truth.parameters.at("K_kappa"));
    EXPECT_FALSE(warns(found, "contradict")) << set;
    options.fit.insert(FitParameter::kLengthScale);
    found = calibrate({data}, options);
    if (found.status != CalibrationStatus::kCalibrated) continue;
    EXPECT_FALSE(warns(found, "fit length_scale as well")) << set;
    together.add(found.parameters.front(), truth.parameters.at("K_kappa"));
  }
  std::printf("warned %d of %d\n", warned, sets);
  print("lengths", {{"alone", alone}, {"together", together}});
  EXPECT_GT(together.count, sets / 2);
  EXPECT_TRUE(together.covers(0.95));
  EXPECT_EQ(warned, sets);
  EXPECT_LT(alone.coverage(), test::isFullSize() ? 0.6 : 0.85) << "the reason to warn";
}

// Bending and shear of a tilted arm do nearly the same. What its captures know is a combination of
// both: it is reported with an error that holds, and predictions that use it are as certain as they
// claim.

constexpr int kCaptures = 21;
constexpr double kSharpNoise = 0.003;  // of twists [m], [rad]: both parameters are determined

// Bending and shear have comparable parts in the bending of this arm.
model::Arm tiltedArm() {
  test::Ring ring = test::helicalRing();
  ring.stiffness.gamma = 30;
  return test::ringArm(ring);
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

TEST(CalibrationVerdict, TheCombinationOfATiltedArmIsFoundWithinItsErrors) {
  const model::Arm known = tiltedArm();
  CalibrationOptions options;
  options.held_out = false;
  options.next_pressures = 0;
  int covered = 0, bad_covered = 0;
  for (int rig = 0; rig < kRigs; ++rig) {
    Random random(5000 + rig);
    const test::RigTruth truth = drawTruth(known, random);
    const Pressures pressures = randomPressures(known, kCaptures, random);
    const Calibration found =
        calibrated({twists(known, truth, pressures, kSharpNoise, kSharpNoise, random)}, options);
    ASSERT_EQ(found.combinations.size(), 2u) << rig;
    const Combination &well = found.combinations[0], &badly = found.combinations[1];
    EXPECT_TRUE(well.identifiable) << rig;
    EXPECT_GT(well.powers[1].exponent, 0) << rig;
    EXPECT_LT(badly.powers[1].exponent, 0) << rig;
    EXPECT_NEAR(std::hypot(well.powers[0].exponent, well.powers[1].exponent), 1, 1e-12);
    covered += std::abs(logError(well, truth)) < 2 * well.relative_error;
    bad_covered += std::abs(logError(badly, truth)) < 2 * badly.relative_error;
    const double single = std::min(relativeErrorOf(parameter(found, "K_gamma")),
                                   relativeErrorOf(parameter(found, "K_kappa")));
    EXPECT_GE(single, 3 * well.relative_error) << rig;
  }
  const double least = test::isFullSize() ? 0.93 * kRigs : test::leastOf(kRigs, 0.9545);
  EXPECT_GE(covered, least);
  EXPECT_GE(bad_covered, least);
}

}  // namespace
}  // namespace helix_arm::estimation
