#include "helix_arm/io/provenance.hpp"

#include <gtest/gtest.h>

#include "scene_faults.hpp"

namespace helix_arm::io {
namespace {

using namespace test;

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

TEST(Provenance, IsReadWithTheScene) {
  const Scene scene = sceneOf(kScene);
  ASSERT_TRUE(scene.calibration);
  const Provenance& calibration = *scene.calibration;
  EXPECT_EQ(calibration.date, "2026-01-31T12:00:00Z");
  EXPECT_EQ(calibration.package_version, "0.1.0");
  EXPECT_EQ(calibration.from, "arm.yaml");
  ASSERT_EQ(calibration.data.size(), 2u);
  EXPECT_EQ(calibration.data[0].file, "a.csv");
  EXPECT_EQ(calibration.data[0].sha256.substr(0, 8), "ba7816bf");
  EXPECT_EQ(calibration.data[0].captures, 36);
  ASSERT_EQ(calibration.parameters.size(), 2u);
  EXPECT_EQ(calibration.parameters[0].name, "K_kappa");
  EXPECT_EQ(calibration.parameters[0].value, 1.5e-4);
  EXPECT_EQ(calibration.parameters[0].standard_error, 2e-6);
  EXPECT_TRUE(calibration.parameters[0].identifiable);
  EXPECT_EQ(calibration.parameters[0].unit, "m^2");
  EXPECT_FALSE(calibration.parameters[1].identifiable);
  EXPECT_EQ(calibration.parameters[1].unit, "");
  EXPECT_EQ(calibration.rms, 0.3);
  EXPECT_EQ(calibration.held_out_error, 0.4);
  EXPECT_EQ(calibration.error_unit, "px");
}

TEST(Provenance, IsAbsentWhereNothingWasCalibrated) {
  EXPECT_FALSE(sceneOf(kPlanarScene).calibration);
  const Scene scene = sceneOf(replaced(kScene, "  held_out_error: 0.4\n", ""));
  EXPECT_FALSE(scene.calibration->held_out_error);
}

TEST(Provenance, ChangesNothingOfTheModel) {
  const Scene with = sceneOf(kScene), without = sceneOf(kPlanarScene);
  const Eigen::VectorXd pressure = Eigen::Vector2d(1e5, 3e5);
  EXPECT_EQ(with.arm.twists(pressure), without.arm.twists(pressure));
}

// Line 21 of the scene is the key, 22 and 23 the entries.
const std::string kCombinations =
    "  combinations:\n"
    "    - {exponents: {K_gamma: 0.8, K_kappa: 0.6}, relative_error: 0.01, identifiable: true}\n"
    "    - {exponents: {K_gamma: -0.6, K_kappa: 0.8}, relative_error: 0.5, identifiable: false}\n";
const std::string kCombined = replaced(kScene, "  rms:", kCombinations + "  rms:");

TEST(Provenance, CombinationsAreReadWithIt) {
  EXPECT_TRUE(sceneOf(kScene).calibration->combinations.empty());
  const std::vector<Provenance::Combination> read = sceneOf(kCombined).calibration->combinations;
  ASSERT_EQ(read.size(), 2u);
  EXPECT_EQ(read[0].exponents, (std::map<std::string, double>{{"K_gamma", 0.8}, {"K_kappa", 0.6}}));
  EXPECT_EQ(read[0].relative_error, 0.01);
  EXPECT_TRUE(read[0].identifiable);
  EXPECT_EQ(read[1].exponents.at("K_gamma"), -0.6);
  EXPECT_FALSE(read[1].identifiable);
}

TEST(Provenance, CombinationsMustBeThoseOfACovariance) {
  expectFaults("combined", kCombined);
  EXPECT_EQ(faultsOf(replaced(kScene, "  rms:", "  combinations: []\n  rms:")),
            Faults{":21 calibration.combinations is empty; expected a list of at least one entry"});
}

TEST(Provenance, BreakingARuleIsReported) { expectFaults("calibrated", kScene); }

TEST(Provenance, NeedsDataAndMayHaveNoParameters) {
  const std::string parameters =
      kScene.substr(kScene.find("    K_kappa"), kScene.find("  rms") - kScene.find("    K_kappa"));
  EXPECT_TRUE(faultsOf(replaced(kScene, "parameters:\n" + parameters, "parameters: {}\n")).empty());
  const std::string data = kScene.substr(kScene.find("    - {file"),
                                         kScene.find("  parameters") - kScene.find("    - {file"));
  EXPECT_EQ(faultsOf(replaced(kScene, "data:\n" + data, "data: []\n")),
            Faults{":15 calibration.data is empty; expected a list of at least one entry"});
}

}  // namespace
}  // namespace helix_arm::io
