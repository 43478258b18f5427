#include <Eigen/Geometry>
#include <cmath>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/model/curve.hpp"
#include "scene_faults.hpp"

namespace helix_arm::io {
namespace {

using namespace test;

using basics::kPi;
constexpr double kTolerance = 1e-15;

Eigen::Matrix3d turn(double deg, const Eigen::Vector3d& axis) {
  return Eigen::AngleAxisd(deg * kPi / 180, axis).toRotationMatrix();
}
Eigen::Matrix3d rx(double deg) { return turn(deg, Eigen::Vector3d::UnitX()); }
Eigen::Matrix3d ry(double deg) { return turn(deg, Eigen::Vector3d::UnitY()); }
Eigen::Matrix3d rz(double deg) { return turn(deg, Eigen::Vector3d::UnitZ()); }

TEST(SceneLoader, RingPosesFollowTheirDefinition) {
  const Scene scene = sceneOf(kSpatialScene);
  for (int i = 0; i < 3; ++i) {
    const double th = 2 * kPi * i / 3;
    const lie::SE3& X_O = scene.arm.actuator(i).X_O;
    EXPECT_TRUE(X_O.translation.isApprox(0.03 * Eigen::Vector3d(0, std::cos(th), std::sin(th)),
                                         kTolerance));
    EXPECT_TRUE(X_O.rotation.isApprox(rx(120.0 * i - 90) * rz(-10), 1e-14)) << X_O.rotation;
  }
}

TEST(SceneLoader, ActuatorPosesAreRpyOrTilt) {
  const Scene scene =
      sceneOf(replaced(kSpatialScene, "rpy_deg: [0, 0, 5]", "rpy_deg: [30, 40, 50]"));
  const lie::SE3& left = scene.arm.actuator(3).X_O;
  EXPECT_EQ(left.translation, Eigen::Vector3d(0, 0.02, 0));
  EXPECT_TRUE(left.rotation.isApprox(rz(50) * ry(40) * rx(30), 1e-15));
  EXPECT_EQ(scene.arm.actuator(4).X_O.rotation, Eigen::Matrix3d::Identity());
  const double th_deg = std::atan2(0.03, 0.01) * 180 / kPi;
  EXPECT_TRUE(scene.arm.actuator(5).X_O.rotation.isApprox(rx(th_deg - 90) * rz(-12), 1e-15));
}

TEST(SceneLoader, BasePoseIsFixedAxisRollPitchYaw) {
  const Scene scene = sceneOf(kSpatialScene);
  EXPECT_EQ(scene.X_WB.translation, Eigen::Vector3d(0.1, 0.2, 1));
  EXPECT_TRUE(scene.X_WB.rotation.isApprox(rz(20) * ry(90) * rx(10), 1e-15));
}

TEST(SceneLoader, LimitsAndCurvesAreInPascals) {
  const Scene scene = sceneOf(kSpatialScene);
  const model::Actuator& ring = scene.arm.actuator(0);
  EXPECT_EQ(ring.limits.lower, 0);
  EXPECT_EQ(ring.limits.upper, 300e3);
  EXPECT_EQ(ring.contraction.inputRange().upper, 400e3);
  EXPECT_NEAR(ring.contraction.length(200e3), 0.4 - 0.1 * 0.5, 1e-15);
  EXPECT_EQ(scene.arm.actuator(3).limits.upper, 100e3);  // left open: the whole curve
  EXPECT_EQ(scene.arm.actuator(4).limits.lower, 10e3);
  EXPECT_EQ(scene.arm.actuator(4).limits.upper, 90e3);
  EXPECT_NEAR(scene.arm.actuator(4).contraction.length(50e3), 0.12, 1e-15);
}

TEST(SceneLoader, FreeLengthsHaveTheirScales) {
  const Scene scene =
      sceneOf(kSpatialScene, {{"arm.sections.0.ring.length_scale", "[1.02, 1, 0.97]"},
                              {"arm.sections.1.actuators.2.length_scale", "1.5"}});
  const Scene common = sceneOf(kSpatialScene, {{"arm.sections.0.ring.length_scale", "1.02"},
                                               {"arm.sections.0.ring.stroke_scale", "[1, 1.2, 1]"},
                                               {"arm.sections.1.actuators.2.stroke_scale", "0.9"}});
  const double expected[] = {1.02, 1, 0.97};
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(scene.arm.actuator(i).contraction.length(200e3), 0.35 * expected[i], 1e-15);
    const double stroke = i == 1 ? 1.2 : 1;
    EXPECT_NEAR(common.arm.actuator(i).contraction.length(200e3), (0.4 - 0.05 * stroke) * 1.02,
                1e-15);
    EXPECT_EQ(scene.arm.actuator(i).limits.upper, 300e3);
  }
  EXPECT_NEAR(scene.arm.actuator(4).contraction.length(50e3), 0.12, 1e-15);
  EXPECT_NEAR(scene.arm.actuator(5).contraction.length(50e3), 0.18, 1e-15);
  EXPECT_NEAR(common.arm.actuator(5).contraction.length(50e3), 0.1 + 0.9 * 0.02, 1e-15);
}

TEST(SceneLoader, TendonsTakeAngles) {
  const Scene scene = sceneOf(replaced(
      replaced(kSpatialScene, "contraction: muscle, max_pressure_kpa: 300", "contraction: cable"),
      "regulator:\n  simulated: {time_constant_s: 0.2, supply_kpa: 450, noise_kpa: 2, seed: 7}\n",
      ""));
  const model::Actuator& tendon = scene.arm.actuator(0);
  EXPECT_EQ(tendon.drive, model::Drive::kTendon);
  EXPECT_EQ(tendon.limits.upper, 10);
  EXPECT_NEAR(tendon.contraction.length(4), 0.3 - 0.01 * 4, 1e-15);
  EXPECT_EQ(scene.arm.actuator(3).drive, model::Drive::kPressure);
}

TEST(SceneLoader, TheNearestStiffnessApplies) {
  const Scene scene = sceneOf(kSpatialScene);
  const double gamma[] = {10, 10, 10, 20, 20, 30}, kappa[] = {1e-4, 1e-4, 1e-4, 2e-4, 2e-4, 3e-4};
  const double tau[] = {0, 0, 0, 1e-5, 1e-5, 2e-5};
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(scene.arm.actuator(i).stiffness.gamma, gamma[i]) << i;
    EXPECT_EQ(scene.arm.actuator(i).stiffness.tau, tau[i]) << i;
    EXPECT_EQ(scene.arm.actuator(i).stiffness.kappa, kappa[i]) << i;
  }
}

