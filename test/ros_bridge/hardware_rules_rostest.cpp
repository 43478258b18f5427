// The end of a commander or its client on hardware, and what pressure_command refuses there:
// targets that come before enabling, looser rules, another regulator; and what it answers where the
// regulator does not hear.
#include <csignal>

#include <actionlib_msgs/GoalStatusArray.h>

#include "helix_arm/FollowTipPathActionResult.h"
#include "helix_arm/Reload.h"
#include "ros_bridge/common/client_watch.hpp"
#include "support/hardware_rig.hpp"

namespace helix_arm::test {
namespace {

using simulation::DeviceFault;

const Eigen::Vector3d kPressures(1.5e5, 1e5, 5e4);  // [Pa]

class HardwareRules : public ::testing::TestWithParam<Line> {
 protected:
  // Waits for so many more answers to the targets, and gives the last one.
  TargetStatus answerAfter(std::size_t count) {
    const std::size_t before = rig_.status.all().size();
    EXPECT_TRUE(waitFor([&] { return rig_.status.all().size() >= before + count; }));
    return rig_.status.all().empty() ? TargetStatus() : rig_.status.last();
  }

  // Asks the node to reload its scene with one text in place of another.
  Reload::Response reloadWith(const std::string& old, const std::string& changed) {
    std::string scene = contentOf(regulator_.scene());
    const std::size_t at = scene.find(old);
    EXPECT_NE(at, std::string::npos) << old;
    if (at == std::string::npos) return {};
    scene.replace(at, old.size(), changed);
    const TemporaryFile file(scene, ".yaml");
    Reload reload;
    reload.request.scene = file.path();
    EXPECT_TRUE(ros::service::call("/" + kName + "/pressure_command/reload", reload));
    return reload.response;
  }

  const std::string kName = nameOf(GetParam());
  EmulatedRegulator regulator_{GetParam()};
  HardwareRig rig_{
      regulator_, kName, {"_scene_folder:=" + std::filesystem::temp_directory_path().string()}};
};
INSTANTIATE_TEST_SUITE_P(, HardwareRules, ::testing::ValuesIn(linesBySize(Line::kModbus)),
                         nameOfLine);

TEST_P(HardwareRules, TargetsAloneDoNotEnable) {
  rig_.command(kPressures);
  EXPECT_EQ(answerAfter(20).fault, "not_enabled");
  EXPECT_EQ(rig_.safety.last().state, "disabled");
  EXPECT_TRUE(regulator_.isVented());
  EXPECT_TRUE(regulator_.setPoint().isZero());
}

TEST_P(HardwareRules, ACommanderThatIsDoneLeavesTheArmAtRest) {
  // A target that is on its way cancels a request, and a busy machine may be silent for too long.
  ASSERT_TRUE(waitFor(
      [&] {
        if (!rig_.bringTo(kPressures)) return false;
        rig_.fallSilent();
        while (rig_.trigger(names::kRest).success) continue;
        return rig_.comesTo("disabled", 5);
      },
      60))
      << rig_.safety.last().reason;
  EXPECT_EQ(rig_.safety.last().cause, "none");
  EXPECT_TRUE(waitFor([&] { return regulator_.isVented(); }));
  EXPECT_TRUE(regulator_.setPoint().isZero());
  rig_.command(kPressures);
  EXPECT_EQ(answerAfter(20).fault, "not_enabled");
  EXPECT_EQ(rig_.safety.last().state, "disabled");
}

TEST_P(HardwareRules, OnlyAReloadThatIsAsSafeIsTaken) {
  ASSERT_TRUE(rig_.bringTo(kPressures)) << rig_.node.output();
  const Reload::Response looser = reloadWith("slew_kpa_s: 2000", "slew_kpa_s: 4000");
  EXPECT_FALSE(looser.success);
  EXPECT_TRUE(has(looser.message, "safety.slew_kpa_s would go from 2000 to 4000 kPa/s"));
  const Reload::Response stricter = reloadWith("slew_kpa_s: 2000", "slew_kpa_s: 1000");
  EXPECT_TRUE(stricter.success) << stricter.message;
  // It is compared with the rules at the start, not with the last ones.
  EXPECT_TRUE(reloadWith("slew_kpa_s: 2000", "slew_kpa_s: 2000").success);
  const LineKind& kind = kindOf(GetParam());
  const Reload::Response other = reloadWith(kind.part, kind.other);
  EXPECT_FALSE(other.success);
  EXPECT_NE(other.message.find("another regulator"), std::string::npos) << other.message;
}

TEST_P(HardwareRules, AnUnreachableRegulatorIsReportedToTheCaller) {
  ASSERT_TRUE(rig_.bringTo(kPressures)) << rig_.node.output();
  regulator_.setFault(DeviceFault::kSilence);
  EXPECT_TRUE(waitFor([&] { return !rig_.trigger(names::kVent).success; }));
  EXPECT_FALSE(rig_.stop(true).success);
  regulator_.setFault(DeviceFault::kNone);
  EXPECT_TRUE(waitFor([&] { return rig_.stop(true).success; }));
  EXPECT_TRUE(rig_.stop(false).success);
  EXPECT_TRUE(rig_.comesTo("vented")) << rig_.safety.last().reason;
}

class ClientOfTheLoop : public ::testing::Test {
 protected:
  void follow(double duration, const std::vector<std::string>& more = {}) {
    ASSERT_TRUE(arm_.enable()) << arm_.rig.node.outputNow();
    arm_.follow(duration, more);
  }

