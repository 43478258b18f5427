#include "helix_arm/control/target_check.hpp"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "support/sample_arm.hpp"

namespace helix_arm::control {
namespace {

const double kNan = std::nan("");
const double kInfinity = std::numeric_limits<double>::infinity();

class PressureCheck : public ::testing::Test {
 protected:
  using Names = std::vector<std::string>;

  // Expects the fault, and every word in the message to the sender.
  void expectRefused(const Names& name, const std::vector<double>& pressure, Fault fault,
                     const std::vector<std::string>& words) {
    const auto checked = checkPressures(arm_, command_, name, pressure);
    ASSERT_TRUE(std::holds_alternative<Refusal>(checked));
    const Refusal& refusal = std::get<Refusal>(checked);
    EXPECT_STREQ(nameOf(refusal.fault), nameOf(fault));
    for (const std::string& word : words) {
      EXPECT_NE(refusal.message.find(word), std::string::npos)
          << word << " in: " << refusal.message;
    }
  }

  const model::Arm arm_ = test::sampleArm();
  const Eigen::VectorXd command_ = Eigen::Vector3d(1e5, 2e5, 3e5);
};

TEST_F(PressureCheck, WithoutNamesAllAreMeantInTheOrderOfTheArm) {
  const auto checked = checkPressures(arm_, command_, {}, {0.0, 1e4, test::kSampleMaxPressure});
  ASSERT_TRUE(std::holds_alternative<Eigen::VectorXd>(checked));
  EXPECT_EQ(std::get<Eigen::VectorXd>(checked),
            Eigen::Vector3d(0.0, 1e4, test::kSampleMaxPressure));
}

TEST_F(PressureCheck, ThoseNotNamedKeepTheirCommand) {
  const auto checked = checkPressures(arm_, command_, {"s1_m3", "s1_m1"}, {5e4, 6e4});
  ASSERT_TRUE(std::holds_alternative<Eigen::VectorXd>(checked));
  EXPECT_EQ(std::get<Eigen::VectorXd>(checked), Eigen::Vector3d(6e4, 2e5, 5e4));
}

TEST_F(PressureCheck, WhatBreaksARuleIsRefused) {
  const double upper = test::kSampleMaxPressure;
  const struct {
    Names name;
    std::vector<double> pressure;
    Fault fault;
    std::vector<std::string> words;
  } kRows[] = {
      {{}, {1, 2}, Fault::kWrongSize, {"2 pressures for 3 actuators"}},
      {{"s9_m1"}, {1}, Fault::kUnknownName, {"'s9_m1'", "s1_m1, s1_m2, s1_m3"}},
      {{"s1_m2", "s1_m2"}, {1, 1}, Fault::kDuplicateName, {"'s1_m2'", "once"}},
      {{}, {0, kNan, 0}, Fault::kNotFinite, {"s1_m2", "nan"}},
      {{"s1_m1"}, {-kInfinity}, Fault::kNotFinite, {"s1_m1", "-inf"}},
      {{"s1_m1"}, {std::nextafter(upper, 1e9)}, Fault::kOutOfRange, {"s1_m1", "0 to 400000"}},
      {{"s1_m2"}, {-1e-9}, Fault::kOutOfRange, {"s1_m2", "-1e-09"}},
  };
  for (const auto& row : kRows) expectRefused(row.name, row.pressure, row.fault, row.words);
}

TEST_F(PressureCheck, ACommandMayLieBetweenTheAtmosphereAndTheLimits) {
  model::Section section;
  for (const model::Range limits : {model::Range{5e4, 3e5}, {-8e4, -2e4}, {0, 3e5}}) {
    model::Actuator actuator = arm_.actuator(static_cast<int>(section.actuators.size()));
    actuator.contraction = model::Contraction::table({-1e5, 4e5}, {0.41, 0.30});
    actuator.limits = limits;
    section.actuators.push_back(actuator);
  }
  const model::Arm arm({section});
  const auto fault = [&](std::vector<double> pressure) {
    const auto checked = checkCommand(arm, command_, {}, pressure);
    const auto* refusal = std::get_if<Refusal>(&checked);
    return std::string(refusal == nullptr ? "none" : nameOf(refusal->fault));
  };
  EXPECT_EQ(fault({0, 0, 0}), "none");
  EXPECT_EQ(fault({2e4, -1e4, 0}), "none");
  EXPECT_EQ(fault({3e5, -8e4, 3e5}), "none");
  for (const std::vector<double>& beyond :
       {std::vector<double>{-1, 0, 0}, {3.1e5, 0, 0}, {0, 1, 0}, {0, -8.1e4, 0}, {0, 0, kNan}}) {
    EXPECT_NE(fault(beyond), "none");
  }
  // Which a target may not.
  EXPECT_TRUE(std::holds_alternative<Refusal>(checkPressures(arm, command_, {}, {2e4, -3e4, 0.0})));
}

TEST_F(PressureCheck, AReadingMayLieOutsideTheLimitsButMustBeWhole) {
  const auto read = [&](const Names& name, const std::vector<double>& pressure) {
    return checkReading(arm_, name, pressure);
  };
  const auto faultOf = [&](const Names& name, const std::vector<double>& pressure) {
    return std::get<Refusal>(read(name, pressure)).fault;
  };
  EXPECT_EQ(std::get<Eigen::VectorXd>(read({}, {-2e3, 9e5, 0.0})), Eigen::Vector3d(-2e3, 9e5, 0.0));
  EXPECT_EQ(std::get<Eigen::VectorXd>(read({"s1_m3", "s1_m1", "s1_m2"}, {3, 1, 2})),
            Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(faultOf({"s1_m3", "s1_m1"}, {3, 1}), Fault::kWrongSize);
  EXPECT_EQ(faultOf({}, {1, kNan, 2}), Fault::kNotFinite);
  EXPECT_EQ(faultOf({}, {1, 2e8, 2}), Fault::kOutOfRange);
  EXPECT_EQ(faultOf({}, {1, 2, -1e300}), Fault::kOutOfRange);
}

TEST(TwistCheck, RowsAreSections) {
  std::vector<double> row_by_row(12);
  for (int i = 0; i < 12; ++i) row_by_row[i] = i;
  const auto checked = checkTwists(2, row_by_row);
  ASSERT_TRUE(std::holds_alternative<model::Twists>(checked));
  const auto& twists = std::get<model::Twists>(checked);
  EXPECT_EQ(twists(5, 0), 5.0);
  EXPECT_EQ(twists(0, 1), 6.0);
}

TEST(TwistCheck, AWrongSizeOrANumberThatIsNoneIsRefused) {
  for (const int size : {0, 6, 11, 13}) {
    const auto checked = checkTwists(2, std::vector<double>(size, 0.0));
    ASSERT_TRUE(std::holds_alternative<Refusal>(checked)) << size;
    EXPECT_EQ(std::get<Refusal>(checked).fault, Fault::kWrongSize);
  }
  std::vector<double> twist(6, 0.0);
  twist[4] = kNan;
  const auto checked = checkTwists(1, twist);
  ASSERT_TRUE(std::holds_alternative<Refusal>(checked));
  EXPECT_EQ(std::get<Refusal>(checked).fault, Fault::kNotFinite);
  EXPECT_NE(std::get<Refusal>(checked).message.find("twist[4]"), std::string::npos);
}

Fault faultOfPose(const Eigen::Vector3d& position, const Eigen::Quaterniond& rotation) {
  return std::get<Refusal>(checkPose(position, rotation)).fault;
}

TEST(PoseCheck, AUnitQuaternionPassesAndIsNormalised) {
  const Eigen::Quaterniond unit(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()));
  const double share = 1.0 + 0.9 * kQuaternionTolerance;
  const Eigen::Quaterniond nearly(share * unit.w(), share * unit.x(), share * unit.y(),
                                  share * unit.z());
  const auto checked = checkPose({1, 2, 3}, nearly);
  ASSERT_TRUE(std::holds_alternative<lie::SE3>(checked));
  const auto& X = std::get<lie::SE3>(checked);
  EXPECT_LT((X.rotation - unit.toRotationMatrix()).norm(), 1e-14);
  EXPECT_EQ(X.translation, Eigen::Vector3d(1, 2, 3));
}

TEST(PoseCheck, OthersAreRefused) {
  const Eigen::Quaterniond unit = Eigen::Quaterniond::Identity();
  EXPECT_EQ(faultOfPose({0, 0, 0}, {0, 0, 0, 0}), Fault::kNotUnitQuaternion);
  EXPECT_EQ(faultOfPose({0, 0, 0}, {1 + 1.1 * kQuaternionTolerance, 0, 0, 0}),
            Fault::kNotUnitQuaternion);
  EXPECT_EQ(faultOfPose({0, 0, 0}, {1 - 1.1 * kQuaternionTolerance, 0, 0, 0}),
            Fault::kNotUnitQuaternion);
  EXPECT_EQ(faultOfPose({0, 0, 0}, {1, kNan, 0, 0}), Fault::kNotFinite);
  EXPECT_EQ(faultOfPose({0, 0, 0}, {kInfinity, 0, 0, 0}), Fault::kNotFinite);
  EXPECT_EQ(faultOfPose({0, kNan, 0}, unit), Fault::kNotFinite);
  EXPECT_EQ(faultOfPose({0, 0, -kInfinity}, unit), Fault::kNotFinite);
}

TEST(TargetCheck, ATargetOffByMoreThanItsTimeoutIsStale) {
  for (const double sign : {1.0, -1.0}) {  // of the past, and of the future
    EXPECT_FALSE(checkAge(0.99 * sign, 1));
    EXPECT_FALSE(checkAge(sign, 1));
    EXPECT_FALSE(checkAge(1e9 * sign, kInfinity));
  }
  for (const auto& [age, words] :
       {std::pair(1.01, "1.01 s ago"),
        {-3.0,
         "the target is stamped 3 s ahead of this machine's clock, more than 1 s "
         "(safety.target_timeout_s); synchronise the clocks"}}) {
    const auto refusal = checkAge(age, 1);
    ASSERT_TRUE(refusal) << words;
    EXPECT_EQ(refusal->fault, Fault::kStale);
    EXPECT_NE(refusal->message.find(words), std::string::npos) << refusal->message;
  }
}

// ---- Pressures that look like kilopascals -------------------------------------------------------

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

TEST(UnitWatch, ARampThatPassesOneKilopascalIsInPascals) {
  UnitWatch watch;
  for (int k = 1; k <= 20; ++k) watch.note(0.05 * k, "/series", 60.0 * k);
  EXPECT_EQ(watch.warning(100), "");
  for (int k = 20; k > 0; --k) watch.note(100 + 0.05 * k, "/series", 60.0 * k);
  EXPECT_EQ(watch.warning(200), "") << "on its way down it is trusted";
}

}  // namespace
}  // namespace helix_arm::control