TEST(SceneLoader, TagsAreSeenFromTheBaseCurve) {
  const Scene scene = sceneOf(kSpatialScene);
  ASSERT_TRUE(scene.tags);
  EXPECT_EQ(scene.tags->size, 0.02);
  EXPECT_EQ(scene.vision.detector.family, "25h9");
  ASSERT_EQ(scene.tags->tags.size(), 3u);
  const int ids[] = {3, 1, 0}, sections[] = {1, 1, 0};
  const double s[] = {0.25, 1, 0.5};
  const lie::SE3 X_MT{rz(35) * ry(25) * rx(15), {0.01, -0.02, 0.04}};
  const lie::SE3 X_ST = scene.arm.actuator(5).X_O * X_MT;
  for (int i = 0; i < 3; ++i) {
    const estimation::TagPlacement& tag = scene.tags->tags[i];
    EXPECT_EQ(tag.id, ids[i]);
    EXPECT_EQ(tag.section, sections[i]);
    EXPECT_EQ(tag.s, s[i]);
    const lie::SE3 expected = i < 2 ? X_ST : lie::SE3();  // the last is given in the base curve
    EXPECT_TRUE(tag.X_ST.rotation.isApprox(expected.rotation, 1e-14));
    EXPECT_LT((tag.X_ST.translation - expected.translation).norm(), kTolerance);
  }
}

TEST(SceneLoader, TheCameraLooksAlongTheXAxisOfItsBody) {
  const Scene scene = sceneOf(kSpatialScene);
  ASSERT_TRUE(scene.camera);
  const Eigen::Matrix3d body = rz(170) * ry(12) * rx(5);
  EXPECT_EQ(scene.camera->X_WC.translation, Eigen::Vector3d(1, 0.5, 0.8));
  const Eigen::Matrix3d& optical = scene.camera->X_WC.rotation;
  EXPECT_TRUE(optical.col(2).isApprox(body.col(0), 1e-14));   // z forward
  EXPECT_TRUE(optical.col(0).isApprox(-body.col(1), 1e-14));  // x right
  EXPECT_TRUE(optical.col(1).isApprox(-body.col(2), 1e-14));  // y down
  const estimation::Camera& model = scene.camera->model;
  EXPECT_EQ(model.width, 640);
  EXPECT_EQ(model.height, 480);
  EXPECT_EQ(model.fx, 600);
  EXPECT_EQ(model.fy, 610);
  EXPECT_EQ(model.cx, 320.5);
  EXPECT_EQ(model.cy, 239.5);
  EXPECT_EQ(model.distortion, (std::array<double, 8>{0.1, -0.2, 0.001, -0.002, 0.05, 0, 0, 0}));
  EXPECT_NO_THROW(scene.view().validate());
}

