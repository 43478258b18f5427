#include <limits>

#include <gtest/gtest.h>

#include "estimation/calibration_data.hpp"
#include "helix_arm/statics/exact.hpp"
#include "support/has.hpp"
#include "support/loaded_arm.hpp"

namespace helix_arm::estimation {
namespace {

using test::kMaxPressure;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

model::Arm scaled(const model::Arm& arm, double kappa, double gamma) {
  model::Stiffness stiffness = arm.actuator(0).stiffness;
  stiffness.kappa *= kappa;
  stiffness.gamma *= gamma;
  return arm.withStiffness(stiffness);
}

ArmCaptures poses(const model::Arm& known, const TagLayout& layout, const model::Arm& truth,
                  double noise, Random& random) {
  return poses(known, layout, rigOf(truth, layout), test::twelvePressures(known), noise, random);
}

ArmCaptures corners(const model::Arm& known, const ArmView& view, const test::RigTruth& truth,
                    double noise, Random& random) {
  return corners(known, view, truth, test::twelvePressures(known), noise, random);
}

void expectFound(const Calibration& found, const test::RigTruth& truth, double tolerance) {
  for (const Parameter& one : found.parameters) {
    if (!one.identifiable) continue;
    const double expected = truth.parameters.at(one.name);
    EXPECT_NEAR(one.value, expected, tolerance * std::max(std::abs(expected), 0.1)) << one.name;
  }
  EXPECT_TRUE(parameter(found, "K_kappa").identifiable);
}

TEST(Calibration, FindsEveryParameterOfARigThatIsSeenWithoutNoise) {
  const model::Arm known = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView();
  Random random(1);
  const test::RigErrors errors{0.2, 0.3, 0.02, 0.01, 0.02, 0.002, 0.05, 0.0002};
  const test::RigTruth truth = test::drawRig(known, view, errors, random);
  const CalibrationOptions options = test::everythingFromExactReadings(1e-6);
  const Calibration found = calibrated({corners(known, view, truth, 0, random)}, options);
  expectFound(found, truth, 1e-4);
  EXPECT_TRUE(parameter(found, "K_gamma").identifiable);
  EXPECT_DOUBLE_EQ(found.stiffness->kappa, parameter(found, "K_kappa").value);
  EXPECT_LT(found.rms, 1e-3);
  EXPECT_LT((found.X_B0B.translation - truth.X_B0B.translation).norm(), 1e-5);
}

TEST(Calibration, WrongTagsAreNamedAndDoNotMoveTheAnswer) {
  const model::Arm known = test::ringArm(test::helicalRing());
  const TagLayout layout = test::sampleLayout(1, 12);
  Random random(6);
  CalibrationOptions options;
  options.fit.insert(FitParameter::kBase);
  ArmCaptures data = poses(known, layout, scaled(known, 1.0, 0.5), 0.002, random);
  const Calibration clean = calibrate({data}, options);
  std::get<std::vector<PoseObservation>>(data.captures[4].reading)[7].X_BT.translation.y() += 0.2;
  for (PoseObservation& seen : std::get<std::vector<PoseObservation>>(data.captures[8].reading)) {
    seen.X_BT.translation += Eigen::Vector3d(0.1, -0.3, 0.2);
  }
  const Calibration found = calibrated({data}, options);
  EXPECT_EQ(found.captures[4].outlier_tags, std::vector<int>{7});
  EXPECT_FALSE(found.captures[4].outlier);
  EXPECT_TRUE(found.captures[8].outlier);
  EXPECT_EQ(found.captures[8].outlier_tags.size(), layout.tags.size());
  for (const char* const name : {"K_gamma", "base_x", "base_rz"}) {
    const Parameter& one = parameter(found, name);
    EXPECT_LT(std::abs(one.value - parameter(clean, name).value), 2 * one.standard_error) << name;
  }
  EXPECT_TRUE(warns(found, "do not fit the others: 9"));
}

TEST(Calibration, HeldOutCapturesArePredictedByAFitWithoutThem) {
  const model::Arm known = test::ringArm(test::straightRing());
  Random random(7);
  CalibrationOptions options;
  options.fit.erase(FitParameter::kGamma);
  const ArmCaptures data = curvatures(known, scaled(known, 1.4, 1.0), 0.05, random);
  const Calibration all = calibrate({data}, options);
  ASSERT_EQ(all.by_pressure->groups.size(), data.captures.size());
  double square = 0;
  for (std::size_t g = 0; g < data.captures.size(); ++g) {
    ArmCaptures rest = data;
    rest.captures.erase(rest.captures.begin() + static_cast<std::ptrdiff_t>(g));
    const Calibration without = calibrate({rest}, options);
    const model::Arm fitted = known.withStiffness(*without.stiffness);
    const double error =
        std::abs(model::curvatureOf(fitted.twists(data.captures[g].pressure).col(0)) -
                 std::get<CurvatureReading>(data.captures[g].reading).curvature);
    // The noise, and with it the weight of the prior, differs a little between the two.
    EXPECT_NEAR(all.by_pressure->groups[g].error, error, 2e-3);
    square += error * error;
  }
  EXPECT_NEAR(all.by_pressure->error, std::sqrt(square / 12), 1e-3);
  EXPECT_GT(all.by_pressure->error, all.by_pressure->in_sample);
}

// What cannot be calibrated, and the words that tell why.
TEST(Calibration, RefusesWithAReason) {
  using Status = CalibrationStatus;
  static const model::Arm known = test::ringArm(test::helicalRing());
  const auto ofTags = [] {
    Random random(13);
    return poses(known, test::sampleLayout(1, 8), known, 0.001, random);
  };
  const struct {
    Status status;
    const char* words;
    void (*spoil)(ArmCaptures&, CalibrationOptions&);
    bool tags = false;
  } cases[] = {
      {Status::kNoCaptures, "record some", [](auto& data, auto&) { data.captures.clear(); }},
      {Status::kBadData, "positions in metres, and these seem to be millimetres",
       [](auto& data, auto&) {
         for (Capture& one : data.captures) {
           for (auto& seen : std::get<std::vector<PoseObservation>>(one.reading)) {
             seen.X_BT.translation *= 1e3;
           }
         }
       },
       true},
      {Status::kBadData, "capture 6: the pressure of muscle_2",
       [](auto& data, auto&) { data.captures[5].pressure[1] = kNaN; }},
      {Status::kBadData, "muscle_1",
       [](auto& data, auto&) { data.captures[1].pressure[0] = 2 * kMaxPressure; }},
      {Status::kNothingToFit, "need captures of tags",
       [](auto&, auto& o) { o.fit.insert(FitParameter::kBase); }},
      {Status::kNotIdentifiable, "bend the arm farther",
       [](auto& data, auto&) {
         data = dataOf(test::ringArm(test::straightRing()));
         for (int i = 0; i < 5; ++i) {
           test::addCapture(data, Eigen::VectorXd::Constant(3, 5e4 * i), CurvatureReading{0.001});
         }
       }},
  };
  for (const auto& [status, words, spoil, tags] : cases) {
    ArmCaptures data = tags ? ofTags() : twists(known, known, 1e-3);
    CalibrationOptions options;
    spoil(data, options);
    const Calibration found = calibrate({data}, options);
    EXPECT_EQ(found.status, status) << nameOf(found.status);
    EXPECT_TRUE(test::has(found.reason, words));
  }
}

constexpr statics::TierSetting kLoaded{statics::Tier::kLoaded, 5};

// An arm that stands out horizontally and sags, and what is thought of it.
struct LoadedRig {
  model::Arm known = test::ringArm(test::straightRing());
  statics::Load known_load = test::horizontalLoad(1, 0.25, 500.0);
  model::Stiffness stiffness = known.actuator(0).stiffness;  // true
  statics::Load load = known_load;                           // true
  double length_scale = 1;

