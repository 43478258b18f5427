// Paths of the tip: goals of follow_tip_path and how they end, and the node that sends a path file.
#include <csignal>
#include <future>

#include "helix_arm/Reload.h"
#include "support/loop_rig.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

using Result = FollowTipPathResult;

class FollowTipPath : public LoopRig {
 protected:
  int refusal(const FollowTipPathGoal& goal) {
    send(goal);
    const int code = endOfGoal();
    EXPECT_EQ(client_->getState(), actionlib::SimpleClientGoalState::REJECTED) << code;
    return code;
  }
  // The goal of another client, beside that of client_.
  Client& sendByAnother(const FollowTipPathGoal& goal) {
    if (!other_) other_ = std::make_unique<Client>("visual_servo/follow_tip_path", false);
    EXPECT_TRUE(waitFor([this] { return other_->isServerConnected(); }));
    other_->sendGoal(goal);
    return *other_;
  }
  bool otherEnds() {
    return waitFor([this] { return other_->getState().isDone(); }, 60);
  }

  std::unique_ptr<Client> other_;
};

TEST_F(FollowTipPath, MovesTheTipAlongAPath) {
  send(goalAlong({kMiddle, kBeside, kMiddle}, 1.0));
  EXPECT_EQ(endOfGoal(), Result::SUCCESSFUL);
  EXPECT_EQ(client_->getState(), actionlib::SimpleClientGoalState::SUCCEEDED);
  const Result& result = *client_->getResult();
  EXPECT_GT(result.pictures, 5U);
  EXPECT_LT(result.rms_m, 0.005) << result.error_string;
  EXPECT_LE(result.rms_m, result.max_m);
  ASSERT_GT(feedback_.size(), 5U);
  EXPECT_LT(feedback_.front().time_from_start.toSec(), feedback_.back().time_from_start.toSec());
  for (const FollowTipPathFeedback& feedback : feedback_) {
    EXPECT_NEAR(feedback.error, (tipOf(feedback.desired) - tipOf(feedback.measured)).norm(), 1e-9);
    EXPECT_GT(feedback.sd, 0);
    EXPECT_EQ(feedback.header.frame_id, "arm_base");
  }
}

TEST_F(FollowTipPath, ABadGoalIsRefusedWithTheFault) {
  const std::vector<Eigen::Vector3d> sound = {kMiddle, kBeside};
  struct Fault {
    const char* words;
    std::function<void(FollowTipPathGoal&)> plant;
  };
  const Fault faults[] = {
      {"point 2", [](auto& g) { g.path.points[1].transforms[0].translation.x = std::nan(""); }},
      {"point 2", [](auto& g) { g.path.points[1].time_from_start = ros::Duration(0); }},
      {"2 transforms", [](auto& g) { g.path.points[0].transforms.resize(2); }},
      {"joint_names", [](auto& g) { g.path.joint_names = {"elbow"}; }},
      {"'nowhere'", [](auto& g) { g.path.header.frame_id = "nowhere"; }},
      {"moves relative to", [](auto& g) { g.path.header.frame_id = "model_tip"; }},
      {"mode 2", [](auto& g) { g.mode = 2; }},
      {"point 1",
       [](auto& g) {
         g.mode = FollowTipPathGoal::POSE, g.path.points[0].transforms[0].rotation.w = 2;
       }},
      {"on_contact 4", [](auto& g) { g.on_contact = 4; }},
      {"path_tolerance", [](auto& g) { g.path_tolerance = -1e-3; }},
      {"hold_s", [](auto& g) { g.hold_s = std::nan(""); }},
      {"leaves the arm's reach",
       [](auto& g) { g.path.points[1].transforms[0].translation.y = 0.3; }},
      {"too fast", [](auto& g) { g.path.points[1].time_from_start = ros::Duration(0.01); }},
      {"at most 60 s",
       [](auto& g) { g.path.header.stamp = ros::Time::now() + ros::Duration(100); }},
      {"1 points", [](auto& g) { g.path.points.resize(1); }},
  };
  for (const Fault& fault : faults) {
    FollowTipPathGoal goal = goalAlong(sound, 1.0);
    fault.plant(goal);
    EXPECT_EQ(refusal(goal), Result::INVALID_GOAL) << fault.words;
    EXPECT_NE(client_->getResult()->error_string.find(fault.words), std::string::npos)
        << fault.words << ": " << client_->getResult()->error_string;
  }
  FollowTipPathGoal old = goalAlong(sound, 1.0);
  old.path.header.stamp = ros::Time::now() - ros::Duration(5);
  EXPECT_EQ(refusal(old), Result::OLD_HEADER_TIMESTAMP) << client_->getResult()->error_string;
  EXPECT_EQ(loop_.last().state, LoopStatus::IDLE) << "nothing moves by them";
}

