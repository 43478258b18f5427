// The model of an arm under load: its tier, where no shape holds the load, scenes without load.
#include <ros/service.h>

#include "helix_arm/Reload.h"
#include "support/temporary_file.hpp"
#include "support/vision_rig.hpp"

namespace helix_arm::test {
namespace {

constexpr char kLoaded[] = HELIX_ARM_SOURCE_DIR "/config/scenes/loaded.yaml";
constexpr char kStatus[] = "pressure_command: model";

void reload(const std::string& scene) {
  Reload call;
  call.request.scene = scene;
  ASSERT_TRUE(ros::service::waitForService("pressure_command/reload", ros::Duration(20)));
  ASSERT_TRUE(ros::service::call("pressure_command/reload", call));
  EXPECT_TRUE(call.response.success) << call.response.message;
}

class UnderLoad : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(rig_.connect()); }
  void TearDown() override { reload("loaded"); }

  Rig rig_;
};

TEST_F(UnderLoad, TheModelIsOfTheLoadedTierInPieces) {
  const auto model = rig_.model.next([](const ArmShape&) { return true; });
  ASSERT_TRUE(model);
  const statics::TierChoice& choice = shippedScene("loaded").model.choice();
  EXPECT_EQ(model->tier, "loaded");
  EXPECT_EQ(static_cast<int>(model->order), choice.setting.order);
  EXPECT_GE(model->order, 2u);
  EXPECT_FALSE(model->tier_reason.empty());
  EXPECT_EQ(model->sections, 1u);
  EXPECT_EQ(model->pieces, 8u);
  EXPECT_EQ(model->piece_twist.size(), 6u * 8u);
  EXPECT_TRUE(rig_.diagnoses(kStatus, "tier", "loaded"));
  EXPECT_TRUE(rig_.diagnoses(kStatus, "solve_status", "converged"));
}

// An arm on its head, with more on it than it can bear at every pressure.
TEST_F(UnderLoad, WhereNoShapeHoldsTheLoadThereIsNoModelAndTheDiagnosticsSaySo) {
  const TemporaryFile file(io::sceneText(kLoaded, {{"tier", "loaded"},
                                                   {"order", "2"},
                                                   {"arm.base.rpy_deg", "[0, -90, 0]"},
                                                   {"load.mass_kg", "20"}}),
                           ".yaml");
  const io::Scene scene = io::loadScene(file.path());
  std::vector<double> held, crushed;
  for (int corner = 0; corner < 8; ++corner) {
    std::vector<double> pressure;
    for (int i = 0; i < 3; ++i) pressure.push_back((corner >> i & 1) != 0 ? 4e5 : 1e4);
    (scene.model.solve(vectorOf(pressure)).converged() ? held : crushed) = pressure;
  }
  ASSERT_FALSE(held.empty());
  ASSERT_FALSE(crushed.empty());
  reload(file.path());
  rig_.keepOn();
  ASSERT_EQ(rig_.sendPressures(crushed).outcome, TargetStatus::REACHED);
  EXPECT_TRUE(rig_.diagnoses(kStatus, "solve_status", "not_converged"));
  EXPECT_TRUE(
      rig_.diagnoses(kStatus, "unsolved", [](const std::string& v) { return std::stoul(v) > 0; }));
  const std::size_t from = rig_.model.all().size();
  ASSERT_EQ(rig_.sendPressures(held).outcome, TargetStatus::REACHED);
  EXPECT_TRUE(rig_.diagnoses(kStatus, "solve_status", "converged"));
  EXPECT_TRUE(rig_.model.next([](const ArmShape&) { return true; }));
  // Every model is one of pressures at which there is a shape.
  for (std::size_t i = from; i < rig_.model.all().size(); ++i) {
    const auto measured = VisionListener::of(rig_.measured, rig_.model.all()[i]->header.stamp);
    ASSERT_TRUE(measured);
    EXPECT_TRUE(scene.model.solve(scene.arm.clamped(vectorOf(measured->pressure))).converged());
  }
}

TEST_F(UnderLoad, AReloadedSceneWithoutLoadIsOfTheLinearTier) {
  std::string text = io::sceneText(kLoaded, {});
  const std::size_t begin = text.find("\nload:");
  ASSERT_NE(begin, std::string::npos);
  std::size_t end = text.find('\n', begin + 1);
  while (text[end + 1] == ' ') end = text.find('\n', end + 1);
  text.erase(begin, end - begin);
  const TemporaryFile file(text, ".yaml");
  reload(file.path());
  const auto model = rig_.model.next([](const ArmShape& m) { return m.tier == "linear"; });
  ASSERT_TRUE(model);
  EXPECT_EQ(model->order, 0u);
  EXPECT_LE(model->pieces, 1u);
  EXPECT_TRUE(rig_.diagnoses(kStatus, "tier", "linear"));
}

}  // namespace
}  // namespace helix_arm::test