  EmulatedRegulator regulator_{Line::kSerial};
  HardwareLoop arm_{regulator_, "client"};
  HardwareRig& rig_ = arm_.rig;
  Process& loop_ = arm_.loop;
  std::unique_ptr<Process>& client_ = arm_.client;
};

class GoneClient : public ClientOfTheLoop, public ::testing::WithParamInterface<int> {};
INSTANTIATE_TEST_SUITE_P(, GoneClient, ::testing::Values(SIGKILL, SIGSTOP), [](const auto& signal) {
  return signal.param == SIGKILL ? "Killed" : "Stopped";
});

TEST_P(GoneClient, LeavesAnArmThatVents) {
  using ros_bridge::ClientWatch;
  follow(120, {"_hold_s:=50"});
  ASSERT_TRUE(arm_.isUnderWay()) << client_->outputNow() << loop_.outputNow();
  client_->signal(GetParam());
  const double begin = regulator::steadyNow();
  const double patience = GetParam() == SIGKILL ? ClientWatch::kMisses * ClientWatch::kPeriod
                                                : ClientWatch::kLongestSilence;
  EXPECT_TRUE(rig_.ventsBy(begin, patience + kTargetTimeout + kSlack)) << loop_.outputNow();
  std::printf("the board had its vent order %.0f ms after the client was gone\n",
              1e3 * (regulator::steadyNow() - begin));
  EXPECT_TRUE(rig_.comesTo("vented")) << rig_.safety.last().reason;
  EXPECT_EQ(rig_.safety.last().cause, "stale_target");
  EXPECT_TRUE(loop_.prints("/client/follow_path, is gone or does not answer"));
  client_->signal(SIGCONT);
}

// The check of so long a path takes about as long as it takes to miss the client.
TEST_F(ClientOfTheLoop, ThatDiesWhileItsGoalIsCheckedLeavesNothingMoving) {
  ros::NodeHandle node("/client");
  Inbox<actionlib_msgs::GoalStatusArray> goals(node, "visual_servo/follow_tip_path/status");
  Inbox<FollowTipPathActionResult> results(node, "visual_servo/follow_tip_path/result");
  follow(9000);
  ASSERT_TRUE(goals.next([](const auto& goal) { return !goal.status_list.empty(); }))
      << client_->outputNow();
  client_->signal(SIGKILL);
  ASSERT_TRUE(waitFor([&] { return !results.all().empty(); }, 60)) << loop_.outputNow();
  EXPECT_EQ(results.last().result.error_code, FollowTipPathResult::CLIENT_LOST)
      << results.last().result.error_string;
  if (results.last().status.status == actionlib_msgs::GoalStatus::REJECTED) {
    EXPECT_TRUE(regulator_.setPoint().isZero()) << "it was never begun";
  } else {
    EXPECT_TRUE(rig_.comesTo("vented")) << rig_.safety.last().reason;
  }
}

TEST_F(ClientOfTheLoop, ThatLivesIsServedToTheEndAndTheArmThenRests) {
  follow(4, {"_hold_s:=0.5"});
  ASSERT_TRUE(arm_.isUnderWay()) << client_->outputNow() << loop_.outputNow();
  EXPECT_EQ(client_->exitCode(60), 0) << client_->output() << loop_.outputNow();
  EXPECT_TRUE(rig_.comesTo("disabled")) << rig_.safety.last().reason;
  EXPECT_EQ(rig_.safety.last().cause, "none");
  EXPECT_TRUE(regulator_.isVented());
}

TEST_F(ClientOfTheLoop, CannotHaveAPlaceHeldWithoutEnd) {
  follow(9, {"_hold_s:=80000"});
  EXPECT_EQ(client_->exitCode(60), 1) << client_->output();
  EXPECT_TRUE(has(client_->output(), "hold_s is 80000; expected at most 60 on hardware"));
  EXPECT_TRUE(regulator_.isVented() || regulator_.setPoint().isZero());
}

}  // namespace
}  // namespace helix_arm::test