TEST_F(FollowTipPath, ARunningGoalKeepsTargetsAndBadGoalsAway) {
  send(goalAlong({kMiddle, kBeside, kMiddle}, 3.0));
  ASSERT_TRUE(isUnderWay());
  tip_target_.publish(targetAt(kMiddle));
  const TargetStatus answer = answerOn(names::kTipTarget);
  EXPECT_EQ(answer.fault, "other_commander");
  EXPECT_NE(answer.message.find(names::kFollowTipPath), std::string::npos) << answer.message;
  const Client& other = sendByAnother(goalAlong({kMiddle}, 1.0));
  EXPECT_TRUE(otherEnds());
  EXPECT_EQ(other.getState(), actionlib::SimpleClientGoalState::REJECTED);
  EXPECT_FALSE(client_->getState().isDone());
  EXPECT_EQ(endOfGoal(), Result::SUCCESSFUL);
}

TEST_F(FollowTipPath, ANewGoalReplacesTheRunningOne) {
  send(goalAlong({kMiddle, kBeside}, 20.0));
  ASSERT_TRUE(isUnderWay());
  const Client& other = sendByAnother(goalAlong({kBeside, kMiddle}, 1.0));
  EXPECT_TRUE(waitFor([&] { return client_->getState().isDone(); }));
  EXPECT_EQ(client_->getState(), actionlib::SimpleClientGoalState::PREEMPTED);
  EXPECT_TRUE(otherEnds());
  EXPECT_EQ(other.getState(), actionlib::SimpleClientGoalState::SUCCEEDED)
      << other.getState().getText();
}

