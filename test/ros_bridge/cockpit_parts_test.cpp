// The cockpit without its window: what it offers, holds, calls and remembers.
#include <chrono>
#include <future>

#include "ros_bridge/cockpit/cockpit_link.hpp"
#include "ros_bridge/cockpit/cockpit_view.hpp"
#include "support/eventually.hpp"
#include "support/has.hpp"

namespace helix_arm::ros_bridge {
namespace {

// What the cockpit says of an arm, and what it offers.
CockpitView arm(const std::string& state) {
  CockpitView out;
  out.ns = "/left";
  out.connected = true;
  out.safety.emplace();
  out.safety->state = state;
  out.channels = {{"muscle_1", 1e5, 99e3, 0, 4e5}};
  return out;
}

TEST(Possibility, WithoutAnArmOnlyTheStopIsOffered) {
  CockpitView view = arm("enabled");
  view.connected = false;
  view.safety->stopped = true;  // of an arm that is gone: latched topics outlive nothing
  EXPECT_TRUE(mayStop(view).possible());
  for (const Possibility& one :
       {mayEnable(view), mayVent(view), mayRelease(view), mayHold(view), mayAimTip(view),
        maySetPressure(view, view.channels[0]), mayUse(view), mayCalibrate(view)}) {
    EXPECT_FALSE(one.possible());
  }
}

Possibility maySlide(const CockpitView& view) { return maySetPressure(view, view.channels[0]); }

// What an arm that is changed so allows, or why not.
TEST(Possibility, FollowsFromTheStateAndNamesWhatPreventsIt) {
  using View = CockpitView;
  const auto nothing = [](View&) {};
  const auto tipless = [](View& v) { v.tip_heard = false; };
  const auto unread = [](View& v) { v.channels[0].measured = kUnknown; };
  const auto stopped = [](View& v) { v.safety->stopped = true; };
  const auto unlimited = [](View& v) { v.channels[0].upper = kUnknown; };
  const auto holding = [](View& v) { v.goal = CockpitGoal::kPressures; };
  const auto ready = [](View& v) { v.calibration.there = true; };
  const auto calibrating = [](View& v) { v.calibration.there = v.calibration.running = true; };
  const auto aiming = [](View& v) { v.calibration.there = true, v.goal = CockpitGoal::kTip; };
  const auto ended = [](View& v) { v.calibration.ended = true; };
  const auto measuring = [](View& v) {
    v.calibration.there = v.experiment.there = v.experiment.running = true;
  };
  const auto measured = [](View& v) { v.experiment.there = v.experiment.ended = true; };
  const auto good = [](View& v) {
    v.calibration.ended = true, v.calibration.result.success = true;
  };
  const auto loaded = [=](View& v) { good(v), v.calibration.is_loaded = true; };
  const auto again = [=](View& v) { good(v), v.calibration.running = true; };
  const struct {
    const char* state;
    std::function<void(View&)> change;
    // And words of why it may not be done; null: it may.
    std::vector<std::pair<std::function<Possibility(const View&)>, const char*>> may;
  } kRows[] = {
      {"enabled",
       nothing,
       {{mayEnable, "the arm is enabled already"},
        {mayVent, nullptr},
        {mayStop, nullptr},
        {mayRelease, ""},
        {mayHold, nullptr},
        {mayAimTip, nullptr},
        {maySlide, nullptr},
        {mayCalibrate, "calibration:=true"},
        {mayExperiment, "calibration:=true"},
        {mayUse, ""}}},
      {"enabled", tipless, {{mayAimTip, "visual_servo"}, {mayHold, nullptr}}},
      {"enabled", unlimited, {{maySlide, "limits of muscle_1"}}},
      {"disabled", nothing, {{mayEnable, nullptr}, {mayHold, ""}}},
      {"vented", nothing, {{mayEnable, nullptr}, {mayAimTip, ""}}},
      {"fault", nothing, {{mayEnable, ""}, {maySlide, "enable"}}},
      {"disabled", unread, {{mayEnable, "reading of muscle_1"}}},
      {"vented",
       stopped,
       {{mayStop, ""}, {mayRelease, nullptr}, {mayEnable, "release"}, {mayHold, "release"}}},
      {"fault", holding, {{mayHold, nullptr}}},  // to let go
      {"enabled", ready, {{mayCalibrate, nullptr}, {mayCancel, ""}}},
      {"enabled", aiming, {{mayCalibrate, ""}}},
      {"enabled",
       calibrating,
       {{mayCalibrate, ""}, {mayCancel, nullptr}, {mayHold, ""}, {mayAimTip, ""}, {maySlide, ""}}},
      {"enabled", measured, {{mayExperiment, nullptr}, {mayStopExperiment, ""}}},
      {"disabled", measured, {{mayExperiment, "enable"}}},
      {"enabled",
       measuring,
       {{mayStopExperiment, nullptr},
        {mayExperiment, "already"},
        {mayCalibrate, "stop it first"},
        {maySlide, "stop it first"}}},
      {"enabled", ended, {{mayUse, ""}}},
      {"enabled", good, {{mayUse, nullptr}}},
      {"enabled", loaded, {{mayUse, ""}}},  // a second time meanwhile
      {"enabled", again, {{mayUse, ""}}},
  };
  for (const auto& row : kRows) {
    View view = arm(row.state);
    row.change(view);
    for (const auto& [may, why_not] : row.may) {
      SCOPED_TRACE("row " + std::to_string(&row - kRows) + ": " + (why_not ? why_not : "possible"));
      const Possibility possibility = may(view);
      EXPECT_EQ(possibility.possible(), why_not == nullptr);
      EXPECT_TRUE(test::has(possibility.why_not, why_not == nullptr ? "" : why_not));
    }
  }
}

TEST(CockpitWords, AFailedStopBeginsWithWhatToDoByHand) {
  const Words late =
      answerWords({"Emergency stop", false, "no answer within 3 s", false, kStopByHand});
  EXPECT_EQ(late.text, std::string("Emergency stop: ") + kStopByHand + ": no answer within 3 s");
  EXPECT_EQ(late.tone, Tone::kBad);
  EXPECT_EQ(answerWords({"Enable", false, "the arm is stopped"}).text,
            "Enable: refused: the arm is stopped");
  EXPECT_EQ(answerWords({"Enable", false, "no answer within 3 s", false}).text,
            "Enable: no answer within 3 s")
      << "nobody refused it";
  EXPECT_EQ(answerWords({"Enable", true, "enabled"}).text, "Enable: enabled");
  EXPECT_EQ(answerWords({"Enable", true, "enabled"}).tone, Tone::kQuiet);
}

// When the cockpit stops repeating its target.
class HeldGoalTest : public ::testing::Test {
 protected:
  void SetUp() override { goal_.holdPressures(10.0, {1e5, 0, 0}); }
  HeldGoal goal_;
};

TEST_F(HeldGoalTest, IsRepeatedWhileSomebodyLooks) {
  for (double now = 10.0; now < 60.0; now += 0.1) {
    goal_.look(now);
    ASSERT_TRUE(goal_.turn(now)) << now;
    goal_.noteAnswer(now, false, "", "reached");
  }
  EXPECT_EQ(goal_.state().held, (std::vector<double>{1e5, 0, 0}));
}

TEST_F(HeldGoalTest, EndsWhereTheWindowHangs) {
  EXPECT_TRUE(goal_.turn(10.0 + HeldGoal::kBlind - 0.01));
  EXPECT_FALSE(goal_.turn(10.0 + HeldGoal::kBlind + 0.01));
  goal_.look(20.0);
  EXPECT_FALSE(goal_.turn(20.0)) << "it begins again by itself";
  EXPECT_TRUE(test::has(goal_.state().answer, "window"));
}

TEST_F(HeldGoalTest, EndsWithTheArmAndDoesNotEnableItAgain) {
  goal_.noteState(true, "enabled: follows targets");
  EXPECT_TRUE(goal_.turn(10.1));
  goal_.noteState(false, "fault: a leak");
  EXPECT_FALSE(goal_.turn(10.2));
  EXPECT_TRUE(test::has(goal_.state().answer, "a leak"));
  goal_.noteState(true, "enabled: follows targets");
  EXPECT_FALSE(goal_.turn(10.3));
}

TEST_F(HeldGoalTest, EndsWhereATargetIsRefusedForGood) {
  goal_.noteAnswer(10.1, true, "out_of_range", "stay within 0 to 400000 Pa");
  EXPECT_FALSE(goal_.turn(10.2));
  EXPECT_TRUE(goal_.state().refused);
  EXPECT_EQ(goal_.state().answer, "stay within 0 to 400000 Pa");
}

TEST_F(HeldGoalTest, ATargetOutOfReachOrThatCameLateIsHeldAndTold) {
  goal_.noteAnswer(10.1, false, "", "the tip stays 4.1 mm away", true);
  EXPECT_TRUE(goal_.turn(10.2));
  EXPECT_TRUE(goal_.state().short_of);
  goal_.noteAnswer(10.3, false, "", "reached");
  EXPECT_FALSE(goal_.state().short_of);
  goal_.noteAnswer(10.3, true, "stale", "the target is stamped 2 s ago");
  EXPECT_TRUE(goal_.turn(10.4));
}

TEST_F(HeldGoalTest, WaitsForAnotherCommanderButNotForever) {
  for (double now = 10.0; now < 10.0 + HeldGoal::kPatience; now += 0.1) {
    goal_.look(now);
    ASSERT_TRUE(goal_.turn(now)) << now;
    goal_.noteAnswer(now, true, "other_commander", "/pressure_series commands the arm");
  }
  goal_.look(15.2);
  EXPECT_FALSE(goal_.turn(15.2));
  EXPECT_TRUE(test::has(goal_.state().answer, "/pressure_series"));
}

// As of a visual_servo that died between the cockpit and pressure_command.
TEST_F(HeldGoalTest, EndsWhereNothingAnswers) {
  goal_.noteAnswer(11.0, false, "", "reached");
  const auto turnAt = [this](double now) {
    goal_.look(now);
    return goal_.turn(now);
  };
  EXPECT_TRUE(turnAt(11.0 + HeldGoal::kUnanswered - 0.01));
  goal_.holdPressures(11.0 + HeldGoal::kUnanswered - 0.01, {2e5, 0, 0});
  EXPECT_FALSE(turnAt(11.0 + HeldGoal::kUnanswered + 0.01)) << "another number is no answer";
  EXPECT_TRUE(test::has(goal_.state().answer, "nothing answers"));
  EXPECT_TRUE(goal_.state().refused);
  goal_.holdTip(20.0, {0.3, 0, 0});
  EXPECT_TRUE(turnAt(20.0 + HeldGoal::kUnanswered - 0.01)) << "it has its own time";
}

TEST(StripHistory, AxesHoldAllValuesInSteps) {
  StripHistory history(30, 0);
  EXPECT_EQ(history.pressureTop(1e5), 1e5);
  history.add(0, {1e5, std::nan("")}, std::nan(""));
  EXPECT_EQ(history.pressureTop(1e5), 1e5);
  EXPECT_EQ(history.errorTop(1e-3), 1e-3);
  history.add(1, {1.1e5, 0}, 0.0011);
  EXPECT_EQ(history.pressureTop(1e5), 2e5);
  EXPECT_DOUBLE_EQ(history.errorTop(1e-3), 2e-3);
  history.add(2, {2.1e5, 0}, 0.0051);
  EXPECT_EQ(history.pressureTop(1e5), 5e5);
  EXPECT_DOUBLE_EQ(history.errorTop(1e-3), 1e-2);
}

// Calls that hang hold up neither their caller nor other calls.
constexpr double kLong = 60;    // no call of these tests lasts so long [s]
constexpr double kShort = 0.1;  // [s]

class ServiceCallerTest : public ::testing::Test {
 protected:
  ~ServiceCallerTest() override { open_.set_value(); }

