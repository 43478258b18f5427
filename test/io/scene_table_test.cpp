// stiffness.K_eps_n as a table against pressure.
#include <gtest/gtest.h>

#include "scene_faults.hpp"

namespace helix_arm::io {
namespace {

constexpr char kTable[] = "{pressure_kpa: [0, 130, 260, 414], force_n: [45, 15, 37, 60]}";

Scene loadedWith(const std::string& K_eps) {
  return loadScene(
      HELIX_ARM_SOURCE_DIR "/config/scenes/loaded.yaml",
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

TEST(SceneStiffnessTable, AConstantOneIsANumberBitForBit) {
  const Scene number = loadedWith("60");
  const Scene table = loadedWith("{pressure_kpa: [0, 200, 414], force_n: [60, 60, 60]}");
  EXPECT_TRUE(table.model.load()->tables.empty());
  const Eigen::Vector3d q(3e5, 1e5, 0);
  EXPECT_EQ(table.model.tip(q).tip.translation, number.model.tip(q).tip.translation);
}

TEST(SceneStiffnessTable, WithoutLoadItHasNoEffect) {
  const std::string path = HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml";
  const Scene plain = loadScene(path), table = loadScene(path, {{"arm.stiffness.K_eps_n", kTable}});
  const Eigen::Vector3d q(3e5, 1e5, 0);
  EXPECT_EQ(table.model.tip(q).tip.translation, plain.model.tip(q).tip.translation);
}

TEST(SceneStiffnessTable, RulesAreChecked) {
  const auto faults = [](const std::string& table) {
    std::string message;
    try {
      loadedWith(table);
    } catch (const DocumentError& error) {
      message = error.what();
    }
    return message;
  };
  EXPECT_NE(faults("{pressure_kpa: [0, 414], force_n: [45]}")
                .find("force_n has 1 entries for 2 of pressure_kpa"),
            std::string::npos);
  EXPECT_NE(faults("{pressure_kpa: [0, 200, 100], force_n: [45, 14, 30]}")
                .find("expected ascending pressures"),
            std::string::npos);
  EXPECT_NE(faults("{pressure_kpa: [0, 414], force_n: [45, 0]}").find("force_n[1] is 0"),
            std::string::npos);
  EXPECT_NE(faults("{pressure_kpa: [0, 300], force_n: [45, 30]}")
                .find("expected to cover its limits of 0 to 413.6856 kPa"),
            std::string::npos)
      << faults("{pressure_kpa: [0, 300], force_n: [45, 30]}");
}

}  // namespace
}  // namespace helix_arm::io
