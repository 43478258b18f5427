#include "helix_arm/io/calibrated_scene.hpp"

#include <algorithm>

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

TEST(CalibratedScene, ResponsesAreWrittenAndRemoved) {
  const std::vector<Override> given{{"contractions.muscle.response",
                                     "{rise_time_constant_s: 0.5, play_kpa: [20], play_weight: "
                                     "[0.3]}"}};
  SceneCalibration change = calibration();
  change.contractions = {{"muscle", quintic(pascals(413.6856))}};
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
  EXPECT_TRUE(scene.arm.actuator(3).response.instant()) << "another curve";

  change.responses = {{"muscle", {}}};
  EXPECT_TRUE(calibrated(kSpatialScene, change, given).arm.actuator(0).response.instant());
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

}  // namespace
}  // namespace helix_arm::io
