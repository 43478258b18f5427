// What a calibration refuses, and how it ends when something goes wrong: with a reason, with the
// pressures ramped down, and with the arm at rest. Time runs at five times its pace.
#include <csignal>

#include <ros/this_node.h>

#include "helix_arm/RunCalibrationActionResult.h"
#include "support/calibration_rig.hpp"

namespace helix_arm::test {
namespace {

class CalibrationFaults : public CalibrationRig {
 protected:
  CalibrationFaults() : CalibrationRig("demo") {}

  // A run that is well under way: some pressure is high.
  void startRun() {
    freeTheArm();
    RunCalibrationGoal goal;
    goal.fit = {"K_kappa"};
    goal.plan = {3e5, 0, 0, 0, 3e5, 0, 3e5, 3e5, 0, 0, 0, 3e5};
    first_target_ = targets_.all().size();
    client_->sendGoal(goal);
    ASSERT_TRUE(rig_.command.next([](const PressureArray& command) {
      return command.pressure[0] > 2.9e5;
    })) << calibration_->output();
  }

  std::size_t first_target_ = 0;
};

TEST_F(CalibrationFaults, InvalidRequestsAreAnsweredWithTheFault) {
  const auto expectSays = [](const auto& response, const std::string& words) {
    EXPECT_FALSE(response.success) << words;
    EXPECT_NE(response.message.find(words), std::string::npos) << response.message;
  };
  expectSays(call<Calibrate>("calibrate"), "no sample was recorded");
  const TemporaryFile series("pressure_1_kpa,pressure_2_kpa,pressure_3_kpa\n0,0,0\n", ".csv");
  const TemporaryFile not_a_bag("pressure_kpa,length_m\n0,0.4\n", ".bag");
  for (const auto& [file, words] :
       std::vector<std::pair<std::string, std::string>>{{series.path(), series.path()},
                                                        {"relative.csv", "absolute path"},
                                                        {"/no/such.csv", "/no/such.csv"},
                                                        {"/no/such.bag", "/no/such.bag"},
                                                        {not_a_bag.path(), not_a_bag.path()}}) {
    Calibrate::Request request;
    request.data = {file};
    expectSays(call<Calibrate>("calibrate", request), words);
  }
  for (const auto& [path, words] : {std::pair("/tmp/samples.csv", "no sample was recorded"),
                                    {"/tmp/scene.yaml", "nothing was calibrated"},
                                    {"scene.yaml", "absolute path"}}) {
    Save::Request save;
    save.path = path;
    expectSays(call<Save>("save", save), words);
  }
  FitContraction::Request contraction;
  contraction.data = "/no/such.csv";
  expectSays(call<FitContraction>("fit_contraction", contraction), "/no/such.csv");
  contraction.kind = "cubic";
  expectSays(call<FitContraction>("fit_contraction", contraction), "quintic or table");

  using Goal = RunCalibrationGoal;
  const struct {
    const char* words;
    void (*spoil)(Goal& goal);
  } kGoals[] = {
      {"everything", [](Goal& g) { g.fit = {"everything"}; }},
      {"captures is 6", [](Goal& g) { g.captures_per_pressure = 6; }},
      {"set loop: true", [](Goal& g) { g.fit = {"response"}; }},
      {"4 pressures for 3 actuators",
       [](Goal& g) {
         g.plan = {1, 2, 3, 4};
       }},
      {"step 2 of the plan", [](Goal& g) { g.plan = {0, 0, 0, 9e5, 0, 0}; }},
      {"one pressure",
       [](Goal& g) {
         g.plan = {1e5, 0, 0};
       }},
      {"/no/such/folder", [](Goal& g) { g.out = "/no/such/folder/scene.yaml"; }},
  };
  for (const auto& row : kGoals) {
    Goal goal;
    goal.fit = {"stiffness"};
    goal.captures_per_pressure = 1;
    row.spoil(goal);
    client_->sendGoal(goal);
    EXPECT_TRUE(ends());
    EXPECT_EQ(ending(), "ABORTED");
    ASSERT_TRUE(client_->getResult()) << row.words;
    expectSays(*client_->getResult(), row.words);
  }
  EXPECT_EQ(rig_.command.last().pressure, (std::vector<double>{0, 0, 0}));
}

// Any network peer can name paths. Which of them are taken is a law of FileAccess; here every
// service and the action goes by it, and no message contains a line of a file.
TEST_F(CalibrationFaults, FilesAreReadAndWrittenInTheirFoldersAlone) {
  const TemporaryFolder folder;  // below that of the node
  std::filesystem::create_symlink("/etc/passwd", folder / "link.csv");
  const std::string foreign = folder / "scene.yaml";  // another's: it was never calibrated
  const std::string text = io::sceneText(HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml");
  std::ofstream(foreign) << text;
  Calibrate::Request read, write;
  read.data = {folder / "link.csv"};
  write.out = foreign;
  FitContraction::Request contraction;
  contraction.data = folder / "link.csv";
  Save::Request save;
  save.path = foreign;
  RunCalibrationGoal goal;
  goal.out = foreign;
  client_->sendGoal(goal);
  EXPECT_TRUE(ends());
  EXPECT_EQ(ending(), "ABORTED");
  for (const auto& [message, words] :
       {std::pair(call<Calibrate>("calibrate", read).message, "data is '"),
        {call<FitContraction>("fit_contraction", contraction).message, "data is '"},
        {call<Calibrate>("calibrate", write).message, "out is '"},
        {call<Save>("save", save).message, "path is '"},
        {client_->getResult()->message, "out is '"}}) {
    EXPECT_TRUE(has(message, words));
    EXPECT_EQ(message.find("root:"), std::string::npos) << message;
  }
  EXPECT_EQ(contentOf(foreign), text);

  // What the node itself wrote may be written again.
  ASSERT_TRUE(recordWhenSettled().success);
  save.path = folder / "samples.csv";
  for (int k = 0; k < 2; ++k) {
    const Save::Response response = call<Save>("save", save);
    EXPECT_TRUE(response.success) << response.message;
  }
}

TEST_F(CalibrationFaults, ASampleOfAnArmThatMovesOrOfTheSamePicturesIsRefused) {
  ASSERT_TRUE(recordWhenSettled().success);
  const RecordSample::Response again = call<RecordSample>("record_sample");
  EXPECT_FALSE(again.success);
  EXPECT_TRUE(has(again.message, "of these pictures"));
  EXPECT_EQ(again.samples, 1u);
  ASSERT_EQ(rig_.sendPressures({3e5, 0, 0}).outcome, TargetStatus::REACHED);
  ASSERT_TRUE(
      rig_.measured.next([](const PressureArray& measured) { return measured.pressure[0] > 2e5; }));
  const RecordSample::Response moving = call<RecordSample>("record_sample");
  EXPECT_FALSE(moving.success);
  EXPECT_NE(moving.message.find("not recorded: "), std::string::npos) << moving.message;
  EXPECT_EQ(moving.samples, 1u);
  const RecordSample::Response settled = recordWhenSettled();
  EXPECT_TRUE(settled.success) << settled.message;
  EXPECT_EQ(settled.samples, 2u);
  EXPECT_GE(settled.tags, 5u);
  ASSERT_EQ(settled.pressure.size(), 3u);
  EXPECT_NEAR(settled.pressure[0], 3e5, 5e3);
  EXPECT_EQ(call<ClearSamples>("clear_samples").cleared, 2u);
  EXPECT_EQ(call<ClearSamples>("clear_samples").cleared, 0u);
  ASSERT_EQ(rig_.sendPressures({0, 0, 0}).outcome, TargetStatus::REACHED);
}

TEST_F(CalibrationFaults, ASampleOfStaleMeasurementsIsRefused) {
  ASSERT_TRUE(recordWhenSettled().success);
  rig_process_->signal(SIGINT);
  EXPECT_EQ(rig_process_->exitCode(), 0);
  RecordSample::Response response;
  EXPECT_TRUE(waitFor([&] {
    response = call<RecordSample>("record_sample");
    waitFor([] { return false; }, 0.1);
    return response.message.find("none received for") != std::string::npos;
  })) << response.message;
  EXPECT_FALSE(response.success);
  RunCalibrationGoal goal;
  client_->sendGoal(goal);
  ASSERT_TRUE(ends());
  EXPECT_EQ(ending(), "ABORTED");
  EXPECT_NE(client_->getResult()->message.find("none received for"), std::string::npos);
}

TEST_F(CalibrationFaults, WhateverEndsARunLeavesTheArmAtRestAndSaysWhy) {
  struct End {
    std::function<void()> act;
    const char *ending, *words;
    bool ramps;  // down, without a fault
  };
  for (const End& end :
       {End{[this] { client_->cancelGoal(); }, "PREEMPTED", "cancelled", true},
        // The stream of the run's targets does not undo it.
        End{[] { EXPECT_TRUE(call<std_srvs::Trigger>("/pressure_command/rest").success); },
            "ABORTED", "brought the arm to rest", true},
        End{[this] { rig_process_->signal(SIGINT); }, "ABORTED", "was not read", false}}) {
    SCOPED_TRACE(end.words);
    startRun();
    end.act();
    ASSERT_TRUE(ends());
    EXPECT_EQ(ending(), end.ending);
    EXPECT_TRUE(has(client_->getResult()->message, end.words));
    EXPECT_TRUE(atRest());
    if (!end.ramps) continue;
    EXPECT_TRUE(restsWithoutAFault()) << calibration_->outputNow();
    expectRamps(first_target_);
  }
}

TEST_F(CalibrationFaults, AskedToEndItRampsDownFirst) {
  startRun();
  calibration_->signal(SIGINT);
  EXPECT_EQ(calibration_->exitCode(), 0) << calibration_->output();
  EXPECT_TRUE(atRest());
  EXPECT_TRUE(restsWithoutAFault()) << calibration_->output();
  expectRamps(first_target_);
}

TEST_F(CalibrationFaults, ASecondGoalReplacesTheFirstAfterRest) {
  startRun();
  RunCalibrationGoal goal;
  goal.plan = {0, 0, 0, 0, 0, 1e5};
  goal.captures_per_pressure = 1;
  goal.fit = {"K_kappa"};
  client_->sendGoal(goal);
  ASSERT_TRUE(ends());
  EXPECT_TRUE(client_->getResult()) << calibration_->output();
  EXPECT_TRUE(atRest());
  EXPECT_TRUE(restsWithoutAFault()) << calibration_->outputNow();
  expectRamps(first_target_);
}

TEST_F(CalibrationFaults, KilledItLeavesAnArmThatVents) {
  ros::NodeHandle node;
  Inbox<SafetyState> safety(node, names::kSafetyState);
  startRun();
  calibration_->signal(SIGKILL);
  EXPECT_EQ(calibration_->exitCode(), 128 + SIGKILL);
  EXPECT_TRUE(waitFor([&] {
    return !safety.all().empty() && safety.last().state == "vented" &&
           safety.last().cause == "stale_target";
  })) << (safety.all().empty() ? "no state" : safety.last().reason);
  EXPECT_TRUE(atRest());
}

// The client is another process, and killed.
TEST_F(CalibrationFaults, WithoutTheNodeThatAskedForItARunEnds) {
  Inbox<RunCalibrationActionResult> results(node_, "calibration/run_calibration/result");
  freeTheArm();
  first_target_ = targets_.all().size();
  Process client({"rostopic", "pub", "/calibration/run_calibration/goal",
                  "helix_arm/RunCalibrationActionGoal",
                  "{goal: {fit: [K_kappa], plan: [300000.0, 0, 0, 0, 300000.0, 0, 300000.0, "
                  "300000.0, 0, 0, 0, 300000.0]}}"});
  ASSERT_TRUE(rig_.command.next([](const PressureArray& command) {
    return command.pressure[0] > 2.9e5;
  })) << client.outputNow()
      << calibration_->outputNow();
  client.signal(SIGKILL);
  ASSERT_TRUE(waitFor([&] { return !results.all().empty(); })) << calibration_->outputNow();
  EXPECT_EQ(results.last().status.status, actionlib_msgs::GoalStatus::ABORTED);
  EXPECT_TRUE(has(results.last().result.message, "is gone or does not answer"));
  EXPECT_TRUE(atRest());
  EXPECT_TRUE(restsWithoutAFault()) << calibration_->outputNow();
  expectRamps(first_target_);
}

TEST_F(CalibrationFaults, ToAnotherCommanderItLeavesTheArm) {
  ASSERT_EQ(rig_.sendPressures({0, 0, 1e5}).outcome, TargetStatus::REACHED);
  RunCalibrationGoal goal;
  client_->sendGoal(goal);
  ASSERT_TRUE(waitFor([this] {
    const TargetStatus answer = rig_.sendPressures({0, 0, 1e5});
    // Or the answer to the run's own target, which came first.
    EXPECT_TRUE(answer.outcome == TargetStatus::REACHED ||
                answer.commander != ros::this_node::getName())
        << answer.message;
    return client_->getState().isDone();
  }));
  EXPECT_EQ(ending(), "ABORTED");
  EXPECT_TRUE(has(client_->getResult()->message, "commands the arm"));
  EXPECT_EQ(rig_.sendPressures({0, 0, 0}).outcome, TargetStatus::REACHED);
}

}  // namespace
}  // namespace helix_arm::test
