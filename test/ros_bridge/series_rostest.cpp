// The series node: plays its rows in order, ends, and gives way to others.
#include <gtest/gtest.h>

#include "support/process.hpp"
#include "support/ros_rig.hpp"

namespace helix_arm::test {
namespace {

TEST(Series, PlaysItsRowsInOrderAndEnds) {
  // No Rig: its first target would be a command, too, and hold the lease against the series.
  ros::NodeHandle node("replay");
  const Inbox<PressureArray> command(node, names::kPressureCommand);
  ASSERT_TRUE(waitFor([&] { return !command.all().empty(); }));
  Process series({HELIX_ARM_SERIES, "__ns:=replay",
                  "_scene:=" HELIX_ARM_SOURCE_DIR "/test/ros_bridge/scenes/brisk.yaml",
                  "_data:=" HELIX_ARM_SOURCE_DIR "/test/ros_bridge/series.csv", "_ramp_s:=0.2",
                  "_hold_s:=0.5"});
  const std::vector<std::vector<double>> rows = {
      {1e5, 0, 5e4, 0, 0, 0, 0}, {0, 2e5, 5e4, 0, 0, 0, 0}, {3e4, 3e4, 3e4, 0, 0, 0, 0}};
  std::size_t reached = 0, looked_at = 0;
  EXPECT_TRUE(waitFor([&] {
    for (; looked_at < command.all().size() && reached < rows.size(); ++looked_at) {
      if (command.all()[looked_at]->pressure == rows[reached]) ++reached;
    }
    return reached == rows.size();
  })) << reached
      << " rows reached\n"
      << series.output();
  EXPECT_EQ(series.exitCode(), 0) << series.output();
  for (const char* words : {"row 3 of 3", "no column for muscle_4, muscle_5, muscle_6, muscle_7"}) {
    EXPECT_NE(series.output().find(words), std::string::npos) << words << series.output();
  }
}

TEST(Series, GivesWayToSomeoneElseAndGoesOnAfterwards) {
  const std::string series = "/yield/pressure_series";
  Rig rig("yield");
  ASSERT_TRUE(rig.connect());
  const auto by_series = [&](const TargetStatus& s) {
    return s.commander == series && s.outcome == TargetStatus::TAKEN;
  };
  ASSERT_TRUE(rig.status.next(by_series));
  ASSERT_TRUE(waitFor([&] {
    return rig.sendPressures(std::vector<double>(7, 1e5)).outcome == TargetStatus::TAKEN;
  }));
  EXPECT_TRUE(rig.status.next(by_series));
}

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) { return helix_arm::test::runRostest(argc, argv); }
