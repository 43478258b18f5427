// The fault matrix of the ROS master and of simulated time, each with a master of its own.
#include <csignal>

#include <gtest/gtest.h>
#include <rosbag/bag.h>

#include "helix_arm/PressureArray.h"
#include "support/emulated_regulator.hpp"
#include "support/eventually.hpp"
#include "support/process.hpp"
#include "support/test_size.hpp"

namespace helix_arm::test {
namespace {

const std::string kNode = "/pressure_command";

class DeadMaster : public ::testing::Test {
 protected:
  std::vector<std::string> node(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> out = {HELIX_ARM_PRESSURE_COMMAND, "_scene:=" + regulator_.scene()};
    out.insert(out.end(), more.begin(), more.end());
    return out;
  }
  // Goes through pressures above 140 kPa on every muscle.
  Process commander() const {
    return Process({HELIX_ARM_SERIES, "_scene:=" + regulator_.scene(), "_loop:=true",
                    "_ramp_s:=0.2", "_hold_s:=1"},
                   master_.variables());
  }
  void call(const std::vector<std::string>& arguments, const std::string& answer) const {
    std::vector<std::string> command = {"rosservice", "call", "--wait"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    Process process(command, master_.variables());
    EXPECT_EQ(process.exitCode(), 0) << process.output();
    EXPECT_NE(process.output().find(answer), std::string::npos) << process.output();
  }
  // Enabled, again where a busy machine trips the brisk rules of the scene.
  bool inflates() const {
    for (int attempt = 0; attempt < 12; ++attempt) {
      call({kNode + "/enable"}, "success: ");
      if (eventually([this] { return regulator_.pressure()[0] > 1.4e5; }, 8)) return true;
    }
    return false;
  }
  bool vents(double deadline) const {
    return eventually([this] { return regulator_.isVented(); }, deadline);
  }
  EmulatedRegulator regulator_{Line::kModbus};
  Master master_;
};

// A hanging master accepts requests and answers none, including those to unregister at the end.
TEST_F(DeadMaster, ItsEndOrItsSilenceEndsTheNodeVented) {
  struct End {
    const char *what, *words;
    bool hangs, asked;
  };
  for (const End& end :
       {End{"master hung", "does not answer", true, false}, End{"master lost", "", false, false},
        End{"interrupted while the master hangs", "", true, true}}) {
    if (!end.hangs && !isFullSize()) break;
    SCOPED_TRACE(end.what);
    Process arm(node(), master_.variables());
    Process hand = commander();
    ASSERT_TRUE(arm.prints("loop at") && inflates()) << arm.output();
    const double begin = regulator::steadyNow();
    end.hangs ? master_.signal(SIGSTOP) : master_.stop();
    if (end.asked) {
      arm.signal(SIGINT);
      EXPECT_TRUE(vents(5));
    }
    EXPECT_EQ(arm.exitCode(60), 1) << arm.output();
    std::printf("[  FIGURE  ] %s: the node has ended, the regulator is empty after %.1f s\n",
                end.what, regulator::steadyNow() - begin);
    EXPECT_NE(arm.output().find(end.words), std::string::npos) << arm.output();
    EXPECT_EQ(arm.output().find("guard:"), std::string::npos) << "the node has not vented";
    // Its valves have closed with the link.
    EXPECT_LT(regulator_.pressure().maxCoeff(), kEmpty);
    EXPECT_EQ(hand.exitCode(60), 1) << hand.output();
    end.hangs ? master_.signal(SIGCONT) : master_.start();
  }
}

TEST_F(DeadMaster, HardwareRefusesSimulatedTime) {
  Process set({"rosparam", "set", "/use_sim_time", "true"}, master_.variables());
  ASSERT_EQ(set.exitCode(), 0) << set.output();
  Process arm(node(), master_.variables());
  EXPECT_EQ(arm.exitCode(), 2) << arm.output();
  for (const char* words : {"/use_sim_time", "~allow_sim_time"}) {
    EXPECT_NE(arm.output().find(words), std::string::npos) << words << " in " << arm.output();
  }
}

TEST_F(DeadMaster, APausedRecordingIsASilentCommander) {
  const TemporaryFolder folder;
  const std::string path = folder / "targets.bag";
  {
    rosbag::Bag bag(path, rosbag::bagmode::Write);
    PressureArray target;
    target.pressure = {1.5e5, 1e5, 5e4};
    for (int i = 0; i < 1200; ++i) {  // a minute at 20 Hz
      target.header.stamp = ros::Time(1e9 + 0.05 * i);
      bag.write("/pressure_target", target.header.stamp, target);
    }
  }
  Process set({"rosparam", "set", "/use_sim_time", "true"}, master_.variables());
  ASSERT_EQ(set.exitCode(), 0) << set.output();
  Process player({"rosbag", "play", "--clock", "--quiet", path, "__name:=player"},
                 master_.variables());
  Process arm(node({"_allow_sim_time:=true"}), master_.variables());
  ASSERT_TRUE(arm.prints("loop at")) << arm.output();
  ASSERT_TRUE(inflates()) << arm.output();
  const double begin = regulator::steadyNow();
  call({"/player/pause_playback", "true"}, "success: True");
  ASSERT_TRUE(vents(10));
  std::printf(
      "[  FIGURE  ] recording paused (and simulated time with it): the regulator vents "
      "%.0f ms after the call began\n",
      1e3 * (regulator::steadyNow() - begin));
  EXPECT_TRUE(arm.prints("stale", 5) || arm.output().find("target_timeout") != std::string::npos)
      << arm.output();
}

}  // namespace
}  // namespace helix_arm::test
