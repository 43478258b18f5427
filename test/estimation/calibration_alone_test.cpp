#include <cmath>

#include <gtest/gtest.h>

#include "helix_arm/calibration/calibration.hpp"
#include "support/sample_rig.hpp"

namespace helix_arm::estimation {
namespace {

// Corners of a rig of which everything is wrong, at the twelve pressures.
ArmCaptures corners(double noise, const ArmView& view = test::sampleView(0.8, 1, 8)) {
  const model::Arm known = test::ringArm(test::helicalRing());
  test::Random random(7);
  const test::RigTruth truth =
      test::drawRig(known, view, {0.2, 0.3, 0.02, 0.01, 0.02, 0.002, 0.05, 0.0002}, random);
  ArmCaptures data{"rig", known, false, view.layout, view.X_CB, view.camera.fx, {}};
  for (const Eigen::VectorXd& pressure : test::twelvePressures(known)) {
    test::addCapture(data, pressure, test::observe(truth, pressure, noise, random));
  }
  return data;
}

CalibrationOptions alone(CalibrationOptions options) {
  options.errors = false;
  return options;
}

// Same values, of parameters that are identified.
void expectSameValues(const ArmCaptures& data, const CalibrationOptions& options) {
  const Calibration with = calibrate({data}, options), without = calibrate({data}, alone(options));
  ASSERT_EQ(with.status, CalibrationStatus::kCalibrated) << with.reason;
  ASSERT_EQ(without.status, CalibrationStatus::kCalibrated) << without.reason;
  ASSERT_EQ(with.parameters.size(), without.parameters.size());
  for (std::size_t i = 0; i < with.parameters.size(); ++i) {
    EXPECT_EQ(without.parameters[i].name, with.parameters[i].name);
    EXPECT_EQ(without.parameters[i].value, with.parameters[i].value) << with.parameters[i].name;
  }
  EXPECT_EQ(without.noise_scale, with.noise_scale);
  EXPECT_EQ(without.rms, with.rms);
  ASSERT_EQ(without.shapes.size(), with.shapes.size());
  for (std::size_t c = 0; c < with.shapes.size(); ++c) {
    EXPECT_EQ(without.shapes[c], with.shapes[c]);
  }
}

TEST(ParametersAlone, OfStiffnessAndRigAreThoseWithErrors) {
  const CalibrationOptions options = test::everythingFromExactReadings(1e-3);
  const ArmCaptures data = corners(1e-3, test::sampleView());
  const Calibration with = calibrate({data}, options);
  for (const char* name : {"K_kappa", "K_gamma"}) {
    bool identifiable = false;
    for (const Parameter& one : with.parameters) {
      identifiable |= one.name == name && one.identifiable;
    }
    ASSERT_TRUE(identifiable) << name << " is held, so its value says nothing";
  }
  expectSameValues(data, options);
}

TEST(ParametersAlone, OfPlacementsWithFreeShapesAreThoseWithErrors) {
  CalibrationOptions options;
  options.base = options.tags = options.bleed = options.free_shapes = true;
  expectSameValues(corners(0.3), options);
}

TEST(ParametersAlone, HaveNothingElse) {
  const Calibration found = calibrate({corners(0.3)}, alone({}));
  ASSERT_EQ(found.status, CalibrationStatus::kCalibrated) << found.reason;
  for (const Parameter& one : found.parameters) {
    EXPECT_TRUE(std::isnan(one.standard_error)) << one.name;
    EXPECT_FALSE(one.identifiable) << one.name;
  }
  EXPECT_EQ(found.correlation.size(), 0);
  EXPECT_TRUE(found.combinations.empty());
  EXPECT_TRUE(found.next_pressures.empty());
  EXPECT_TRUE(found.held_out_shapes.empty());
  EXPECT_FALSE(found.by_pressure || found.by_arm);
  for (const CaptureResidual& one : found.captures) EXPECT_FALSE(one.gain);
}

TEST(ParametersAlone, AreAtTheOptimumEvenIfNothingDeterminesThem) {
  // Shear hardly affects an untilted arm.
  const model::Arm known = test::ringArm(test::straightRing());
  ArmCaptures data{"arm", known, false, {}, {}, 0, {}};
  model::Stiffness stiffness = known.actuator(0).stiffness;
  stiffness.kappa *= 1.2;
  const model::Arm truth = known.withStiffness(stiffness);
  for (const Eigen::VectorXd& pressure : test::twelvePressures(known)) {
    test::addCapture(data, pressure,
                     TwistReading{truth.twists(pressure), 1e-8 * lie::Matrix6::Identity()});
  }
  const Calibration found = calibrate({data}, alone({}));
  ASSERT_EQ(found.status, CalibrationStatus::kCalibrated) << found.reason;
  ASSERT_EQ(found.parameters.size(), 2u);
  EXPECT_NEAR(found.parameters[0].value / stiffness.kappa, 1, 1e-4);
  EXPECT_NEAR(found.parameters[1].value / stiffness.gamma, 1, 1e-4);  // that of its prior
  for (const Parameter& one : calibrate({data}, {}).parameters) {
    if (one.name != "K_gamma") continue;
    EXPECT_FALSE(one.identifiable);
  }
}

}  // namespace
}  // namespace helix_arm::estimation
