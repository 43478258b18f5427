// Rigs that are not as their scenes say, in `follow`.
#include <functional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "procedures/follow_run.hpp"
#include "support/random.hpp"
#include "support/shipped_scene.hpp"
#include "support/test_size.hpp"

namespace helix_arm::procedures {
namespace {

using Actuators = std::vector<model::Actuator>;

// Half a minute between tips of random pressures, on a rig with other actuators.
FollowResult runOn(const io::Scene& scene, unsigned seed,
                   const std::function<void(Actuators&)>& change) {
  test::Random random(seed);
  FollowPlan plan;
  plan.seconds = 30;
  plan.seed = seed;
  model::SectionOf<lie::SE3> section;
  Eigen::VectorXd fraction(scene.arm.actuatorCount());
  for (int k = 0; k < 6; ++k) {
    for (double& one : fraction) one = random.uniform(0.05, 0.95);
    plan.tips.push_back(scene.model.tip(scene.arm.inputAt(fraction)).tip.translation);
  }
  for (int i = 0; i < fraction.size(); ++i) section.actuators.push_back(scene.arm.actuator(i));
  change(section.actuators);
  io::Scene rig = scene;
  rig.arm = model::Arm(std::vector<model::SectionOf<lie::SE3>>{section});
  rig.model = {rig.arm, std::nullopt, scene.model.load(), scene.model.choice().setting};
  return runFollow(scene, rig, plan);
}

// The muscle gets this part of what is read.
void weaken(model::Actuator& actuator, double gain) {
  std::vector<double> pressure, length;
  for (int k = 0; k <= 50; ++k) {
    pressure.push_back(actuator.limits.upper * (k / 50.0));
    length.push_back(actuator.contraction.lengthInside(gain * pressure.back()));
  }
  actuator.contraction = model::Contraction::table(pressure, length);
}

TEST(SuspectWatch, NamesWhatIsWrongAndNoContact) {
  const struct {
    std::string named;
    std::function<void(Actuators&)> change;
  } mistakes[] = {
      {"", [](Actuators&) {}},
      {"channels_exchanged muscle_1 and muscle_2",
       [](Actuators& all) { std::swap(all[0].X_O, all[1].X_O); }},
      {"channel_dead muscle_2", [](Actuators& all) { weaken(all[1], 0.003); }},
      {"pressure_gain muscle_1", [](Actuators& all) { weaken(all[0], 0.6); }},
  };
  const std::string four = "{count: 4, radius_m: 0.03, contraction: fig3_muscle}";
  for (const io::Scene& scene :
       {test::demo(),
        test::demo({{"arm.sections[0].ring", four}, {"simulation.arm", "{length_scale: 1.01}"}})}) {
    for (const auto& mistake : mistakes) {
      for (int seed = 1; seed <= test::draws(1, 2); ++seed) {
        const FollowResult result = runOn(scene, seed, mistake.change);
        const auto& found = result.suspects;
        EXPECT_EQ(found.empty() ? "" : found[0].cause + " " + found[0].where, mistake.named)
            << scene.arm.actuatorCount() << " muscles, seed " << seed;
        EXPECT_TRUE(result.alarms.empty());
      }
    }
  }
}

}  // namespace
}  // namespace helix_arm::procedures
