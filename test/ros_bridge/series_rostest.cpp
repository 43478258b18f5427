// The series node: plays its rows in order, ends without a fault, and gives way to others.
#include <cmath>
#include <csignal>

#include "helix_arm/SafetyState.h"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "support/process.hpp"
#include "support/ros_rig.hpp"
#include "support/temporary_file.hpp"

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

// An arm of its own, whose commander may be silent for so long that only what the series says at
// its end brings the arm to rest.
class SeriesEnd : public ::testing::Test {
 protected:
  std::vector<std::string> series(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(),
                     {HELIX_ARM_SERIES, "__ns:=end", "_scene:=" + scene_.path()});
    return arguments;
  }
  bool starts() {
    return waitFor([this] { return !measured_.all().empty() && !safety_.all().empty(); });
  }
  bool comesTo(const std::string& reason) {
    return waitFor([&] { return safety_.last().reason.find(reason) != std::string::npos; });
  }
  void expectRestWithoutAFault() {
    EXPECT_TRUE(comesTo("disabled: at rest")) << safety_.last().reason;
    bool ramped = false;
    for (const auto& state : safety_.all()) {
      EXPECT_EQ(state->cause, "none") << state->reason;
      ramped = ramped || state->reason == "enabled: ramps down to rest";
    }
    EXPECT_TRUE(ramped);
    for (const char* trouble : {"WARN", "ERROR", "FATAL"}) {
      EXPECT_EQ(arm_.outputNow().find(trouble), std::string::npos) << arm_.output();
    }
  }

  const TemporaryFile scene_{
      io::sceneText(HELIX_ARM_SOURCE_DIR "/test/ros_bridge/scenes/brisk.yaml",
                    {{"safety.target_timeout_s", "100"}, {"safety.slew_kpa_s", "500"}}),
      ".yaml"};
  ros::NodeHandle node_{"end"};
  Inbox<SafetyState> safety_{node_, names::kSafetyState};
  Inbox<PressureArray> measured_{node_, names::kPressureMeasured};
  Process arm_{
      {HELIX_ARM_PRESSURE_COMMAND, "__ns:=end", "_scene:=" + scene_.path(), "_frame_prefix:=end_"}};
};

TEST_F(SeriesEnd, AfterItsLastRowIsNoFault) {
  ASSERT_TRUE(starts()) << arm_.outputNow();
  Process monitor({HELIX_ARM_MONITOR, "__ns:=end", "_min_rate:=1"});
  ASSERT_TRUE(monitor.prints("disabled")) << monitor.output();
  Process process(series({"_data:=" HELIX_ARM_SOURCE_DIR "/test/ros_bridge/series.csv",
                          "_ramp_s:=0.2", "_hold_s:=0.5"}));
  EXPECT_EQ(process.exitCode(), 0) << process.output();
  expectRestWithoutAFault();
  monitor.signal(SIGINT);
  EXPECT_EQ(monitor.exitCode(), 0) << monitor.output();
  EXPECT_NE(monitor.output().find("the arm runs"), std::string::npos) << monitor.output();
}

TEST_F(SeriesEnd, OnRequestIsNoFault) {
  ASSERT_TRUE(starts()) << arm_.outputNow();
  Process process(series({"_loop:=true"}));
  ASSERT_TRUE(comesTo("follows targets")) << process.outputNow();
  process.signal(SIGINT);
  EXPECT_EQ(process.exitCode(), 0) << process.output();
  expectRestWithoutAFault();
}

TEST(Series, YieldsToAnotherCommanderAndContinuesAfterwards) {
  const std::string series = "/yield/pressure_series";
  Rig rig("yield");
  ASSERT_TRUE(rig.connect());
  const auto by_series = [&](const TargetStatus& s) {
    return s.commander == series && s.outcome == TargetStatus::REACHED;
  };
  ASSERT_TRUE(rig.status.next(by_series));
  ASSERT_TRUE(waitFor([&] {
    return rig.sendPressures(std::vector<double>(7, 1e5)).outcome == TargetStatus::REACHED;
  }));
  EXPECT_TRUE(rig.status.next(by_series));
}

