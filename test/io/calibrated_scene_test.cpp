#include "helix_arm/io/calibrated_scene.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/provenance.hpp"
#include "io/document/document.hpp"
#include "io/document/number.hpp"
#include "scene_faults.hpp"
#include "support/random.hpp"

namespace helix_arm::io {
namespace {

using namespace test;

using basics::kPi;

Provenance provenance() {
  return {"2026-01-31T12:00:00Z",
          "0.1.0",
          "a path: with \"signs\" # and blanks",
          std::string(64, 'a'),
          "arm.stiffness.K_gamma=50 tags.size_m=0.03",
          {{"corners.csv", std::string(64, '0'), 36}, {"12", std::string(64, 'e'), 0}},
          {{"K_kappa", 1.0 / 3, 1e-7, true, "m^2"}, {"tag_7_s", -2, 0, false, ""}},
          {},
          0.3,
          0.4,
          "px"};
}

constexpr double kBorderShift = 0.0002;  // [m]

SceneCalibration calibration() {
  SceneCalibration made;
  made.provenance = provenance();
  return made;
}

// The scene of a text once it is calibrated.
Scene calibrated(const std::string& text, const SceneCalibration& change,
                 const std::vector<Override>& overrides = {}) {
  return sceneOf(calibratedSceneText(test::TemporaryFile(text).path(), overrides, change));
}

std::string refusal(const std::string& text, const SceneCalibration& change) {
  const test::TemporaryFile file(text);
  try {
    calibratedSceneText(file.path(), {}, change);
  } catch (const DocumentError& error) {
    return std::string(error.what()).substr(file.path().size());
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

double difference(const lie::SE3& a, const lie::SE3& b) {
  return (a.rotation - b.rotation).norm() + (a.translation - b.translation).norm();
}

lie::SE3 randomPose(test::Random& random, double size) {
  lie::Vector6 twist;
  for (int i = 0; i < 6; ++i) twist[i] = size * random.normal();
  return lie::SE3::exp(twist);
}

void expectSameTags(const estimation::TagLayout& a, const estimation::TagLayout& b,
                    double tolerance) {
  EXPECT_NEAR(a.size, b.size, tolerance);
  ASSERT_EQ(a.tags.size(), b.tags.size());
  for (std::size_t i = 0; i < a.tags.size(); ++i) {
    EXPECT_EQ(a.tags[i].id, b.tags[i].id);
    EXPECT_EQ(a.tags[i].section, b.tags[i].section);
    EXPECT_EQ(a.tags[i].s, b.tags[i].s);
    EXPECT_LE(difference(a.tags[i].X_ST, b.tags[i].X_ST), tolerance) << a.tags[i].id;
  }
}

void expectSameLoad(const Scene& a, const Scene& b) {
  EXPECT_EQ(a.model.choice().setting.name(), b.model.choice().setting.name());
  ASSERT_EQ(a.model.load().has_value(), b.model.load().has_value());
  if (!a.model.load()) return;
  const statics::Load &one = *a.model.load(), &other = *b.model.load();
  EXPECT_EQ(one.gravity, other.gravity);
  EXPECT_EQ(one.mass, other.mass);
  EXPECT_EQ(one.K_eps, other.K_eps);
  ASSERT_EQ(one.points.size(), other.points.size());
  for (std::size_t i = 0; i < one.points.size(); ++i) {
    EXPECT_EQ(one.points[i].section, other.points[i].section);
    EXPECT_EQ(one.points[i].s, other.points[i].s);
    EXPECT_EQ(one.points[i].mass, other.points[i].mass);
    EXPECT_EQ(one.points[i].force, other.points[i].force);
    EXPECT_EQ(one.points[i].moment, other.points[i].moment);
    EXPECT_EQ(one.points[i].offset, other.points[i].offset);
  }
}

// All that a text says except of its calibration.
std::string uncalibrated(const std::string& text) {
  FaultList faults("scene.yaml");
  Value document = parseDocument(text, {}, faults).value();
  eraseValue(document, "calibration");
  return writeDocument(document);
}

class ShippedScene : public testing::TestWithParam<const char*> {
 protected:
  std::string path() const { return test::shippedPath(GetParam()); }
};
INSTANTIATE_TEST_SUITE_P(Scenes, ShippedScene,
                         testing::Values("annotated", "demo", "helical_50", "loaded", "planar_101",
                                         "planar_50", "planar_76", "spatial_101", "spatial_50"));

TEST_P(ShippedScene, WithoutAChangeIsTheSame) {
  const std::string text = calibratedSceneText(path(), {}, calibration());
  EXPECT_EQ(uncalibrated(text), uncalibrated(sceneText(path())));
  EXPECT_NO_THROW(sceneOf(text));
}

TEST_P(ShippedScene, ContainsAllThatWasCalibrated) {
  const Scene before = loadScene(path());
  test::Random random(31);
  SceneCalibration change = calibration();
  change.stiffness = model::Stiffness{12.5, 1.0 / 3e5, 1.0 / 7e3};
  change.length_scale = Eigen::VectorXd(before.arm.actuatorCount());
  for (double& scale : *change.length_scale) scale = random.uniform(0.95, 1.05);
  Eigen::VectorXd& strokes = change.numbers[estimation::FitParameter::kStrokeScaleEach];
  strokes = 2 - change.length_scale->array();
  if (before.camera) change.X_CB = before.X_CB() * randomPose(random, 0.02);
  if (before.tags) {
    change.X_BF = randomPose(random, 0.02);
    change.numbers[estimation::FitParameter::kBorderShift] =
        Eigen::VectorXd::Constant(1, kBorderShift);
    change.tags = before.tags;
    for (estimation::TagPlacement& tag : change.tags->tags) {
      tag.s = std::clamp(tag.s + 0.01 * random.normal(), 0.0, 1.0);
      tag.X_ST = tag.X_ST * randomPose(random, 0.01);
    }
  }
  const Scene after = sceneOf(calibratedSceneText(path(), {}, change));
  for (int i = 0; i < after.arm.actuatorCount(); ++i) {
    const model::Actuator &a = after.arm.actuator(i), &b = before.arm.actuator(i);
    EXPECT_EQ(a.stiffness.gamma, change.stiffness->gamma);
    EXPECT_EQ(a.stiffness.tau, change.stiffness->tau);
    EXPECT_EQ(a.stiffness.kappa, change.stiffness->kappa);
    const double q = 0.4 * b.limits.upper + 0.6 * b.limits.lower;
    const double rest = b.contraction.restLength();
    EXPECT_NEAR(a.contraction.length(q),
                (*change.length_scale)[i] * (rest + strokes[i] * (b.contraction.length(q) - rest)),
                1e-15);
    EXPECT_EQ(a.limits.upper, b.limits.upper);
  }
  if (change.X_CB) {
    EXPECT_LT(difference(after.X_CB(), *change.X_CB), 1e-12);
  }
  if (change.tags) {
    EXPECT_LT(difference(after.X_BF, *change.X_BF), 1e-12);
    change.tags->size -= 2 * kBorderShift;
    expectSameTags(*after.tags, *change.tags, 1e-12);
  }
}

TEST(CalibratedScene, StatesItsOrigin) {
  SceneCalibration change = calibration();
  Provenance& expected = change.provenance;
  const std::string name = expected.parameters[0].name, other = expected.parameters[1].name;
  const double c = std::cos(1.0 / 3), s = std::sin(1.0 / 3);
  expected.combinations = {{{{name, c}, {other, s}}, 1.0 / 7, true},
                           {{{name, -s}, {other, c}}, 2.0 / 3, false}};
  const Scene scene = calibrated(kSpatialScene, change);
  ASSERT_TRUE(scene.calibration);
  EXPECT_EQ(scene.calibration->date, expected.date);
  EXPECT_EQ(scene.calibration->package_version, expected.package_version);
  EXPECT_EQ(scene.calibration->from, expected.from);
  EXPECT_EQ(scene.calibration->from_sha256, expected.from_sha256);
  EXPECT_EQ(scene.calibration->overrides, expected.overrides);
  ASSERT_EQ(scene.calibration->data.size(), 2u);
  EXPECT_EQ(scene.calibration->data[1].file, "12");
  EXPECT_EQ(scene.calibration->data[1].sha256, std::string(64, 'e'));
  ASSERT_EQ(scene.calibration->parameters.size(), 2u);
  EXPECT_EQ(scene.calibration->parameters[0].value, 1.0 / 3);
  EXPECT_TRUE(scene.calibration->parameters[0].identifiable);
  EXPECT_EQ(scene.calibration->parameters[0].unit, "m^2");
  EXPECT_EQ(scene.calibration->parameters[1].unit, "");
  EXPECT_EQ(scene.calibration->rms, 0.3);
  EXPECT_EQ(scene.calibration->held_out_error, 0.4);
  EXPECT_EQ(scene.calibration->error_unit, "px");
  const auto& read = scene.calibration->combinations;
  ASSERT_EQ(read.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(read[i].exponents, expected.combinations[i].exponents);
    EXPECT_EQ(read[i].relative_error, expected.combinations[i].relative_error);
    EXPECT_EQ(read[i].identifiable, i == 0);
  }
  const std::string text =
      calibratedSceneText(test::TemporaryFile(kSpatialScene).path(), {}, calibration());
  EXPECT_EQ(text.rfind("# A calibrated scene.", 0), 0u);
}

TEST(CalibratedScene, MayBeCalibratedAgain) {
  SceneCalibration change = calibration();
  change.length_scale = Eigen::VectorXd::Constant(6, 1.02);
  const std::string once =
      calibratedSceneText(test::TemporaryFile(kSpatialScene).path(), {}, change);
  EXPECT_NE(once.find("length_scale: 1.02"), std::string::npos) << "equal ones are one number";
  change.provenance.date = "2027-01-01T00:00:00Z";
  (*change.length_scale)[1] = 1.01;
  const Scene twice = calibrated(once, change);
  EXPECT_EQ(twice.calibration->date, "2027-01-01T00:00:00Z");
  EXPECT_NEAR(twice.arm.actuator(0).contraction.length(0), 0.4 * 1.02 * 1.02, 1e-15);
  EXPECT_NEAR(twice.arm.actuator(1).contraction.length(0), 0.4 * 1.02 * 1.01, 1e-15);
  EXPECT_NEAR(twice.arm.actuator(5).contraction.length(0), 0.1 * 1.02 * 1.02, 1e-15);
}

TEST(CalibratedScene, WhatLoadsTheArmAndItsTierStay) {
  SceneCalibration change = calibration();
  change.stiffness = model::Stiffness{7, 0, 3e-4};
  // Each section's own: the mass of the whole arm is spread by lengths that stiffness changes.
  const std::string scene = test::replaced(kLoadedScene, "mass_kg: 0.3", "mass_kg: [0.2, 0.1]");
  const Scene before = sceneOf(scene);
  const Scene after = calibrated(scene, change);
  EXPECT_EQ(after.arm.actuator(0).stiffness.kappa, 3e-4);
  EXPECT_EQ(after.model.load()->K_eps, (std::vector<double>{900, 900}));
  EXPECT_EQ(after.model.choice().setting.name(), "loaded, order 3");
  expectSameLoad(before, after);
  const std::string text = calibratedSceneText(test::TemporaryFile(scene).path(), {}, change);
  EXPECT_EQ(text.find("K_eps_n"), text.rfind("K_eps_n")) << "where it was given, and only there";
}

TEST(CalibratedScene, KKappaKeepsItsTableOrTakesANewOne) {
  SceneCalibration change = calibration();
  change.stiffness = model::Stiffness{10, 0, 2e-4};
  const Scene scaled = calibrated(
      kSpatialScene, change,
      {{"arm.stiffness.K_kappa_m2", "{mean_pressure_kpa: [0, 300], ratio_m2: [2e-4, 1e-4]}"}});
  EXPECT_EQ(scaled.arm.actuator(0).stiffness.kappa, 2e-4);
  EXPECT_EQ(scaled.arm.bending(0).factor, (std::vector<double>{2, 1}));
  // An actuator with a stiffness of its own takes that of the section.
  change.bending = model::StiffnessTable{{-1e5, 4e5}, {1, 2}};
  const Scene fitted = calibrated(kSpatialScene, change);
  EXPECT_EQ(fitted.arm.bending(1).factor, (std::vector<double>{1, 2}));
  EXPECT_EQ(fitted.arm.actuator(5).stiffness.kappa, 2e-4);
}

TEST(CalibratedScene, K_epsIsReplacedWhereItIsGiven) {
  SceneCalibration change = calibration();
  change.K_eps = 1100;
  const Scene arms = calibrated(kLoadedScene, change);
  EXPECT_EQ(arms.model.load()->K_eps, (std::vector<double>{1100, 1100}));
  EXPECT_EQ(arms.arm.actuator(5).stiffness.kappa, 3e-4) << "the others stay";
  const Scene own = calibrated(kLoadedScene, change, {{"arm.sections.1.stiffness.K_eps_n", "700"}});
  EXPECT_EQ(own.model.load()->K_eps, (std::vector<double>{1100, 1100}));
  EXPECT_EQ(refusal(kSpatialScene, change),
            "calibratedSceneText: K_eps is calibrated, but scene rig has no load; expected one "
            "with a load");
}

TEST(CalibratedScene, TheCameraMayHaveAnyOrientation) {
  test::Random random(32);
  const Scene before = sceneOf(kSpatialScene);
  SceneCalibration change = calibration();
  for (int trial = 0; trial < 120; ++trial) {
    // Its body pitches by 90 degrees, or nearly, every other time: there roll and yaw are one.
    lie::SE3 X_WC = randomPose(random, 2);
    if (trial % 2 == 0) {
      const double off = trial % 4 == 0 ? 0 : random.logUniform(1e-16, 1e-3);
      lie::Vector6 pitch = lie::Vector6::Zero(), yaw = pitch, roll = pitch;
      pitch[4] = (trial % 8 < 4 ? 1 : -1) * (kPi / 2 - off);
      yaw[5] = random.uniform(-kPi, kPi);
      roll[3] = random.uniform(-kPi, kPi);
      X_WC.rotation = (lie::SE3::exp(yaw) * lie::SE3::exp(pitch) * lie::SE3::exp(roll)).rotation;
      Eigen::Matrix3d optical_in_body;
      optical_in_body << 0, 0, 1, -1, 0, 0, 0, -1, 0;
      X_WC.rotation *= optical_in_body;
    }
    change.X_CB = X_WC.inverse() * before.X_WB;
    EXPECT_LT(difference(calibrated(kSpatialScene, change).X_CB(), *change.X_CB), 1e-12) << trial;
  }
}

estimation::ContractionFit quintic(double max_pressure) {
  estimation::ContractionFit fit;
  fit.kind = estimation::CurveKind::kQuintic;
  fit.coefficients = {0.41, -0.11, 0, 0.001, 0, 0};
  fit.reference_pressure = max_pressure;
  fit.curve = model::Contraction::quintic(fit.coefficients, max_pressure, max_pressure);
  return fit;
}

TEST(CalibratedScene, CurvesReplaceThoseOfTheirNames) {
  SceneCalibration change = calibration();
  estimation::ContractionFit table;
  table.kind = estimation::CurveKind::kTable;
  table.pressures = {0, 49999.9, 100e3 / 3 * 4};
  table.lengths = {0.1, 0.121, 0.131};
  table.curve = model::Contraction::table(table.pressures, table.lengths);
  const double max = pascals(413.6856);
  change.contractions = {{"muscle", quintic(max)}, {"bellows", table}};
  const Scene scene = calibrated(kSpatialScene, change);
  const model::Contraction& muscle = scene.arm.actuator(0).contraction;
  EXPECT_EQ(muscle.inputRange().upper, max);
  EXPECT_EQ(scene.arm.actuator(0).limits.upper, 300e3) << "its limits stay";
  for (double p = 0; p < max; p += 1e4) EXPECT_EQ(muscle.length(p), quintic(max).curve->length(p));
  const model::Contraction& bellows = scene.arm.actuator(3).contraction;
  EXPECT_NEAR(scene.arm.actuator(3).limits.upper, table.pressures.back(), 1e-10)
      << "left open, they are those of the curve";
  for (double p = 0; p < 133e3; p += 1e3) {
    EXPECT_NEAR(bellows.length(p), table.curve->length(p), 1e-15);
  }
}

TEST(CalibratedScene, ResponsesAreWrittenKeptAndRemoved) {
  const std::vector<Override> given{{"contractions.muscle.response",
                                     "{rise_time_constant_s: 0.5, play_kpa: [20], play_weight: "
                                     "[0.3]}"}};
  SceneCalibration change = calibration();
  change.contractions = {{"muscle", quintic(pascals(413.6856))}};
  const model::Response kept = calibrated(kSpatialScene, change, given).arm.actuator(0).response;
  EXPECT_EQ(kept.rise_time, 0.5);
  ASSERT_EQ(kept.play_count, 1);
  EXPECT_EQ(kept.plays[0].reach, pascals(20));

  model::Response response;
  response.rise_time = 1.0 / 3;
  response.fall_time = 2.0;
  response.play_count = 2;
  response.plays[0] = {1e4 / 3, 0.1};
  response.plays[1] = {3e4, 0.7};
  response.slow_time = 22.0 / 3;
  response.slow_weight = 0.1;
  change.responses = {{"muscle", response}};
  const Scene scene = calibrated(kSpatialScene, change, given);
  const model::Response& written = scene.arm.actuator(0).response;
  EXPECT_EQ(written.rise_time, response.rise_time);
  EXPECT_EQ(written.fall_time, response.fall_time);
  ASSERT_EQ(written.play_count, 2);
  EXPECT_NEAR(written.plays[0].reach, 1e4 / 3, 1e-9);
  EXPECT_EQ(written.plays[1].weight, 0.7);
  EXPECT_EQ(written.slow_time, response.slow_time);
  EXPECT_EQ(written.slow_weight, 0.1);
  EXPECT_EQ(scene.contractions.at("muscle").play_count, 2);
  EXPECT_TRUE(scene.arm.actuator(3).response.instant()) << "another curve";

  change.responses = {{"muscle", {}}};
  EXPECT_TRUE(calibrated(kSpatialScene, change, given).arm.actuator(0).response.instant());
  change.responses = {{"rubber", response}};
  EXPECT_THROW(calibrated(kSpatialScene, change), std::invalid_argument);
}

TEST(CalibratedScene, ANewCurveIsNotScaledAsTheOldOneWas) {
  SceneCalibration scaled = calibration();
  scaled.length_scale = Eigen::VectorXd::Constant(6, 1.02);
  scaled.numbers[estimation::FitParameter::kStrokeScaleEach] = Eigen::VectorXd::Constant(6, 1.1);
  const test::TemporaryFile once(
      calibratedSceneText(test::TemporaryFile(kSpatialScene).path(), {}, scaled));
  SceneCalibration change = calibration();
  change.contractions = {{"muscle", quintic(pascals(413.6856))}};
  const auto lengthAt = [&](double pressure) {
    const test::TemporaryFile twice(calibratedSceneText(once.path(), {}, change));
    return loadScene(twice.path()).arm.actuator(0).contraction.length(pressure);
  };
  const model::Contraction& curve = *change.contractions.front().second.curve;
  const double measured = curve.length(0);
  EXPECT_NEAR(lengthAt(0), measured, 1e-15);
  EXPECT_NEAR(lengthAt(3e5), curve.length(3e5), 1e-15);
  change.length_scale = Eigen::VectorXd::Constant(6, 1.01);
  EXPECT_NEAR(lengthAt(0), 1.01 * measured, 1e-12) << "a scale of the new one is its own";
}

// Its first line is line 11 of the scene.
const std::string kScene = kPlanarScene + R"(calibration:
  date: "2026-01-31T12:00:00Z"
  package_version: "0.1.0"
  from: arm.yaml
  data:
    - {file: a.csv, sha256: ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad, captures: 36}
    - {file: b.csv, sha256: e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855, captures: 0}
  parameters:
    K_kappa: {value: 1.5e-4, standard_error: 2.0e-6, identifiable: true, unit: m^2}
    K_gamma: {value: 10, standard_error: 0, identifiable: false}
  rms: 0.3
  held_out_error: 0.4
  error_unit: px
)";

TEST(Provenance, IsAbsentWhereNothingWasCalibrated) {
  EXPECT_FALSE(sceneOf(kPlanarScene).calibration);
  const Scene scene = sceneOf(replaced(kScene, "  held_out_error: 0.4\n", ""));
  EXPECT_FALSE(scene.calibration->held_out_error);
}

// Line 21 of the scene is the key, 22 and 23 the entries.
const std::string kCombinations =
    "  combinations:\n"
    "    - {exponents: {K_gamma: 0.8, K_kappa: 0.6}, relative_error: 0.01, identifiable: true}\n"
    "    - {exponents: {K_gamma: -0.6, K_kappa: 0.8}, relative_error: 0.5, identifiable: false}\n";
const std::string kCombined = replaced(kScene, "  rms:", kCombinations + "  rms:");

TEST(Provenance, BreakingARuleIsReported) {
  expectFaults("calibrated", kScene);
  expectFaults("combined", kCombined);
}

}  // namespace
}  // namespace helix_arm::io
