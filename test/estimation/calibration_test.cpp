#include <limits>

#include <gtest/gtest.h>

#include "estimation/calibration_data.hpp"
#include "helix_arm/calibration/suspects.hpp"
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

TEST(Calibration, TorsionIsFoundFromZeroAndOtherwiseStaysZero) {
  const model::Arm known = test::ringArm(test::helicalRing());
  model::Stiffness stiff = known.actuator(0).stiffness;
  stiff.tau = 3e-4;
  CalibrationOptions options;
  options.fit.insert(FitParameter::kTau);
  options.stiffness_prior = 5;
  const Calibration found = calibrated({twists(known, known.withStiffness(stiff), 1e-6)}, options);
  EXPECT_EQ(parameter(found, "K_tau").initial, 0.0);
  EXPECT_NEAR(parameter(found, "K_tau").value / 3e-4, 1, 1e-3);

  Random random(3);
  const model::Arm straight = test::ringArm(test::straightRing());
  const Calibration blind = calibrated({curvatures(straight, straight, 0.01, random)}, options);
  EXPECT_FALSE(parameter(blind, "K_tau").identifiable);
  EXPECT_EQ(blind.stiffness->tau, 0.0);
}

TEST(Calibration, EachActuatorGetsItsOwnScales) {
  const model::Arm known = test::ringArm(test::straightRing());
  const Eigen::Vector3d scales(1.02, 0.98, 1.01), strokes(0.94, 1.08, 1.03);
  const Eigen::VectorXd rest = known.lengths(Eigen::Vector3d::Zero());
  ArmCaptures data = twists(known, known, 1e-5);
  for (Capture& capture : data.captures) {
    const Eigen::VectorXd change = known.lengths(capture.pressure) - rest;
    const Eigen::VectorXd lengths = scales.cwiseProduct(rest + strokes.cwiseProduct(change));
    std::get<TwistReading>(capture.reading).twists = known.twistsOfLengths(lengths);
  }
  CalibrationOptions options;
  options.fit.insert(FitParameter::kLengthScaleEach);
  options.fit.insert(FitParameter::kStrokeScaleEach);
  const Calibration found = calibrated({data}, options);
  EXPECT_LT((found.length_scale - scales).norm(), 1e-5);
  EXPECT_TRUE(parameter(found, "length_scale_muscle_2").identifiable);
  for (int i = 0; i < 3; ++i) {
    const Parameter& stroke = parameter(found, "stroke_scale_muscle_" + std::to_string(i + 1));
    EXPECT_NEAR(stroke.value, strokes[i], 1e-4);
    EXPECT_TRUE(stroke.identifiable);
  }
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

// A camera sees three of the strips of tags along six muscles.
TEST(Suspects, NameTheStripAlongAMuscleThatIsTurnedAndATagThatIsTurnedAlone) {
  const model::Arm known = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView(0.8, 1, 24, 6);
  Random random(7);
  const ArmCaptures sound =
      corners(known, view, test::drawRig(known, view, {}, random), 0.2, random);
  for (const auto& [quarters, placement] :
       {std::pair(1, false), std::pair(2, false), std::pair(3, false), std::pair(1, true),
        std::pair(2, true), std::pair(3, true)}) {
    for (const std::vector<int>& turned : {std::vector<int>{4, 10, 16, 22}, std::vector<int>{10}}) {
      ArmCaptures data = sound;
      for (Capture& capture : data.captures) {
        for (auto& seen : std::get<std::vector<CornerObservation>>(capture.reading)) {
          if (std::find(turned.begin(), turned.end(), seen.tag) == turned.end()) continue;
          const Corners as_glued = seen.direction;
          for (int i = 0; i < 4; ++i) seen.direction.col(i) = as_glued.col((i + quarters) % 4);
        }
      }
      CalibrationOptions options;
      if (placement) options.fit.insert({FitParameter::kBase, FitParameter::kTags});
      const auto suspects = suspectsOf({data}, options);
      ASSERT_FALSE(suspects.empty()) << placement << " " << turned.size() << " " << quarters;
      EXPECT_EQ(suspects.front().cause, "tags_turned");
      EXPECT_EQ(suspects.front().where, turned.size() == 1 ? "tag 10" : "tags 4, 10, 16, 22");
      EXPECT_GT(suspects.front().explains, 0.9);
      data.captures.resize(1, data.captures.front());
      options.fit = {FitParameter::kBase};
      options.free_shapes = true;
      const auto of_one = suspectsOf({data}, options);
      ASSERT_FALSE(of_one.empty()) << "of one picture, " << turned.size() << " " << quarters;
      EXPECT_EQ(of_one.front().where, suspects.front().where);
    }
  }
  EXPECT_TRUE(suspectsOf({sound}, {}).empty());
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

TEST(Calibration, SeveralArmsShareOneStiffnessAndEachIsPredictedByTheOthers) {
  Random random(8);
  std::vector<ArmCaptures> arms;
  for (const double radius : {0.02, 0.0254, 0.04}) {
    test::Ring ring = test::straightRing();
    ring.radius = radius;
    const model::Arm known = test::ringArm(ring);
    arms.push_back(curvatures(known, scaled(known, 1.3, 1.0), 0.01, random));
    arms.back().name = "arm of " + std::to_string(radius);
  }
  CalibrationOptions options;
  options.fit.erase(FitParameter::kGamma);
  const Calibration found = calibrated(arms, options);
  const Parameter& kappa = parameter(found, "K_kappa");
  EXPECT_LT(std::abs(kappa.value - 1.3 * 1.38e-4), 3 * kappa.standard_error);
  ASSERT_TRUE(found.by_arm);
  ASSERT_EQ(found.by_arm->groups.size(), 3u);
  EXPECT_EQ(found.by_arm->groups[1].label, arms[1].name);
  EXPECT_LT(found.by_arm->error, 0.03);
  EXPECT_EQ(found.captures.size(), 36u);
  EXPECT_EQ(found.captures.back().arm, 2);
}

TEST(Calibration, SaysWhichCapturesAddNothingAndWhichWouldAddMost) {
  const model::Arm known = test::ringArm(test::straightRing());
  Random random(11);
  ArmCaptures data = curvatures(known, known, 0.01, random);
  CalibrationOptions options;
  options.fit.erase(FitParameter::kGamma);
  const Calibration found = calibrated({data}, options);
  // At rest no stiffness is seen; the harder it bends, the more is.
  EXPECT_LT(found.captures.front().gain, 1e-6);
  EXPECT_GT(found.captures.back().gain, found.captures[3].gain);
  ASSERT_EQ(found.next_pressures.size(), 3u);
  EXPECT_NE(found.next_pressures[0], found.next_pressures[1]);
  EXPECT_GE(found.next_pressures.front().maxCoeff(), 0.99 * kMaxPressure);
  EXPECT_TRUE(test::has(found.warnings.front(), "0, 0, 0 kPa"));

  // What is suggested takes more from the uncertainty than what is not.
  const auto errorWith = [&](const Eigen::VectorXd& pressure) {
    ArmCaptures more = data;
    const double exact = model::curvatureOf(known.twists(pressure).col(0));
    for (int i = 0; i < 20; ++i) test::addCapture(more, pressure, CurvatureReading{exact});
    CalibrationOptions plain = options;
    plain.held_out = false;
    return parameter(calibrate({more}, plain), "K_kappa").standard_error;
  };
  EXPECT_LT(errorWith(found.next_pressures.front()), errorWith(data.captures[3].pressure));
}

TEST(Calibration, LeastTipErrorIsAtItsValley) {
  const model::Arm known = test::ringArm(test::helicalRing());
  const model::Arm truth = scaled(known, 1.7, 1.0);
  const LeastTipError exact = fitLeastTipError({twists(known, truth, 1e-3)}).value();
  EXPECT_NEAR(exact.K_kappa / truth.actuator(0).stiffness.kappa, 1, 1e-5);
  EXPECT_LT(exact.error, 1e-7);

  Random random(12);
  const model::Arm straight = test::ringArm(test::straightRing());
  const ArmCaptures noisy = curvatures(straight, scaled(straight, 1.7, 1.0), 0.1, random);
  const LeastTipError least = fitLeastTipError({noisy}).value();
  const auto meanError = [&](double K_kappa) {
    model::Stiffness stiffness = straight.actuator(0).stiffness;
    stiffness.kappa = K_kappa;
    const model::Arm arm = straight.withStiffness(stiffness);
    double sum = 0;
    for (const Capture& capture : noisy.captures) {
      sum += std::abs(model::curvatureOf(arm.twists(capture.pressure).col(0)) -
                      std::get<CurvatureReading>(capture.reading).curvature);
    }
    return sum / static_cast<double>(noisy.captures.size());
  };
  EXPECT_NEAR(least.error, meanError(least.K_kappa), 1e-12);
  for (double factor = 0.05; factor < 20; factor *= 1.02) {
    EXPECT_GE(meanError(factor * least.K_kappa), least.error - 1e-7);
  }
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
      {Status::kOnePressure, "100, 0, 0.5 kPa",
       [](auto& data, auto&) {
         for (Capture& one : data.captures) one.pressure = Eigen::Vector3d(1e5, 0, 500);
       }},
      {Status::kOnePressure, "; the highest is 1.35 kPa, and 135 kPa if the pressures are in bar",
       [](auto& data, auto&) {
         for (Capture& one : data.captures) one.pressure = Eigen::Vector3d(400, 0, 1350);
       }},
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
      {Status::kBadData, "has 2 pressures, but the arm has 3 actuators",
       [](auto& data, auto&) { data.captures[1].pressure = Eigen::VectorXd::Zero(2); }},
      {Status::kBadData, "muscle_1",
       [](auto& data, auto&) { data.captures[1].pressure[0] = 2 * kMaxPressure; }},
      {Status::kBadData, "capture 8: has another kind",
       [](auto& data, auto&) { data.captures[7].reading = CurvatureReading{0.5}; }},
      {Status::kNothingToFit, "need captures of tags",
       [](auto&, auto& o) { o.fit.insert(FitParameter::kBase); }},
      {Status::kNothingToFit, "no parameter to fit", [](auto&, auto& o) { o.fit.clear(); }},
      {Status::kNothingToFit, "muscle_3",
       [](auto& data, auto&) {
         std::vector<model::Section> sections(1);
         for (int i = 0; i < 3; ++i) sections[0].actuators.push_back(known.actuator(i));
         sections[0].actuators[2].stiffness.kappa *= 2;
         data.arm = model::Arm(sections);
       }},
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
  EXPECT_EQ(parameter(found, "K_eps").unit, "N");
  EXPECT_NEAR(parameter(found, "length_scale").value, 1.01, 1e-5);
  ASSERT_TRUE(found.K_eps.has_value());
  EXPECT_DOUBLE_EQ(*found.K_eps, parameter(found, "K_eps").value);
  // Beside an arm with a weight, the same without it counts as well, first or not.
  ArmCaptures bare = data;
  bare.load->gravity.setZero();
  rig.load.gravity.setZero();
  for (Capture& one : bare.captures) {
    one.reading = TwistReading{rig.shape(one.pressure).twists(), covariance};
  }
  ASSERT_FALSE(bare.isLoaded());
  EXPECT_NEAR(parameter(calibrated({bare, data}, options), "K_eps").value, 650.0, 0.1);
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
