#include <gtest/gtest.h>

#include "estimation/calibration_data.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "support/sample_load.hpp"

namespace helix_arm::estimation {
namespace {

constexpr statics::TierSetting kLoaded{statics::Tier::kLoaded, 5};

// How far a parameter is from the truth, in its standard errors.
double sigmasOff(const Calibration& calibration, const std::string& name, double truth) {
  const Parameter& one = parameter(calibration, name);
  return std::abs(one.value - truth) / one.standard_error;
}

// An arm that stands out horizontally and sags, and what is thought of it.
struct LoadedRig {
  model::Arm known = test::ringArm(test::straightRing());
  statics::Load known_load = test::horizontalLoad(1, 0.25, 500.0);
  model::Stiffness stiffness = known.actuator(0).stiffness;  // true
  statics::Load load = known_load;                           // true
  double length_scale = 1;
  bool exact = true;  // else by the tier that the model has, and many times faster

  model::Shape shape(const Eigen::VectorXd& pressure) const {
    const model::Arm arm = known.withStiffness(stiffness);
    const model::Twists unloaded = arm.twistsOfLengths(length_scale * arm.lengths(pressure));
    const statics::Solution solution =
        exact ? statics::ExactArm(arm, load).solve(unloaded)
              : statics::LoadedArm(arm, load, kLoaded.order).solve(unloaded);
    if (!solution.converged()) throw std::runtime_error("the sample load is too heavy");
    return solution.shape;
  }

  ArmCaptures captures(const TagLayout& layout = {}) const {
    ArmCaptures data = dataOf(known, layout);
    data.load = known_load;
    data.tier = kLoaded;
    return data;
  }