  model::Shape shape(const Eigen::VectorXd& pressure) const {
    const model::Arm arm = known.withStiffness(stiffness);
    const model::Twists unloaded = arm.twistsOfLengths(length_scale * arm.lengths(pressure));
    const statics::Solution solution = statics::ExactArm(arm, load).solve(unloaded);
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
  options.fit.insert(FitParameter::kEps);
  options.fit.insert(FitParameter::kLengthScale);
  options.held_out = false;
  const Calibration found = calibrated({data}, options);
  EXPECT_NEAR(parameter(found, "K_kappa").value / rig.stiffness.kappa, 1, 1e-4);
  EXPECT_NEAR(parameter(found, "K_gamma").value / rig.stiffness.gamma, 1, 1e-4);
  EXPECT_NEAR(parameter(found, "K_eps").value, 650.0, 0.1);
  EXPECT_NEAR(parameter(found, "length_scale").value, 1.01, 1e-5);
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
  options.fit = {FitParameter::kBase};
  options.free_shapes = true;
  options.base_prior = {10.0, 10.0};
  options.position_noise = 0.001;
  const Calibration found = calibrated({data}, options);
  EXPECT_LT((found.X_B0B.log() - offset).cwiseAbs().maxCoeff(), 1e-4);
  EXPECT_LT(found.rms, 1e-5);
  data.load.reset();
  const Calibration ignorant = calibrate({data}, options);
  EXPECT_GT(ignorant.rms, 100 * found.rms);
}

}  // namespace
}  // namespace helix_arm::estimation
