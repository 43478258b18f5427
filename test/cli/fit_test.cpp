#include <cmath>
#include <sstream>

#include <gtest/gtest.h>

#include "command.hpp"
#include "rod_scene.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;

// The tags of the rod, bent about z to a quarter of a circle of that length.
std::string bentRows(int capture, double length) {
  const double bend = std::acos(0.0);
  std::ostringstream rows;
  rows.precision(17);
  for (int tag = 1; tag <= 6; ++tag) {
    const double s[] = {0.25, 0.5, 1};
    const double angle = bend * s[(tag - 1) % 3], radius = length / bend;
    const double out = tag <= 3 ? 0.05 : 0, up = tag <= 3 ? 0 : 0.05;
    rows << capture << ",0," << tag << "," << (radius - out) * std::sin(angle) << ","
         << radius - (radius - out) * std::cos(angle) << "," << up << ",0,0," << std::sin(angle / 2)
         << "," << std::cos(angle / 2) << "\n";
  }
  return rows.str();
}

Outcome fit(const TemporaryFile& scene, const TemporaryFile& data,
            const std::string& format = "json") {
  return runCommand({"fit", scene.path(), data.path(), "--format", format});
}

// Of poses without noise: the model's prior then says nothing.
json fitExact(const TemporaryFile& scene, const TemporaryFile& data) {
  return resultOf({"fit", scene.path(), data.path(), "--set", "vision.tag_position_noise_m=1e-5"});
}

TEST(Fit, FindsTheTwistThatTheTagsTell) {
  const TemporaryFile scene(kRodScene),
      data(kTagPoseHeader + bentRows(3, 0.25) + bentRows(8, 0.28));
  const json result = fitExact(scene, data);
  ASSERT_EQ(result["captures"].size(), 2u);
  const double lengths[] = {0.25, 0.28};
  for (int i = 0; i < 2; ++i) {
    const json& capture = result["captures"][i];
    EXPECT_EQ(capture["capture"], i == 0 ? 3 : 8);
    EXPECT_EQ(capture["converged"], true);
    EXPECT_EQ(capture["status"], "converged");
    const std::vector<double> twist = numbersOf(capture["twist"][0]);
    const double expected[] = {lengths[i], 0, 0, 0, 0, std::acos(0.0)};
    ASSERT_EQ(twist.size(), 6u);
    for (int j = 0; j < 6; ++j) EXPECT_NEAR(twist[j], expected[j], 1e-6) << j;
    ASSERT_EQ(capture["covariance"].size(), 6u);
    for (int j = 0; j < 6; ++j) {
      ASSERT_EQ(capture["covariance"][j].size(), 6u);
      EXPECT_GT(capture["covariance"][j][j].get<double>(), 0);
    }
    EXPECT_NEAR(capture["rms_m"].get<double>(), 0, 1e-6);
    EXPECT_EQ(capture["outlier_tags"], json::array());
    EXPECT_EQ(capture["unknown_tags"], json::array());
    EXPECT_EQ(capture["tags"].size(), 6u);
  }
  EXPECT_NEAR(result["median_rms_m"].get<double>(), 0, 1e-6);
  EXPECT_EQ(result["flagged_captures"], json::array());
}

TEST(Fit, TooFewTagsGiveNoTwistAndExitCodeOne) {
  const TemporaryFile scene(kRodScene);
  const TemporaryFile one(kTagPoseHeader + "4,0,1,0.1,0,0,0,0,0,1\n");
  const Outcome outcome = fit(scene, one);
  EXPECT_EQ(outcome.exit_code, 1);
  const json result = outcome.json();
  EXPECT_TRUE(result["captures"][0]["twist"].is_null());
  EXPECT_TRUE(result["captures"][0]["covariance"].is_null());
  EXPECT_TRUE(result["captures"][0]["rms_m"].is_null());
  EXPECT_EQ(result["captures"][0]["status"], "underdetermined");
  EXPECT_EQ(result["captures"][0]["converged"], false);
  EXPECT_TRUE(result["median_rms_m"].is_null());
  EXPECT_EQ(result["reason"].get<std::string>().find("no capture could be fitted"), 0u);
  // One capture that can be fitted is a result, and the other says what it lacks.
  const TemporaryFile both(kTagPoseHeader + bentRows(3, 0.25) + "4,0,1,0.1,0,0,0,0,0,1\n");
  const Outcome mixed = fit(scene, both);
  EXPECT_EQ(mixed.exit_code, 0);
  EXPECT_TRUE(mixed.json()["captures"][1]["twist"].is_null());
  EXPECT_EQ(mixed.json()["captures"][1]["outlier_tags"], json::array());
  // Beside the RMS stands that of the noise, 10 mm per axis.
  EXPECT_TRUE(has(fit(scene, both, "text").out, "an RMS of about 17.3 mm is expected"));
  EXPECT_EQ(fit(scene, one, "csv").exit_code, 1);
  EXPECT_EQ(fit(scene, one, "text").exit_code, 1);
}

}  // namespace
}  // namespace helix_arm::test
