// Targets that no one should obey: dropped, counted, answered, and the arm stays as it was.
#include <cmath>
#include <limits>
#include <map>

#include <gtest/gtest.h>

#include "helix_arm/control/target_check.hpp"
#include "support/ros_rig.hpp"

namespace helix_arm::test {
namespace {

using control::Fault;

const double kNan = std::nan("");
const double kInfinity = std::numeric_limits<double>::infinity();
const std::vector<double> kHeld = {1.1e5, 1.2e5, 1.3e5};  // in force before each bad target [Pa]

class BadInput : public ::testing::Test {
 protected:
  void SetUp() override {
    rig_.keepOn();
    ASSERT_TRUE(rig_.connect());
    ASSERT_EQ(rig_.sendPressures(kHeld).outcome, TargetStatus::REACHED);
  }

  // Sends the targets; each must be dropped for the fault, which its message tells with the word.
  template <class Target>
  void expectDropped(const std::vector<std::pair<Target, std::string>>& targets, Fault fault) {
    for (const auto& [target, word] : targets) {
      const TargetStatus answer = rig_.send(target);
      EXPECT_EQ(answer.outcome, TargetStatus::DROPPED);
      EXPECT_EQ(answer.fault, control::nameOf(fault));
      EXPECT_NE(answer.message.find(word), std::string::npos) << word << " in: " << answer.message;
      EXPECT_EQ(rig_.commandAfter(answer), kHeld);
      ++sent_[fault];
    }
    EXPECT_TRUE(rig_.diagnoses("pressure_command: targets",
                               names::kDroppedPrefix + std::string(control::nameOf(fault)),
                               std::to_string(sent_[fault])));
  }

  static PressureArray pressures(const std::vector<double>& pressure,
                                 const std::vector<std::string>& name = {}) {
    PressureArray out;
    out.pressure = pressure;
    out.name = name;
    return out;
  }

  static ShapeTarget shape(const std::vector<double>& twist) {
    ShapeTarget out;
    out.twist = twist;
    return out;
  }

  static TipTarget pose(double x, double qx, double qw, int mode = TipTarget::POSE,
                        const std::string& frame = "") {
    TipTarget out;
    out.header.frame_id = frame;
    out.mode = static_cast<std::uint8_t>(mode);
    out.pose.position.x = x;
    out.pose.orientation.x = qx;
    out.pose.orientation.w = qw;
    return out;
  }

  Rig rig_;
  static std::map<Fault, int> sent_;  // since the node started
};

std::map<Fault, int> BadInput::sent_;

TEST_F(BadInput, NumbersThatAreNotFinite) {
  expectDropped<PressureArray>({{pressures({0, kNan, 0}), "muscle_2"},
                                {pressures({0, 0, kInfinity}), "muscle_3"},
                                {pressures({-kInfinity}, {"muscle_1"}), "muscle_1"}},
                               Fault::kNotFinite);
  expectDropped<ShapeTarget>({{shape({0.4, 0, 0, 0, kNan, 0}), "twist[4]"}}, Fault::kNotFinite);
  expectDropped<TipTarget>({{pose(kNan, 0, 1), "the tip's x"},
                            {pose(kInfinity, 0, 0, TipTarget::POSITION), "the tip's x"},
                            {pose(0.3, kNan, 1), "quaternion"}},
                           Fault::kNotFinite);
}

TEST_F(BadInput, WrongSizes) {
  expectDropped<PressureArray>({{pressures({}), "0 pressures"},
                                {pressures({1, 2}), "2 pressures"},
                                {pressures({1, 2, 3, 4}), "4 pressures"},
                                {pressures({1, 2}, {"muscle_1"}), "1 names"},
                                {pressures({}, {"muscle_1"}), "0 pressures"}},
                               Fault::kWrongSize);
  expectDropped<ShapeTarget>(
      {{shape({}), "0 numbers"}, {shape({1, 2, 3, 4, 5, 6, 7}), "7 numbers"}}, Fault::kWrongSize);
}

TEST_F(BadInput, Names) {
  const std::string endless(2'000'000, '\n');
  expectDropped<PressureArray>(
      {{pressures({1}, {"muscle_9"}), "'muscle_9'"}, {pressures({1}, {endless}), "????...'"}},
      Fault::kUnknownName);
  EXPECT_LT(rig_.status.last().message.size(), 200U);
  expectDropped<PressureArray>({{pressures({1, 2}, {"muscle_1", "muscle_1"}), "'muscle_1'"}},
                               Fault::kDuplicateName);
}

TEST_F(BadInput, PressuresBeyondTheLimits) {
  expectDropped<PressureArray>(
      {{pressures({-1, 0, 0}), "muscle_1"}, {pressures({9e5}, {"muscle_2"}), "muscle_2"}},
      Fault::kOutOfRange);
}

TEST_F(BadInput, FramesModesAndQuaternions) {
  expectDropped<TipTarget>(
      {{pose(0.3, 0, 1, TipTarget::POSE, "world"), "'world'"},
       {pose(0.3, 0, 1, TipTarget::POSITION, "/arm_base"), "'/arm_base'"},
       {pose(0.3, 0, 1, TipTarget::POSE, std::string(2'000'000, 'x')), "xxxx...'"}},
      Fault::kWrongFrame);
  expectDropped<TipTarget>({{pose(0.3, 0, 1, 2), "mode 2"}}, Fault::kUnknownMode);
  expectDropped<TipTarget>({{pose(0.3, 0, 0), "norm 0"}, {pose(0.3, 1, 1), "norm 1.41"}},
                           Fault::kNotUnitQuaternion);
}

TEST_F(BadInput, AfterAllOfItTheArmObeysAGoodTarget) {
  rig_.sendPressures({kNan, kNan, kNan});
  ++sent_[Fault::kNotFinite];
  const std::vector<double> wanted = {2e5, 1e5, 0};
  const TargetStatus answer = rig_.sendPressures(wanted);
  EXPECT_EQ(answer.outcome, TargetStatus::REACHED);
  EXPECT_EQ(rig_.commandAfter(answer), wanted);
  EXPECT_TRUE(rig_.diagnoses("pressure_command: targets", names::kLastFaultKey,
                             [](const std::string& fault) { return !fault.empty(); }));
}

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) { return helix_arm::test::runRostest(argc, argv); }