// On an arm with a plate and a tool, against the poses of its curve and its tip.
TEST(SceneLoader, BodiesAreWhereTheyAreFixed) {
  const io::Scene scene = test::shippedScene(
      "mocap",
      {{"arm.sections.0.plate_m", "0.02"},
       {"arm.tool", "{position_m: [0.05, 0.01, 0], rpy_deg: [0, 0, 30]}"},
       {"bodies",
        "[{name: a, plate: base, position_m: [0, 0.09, 0]}, {name: b, section: arm, s: 0.5,"
        " rpy_deg: [90, 0, 0]}, {name: c, plate: arm}, {name: d, tool: true, position_m: "
        "[0, 0, 0.03], noise: {position_m: 0.0005, rotation_deg: 0}}]"}});
  ASSERT_TRUE(scene.hasBodies() && scene.isSeen());
  const model::Shape shape = scene.model.solve(scene.arm.inputAt(0.4)).shape;
  const std::vector<lie::SE3> seen = estimation::tagPoses(*scene.tags, shape);
  const auto moved = [](double x, double y, double z) {
    return lie::SE3{Eigen::Matrix3d::Identity(), Eigen::Vector3d(x, y, z)};
  };
  const lie::SE3 turn{Eigen::AngleAxisd(kPi / 2, Eigen::Vector3d::UnitX()).toRotationMatrix(),
                      Eigen::Vector3d::Zero()};
  const lie::SE3 expected[] = {moved(0, 0.09, 0), model::poseAt(shape, 0, 0.5) * turn,
                               model::poseAt(shape, 0, 1.0) * moved(0.02, 0, 0),
                               model::tipPose(shape) * moved(0, 0, 0.03)};
  ASSERT_EQ(seen.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_LT((expected[i].inverse() * seen[i]).log().norm(), 1e-12) << i;
  }
  EXPECT_EQ(scene.tags->tags[3].noise->position, 0.0005);
  EXPECT_EQ(scene.tags->tags[3].noise->rotation, 0);
  EXPECT_EQ(scene.vision.min_tags, 1);
}

TEST(SceneLoader, AirMayLeaveMoreSlowlyThanItEnters) {
  const Scene scene = sceneOf(kSpatialScene, {{"safety.follow.fall_time_constant_s", "0.7"}});
  EXPECT_EQ(scene.safety.rules.fallTimeConstant(), 0.7);
  EXPECT_EQ(sceneOf(kSpatialScene).safety.rules.fallTimeConstant(), 0.3);
}

TEST(SceneLoader, APlanarRingIsTwoPointsOfThePlane) {
  const Scene scene = sceneOf(kPlanarScene);
  ASSERT_TRUE(scene.planar);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(scene.planar->actuator(i).X_O.translation, Eigen::Vector2d(0, i == 0 ? 0.03 : -0.03));
    EXPECT_EQ(scene.planar->actuator(i).X_O.rotation, Eigen::Matrix2d::Identity());
    EXPECT_EQ(scene.arm.actuator(i).X_O.translation, Eigen::Vector3d(0, i == 0 ? 0.03 : -0.03, 0));
    EXPECT_EQ(scene.arm.actuator(i).X_O.rotation, Eigen::Matrix3d::Identity());
  }
  EXPECT_FALSE(sceneOf(kSpatialScene).planar);
}

// ring.phase_deg, plate_m and arm.tool.
double apart(const lie::SE3& a, const lie::SE3& b) {
  return (a.translation - b.translation).norm() + (a.rotation - b.rotation).norm();
}

