#include "helix_arm/procedures/contact_proof.hpp"

#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "helix_arm/follow/path_check.hpp"
#include "helix_arm/procedures/follow_run.hpp"
#include "support/has.hpp"

namespace helix_arm::procedures {
namespace {

using follow::OnContact;
using test::has;

const std::string kDemo = std::string(HELIX_ARM_SOURCE_DIR) + "/config/scenes/demo.yaml";

io::Scene demo(const std::vector<io::Override>& changes = {}) {
  return io::loadScene(kDemo, changes);
}

ContactProof proofOf(const estimation::QuietScore& quiet, const io::Scene& scene = demo()) {
  return contactProof(scene, quiet);
}

// Of the scene, and as the loop has learnt it of the rig.
TEST(QuietPath, IsAPathThatModelAndTrueArmCanFollowWithRests) {
  const io::Scene scene = demo(), truth = demo({{"arm.stiffness.K_gamma", "60"},
                                                {"arm.stiffness.K_kappa_m2", "1.176e-4"},
                                                {"arm.sections[0].ring.length_scale", "1.01"}});
  for (const std::uint32_t seed : {1, 2, 3}) {
    const control::TipPath path = quietPath(scene, 400, seed);
    const auto refusal = checkPath(scene, path);
    EXPECT_FALSE(refusal) << (refusal ? refusal->reason : "");
    statics::InverseSolver solver(truth.model);
    const Eigen::VectorXd slew = Eigen::VectorXd::Constant(3, truth.follow.slew);
    const auto refused =
        follow::checkPath(path, truth.arm, solver, truth.arm.inputAt(0.3), {0.05, slew});
    EXPECT_FALSE(refused) << (refused ? refused->reason : "");
    EXPECT_GE(path.lastTime(), 400);
    double rests = 0, fastest = 0;
    for (double time = 0; time < path.lastTime(); time += 0.01) {
      const double speed = path.at(time).velocity.norm();
      fastest = std::max(fastest, speed);
      if (speed == 0) rests += 0.01;
    }
    EXPECT_GT(rests, 0.6 * path.lastTime());
    EXPECT_GT(fastest, 0.08) << "slow moves prove nothing";
  }
  EXPECT_NE(quietPath(scene, 9, 1).at(0).position, quietPath(scene, 9, 2).at(0).position);
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

TEST(ContactProof, AnArmOfUnknownStiffnessHasForcesPerStiffness) {
  const io::Scene scene =
      io::loadScene(std::string(HELIX_ARM_SOURCE_DIR) + "/config/scenes/spatial_50.yaml");
  ASSERT_FALSE(scene.model.load());
  const ContactProof proof = contactProof(scene, {10, 200, 0.05});
  EXPECT_TRUE(proof.normalised);
  EXPECT_NEAR(900 * proof.force, proofOf({10, 200, 0.05}).force, 1e-12);
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
  constexpr int kPushes = 20;
  for (int k = 0; k < kPushes; ++k) {
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
              found, kPushes);
  EXPECT_GE(found, 16);
  EXPECT_LT(proof.force, 0.5);
}

}  // namespace
}  // namespace helix_arm::procedures