// A pressure_command whose answers the test determines.
class Answers : public ::testing::Test {
 protected:
  Answers()
      : node_("told"),
        command_(node_.advertise<PressureArray>(names::kPressureCommand, 1, true)),
        status_(node_.advertise<TargetStatus>(names::kTargetStatus, 10)),
        targets_(node_, names::kPressureTarget),
        series_({HELIX_ARM_SERIES, "__ns:=told", "__name:=series",
                 "_scene:=" HELIX_ARM_SOURCE_DIR "/test/ros_bridge/scenes/brisk.yaml",
                 "_loop:=true", "_ramp_s:=0.2", "_hold_s:=0"}) {
    PressureArray command;
    command.pressure = kStands;
    command_.publish(command);
  }

  void answer(std::uint8_t outcome, control::Fault fault, const ros::Time& stamp = {}) {
    TargetStatus answer;
    answer.target_stamp = stamp;
    answer.commander = "/told/series";
    answer.outcome = outcome;
    if (outcome == TargetStatus::DROPPED) answer.fault = control::nameOf(fault);
    answer.message = "told so";
    status_.publish(answer);
  }
  bool moves() {
    return nullptr !=
           targets_.next([](const PressureArray& target) { return target.pressure != kStands; });
  }
  /// Whether it exits with 1 while this continues.
  bool ends(const std::function<void()>& trouble) {
    int code = -1;
    waitFor([&] {
      trouble();
      return (code = series_.exitCode(0.05)) != -1;
    });
    return code == 1;
  }
  /// Accepts the targets that came, except for the first and the last ones; exit code of the series
  /// that is asked to end once it commands, if not before.
  int endWithAnswers(std::size_t without, bool asked = false, std::size_t answered = 0) {
    int code = -1;
    waitFor([&] {
      for (; answered + without < targets_.all().size(); ++answered) {
        answer(TargetStatus::REACHED, {}, targets_.all()[answered]->header.stamp);
      }
      if (answered > 10 && !asked) {
        series_.signal(SIGINT);
        asked = true;
      }
      return (code = series_.exitCode(0.01)) != -1;
    });
    return code;
  }
  /// Expects the same, that it ends well and asks for rest or does not; there is no such service.
  void expectEnds(bool asks, std::size_t without, bool asked = false, std::size_t answered = 0) {
    EXPECT_EQ(endWithAnswers(without, asked, answered), 0) << series_.output();
    const char* const words = asks ? "/told/pressure_command/rest does not exist" : "/rest";
    EXPECT_EQ(series_.output().find(words) != std::string::npos, asks) << series_.output();
  }

  inline static const std::vector<double> kStands = {1e4, 2e4, 3e4, 0, 0, 0, 0};  // [Pa]
  ros::NodeHandle node_;
  ros::Publisher command_, status_;
  Inbox<PressureArray> targets_;
  Process series_;
};

// Once it commands.
class Commands : public Answers {
 protected:
  void SetUp() override {
    ASSERT_TRUE(waitFor([this] { return status_.getNumSubscribers() > 0; }) && moves())
        << series_.outputNow();
  }
};

TEST_F(Commands, WhatCameLateOrToADisabledArmIsWaitedFor) {
  for (const control::Fault fault : {control::Fault::kStale, control::Fault::kNotEnabled}) {
    answer(TargetStatus::DROPPED, fault);
    EXPECT_TRUE(targets_.next([](const auto& target) { return target.pressure == kStands; }))
        << control::nameOf(fault) << series_.outputNow();
    answer(TargetStatus::REACHED, fault);
    EXPECT_TRUE(moves()) << control::nameOf(fault) << series_.outputNow();
  }
  EXPECT_TRUE(series_.prints("the series waits: told so")) << series_.output();
}

