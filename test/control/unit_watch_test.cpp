// Kilopascals in a field of pascals.
#include <gtest/gtest.h>

#include "helix_arm/control/target_check.hpp"
#include "support/sample_arm.hpp"

namespace helix_arm::control {
namespace {

TEST(UnitWatch, WarnsOnceOfACommanderWhosePressuresStayBelowOneKilopascal) {
  UnitWatch watch;
  for (int k = 0; k < 100; ++k) watch.note(0.1 * k, "/mine", 200);
  EXPECT_EQ(watch.warning(0.1), "");
  const std::string text = watch.warning(UnitWatch::kPatience);
  EXPECT_NE(text.find("/mine"), std::string::npos);
  EXPECT_NE(text.find("200 Pa"), std::string::npos);
  EXPECT_NE(text.find("200000"), std::string::npos);
  EXPECT_EQ(watch.warning(100), "");
  watch.note(200, "/mine", 300);
  EXPECT_EQ(watch.warning(300), "");
}

TEST(UnitWatch, ASingleTargetIsEnough) {
  UnitWatch watch;
  watch.note(5, "/rostopic_1", 999);
  EXPECT_EQ(watch.warning(5 + UnitWatch::kPatience - 0.01), "");
  EXPECT_NE(watch.warning(5 + UnitWatch::kPatience), "");
}

TEST(UnitWatch, ARampThatPassesOneKilopascalIsInPascals) {
  UnitWatch watch;
  for (int k = 1; k <= 20; ++k) watch.note(0.05 * k, "/series", 60.0 * k);
  EXPECT_EQ(watch.warning(100), "");
  for (int k = 20; k > 0; --k) watch.note(100 + 0.05 * k, "/series", 60.0 * k);
  EXPECT_EQ(watch.warning(200), "") << "on its way down it is trusted";
}

TEST(UnitWatch, AnEmptyArmIsNoSuspicion) {
  UnitWatch watch;
  watch.note(0, "/mine", 0);
  EXPECT_EQ(watch.warning(100), "");
}

TEST(KilopascalWarning, LooksAtAllPressures) {
  const model::Arm arm = test::sampleArm();
  const int n = arm.actuatorCount();
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(2, n);
  EXPECT_EQ(kilopascalWarning("--input", arm, rows), "");
  rows(1, n - 1) = UnitWatch::kSuspicious - 1;
  const std::string text = kilopascalWarning("--input", arm, rows);
  EXPECT_NE(text.find("--input"), std::string::npos) << text;
  EXPECT_NE(text.find("999 Pa"), std::string::npos) << text;
  rows(0, 0) = UnitWatch::kSuspicious;
  EXPECT_EQ(kilopascalWarning("--input", arm, rows), "");
}

TEST(UnitWatch, TellsOfEachCommanderAndRemembersABoundedNumber) {
  UnitWatch watch;
  for (int k = 0; k < 2 * UnitWatch::kMost; ++k) watch.note(0, std::to_string(k), 100);
  int told = 0;
  while (!watch.warning(10).empty()) ++told;
  EXPECT_EQ(told, UnitWatch::kMost);
}

}  // namespace
}  // namespace helix_arm::control
