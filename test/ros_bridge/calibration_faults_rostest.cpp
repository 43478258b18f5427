// What a calibration refuses, and how it ends when something goes wrong: with a reason, with the
// pressures ramped down, and with the arm at rest. Time runs at five times its pace.
#include <csignal>
#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>
#include <ros/master.h>
#include <ros/network.h>
#include <ros/this_node.h>
#include <std_srvs/Trigger.h>
#include <sys/stat.h>
#include <xmlrpcpp/XmlRpc.h>

#include "helix_arm/RunCalibrationActionFeedback.h"
#include "helix_arm/RunCalibrationActionResult.h"
#include "helix_arm/SafetyState.h"
#include "support/calibration_rig.hpp"

namespace helix_arm::test {
namespace {

// Process of a node that the launch file started; 0 if it does not answer.
pid_t processOf(const std::string& node) {
  XmlRpc::XmlRpcValue question, answer, uri;
  question[0] = ros::this_node::getName();
  question[1] = node;
  if (!ros::master::execute("lookupNode", question, answer, uri, false)) return 0;
  std::string host;
  std::uint32_t port = 0;
  if (!ros::network::splitURI(static_cast<std::string&>(uri), host, port)) return 0;
  XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port), "/");
  XmlRpc::XmlRpcValue caller;
  caller[0] = ros::this_node::getName();
  if (!client.execute("getPid", caller, answer) || answer.size() != 3) return 0;
  return static_cast<int&>(answer[2]);
}

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
  std::filesystem::create_symlink(folder / "nothing.yaml", folder / "dangling.yaml");
  ASSERT_EQ(mkfifo((folder / "fifo.csv").c_str(), 0600), 0);
  const auto expectSays = [](const std::string& path, const std::string& message,
                             const std::string& words) {
    EXPECT_NE(message.find(words), std::string::npos) << path << ": " << message;
    EXPECT_EQ(message.find("root:"), std::string::npos) << message;
  };
  for (const std::string& path :
       {std::string("/etc/passwd"), folder / "link.csv", folder / "fifo.csv"}) {
    Calibrate::Request request;
    request.data = {path};
    expectSays(path, call<Calibrate>("calibrate", request).message, "data is '");
    FitContraction::Request contraction;
    contraction.data = path;
    expectSays(path, call<FitContraction>("fit_contraction", contraction).message, "data is '");
  }
  const std::string foreign = folder / "scene.yaml";  // another's: it was never calibrated
  const std::string text = io::sceneText(HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml");
  std::ofstream(foreign) << text;
  for (const std::string& path :
       {foreign, folder / "dangling.yaml", std::string("/no/such/new.yaml")}) {
    Save::Request save;
    save.path = path;
    expectSays(path, call<Save>("save", save).message, "path is '");
    Calibrate::Request request;
    request.out = path;
    expectSays(path, call<Calibrate>("calibrate", request).message, "out is '");
    RunCalibrationGoal goal;
    goal.out = path;
    client_->sendGoal(goal);
    EXPECT_TRUE(ends());
    EXPECT_EQ(ending(), "ABORTED") << path;
  }
  EXPECT_EQ(contentOf(foreign), text);
  EXPECT_FALSE(std::filesystem::exists(folder / "nothing.yaml"));

  // What the node itself wrote may be written again.
  ASSERT_TRUE(recordWhenSettled().success);
  Save::Request save;
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

TEST_F(CalibrationFaults, CancelledItRampsThePressuresDown) {
  startRun();
  client_->cancelGoal();
  ASSERT_TRUE(ends());
  EXPECT_EQ(ending(), "PREEMPTED");
  EXPECT_NE(client_->getResult()->message.find("cancelled"), std::string::npos);
  EXPECT_TRUE(atRest());
  EXPECT_TRUE(restsWithoutAFault()) << calibration_->outputNow();
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

TEST_F(CalibrationFaults, WithoutMeasurementsTheArmVentsAndItSaysSo) {
  startRun();
  rig_process_->signal(SIGINT);
  ASSERT_TRUE(ends());
  EXPECT_EQ(ending(), "ABORTED");
  EXPECT_TRUE(has(client_->getResult()->message, "was not read"));
  EXPECT_TRUE(atRest());
}

TEST_F(CalibrationFaults, PicturesThatFailToComeForAWhileAreWaitedFor) {
  Inbox<RunCalibrationActionFeedback> feedback(node_, "calibration/run_calibration/feedback");
  const pid_t vision = processOf("/vision");
  ASSERT_GT(vision, 0);
  startRun();
  ASSERT_EQ(kill(vision, SIGSTOP), 0);
  const auto waits = feedback.next([](const RunCalibrationActionFeedback& one) {
    return one.feedback.state.find("tag detections: none received for") != std::string::npos;
  });
  ASSERT_EQ(kill(vision, SIGCONT), 0);
  EXPECT_TRUE(waits) << calibration_->outputNow();
  ASSERT_TRUE(ends());
  // The run was completed: it came to the fit, with a sample of each step. The fit of so few
  // captures may be refused.
  EXPECT_EQ(feedback.last().feedback.state, "fitting") << client_->getResult()->message;
  EXPECT_EQ(feedback.last().feedback.samples, 4u);
  EXPECT_TRUE(has(calibration_->outputNow(), "run_calibration waits for pictures"));
  EXPECT_TRUE(atRest());
  EXPECT_TRUE(restsWithoutAFault()) << calibration_->outputNow();
  expectRamps(first_target_);
}

TEST_F(CalibrationFaults, AskedToEndItRampsDownFirst) {
  startRun();
  calibration_->signal(SIGINT);
  EXPECT_EQ(calibration_->exitCode(), 0) << calibration_->output();
  EXPECT_TRUE(atRest());
  EXPECT_TRUE(restsWithoutAFault()) << calibration_->output();
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

// The stream of the run's targets does not undo it.
TEST_F(CalibrationFaults, ARestThatSomebodyElseAsksForEndsTheRun) {
  startRun();
  EXPECT_TRUE(call<std_srvs::Trigger>("/pressure_command/rest").success);
  ASSERT_TRUE(ends());
  EXPECT_EQ(ending(), "ABORTED");
  EXPECT_TRUE(has(client_->getResult()->message, "brought the arm to rest"));
  EXPECT_TRUE(atRest());
  EXPECT_TRUE(restsWithoutAFault()) << calibration_->outputNow();
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