  // The answers once there are this many.
  std::vector<CallAnswer> answers(std::size_t count) {
    test::eventually(
        [&] {
          for (CallAnswer& answer : caller_.take()) answers_.push_back(std::move(answer));
          return answers_.size() >= count;
        },
        30);
    return answers_;
  }
  static ServiceCaller::Call answering(bool success, const std::string& message) {
    return [=] { return CallAnswer{"", success, message}; };
  }
  // A call that ends with the test.
  ServiceCaller::Call hanging() {
    return [gate = gate_] {
      gate.wait();
      return CallAnswer{"", true, "late"};
    };
  }

  std::promise<void> open_;
  const std::shared_future<void> gate_ = open_.get_future().share();
  ServiceCaller caller_;
  std::vector<CallAnswer> answers_;
};

TEST_F(ServiceCallerTest, CallsThatHangAreLimitedByName) {
  for (int k = 0; k < ServiceCaller::kMostWaiting + 3; ++k) caller_.ask("Enable", kLong, hanging());
  const auto answers = this->answers(3);
  ASSERT_EQ(answers.size(), 3U);
  EXPECT_TRUE(test::has(answers[2].message, "earlier calls"));
  caller_.ask("Vent", kLong, answering(true, ""));
  EXPECT_TRUE(this->answers(4).back().success);
}

// A node that hung and was started again must still hear a stop.
TEST_F(ServiceCallerTest, CallsGivenUpOnLeaveRoomForAnother) {
  for (int k = 0; k < ServiceCaller::kMostWaiting; ++k)
    caller_.ask("Emergency stop", kShort, hanging());
  ASSERT_EQ(this->answers(ServiceCaller::kMostWaiting).size(),
            std::size_t{ServiceCaller::kMostWaiting});
  caller_.ask("Emergency stop", kLong, answering(true, "engaged"));
  const auto answers = this->answers(ServiceCaller::kMostWaiting + 1);
  ASSERT_EQ(answers.size(), std::size_t{ServiceCaller::kMostWaiting + 1});
  EXPECT_TRUE(answers.back().success) << answers.back().message;
}

TEST_F(ServiceCallerTest, ItsEndDoesNotWaitForACall) {
  const auto before = std::chrono::steady_clock::now();
  std::promise<void> ended;
  {
    ServiceCaller caller;
    caller.ask("Enable", kLong, [gate = gate_, &ended] {
      gate.wait();
      ended.set_value();
      return CallAnswer{"", true, "late"};
    });
  }
  EXPECT_LT(std::chrono::steady_clock::now() - before, std::chrono::seconds(20));
  open_.set_value();
  open_ = {};  // for the destructor
  ended.get_future().wait();
}

}  // namespace
}  // namespace helix_arm::ros_bridge
