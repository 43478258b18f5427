#include "procedures/loop_config.hpp"

#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "helix_arm/io/calibrated_scene.hpp"
#include "procedures/contact_proof.hpp"
#include "procedures/follow_run.hpp"
#include "support/has.hpp"
#include "support/scene_text.hpp"
#include "support/shipped_scene.hpp"
#include "support/temporary_file.hpp"
#include "support/test_size.hpp"

namespace helix_arm::procedures {
namespace {

using estimation::ArmFilterOptions;
using test::demo;

io::Scene sceneOf(const std::string& more) {
  return io::sceneOfText(test::kPlanarScene + more, "scene.yaml");
}

std::string calibration(const std::string& parameters) {
  return "calibration: {date: \"2026-01-31T12:00:00Z\", package_version: 0.2.0, from: a.yaml, rms: "
         "0.3, error_unit: px, data: [{file: a.csv, sha256: "
         "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad, captures: 36}], "
         "parameters: {" +
         parameters + "}}\n";
}

ArmFilterOptions filterOf(const std::string& parameters) {
  return loopConfigOf(sceneOf(calibration(parameters))).filter;
}

// Covariance of the logs of K_gamma and K_kappa that a filter starts with.
Eigen::Matrix2d stiffnessCovariance(const ArmFilterOptions& filter) {
  const Eigen::Vector2d deviation(filter.stiffness_deviation.gamma,
                                  filter.stiffness_deviation.kappa);
  return deviation.asDiagonal() * filter.stiffness_correlation.topLeftCorner<2, 2>() *
         deviation.asDiagonal();
}

// A load out of the plane makes the fit spatial.
TEST(LoopConfig, IsPlanarWhereTheFitIs) {
  EXPECT_TRUE(loopConfigOf(sceneOf("")).filter.planar);
  EXPECT_FALSE(loopConfigOf(io::sceneOfText(test::kSpatialScene, "scene.yaml")).filter.planar);
  const std::string text = test::replaced(test::kPlanarScene, "K_kappa_m2: 1.0e-4}",
                                          "K_kappa_m2: 1.0e-4, K_eps_n: 900}");
  const io::Scene pulled =
      io::sceneOfText(text + "load: {mass_kg: 0.1, gravity_m_s2: [0, 0, -9.81]}\n", "scene.yaml");
  EXPECT_FALSE(loopConfigOf(pulled).filter.planar);
}

TEST(LoopConfig, ACalibratedSceneStartsWithItsStandardErrors) {
  const ArmFilterOptions filter = filterOf(
      "K_gamma: {value: 100, standard_error: 5, identifiable: true}, "
      "K_kappa: {value: 2.0e-4, standard_error: 2.0e-6, identifiable: true}, "
      "K_eps: {value: 900, standard_error: 90, identifiable: true}, "
      "length_scale: {value: 0.98, standard_error: 0.0049, identifiable: true}");
  EXPECT_NEAR(filter.stiffness_deviation.gamma, 0.05, 1e-12);
  EXPECT_NEAR(filter.stiffness_deviation.kappa, 0.01, 1e-12);
  EXPECT_EQ(filter.stiffness_deviation.tau, ArmFilterOptions().stiffness_deviation.tau);
  EXPECT_NEAR(filter.K_eps_deviation, 0.1, 1e-12);
  EXPECT_NEAR(filter.length_deviation, 0.005, 1e-12);
}

TEST(LoopConfig, ACombinationThatIsKnownIsKnownToTheFilter) {
  const std::string parameters =
      "K_gamma: {value: 100, standard_error: 5, identifiable: true}, "
      "K_kappa: {value: 2.0e-4, standard_error: 1.0e-4, identifiable: false}";
  const std::string combined =
      test::replaced(calibration(parameters), "}}\n",
                     "}, combinations: [{exponents: {K_gamma: 0.8, K_kappa: 0.6}, relative_error: "
                     "0.01, identifiable: true}, {exponents: {K_kappa: 0.8, K_gamma: -0.6}, "
                     "relative_error: ERROR, identifiable: false}]}\n");
  const Eigen::Vector2d well(0.8, 0.6), badly(-0.6, 0.8);
  // An error that is no figure is limited, and loosens nothing else.
  for (const auto& [written, taken] : {std::pair{"0.4", 0.4}, std::pair{"7", 0.5}}) {
    const ArmFilterOptions filter =
        loopConfigOf(sceneOf(test::replaced(combined, "ERROR", written))).filter;
    EXPECT_NO_THROW(filter.validate());
    const Eigen::Matrix2d covariance = stiffnessCovariance(filter);
    EXPECT_NEAR(well.dot(covariance * well), 1e-4, 1e-12);
    EXPECT_NEAR(badly.dot(covariance * badly), taken * taken, 1e-12);
    EXPECT_NEAR(well.dot(covariance * badly), 0, 1e-12);
    EXPECT_EQ(filter.stiffness_deviation.tau, ArmFilterOptions().stiffness_deviation.tau);
    EXPECT_EQ(filter.stiffness_correlation(2, 2), 1);
    EXPECT_TRUE(filter.stiffness_correlation.bottomLeftCorner(2, 2).isZero(0));
  }
  EXPECT_EQ(filterOf(parameters).stiffness_correlation, Eigen::Matrix4d::Identity());
}

// The numbers of a placement, with standard errors [m] and [rad].
std::string placement(const std::string& name, const char* x, const char* errors[2], bool found) {
  std::string out;
  for (const char* suffix : {x, "_y", "_z", "_rx", "_ry", "_rz"}) {
    const bool turn = suffix[1] == 'r';
    out += (out.empty() ? "" : ", ") + name + suffix +
           ": {value: 0, standard_error: " + errors[turn ? 1 : 0] +
           ", identifiable: " + (found ? "true" : "false") + "}";
  }
  return out;
}

TEST(LoopConfig, PlacementsCountAsTheCalibrationFoundThem) {
  const char *sure[] = {"0.0004", "0.001"}, *prior[] = {"0.002", "0.052"};
  const std::string text = io::sceneText(test::shippedPath("demo"), {}) +
                           calibration(placement("base", "_x", sure, true) + ", " +
                                       placement("tag_1", "_along", sure, true) + ", " +
                                       placement("tag_2", "_along", prior, false));
  const io::Scene scene = io::sceneOfText(text, "calibrated.yaml"), before = demo();
  EXPECT_EQ(localizerConfigOf(before).fit.base_prior.translation, 0.002);
  EXPECT_EQ(localizerConfigOf(scene).fit.base_prior.translation, 0.0004);
  EXPECT_EQ(localizerConfigOf(scene).fit.base_prior.rotation, 0.001);
  EXPECT_EQ(placedViewOf(scene)->deviations.tags[1][0], 0.0004);
  EXPECT_EQ(placedViewOf(scene)->deviations.tags[2][5], 0.052);
  EXPECT_EQ(uncalibratedTags(*scene.tags, {0, 1, 2, 3}), (std::vector<int>{2, 3}))
      << "3 is as a tag that was added later";
  EXPECT_TRUE(uncalibratedTags(*before.tags, {0, 1, 2, 3}).empty());

  // A camera that was placed anew is where nobody calibrated it.
  const test::TemporaryFile file(text);
  const io::Scene placed = io::sceneOfText(
      io::sceneTextWithCamera(file.path(), {}, {std::nullopt, scene.camera->X_WC}), "placed.yaml");
  EXPECT_EQ(localizerConfigOf(placed).fit.base_prior.translation, 0.002);
  EXPECT_EQ(uncalibratedTags(*placed.tags, {0, 1, 2, 3}), (std::vector<int>{2, 3}));
}

// ---- Proof of contacts --------------------------------------------------------------------------

using follow::OnContact;
using test::has;

ContactProof proofOf(const estimation::QuietScore& quiet, const io::Scene& scene = demo()) {
  return contactProof(scene, quiet);
}

TEST(ContactProof, TheLimitIsTwiceTheHighestScoreAndAtLeastTheDefault) {
  EXPECT_EQ(proofOf({16.0, 200, 0.03}).limit, 32);
  EXPECT_EQ(proofOf({16.1, 200, 0.03}).limit, 33);
  EXPECT_EQ(proofOf({50, 200, 0.03}).limit, 100);
  EXPECT_EQ(proofOf({1, 200, 0.03}, demo({{"follow.contact_limit", "90"}})).limit, 32);
}

TEST(ContactProof, AnArmYieldsIfItWasWatchedForLongAndFindsAForceOfANewton) {
  const estimation::QuietScore quiet{10, 60, 0.05};
  EXPECT_EQ(proofOf(quiet).on_contact, OnContact::kYield);
  EXPECT_EQ(proofOf(quiet).doubt, "");
  EXPECT_NEAR(proofOf(quiet).force, 0.05 * (std::sqrt(32) + 1.28), 1e-12);
  EXPECT_EQ(proofOf(quiet, demo({{"follow.on_contact", "stop"}})).on_contact, OnContact::kStop);
  const ContactProof brief = proofOf({10, 59, 0.05});
  EXPECT_EQ(brief.on_contact, OnContact::kReport);
  EXPECT_TRUE(has(brief.doubt, "for 59 s; expected at least 60 s")) << brief.doubt;
  const ContactProof blind = proofOf({150, 200, 0.06}, demo({{"follow.on_contact", "stop"}}));
  EXPECT_EQ(blind.on_contact, OnContact::kReport);
  EXPECT_TRUE(has(blind.doubt, "a force of 1.1 N across the resting tip")) << blind.doubt;
}

// The rig's true arm, which its model does not describe: pushes of the force that the proof says.
TEST(ContactProof, TheForceThatItSaysIsFoundInNineOfTenPushes) {
  const io::Scene scene = demo({{"simulation.arm.K_eps_scale", "0.9"}});
  FollowPlan plan;
  plan.seconds = 120;
  plan.path = quietPath(scene, plan.seconds, 3);
  plan.ignore_contacts = true;
  const FollowResult result = runFollow(scene, plan);
  EXPECT_TRUE(result.alarms.empty());
  const ContactProof proof = contactProof(scene, result.quiet);
  EXPECT_LT(proof.quiet.highest, 20);
  EXPECT_NEAR(proof.quiet.seconds, 70, 15);
  int found = 0;
  const int pushes = test::draws(8, 20);
  for (int k = 0; k < pushes; ++k) {
    FollowPlan push;
    push.seed = 100 + k;
    push.seconds = 13;
    const Eigen::VectorXd pressure = scene.arm.inputAt(
        Eigen::Vector3d(0.3 + 0.02 * k, 0.5 + 0.2 * std::sin(k), 0.5 + 0.3 * std::cos(3 * k)));
    const lie::SE3 tip = scene.model.tip(pressure).tip;
    push.tips = {tip.translation};
    const Eigen::Vector3d along = tip.rotation.col(0), side = along.unitOrthogonal();
    push.force =
        TimedForce{12, proof.force * (std::cos(k) * side + std::sin(k) * along.cross(side))};
    const FollowResult pushed = runFollow(scene, push);
    if (!pushed.alarms.empty() && pushed.alarms[0].time <= 12.5 + 0.06) ++found;
  }
  std::printf("[  FIGURE  ] %.2f N by the proof: %d of %d pushes found within 0.5 s\n", proof.force,
              found, pushes);
  EXPECT_GE(found, test::isFullSize() ? 16 : test::leastOf(pushes, 0.9));
  EXPECT_LT(proof.force, 0.5);
}

}  // namespace
}  // namespace helix_arm::procedures
