#include <cmath>

#include <gtest/gtest.h>

#include "command.hpp"
#include "rod_scene.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {
namespace {

// The model's curvature is known: r (l2 - l1) / (2 (r^2 + K_kappa)) of the scene's linear curve.
TEST(Evaluate, ComparesEveryRowWithTheModel) {
  const TemporaryFile scene(kFlatScene);
  const TemporaryFile data(
      "# two rows\npressure_1_kpa,pressure_2_kpa,curvature_rad\n50,0,1\n20,80,0.5\n");
  const nlohmann::json result = resultOf({"evaluate", scene.path(), data.path()});
  ASSERT_EQ(result["points"].size(), 2u);
  const double per_metre = 0.03 / (2 * (0.03 * 0.03 + 1e-4));
  const double model[] = {per_metre * 0.05, per_metre * 0.06},
               measured[] = {1, 0.5};  // the norm has no sign
  for (int i = 0; i < 2; ++i) {
    EXPECT_NEAR(result["points"][i]["model_rad"].get<double>(), model[i], 1e-13);
    EXPECT_EQ(result["points"][i]["measured_rad"], measured[i]);
  }
  EXPECT_EQ(numbersOf(result["points"][1]["pressure_pa"]), (std::vector<double>{20e3, 80e3}));
  EXPECT_NEAR(result["rms_rad"].get<double>(),
              std::hypot(model[0] - 1, model[1] - 0.5) / std::sqrt(2.0), 1e-13);
  EXPECT_NEAR(result["max_rad"].get<double>(),
              std::max(std::abs(model[0] - 1), std::abs(model[1] - 0.5)), 1e-13);

  const auto rows =
      csvRows(runCommand({"--format", "csv", "evaluate", scene.path(), data.path()}).out);
  ASSERT_EQ(rows.size(), 3u);
  EXPECT_EQ(rows[0], (std::vector<std::string>{"pressure_1_pa", "pressure_2_pa", "measured_rad",
                                               "model_rad", "difference_rad"}));
  EXPECT_EQ(std::stod(rows[1][3]), result["points"][0]["model_rad"].get<double>());
}

TEST(Evaluate, OrientationsOfASeriesAreComparedWhereItHasThem) {
  const TemporaryFile scene(kRodScene), turned(
                                            "time_s,pressure_1_kpa,x_m,y_m,z_m,qx,qy,qz,qw\n"
                                            "0,0,0.3,0,0,1,0,0,0\n");
  const std::vector<std::string> evaluate = {"evaluate", scene.path(), turned.path()};
  EXPECT_NEAR(resultOf(evaluate)["rms_rad"].get<double>(), 0, 1e-9) << "of any body";
  const nlohmann::json known = resultOf(
      {"evaluate", scene.path(), turned.path(), "--set", "motion_capture.body_rpy_deg=[0, 0, 0]"});
  EXPECT_NEAR(known["rms_rad"].get<double>(), std::acos(-1.0), 1e-9);
}

TEST(Evaluate, TagPosesAreComparedWithTheModelsTagsAndTip) {
  const TemporaryFile scene(kRodScene);
  // As the model has them, but stretched by 20 mm: the tags are off by 5, 10 and 20 mm.
  const TemporaryFile data(kTagPoseHeader +
                           "5,0,1,0.08,0.05,0,0,0,0,1\n5,0,2,0.16,0.05,0,0,0,0,1\n"
                           "5,0,3,0.32,0.05,0,0,0,0,1\n5,0,4,0.08,0,0.05,0,0,0,1\n"
                           "5,0,5,0.16,0,0.05,0,0,0,1\n5,0,6,0.32,0,0.05,0,0,0,1\n");
  const nlohmann::json result = resultOf(
      {"evaluate", scene.path(), data.path(), "--set", "vision.tag_position_noise_m=1e-5"});
  ASSERT_EQ(result["captures"].size(), 1u);
  const nlohmann::json& capture = result["captures"][0];
  EXPECT_EQ(capture["capture"], 5);
  EXPECT_EQ(capture["outlier_tags"], nlohmann::json::array());
  const double rms = std::sqrt((25 + 100 + 400) / 3.0) * 1e-3;
  EXPECT_NEAR(capture["rms_m"].get<double>(), rms, 1e-12);
  EXPECT_NEAR(capture["tip_error_percent"].get<double>(), 100 * 0.02 / 0.3, 1e-3);
  EXPECT_EQ(result["median_rms_m"], capture["rms_m"]);

  const auto rows =
      csvRows(runCommand({"--format", "csv", "evaluate", scene.path(), data.path()}).out);
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[0],
            (std::vector<std::string>{"capture", "status", "pressure_1_pa", "pressure_2_pa",
                                      "pressure_3_pa", "rms_m", "tip_error_m", "tip_error_percent",
                                      "outlier_tags", "unknown_tags", "model_status"}));
  EXPECT_EQ(rows[1].back(), "converged");
  EXPECT_EQ(std::stod(rows[1][5]), capture["rms_m"].get<double>());
}

}  // namespace
}  // namespace helix_arm::test