TEST(ScenePhase, AThirdOfATurnPermutesTheInputsOfThreeMuscles) {
  for (const char* const name : {"spatial_50", "helical_50"}) {
    const Scene plain = shippedScene(name);
    const Scene turned = shippedScene(name, {{"arm.sections.0.ring.phase_deg", "120"}});
    const Eigen::Vector3d q(3e5, 1e5, 2e4), moved(2e4, 3e5, 1e5);
    // Muscle 1 of the turned ring sits where muscle 2 of the plain one does.
    EXPECT_LT(apart(turned.arm.actuator(0).X_O, plain.arm.actuator(1).X_O), 1e-15);
    EXPECT_LT(apart(turned.arm.tip(q), plain.arm.tip(moved)), 1e-13) << name;
    EXPECT_GT(apart(turned.arm.tip(q), plain.arm.tip(q)), 0.05) << name;
  }
}

TEST(SceneLinks, PlatesAndToolArePartOfTheTip) {
  const Scene plain = shippedScene("spatial_50");
  const Scene scene = shippedScene(
      "spatial_50", {{"arm.sections.0.plate_m", "0.02"},
                     {"arm.tool", "{position_m: [0.05, 0, 0.01], rpy_deg: [90, 0, 0]}"}});
  const Eigen::Vector3d q(3e5, 1e5, 0);
  lie::SE3 link;
  link.rotation << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  link.translation = {0.07, 0, 0.01};
  EXPECT_LT(apart(scene.arm.tip(q), plain.arm.tip(q) * link), 1e-15);
  EXPECT_LT(apart(scene.model.tip(q).tip, scene.arm.tip(q)), 1e-15);
  EXPECT_EQ(scene.arm.restLength(), plain.arm.restLength());
}

TEST(SceneLinks, TheTipLoadIsSeenFromTheTip) {
  const Scene scene = shippedScene(
      "loaded", {{"arm.tool.position_m", "[0.05, 0, 0.01]"}, {"arm.sections.0.plate_m", "0.03"}});
  const statics::PointLoad& tip = scene.model.load()->points.back();
  // position_m of the shipped scene is [0.02, 0, 0].
  EXPECT_LT((tip.offset - Eigen::Vector3d(0.10, 0, 0.01)).norm(), 1e-15);
}

// ring.radius_m and ring.tilt_deg as lists.
TEST(SceneTaper, ListsAreTheEndsOfTheSection) {
  const Scene scene = shippedScene("helical_50", {{"arm.sections.0.ring.radius_m", "[0.05, 0.025]"},
                                                  {"arm.sections.0.ring.tilt_deg", "[0, 15]"}});
  ASSERT_TRUE(scene.arm.tapered());
  for (int i = 0; i < 3; ++i) {
    const model::Actuator& muscle = scene.arm.actuator(i);
    EXPECT_NEAR(model::poseAlong(muscle, 0.0).translation.norm(), 0.05, 1e-15);
    EXPECT_NEAR(model::poseAlong(muscle, 0.4).translation.norm(), 0.04, 1e-15);
    const lie::SE3 end = model::poseAlong(muscle, 1.0), middle = model::poseAlong(muscle, 0.5);
    EXPECT_NEAR(end.translation.norm(), 0.025, 1e-15);
    EXPECT_NEAR(std::acos(end.rotation(0, 0)) * 180 / 3.14159265358979, 15, 1e-9);
    EXPECT_NEAR(std::acos(middle.rotation(0, 0)) * 180 / 3.14159265358979, 7.5, 1e-9);
  }
}

// stiffness.K_eps_n as a table against pressure.
constexpr char kTable[] = "{pressure_kpa: [0, 130, 260, 414], force_n: [45, 15, 37, 60]}";

Scene loadedWith(const std::string& K_eps) {
  return shippedScene(
      "loaded",
      {{"arm.stiffness.K_eps_n", K_eps}, {"load.mass_kg", "0.02"}, {"load.tip.mass_kg", "0.005"}});
}

TEST(SceneStiffnessTable, IsReadRelativeToItsLeastForce) {
  const Scene scene = loadedWith(kTable);
  const statics::Load& load = *scene.model.load();
  EXPECT_EQ(load.K_eps, std::vector<double>{15});
  ASSERT_EQ(load.tables.size(), 1u);
  EXPECT_EQ(load.tables[0].input, (std::vector<double>{0, 130e3, 260e3, 414e3}));
  EXPECT_EQ(load.tables[0].factor, (std::vector<double>{3, 1, 37 / 15., 4}));
}

}  // namespace
}  // namespace helix_arm::io