TEST_F(Commands, TargetsThatAreAllRefusedForWhatTheyAskEndTheSeries) {
  // A single refusal does not, whoever sent it; nor do many with accepted targets in between.
  for (int k = 0; k < 20; ++k) {
    answer(TargetStatus::DROPPED, control::Fault::kOutOfRange);
    if (k % 5 == 0) answer(TargetStatus::REACHED, control::Fault::kOutOfRange);
  }
  EXPECT_TRUE(series_.prints("the series was refused: told so")) << series_.output();
  EXPECT_TRUE(moves()) << series_.outputNow();
  EXPECT_TRUE(ends([this] { answer(TargetStatus::DROPPED, control::Fault::kOutOfRange); }));
  EXPECT_TRUE(has(series_.output(), "told so, and nothing else for 2 s"));
}

TEST_F(Commands, CommandsThatAreAllOfAnotherArmEndTheSeries) {
  PressureArray foreign, sound;
  foreign.pressure = {1e5, 1e5};
  sound.pressure = kStands;
  for (int k = 0; k < 20; ++k) {
    command_.publish(foreign);
    if (k % 5 == 0) command_.publish(sound);
  }
  foreign.pressure.assign(kStands.size(), std::nan(""));
  command_.publish(foreign);
  command_.publish(sound);
  EXPECT_TRUE(series_.prints("pressure_command does not match scene")) << series_.output();
  EXPECT_TRUE(moves()) << series_.outputNow();
  EXPECT_TRUE(ends([&] { command_.publish(foreign); }));
}

TEST_F(Commands, WhoIsAskedForRestGetsNoTargetAfterwards) {
  std::size_t targets_before = 0;
  int calls = 0;
  using Trigger = std_srvs::Trigger;
  const ros::ServiceServer server = node_.advertiseService<Trigger::Request, Trigger::Response>(
      "pressure_command/rest", [&](Trigger::Request&, Trigger::Response& response) {
        ++calls;
        targets_before = targets_.all().size();
        response.success = 1;
        response.message = "comes to rest";
        return true;
      });
  EXPECT_EQ(endWithAnswers(0), 0) << series_.output();
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(targets_.all().size(), targets_before);
  EXPECT_NE(series_.output().find("comes to rest"), std::string::npos) << series_.output();
}

// Without an answer to its last target, which may still be on its way and would cancel the request,
// it does not ask for rest; there is no such service.
TEST_F(Commands, AnArmThatDoesNotAnswerIsNotAskedForRest) { expectEnds(false, 1); }

TEST_F(Commands, WithoutTheServiceTheSeriesEndsAndSaysSo) { expectEnds(true, 0); }

// Before the answer it cannot know whether the arm follows it.
TEST_F(Commands, WhoIsEndedBeforeTheFirstAnswerWaitsForIt) {
  series_.signal(SIGINT);
  expectEnds(true, 0, true);
}

// The first answers are lost where target_status was not connected yet.
TEST_F(Commands, WhoIsEndedBeforeItHearsAnAnswerRepeatsItsTarget) {
  series_.signal(SIGINT);
  ASSERT_TRUE(waitFor([this] {
    const auto& all = targets_.all();
    return all.size() > 1 && all.back()->pressure == all[all.size() - 2]->pressure;
  })) << series_.outputNow();
  expectEnds(true, 0, true, targets_.all().size() - 1);
}

TEST_F(Commands, WhoIsNeverAnsweredEndsAllTheSame) {
  series_.signal(SIGINT);
  EXPECT_EQ(series_.exitCode(), 0) << series_.output();
  EXPECT_EQ(series_.output().find("/rest"), std::string::npos) << series_.output();
}

// Answers to targets that it never sent, before any command came.
TEST_F(Answers, AnswersWithoutTargetsDoNoHarm) {
  ASSERT_TRUE(waitFor([this] { return status_.getNumSubscribers() > 0; }));
  answer(TargetStatus::DROPPED, control::Fault::kStale);
  answer(TargetStatus::REACHED, control::Fault::kStale);
  answer(255, control::Fault::kStale);
  EXPECT_TRUE(moves()) << series_.outputNow();
}

}  // namespace
}  // namespace helix_arm::test
