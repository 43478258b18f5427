#include <cmath>

#include <gtest/gtest.h>

#include "command.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {
namespace {

// A planar arm of two muscles that is a straight rod of 0.4 m at 0 kPa.
const std::string kFlatScene = R"(name: flat
contractions:
  linear: {table: {pressure_kpa: [0, 100], length_m: [0.4, 0.3]}}
arm:
  geometry: planar
  stiffness: {K_gamma: 10, K_tau_m2: 0, K_kappa_m2: 1.0e-4}
  sections: [{name: arm, ring: {count: 2, radius_m: 0.03, contraction: linear}}]
)";

// The same of three muscles and 0.3 m.
const std::string kRodScene = R"(name: rod
contractions:
  linear: {table: {pressure_kpa: [0, 100], length_m: [0.3, 0.2]}}
arm:
  geometry: spatial
  stiffness: {K_gamma: 10, K_tau_m2: 0, K_kappa_m2: 1.0e-4}
  sections: [{name: arm, ring: {count: 3, radius_m: 0.03, contraction: linear}}]
)";

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

}  // namespace
}  // namespace helix_arm::test
