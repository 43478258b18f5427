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
    EXPECT_EQ(capture["status"], "converged");
    const std::vector<double> twist = numbersOf(capture["twist"][0]);
    const double expected[] = {lengths[i], 0, 0, 0, 0, std::acos(0.0)};
    ASSERT_EQ(twist.size(), 6u);
    for (int j = 0; j < 6; ++j) EXPECT_NEAR(twist[j], expected[j], 1e-6) << j;
    EXPECT_NEAR(capture["rms_m"].get<double>(), 0, 1e-6);
  }
}

}  // namespace
}  // namespace helix_arm::test