  ArmCaptures poses(double noise, Random& random) const {
    ArmCaptures data = captures(test::sampleLayout(1, 12));
    for (const Eigen::VectorXd& pressure : test::twelvePressures(known)) {
      test::addCapture(data, pressure, posesOf(data.layout, shape(pressure), {}, noise, random));
    }
    return data;
  }
};

TEST(LoadedCalibration, FindsWhatMadeExactTwists) {
  LoadedRig rig;
  rig.known = test::ringArm(test::helicalRing());
  rig.stiffness = rig.known.actuator(0).stiffness;
  rig.stiffness.kappa *= 1.3;
  rig.stiffness.gamma *= 0.7;
  rig.load.K_eps = {650.0};
  rig.length_scale = 1.01;
  ArmCaptures data = rig.captures();
  data.tier = {statics::Tier::kExact, 0};
  const Eigen::MatrixXd covariance = 1e-12 * Eigen::MatrixXd::Identity(6, 6);
  for (const Eigen::VectorXd& pressure : test::twelvePressures(rig.known)) {
    test::addCapture(data, pressure, TwistReading{rig.shape(pressure).twists(), covariance});
  }
  CalibrationOptions options;
  options.K_eps = true;
  options.length_scale = LengthScaling::kCommon;
  options.held_out = false;
  const Calibration found = calibrated({data}, options);
  EXPECT_NEAR(parameter(found, "K_kappa").value / rig.stiffness.kappa, 1, 1e-4);
  EXPECT_NEAR(parameter(found, "K_gamma").value / rig.stiffness.gamma, 1, 1e-4);
  EXPECT_NEAR(parameter(found, "K_eps").value, 650.0, 0.1);
  EXPECT_EQ(parameter(found, "K_eps").unit, "N");
  EXPECT_NEAR(parameter(found, "length_scale").value, 1.01, 1e-5);
  ASSERT_TRUE(found.K_eps.has_value());
  EXPECT_DOUBLE_EQ(*found.K_eps, parameter(found, "K_eps").value);
}

TEST(LoadedCalibration, FindsTheStiffnessOfAHangingArmWhichIgnoringTheLoadDoesNot) {
  // Its weight pulls an arm that hangs straight: who knows of none takes it for stiffer.
  Random random(31);
  for (int draw = 0; draw < 3; ++draw) {
    LoadedRig rig;
    rig.known_load.gravity = rig.load.gravity = {9.81, 0, 0};
    rig.stiffness.kappa *= std::exp(0.2 * random.normal());
    const ArmCaptures data = rig.poses(0.002, random);
    CalibrationOptions options;
    options.position_noise = 0.002;
    options.K_gamma = false;  // of which an arm without tilt tells next to nothing
    const Calibration found = calibrated({data}, options);
    EXPECT_TRUE(parameter(found, "K_kappa").identifiable);
    EXPECT_LT(sigmasOff(found, "K_kappa", rig.stiffness.kappa), 3.0);
    EXPECT_LT(parameter(found, "K_kappa").standard_error, 0.05 * rig.stiffness.kappa);
    EXPECT_NEAR(found.rms, 0.002 * std::sqrt(3.0), 0.0005);
    ASSERT_EQ(found.curves.size(), data.captures.size());
    EXPECT_GT(found.curves.front().piecesPerSection(), 1);
    EXPECT_EQ(found.curves.front().twists(), found.shapes.front());

    ArmCaptures weightless = data;
    weightless.load.reset();
    options.held_out = false;  // the errors of the noise alone
    const Calibration ignorant = calibrated({weightless}, options);
    EXPECT_GT(sigmasOff(ignorant, "K_kappa", rig.stiffness.kappa), 3.0);
    EXPECT_GT(parameter(ignorant, "K_kappa").value, 1.2 * rig.stiffness.kappa);
  }
}

TEST(LoadedCalibration, TheWeightDeterminesKEps) {
  Random random(32);
  LoadedRig rig;
  rig.load.K_eps = {600.0};
  CalibrationOptions options;
  options.position_noise = 0.002;
  options.K_gamma = false;
  options.K_eps = true;
  const Calibration found = calibrated({rig.poses(0.002, random)}, options);
  EXPECT_TRUE(parameter(found, "K_eps").identifiable);
  EXPECT_LT(sigmasOff(found, "K_eps", 600.0), 3.0);
  EXPECT_GT(sigmasOff(found, "K_eps", 500.0), 3.0);
}

TEST(LoadedCalibration, FreeShapesKeepWhatTheLoadBends) {
  // The model is right except for the placement of the base. Then no shape has to change, and the
  // base is found to the last digit. Shapes without sag would leave some of it in the base.
  const LoadedRig rig;
  lie::Vector6 offset;
  offset << 0.01, -0.02, 0.005, 0.03, -0.02, 0.04;
  Random unused(0);
  ArmCaptures data = rig.captures(test::sampleLayout(1, 12));
  data.tier = {statics::Tier::kExact, 0};
  for (const Eigen::VectorXd& pressure : test::twelvePressures(rig.known)) {
    test::addCapture(data, pressure,
                     posesOf(data.layout, rig.shape(pressure), lie::SE3::exp(offset), 0, unused));
  }
  CalibrationOptions options;
  options.K_kappa = options.K_gamma = false;
  options.base = options.free_shapes = true;
  options.base_prior = {10.0, 10.0};
  options.position_noise = 0.001;
  const Calibration found = calibrated({data}, options);
  EXPECT_LT((found.X_B0B.log() - offset).cwiseAbs().maxCoeff(), 1e-4);
  EXPECT_LT(found.rms, 1e-5);
  data.load.reset();
  const Calibration ignorant = calibrate({data}, options);
  EXPECT_GT(ignorant.rms, 100 * found.rms);
}

TEST(LoadedCalibration, KEpsWithoutALoadIsRefused) {
  Random random(35);
  const LoadedRig rig;
  ArmCaptures data = rig.poses(0.002, random);
  CalibrationOptions options;
  options.K_eps = true;
  data.tier = {statics::Tier::kLinear, 0};
  const Calibration other_tier = calibrate({data}, options);
  EXPECT_EQ(other_tier.status, CalibrationStatus::kNothingToFit);
  EXPECT_NE(other_tier.reason.find("K_eps"), std::string::npos) << other_tier.reason;
  data.tier = kLoaded;
  data.load.reset();
  EXPECT_EQ(calibrate({data}, options).status, CalibrationStatus::kNothingToFit);
}

TEST(LoadedCalibration, ALoadThatNoShapeBalancesIsNamed) {
  // One centred muscle resists no moment about its axis.
  test::Ring ring = test::straightRing(1);
  ring.radius = 0;
  ArmCaptures data = dataOf(test::ringArm(ring));
  data.load = test::horizontalLoad();
  data.load->points.front().moment = {0.1, 0, 0};
  data.tier = kLoaded;
  for (const double pressure : {0.0, 1e5, 2e5}) {
    test::addCapture(data, Eigen::VectorXd::Constant(1, pressure), CurvatureReading{0.1});
  }
  const Calibration found = calibrate({data}, {});
  EXPECT_EQ(found.status, CalibrationStatus::kBadData);
  EXPECT_NE(
      found.reason.find("capture 1: at 0 kPa the model finds no shape that balances the load"),
      std::string::npos)
      << found.reason;
}

}  // namespace
}  // namespace helix_arm::estimation