// Reading a million points takes longer than safety.target_timeout_s.
TEST_F(FollowTipPath, AGoalOfAnySizeDoesNotStopTheOneThatRuns) {
  send(goalAlong({kMiddle, kBeside}, 60.0));
  ASSERT_TRUE(isUnderWay());
  for (const auto& [points, words] :
       {std::pair(1'000'000, "the path has 1000000 points; expected at most 100000"),
        std::pair(100'000, "leaves the arm's reach")}) {
    FollowTipPathGoal goal = goalAlong(std::vector<Eigen::Vector3d>(points, kMiddle), 0.01);
    goal.path.points.back().transforms[0].translation.x = 1;
    const Client& other = sendByAnother(goal);
    EXPECT_TRUE(otherEnds()) << points;
    EXPECT_EQ(other.getState(), actionlib::SimpleClientGoalState::REJECTED);
    ASSERT_TRUE(other.getResult());
    EXPECT_EQ(other.getResult()->error_code, Result::INVALID_GOAL);
    EXPECT_TRUE(has(other.getResult()->error_string, words));
    EXPECT_FALSE(client_->getState().isDone()) << client_->getState().getText();
    EXPECT_EQ(safety_.last().state, SafetyState::ENABLED) << safety_.last().reason;
  }
  client_->cancelGoal();
  EXPECT_TRUE(waitFor([&] { return client_->getState().isDone(); }));
}

TEST_F(FollowTipPath, ACancelledGoalHoldsTheArmWhereItIsWanted) {
  FollowTipPathGoal goal = goalAlong({kMiddle, kBeside}, 20.0);
  goal.hold_s = 0;  // simulated: without end
  send(goal);
  ASSERT_TRUE(isUnderWay());
  client_->cancelGoal();
  EXPECT_TRUE(waitFor([&] { return client_->getState().isDone(); }));
  EXPECT_EQ(client_->getState(), actionlib::SimpleClientGoalState::PREEMPTED);
  ASSERT_TRUE(loop_.next([](const LoopStatus& status) { return std::isnan(status.path_time); }));
  const Eigen::Vector3d held = tipOf(loop_.last().wanted);
  // For longer than the watchdogs of the loop and of pressure_command.
  const ros::SteadyTime start = ros::SteadyTime::now();
  ASSERT_TRUE(waitFor([&] { return ros::SteadyTime::now() - start > ros::WallDuration(3); }));
  EXPECT_EQ(loop_.last().state, LoopStatus::CLOSED);
  EXPECT_LT((tipOf(loop_.last().wanted) - held).norm(), 1e-9);
  EXPECT_EQ(loop_.last().commander, names::kFollowTipPath);
  // A target ends it, and its own silence ends the command.
  EXPECT_TRUE(tipComesTo(kMiddle, 0.005, targetAt(kMiddle)));
  EXPECT_TRUE(comesTo(LoopStatus::IDLE));
}

// Somebody else, here this test, asks for rest while the loop commands.
TEST_F(FollowTipPath, ARestEndsWhatTheLoopHolds) {
  FollowTipPathGoal goal = goalAlong({kMiddle, kBeside}, 1.0);
  goal.hold_s = 0;  // simulated: without end
  send(goal);
  ASSERT_EQ(endOfGoal(), Result::SUCCESSFUL);
  ASSERT_TRUE(call("pressure_command/rest"));
  ASSERT_TRUE(waitFor([this] { return safety_.last().state == SafetyState::DISABLED; }))
      << safety_.last().reason;
  EXPECT_TRUE(comesTo(LoopStatus::IDLE));
  const std::size_t sent = sent_.all().size(), told = loop_.all().size();
  ASSERT_TRUE(waitFor([&] { return loop_.all().size() > told + 100; }));
  EXPECT_EQ(sent_.all().size(), sent) << "it goes on commanding";
  EXPECT_EQ(safety_.last().state, SafetyState::DISABLED) << safety_.last().reason;
}

TEST_F(FollowTipPath, ARestAbortsTheGoalAndTheNextOneCountsAtOnce) {
  send(goalAlong({kMiddle, kBeside}, 20.0));
  ASSERT_TRUE(isUnderWay());
  ASSERT_TRUE(call("pressure_command/rest"));
  EXPECT_EQ(endOfGoal(), Result::NOT_ENABLED);
  EXPECT_TRUE(has(client_->getResult()->error_string, "brought the arm to rest"));
  send(goalAlong({kMiddle, kBeside}, 1.0));
  EXPECT_EQ(endOfGoal(), Result::SUCCESSFUL) << client_->getResult()->error_string;
}

TEST_F(FollowTipPath, WhoRepeatsATargetIsBroughtToRestUntilItPauses) {
  const TipTarget target = targetAt(kMiddle);
  ASSERT_TRUE(comesTo(LoopStatus::CLOSED, target));
  auto rest = std::async(std::launch::async, [this] { return call("pressure_command/rest"); });
  ASSERT_TRUE(waitFor([&] {
    repeat(target);
    return safety_.last().state == SafetyState::DISABLED;
  })) << safety_.last().reason;
  EXPECT_TRUE(rest.get());
  tip_target_.publish(target);
  EXPECT_EQ(answerOn(names::kTipTarget).fault, "rested");
  const double pause = shippedScene("demo").safety.rules.target_timeout + 0.5;
  waitFor([] { return false; }, pause);
  EXPECT_TRUE(comesTo(LoopStatus::CLOSED, target)) << loop_.last().message;
}

TEST_F(FollowTipPath, AnotherSceneIsTakenWhileTheLastPlaceIsHeldButNotWhileAGoalRuns) {
  FollowTipPathGoal goal = goalAlong({kMiddle, kBeside}, 4.0);
  goal.hold_s = 0;  // simulated: without end
  send(goal);
  ASSERT_TRUE(isUnderWay());
  Reload reload;
  ASSERT_TRUE(ros::service::call("visual_servo/reload", reload));
  EXPECT_FALSE(reload.response.success);
  EXPECT_TRUE(has(reload.response.message, "cancel its goal"));
  ASSERT_EQ(endOfGoal(), Result::SUCCESSFUL);
  ASSERT_TRUE(ros::service::call("visual_servo/reload", reload));
  EXPECT_TRUE(reload.response.success) << reload.response.message;
  EXPECT_TRUE(waitFor([this] { return safety_.last().state == SafetyState::DISABLED; }))
      << safety_.last().reason;
}

TEST_F(FollowTipPath, AVentAbortsTheGoalAndRefusesTheNext) {
  send(goalAlong({kMiddle, kBeside}, 20.0));
  ASSERT_TRUE(isUnderWay());
  ASSERT_TRUE(call("pressure_command/vent"));
  EXPECT_EQ(endOfGoal(), Result::NOT_ENABLED);
  EXPECT_TRUE(has(client_->getResult()->error_string, "vent"));
  EXPECT_TRUE(comesTo(LoopStatus::IDLE));
  send(goalAlong({kMiddle, kBeside}, 1.0));
  EXPECT_EQ(endOfGoal(), Result::NOT_ENABLED);
  EXPECT_TRUE(has(client_->getResult()->error_string, "enable"));
}

TEST_F(FollowTipPath, APathThatTheArmDoesNotKeepIsGivenUp) {
  FollowTipPathGoal goal = goalAlong({kMiddle, kBeside}, 3.0);
  goal.path_tolerance = 1e-3;
  // The loop stays open, and the true arm of the demo is more than 1 mm off.
  ASSERT_TRUE(closeLoop(false));
  ASSERT_TRUE(call("visual_servo/reset"));
  send(goal);
  EXPECT_EQ(endOfGoal(), Result::PATH_TOLERANCE_VIOLATED);
  goal.path_tolerance = 0;
  goal.goal_tolerance = 1e-3;
  send(goal);
  EXPECT_EQ(endOfGoal(), Result::GOAL_TOLERANCE_VIOLATED);
  goal.require_vision = true;
  send(goal);
  EXPECT_EQ(endOfGoal(), Result::VISION_LOST);
  ASSERT_TRUE(closeLoop(true));
}

TEST_F(FollowTipPath, AnotherCommanderKeepsTheArm) {
  PressureArray hold;
  hold.pressure.assign(3, 5e4);
  const auto keepOn = [&] {
    hold.header.stamp = ros::Time::now();
    pressure_target_.publish(hold);
  };
  ASSERT_TRUE(waitFor([&] {
    keepOn();
    return waitFor(
        [this] {
          return !status_.all().empty() && status_.last().topic == names::kPressureTarget &&
                 status_.last().outcome == TargetStatus::REACHED;
        },
        0.1);
  }));
  send(goalAlong({kMiddle, kBeside}, 1.0));
  EXPECT_TRUE(waitFor([&] {
    keepOn();
    return waitFor([this] { return client_->getState().isDone(); }, 0.1);
  }));
  ASSERT_TRUE(client_->getResult());
  EXPECT_EQ(client_->getResult()->error_code, Result::NOT_ENABLED);
  EXPECT_TRUE(has(client_->getResult()->error_string, ros::this_node::getName()));
}

// A path file along a line in y from the middle, in this time [s].
std::string pathFile(double length, double seconds) {
  std::ostringstream out;
  out << "time_s,x_m,y_m,z_m\n";
  for (const double part : {0.0, 0.5, 1.0}) {
    out << part * seconds << ",0.366," << 0.0035 + part * length << ",0.0088\n";
  }
  return out.str();
}

class FollowPath : public LoopRig {
 protected:
  static std::unique_ptr<Process> start(const TemporaryFile& path,
                                        const std::vector<std::string>& more = {}) {
    ros::param::del("/follow_path");  // those of the run before would stay
    std::vector<std::string> command = {HELIX_ARM_FOLLOW_PATH, "_path:=" + path.path(),
                                        "_goal_tolerance_mm:=5", "_hold_s:=0.1"};
    command.insert(command.end(), more.begin(), more.end());
    return std::make_unique<Process>(command);
  }
};

// The cells of a table with comments, by its columns.
using Table = std::map<std::string, std::vector<std::string>>;
Table tableOf(std::istream&& stream) {
  const auto cellsOf = [](const std::string& line) {
    std::vector<std::string> cells;
    std::istringstream text(line);
    for (std::string cell; std::getline(text, cell, ',');) cells.push_back(cell);
    return cells;
  };
  Table out;
  std::vector<std::string> names;
  for (std::string line; std::getline(stream, line);) {
    if (line.front() == '#') continue;
    const std::vector<std::string> cells = cellsOf(line);
    if (names.empty()) {
      names = cells;
      continue;
    }
    if (cells.size() != names.size()) throw std::runtime_error(line);
    for (std::size_t i = 0; i < cells.size(); ++i) out[names[i]].push_back(cells[i]);
  }
  return out;
}

TEST_F(FollowPath, EndsWithItsPathAndLeavesARecordAndItsFigure) {
  const TemporaryFile file(pathFile(0.015, 4), ".csv");
  const TemporaryFolder folder;
  const std::string record = folder / "run.csv";
  const std::string figure = folder / "run.png";
  const auto node = start(file, {"_record:=" + record, "_figure:=" + figure});
  ASSERT_EQ(node->exitCode(120), 0) << node->output();
  EXPECT_NE(node->output().find("the path was followed"), std::string::npos) << node->output();
  const Table table = tableOf(std::ifstream(record));
  const auto number = [&](const std::string& column, std::size_t row) {
    return std::stod(table.at(column).at(row));
  };
  const auto tip = [&](const std::string& name, std::size_t row) {
    return Eigen::Vector3d(number(name + "_x_m", row), number(name + "_y_m", row),
                           number(name + "_z_m", row));
  };
  // Its columns are laws of procedures/; here they are of pictures that this test has seen, too.
  const std::size_t rows = table.at("time_s").size();
  ASSERT_GT(rows, 10U);
  for (std::size_t row = 0; row < rows; ++row) {
    const double stamp = number("stamp_s", row);
    EXPECT_GT(stamp, row > 0 ? number("stamp_s", row - 1) : 0.0);
    for (const ArmShape::ConstPtr& seen : eye_.measured.all()) {
      if (std::abs(seen->header.stamp.toSec() - stamp) > 1e-6) continue;
      EXPECT_LT((tipOf(seen->tip) - tip("measured", row)).norm(), 1e-12) << row;
    }
    EXPECT_NEAR(number("error_m", row), (tip("measured", row) - tip("wanted", row)).norm(), 1e-12);
    EXPECT_LT((tip("predicted", row) - tip("measured", row)).norm(), 0.02);
    EXPECT_FALSE(table.at("state")[row].empty());
  }
  EXPECT_FALSE(table.at("model_x_m").back().empty());
  EXPECT_LT(number("pressure_3_pa", rows - 1), 1e6);
  EXPECT_GT(number("time_s", rows - 1), 3.5);
  // The last picture is taken shortly before the end of the path.
  EXPECT_NEAR(tip("wanted", rows - 1).y(), kMiddle.y() + 0.015, 1e-4);
  std::string begin(4, ' ');
  std::ifstream(figure, std::ios::binary).read(begin.data(), 4);
  EXPECT_EQ(begin, "\x89PNG");
  // Both are replaced by the next run.
  const TemporaryFile shorter(pathFile(0.01, 1), ".csv");
  const auto again = start(shorter, {"_record:=" + record, "_figure:=" + figure});
  EXPECT_EQ(again->exitCode(120), 0) << again->output();
  EXPECT_LT(std::stod(tableOf(std::ifstream(record)).at("time_s").back()), 3.5);
}

TEST_F(FollowPath, AskedToEndItCancelsItsGoalAndRecordsAsFarAsItWent) {
  const TemporaryFile file(pathFile(0.015, 40), ".csv");
  const TemporaryFolder folder;
  const std::string record = folder / "run.csv";
  const auto node = start(file, {"_record:=" + record});
  ASSERT_TRUE(node->prints("mm off, the loop", 60)) << node->output();
  node->signal(SIGINT);
  EXPECT_EQ(node->exitCode(30), 0) << node->output();
  EXPECT_NE(node->output().find("cancelled"), std::string::npos) << node->output();
  EXPECT_TRUE(comesTo(LoopStatus::IDLE));
  std::ifstream stream(record);
  std::string title;
  std::getline(stream, title);
  EXPECT_EQ(title.find("# recorded run of " + file.path()), 0U) << title;
  EXPECT_NE(title.find("cancelled"), std::string::npos) << title;
  EXPECT_GE(tableOf(std::move(stream)).at("time_s").size(), 1U);
}

TEST_F(FollowPath, ARecordReplacesNoFileOfOthers) {
  const TemporaryFile file(pathFile(0.015, 2), ".csv");
  const TemporaryFile foreign("a,b\n1,2\n", ".csv");
  const auto node = start(file, {"_record:=" + foreign.path(), "_figure:=run.pdf"});
  EXPECT_EQ(node->exitCode(60), 2) << node->output();
  for (const std::string& words :
       {"~record is '" + foreign.path() + "', which exists",
        std::string("run.pdf'; expected the absolute path of a .png file")}) {
    EXPECT_NE(node->output().find(words), std::string::npos) << node->output();
  }
  std::string text;
  std::getline(std::ifstream(foreign.path()), text, '\0');
  EXPECT_EQ(text, "a,b\n1,2\n");
}

TEST_F(FollowPath, WhatIsNotFollowedEndsItWithItsCode) {
  const TemporaryFile far(pathFile(0.4, 20), ".csv");
  const TemporaryFile no_path("time_s,x_m,y_m,z_m\n0,0.366,0,0\n0,0.366,0.01,0\n", ".csv");
  for (const auto& [file, code, words] :
       {std::tuple(&far, 1, "leaves the arm's reach"), std::tuple(&no_path, 2, "")}) {
    const auto node = start(*file);
    EXPECT_EQ(node->exitCode(60), code) << node->output();
    EXPECT_NE(node->output().find(words), std::string::npos) << node->output();
  }
}

}  // namespace
}  // namespace helix_arm::test
