// The cockpit without its window: what it says and offers, holds, calls and remembers.
#include <chrono>
#include <cmath>
#include <future>
#include <stdexcept>

#include "ros_bridge/cockpit/cockpit_link.hpp"
#include "ros_bridge/cockpit/cockpit_view.hpp"
#include "support/eventually.hpp"
#include "support/has.hpp"

namespace helix_arm::ros_bridge {
namespace {

// What the cockpit says of an arm, and what it offers.
CockpitView arm(const std::string& state, const std::string& problem = "",
                const std::string& action = "", const std::string& remedy = "") {
  CockpitView out;
  out.ns = "/left";
  out.connected = true;
  out.safety.emplace();
  out.safety->state = state;
  out.safety->problem = problem;
  out.safety->action = action;
  out.safety->remedy = remedy;
  CockpitChannel muscle;
  muscle.name = "muscle_1";
  muscle.command = 1e5;
  muscle.measured = 99e3;
  muscle.lower = 0;
  muscle.upper = 4e5;
  out.channels = {muscle};
  return out;
}
CockpitView enabled() { return arm("enabled", "follows targets"); }

TEST(Headline, TellsProblemActionAndRemedy) {
  const CockpitView view = arm("fault", "a vent was requested", "all channels vent", "call enable");
  const Headline words = headline(view);
  EXPECT_EQ(words.state, "FAULT");
  EXPECT_EQ(words.cause, "a vent was requested: all channels vent");
  EXPECT_EQ(words.remedy, "call enable");
}

TEST(Remedy, IsTheArmsAndWhatPreventsIt) {
  CockpitView view = arm("disabled", "", "all channels vent", "call enable");
  EXPECT_EQ(headline(view).cause, "all channels vent");
  EXPECT_EQ(remedyWords(view), "Next: call enable");
  view.channels[0].measured = kUnknown;
  EXPECT_EQ(remedyWords(view).find("Next: call enable\nEnable: no reading of muscle_1"), 0U);
  EXPECT_EQ(remedyWords(enabled()), "") << "that it is enabled already is no obstacle";
  view.connected = false;
  EXPECT_EQ(remedyWords(view), "");
}

TEST(Headline, TellsEachStateApartInWordsAndTone) {
  EXPECT_EQ(headline(enabled()).state, "ENABLED");
  EXPECT_EQ(headline(enabled()).tone, Tone::kGood);
  EXPECT_EQ(headline(arm("disabled")).tone, Tone::kQuiet);
  EXPECT_EQ(headline(arm("vented")).state, "VENTED");
  EXPECT_EQ(headline(arm("vented")).tone, Tone::kCaution);
  EXPECT_EQ(headline(arm("fault")).tone, Tone::kBad);
  CockpitView resting = enabled();
  resting.safety->resting = true;
  EXPECT_EQ(headline(resting).state, "ENABLED, GOES TO REST");
  CockpitView stopped = arm("vented");
  stopped.safety->stopped = true;
  EXPECT_EQ(headline(stopped).state, "STOPPED (VENTED)");
  EXPECT_EQ(headline(stopped).tone, Tone::kBad);
  CockpitView overdue = arm("vented");
  overdue.safety->vent_overdue = true;
  EXPECT_EQ(headline(overdue).tone, Tone::kBad);
}

TEST(Headline, WithoutAnArmItNamesTheNodeAndTheRemedy) {
  CockpitView view;
  view.ns = "/left";
  const Headline words = headline(view);
  EXPECT_EQ(words.state, "NO CONNECTION");
  EXPECT_TRUE(test::has(words.cause, "/left/pressure_command"));
  EXPECT_TRUE(test::has(words.cause, "namespace"));
  view.ns.clear();  // the panel has no arm
  EXPECT_EQ(headline(view).cause.find("no pressure_command"), std::string::npos);
  EXPECT_TRUE(test::has(headline(view).cause, "namespace"));
}

TEST(Possibility, WithoutAnArmOnlyTheStopIsOffered) {
  CockpitView view = enabled();
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

void determine(RunCalibrationResult& result, const char* name, double initial, double value,
               double error, bool known) {
  result.names.emplace_back(name);
  result.units.emplace_back("");
  result.initial.push_back(initial);
  result.values.push_back(value);
  result.standard_errors.push_back(error);
  result.identifiable.push_back(known);
}

TEST(Words, TheResultOfACalibrationLeadsWithMillimetres) {
  CockpitView view = enabled();
  view.calibration.ended = true;
  view.calibration.result.success = true;
  RunCalibrationResult& result = view.calibration.result;
  result.tip_error_before = 0.0143;
  result.tip_error_after = 0.00104;
  determine(result, "K_kappa", 9.8e-5, 1.05e-4, 2e-6, true);
  const Words words = calibrationWords(view);
  EXPECT_EQ(words.text.find("tip error 14.30 mm before, 1.04 mm after"), 0U);
  EXPECT_TRUE(test::has(words.text, "\nK_kappa"));
  EXPECT_EQ(words.tone, Tone::kGood);
  result.success = false;
  result.message = "nothing was seen";
  EXPECT_EQ(calibrationWords(view).text, "failed: nothing was seen");
  EXPECT_EQ(calibrationWords(view).tone, Tone::kBad);
  view.calibration.cancelled = true;
  EXPECT_EQ(calibrationWords(view).text.find("cancelled"), 0U);
  EXPECT_NE(calibrationWords(view).tone, Tone::kBad);
}

TEST(Words, AnExperimentTellsItsTimeThenItsFiguresAndTheSheet) {
  CockpitView view;
  CockpitExperiment& run = view.experiment;
  run.running = true;
  EXPECT_EQ(experimentWords(view).text, "begins");
  run.progress.doing = "step muscle_1";
  run.progress.seconds_left = 89;
  EXPECT_EQ(experimentWords(view).text, "step muscle_1, 89 s left");
  run.progress.seconds_left = 91 * 60;
  EXPECT_EQ(experimentWords(view).text, "step muscle_1, 91 min left");
  run.running = false;
  run.ended = true;
  run.result.success = true;
  run.result.message = "2 figures of step";
  run.result.sheet = "/data/step.pdf";
  run.result.names = {"muscle_1 up t63 tip", "muscle_1 f"};
  run.result.values = {0.25, kUnknown};
  run.result.standard_errors = {0.01, kUnknown};
  run.result.units = {"s", "Hz"};
  EXPECT_EQ(experimentWords(view).text,
            "2 figures of step\ndata sheet: /data/step.pdf\nmuscle_1 up t63 tip: 0.25 +- 0.01 s");
  EXPECT_EQ(experimentWords(view).tone, Tone::kGood);
  run.result.success = false;
  EXPECT_EQ(experimentWords(view).text.find("stopped: "), 0U);
  EXPECT_EQ(experimentWords(view).tone, Tone::kBad);
}

TEST(Words, TheResultOfACalibrationTellsItsWarnings) {
  CockpitView view = enabled();
  view.calibration.ended = true;
  view.calibration.result.success = true;
  EXPECT_EQ(calibrationWarnings(view).text, "");
  view.calibration.result.warnings = {"residuals are 3.3 times as large as the noise", "another"};
  EXPECT_EQ(calibrationWarnings(view).text,
            "warning: residuals are 3.3 times as large as the noise\nwarning: another");
  EXPECT_EQ(calibrationWarnings(view).tone, Tone::kCaution);
  view.calibration.running = true;
  EXPECT_EQ(calibrationWarnings(view).text, "");
}

TEST(Words, AParameterIsListedIfTheDataDeterminedIt) {
  RunCalibrationResult result;
  determine(result, "length_scale", 1, 1.014, 0.004, true);
  determine(result, "K_gamma", 100, 100, 80, false);
  determine(result, "base_x", 0, 0.001, 0.0001, true);
  determine(result, "base_roll", 0, 0.001, 0.0001, true);
  determine(result, "tag_7_along", 0, 0.001, 0.0001, true);
  determine(result, "tag_7_across", 0, 0.001, 0.0001, true);
  determine(result, "tag_12_along", 0, 0.001, 0.0001, true);
  determine(result, "bleed", 0, 6.5e-5, 7.2e-5, true);
  EXPECT_EQ(parameterLines(result),
            (std::vector<std::string>{"length_scale 1 -> 1.014 +- 0.004", "pose of the base",
                                      "places of 2 tags", "not distinguishable from 0: bleed"}));
}

TEST(Words, OfTheLoopTellStateAndError) {
  CockpitView view = enabled();
  EXPECT_TRUE(test::has(loopWords(view).text, "closed_loop:=true"));
  view.loop = CockpitLoop{"closed", "", 0.0012, 0.0005, 0.0119};
  EXPECT_EQ(loopWords(view).text, "closed, 1.20 mm from the target, tip known to 11.90 mm");
  view.loop->budget_sd = kUnknown;  // before the first budget
  EXPECT_EQ(loopWords(view).text,
            "closed, 1.20 mm from the target, tip known to 0.50 mm if the tags are where the scene "
            "says");
  EXPECT_EQ(loopWords(view).tone, Tone::kGood);
  for (const std::string state : {"diverging", "doubtful"}) {
    view.loop = CockpitLoop{state, "call reset", kUnknown, kUnknown, kUnknown};
    EXPECT_EQ(loopWords(view).text, state + ": call reset");
    EXPECT_EQ(loopWords(view).tone, Tone::kBad);
  }
}

TEST(Words, ASilentCockpitSaysThatTheArmVents) {
  CockpitView view = enabled();
  EXPECT_EQ(goalWords(view).text, "commands nothing");
  view.target_timeout = 1.5;
  EXPECT_TRUE(test::has(goalWords(view).text, "vents after 1.5 s"));
  view.goal = CockpitGoal::kTip;
  view.answer = "the tip stays 5.0 mm away";
  EXPECT_EQ(goalWords(view).text, "holds the tip target: the tip stays 5.0 mm away");
  EXPECT_EQ(goalWords(view).tone, Tone::kQuiet);
  view.short_of = true;
  EXPECT_EQ(goalWords(view).tone, Tone::kCaution) << "it is not where it was sent";
}

TEST(Words, NumbersCarryTheirUnit) {
  EXPECT_EQ(kilopascals(123456), "123.5 kPa");
  EXPECT_EQ(kilopascals(-3), "0.0 kPa");
  EXPECT_EQ(kilopascals(kUnknown), "-");
  EXPECT_EQ(millimetres(0.00123), "1.23 mm");
  EXPECT_EQ(millimetres(kUnknown), "-");
  EXPECT_EQ(placeWords(std::vector<double>{0.3, -2e-5, -0.01234}), "300.0, 0.0, -12.3 mm");
  EXPECT_EQ(placeWords(std::nullopt), "-");
  CockpitChannel channel;
  EXPECT_EQ(limitWords(channel), "-");
  channel.lower = 0;
  channel.upper = 413685.6;
  EXPECT_EQ(limitWords(channel), "0 to 413.7");
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

TEST(CockpitWords, TheArmIsNamedAndWhyThereIsNone) {
  CockpitView view;
  EXPECT_EQ(armName(view), "no arm");
  EXPECT_TRUE(test::has(headline(view).cause, "no name"));
  view.connecting_to = "/left";
  EXPECT_EQ(headline(view).cause, "connects to /left");
  view.silent_master = "http://rig:11311/";
  EXPECT_TRUE(
      test::has(headline(view).cause, "the ROS master at http://rig:11311/ does not answer"));
  view.ns = "/";
  EXPECT_EQ(armName(view), "/ (no namespace)");
  view.ns = "/right";
  EXPECT_EQ(armName(view), "/right");
  EXPECT_TRUE(test::has(headline(view).cause, "/right/pressure_command"));
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

TEST_F(HeldGoalTest, OnceAcceptedItWaitsAnew) {
  goal_.noteAnswer(10.0, true, "other_commander", "x");
  goal_.noteAnswer(14.0, false, "", "reached");
  goal_.noteAnswer(14.1, true, "other_commander", "x");
  goal_.look(18.0);
  EXPECT_TRUE(goal_.turn(18.0));
}

TEST_F(HeldGoalTest, AnAnswerThatComesAfterItsEndChangesNothing) {
  goal_.end("let go");
  goal_.noteAnswer(10.1, true, "not_enabled", "the arm is vented");
  EXPECT_EQ(goal_.state().answer, "let go");
  EXPECT_FALSE(goal_.state().refused);
}

TEST_F(HeldGoalTest, ATipReplacesPressures) {
  goal_.holdTip(11.0, {0.3, 0.1, 0.0});
  EXPECT_EQ(goal_.state().goal, CockpitGoal::kTip);
  EXPECT_EQ(goal_.state().tip[1], 0.1);
  EXPECT_TRUE(goal_.turn(11.1));
}

// What a strip chart remembers.
TEST(StripHistory, KeepsItsSpanAndNoMore) {
  StripHistory history(30, 0.05);
  for (int k = 0; k < 10000; ++k) history.add(0.1 * k, {1e5}, 1e-3);
  EXPECT_NEAR(history.rows().front().time, history.newest() - 30, 0.11);
  EXPECT_LE(history.rows().size(), 302U);
}

TEST(StripHistory, LeavesOutRowsThatComeTooSoon) {
  StripHistory history(30, 0.05);
  for (int k = 0; k < 1000; ++k) history.add(0.001 * k, {0}, 0);
  EXPECT_LE(history.rows().size(), 21U);
  EXPECT_GE(history.rows().size(), 19U);
}

TEST(StripHistory, BeginsAnewWhereTimeJumpsBackOrTheArmIsAnother) {
  StripHistory history(30, 0);
  history.add(5, {1, 2}, 0);
  history.add(4, {1, 2}, 0);
  EXPECT_EQ(history.rows().size(), 1U);
  history.add(6, {1, 2, 3}, 0);
  EXPECT_EQ(history.rows().size(), 1U);
  history.add(std::nan(""), {1, 2, 3}, 0);
  EXPECT_EQ(history.rows().size(), 1U);
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

TEST_F(ServiceCallerTest, TellsTheAnswerOrWhatTheCallThrows) {
  caller_.ask("Enable", kLong, answering(true, "enabled: follows targets"));
  ASSERT_EQ(answers(1).size(), 1U);
  EXPECT_EQ(answers_[0].what, "Enable");
  EXPECT_TRUE(answers_[0].success);
  EXPECT_EQ(answers_[0].message, "enabled: follows targets");
  caller_.ask("Vent", kLong, []() -> CallAnswer { throw std::runtime_error("no such service"); });
  ASSERT_EQ(answers(2).size(), 2U);
  EXPECT_FALSE(answers_[1].success);
  EXPECT_EQ(answers_[1].message, "no such service");
}

TEST_F(ServiceCallerTest, CallsThatHangAreLimitedByName) {
  for (int k = 0; k < ServiceCaller::kMostWaiting + 3; ++k) caller_.ask("Enable", kLong, hanging());
  const auto answers = this->answers(3);
  ASSERT_EQ(answers.size(), 3U);
  EXPECT_TRUE(test::has(answers[2].message, "earlier calls"));
  caller_.ask("Vent", kLong, answering(true, ""));
  EXPECT_TRUE(this->answers(4).back().success);
}

TEST_F(ServiceCallerTest, KnowsWhichCallsWait) {
  EXPECT_FALSE(caller_.waits("Enable"));
  caller_.ask("Enable", kLong, hanging());
  caller_.ask("Vent", kShort, hanging());
  EXPECT_TRUE(caller_.waits("Enable"));
  EXPECT_FALSE(caller_.waits("Release"));
  ASSERT_EQ(this->answers(1).size(), 1U);
  EXPECT_FALSE(caller_.waits("Vent")) << "given up on";
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

TEST_F(ServiceCallerTest, ThreadsOfCallsThatHangAreBounded) {
  std::size_t asked = 0;
  const auto few = [&] {
    for (int k = 0; k < ServiceCaller::kMostWaiting; ++k, ++asked)
      caller_.ask("Vent", kShort, hanging());
    return this->answers(asked);
  };
  for (int k = 0; k < ServiceCaller::kMostRunning / ServiceCaller::kMostWaiting; ++k) {
    const auto answers = few();
    ASSERT_EQ(answers.size(), asked);
    EXPECT_TRUE(test::has(answers.back().message, "no answer within"));
  }
  EXPECT_TRUE(test::has(few().back().message, "too many calls hang"));
}

TEST_F(ServiceCallerTest, EveryFailureHasTheRemedyAndSuccessHasNone) {
  caller_.ask("Stop", kShort, hanging(), "by hand");
  auto late = answers(1);
  EXPECT_FALSE(late.back().answered);
  EXPECT_EQ(late.back().remedy, "by hand");
  caller_.ask("Stop", kLong, answering(false, "no"), "by hand");
  EXPECT_TRUE(answers(2).back().answered);
  EXPECT_EQ(answers(2).back().remedy, "by hand");
  caller_.ask(
      "Stop", kLong, []() -> CallAnswer { throw std::runtime_error("cut off"); }, "by hand");
  EXPECT_EQ(answers(3).back().remedy, "by hand");
  caller_.ask("Stop", kLong, answering(true, "yes"), "by hand");
  EXPECT_EQ(answers(4).back().remedy, "");
  for (int k = 0; k <= ServiceCaller::kMostWaiting; ++k)
    caller_.ask("Many", kLong, hanging(), "by hand");
  EXPECT_EQ(answers(5).back().remedy, "by hand") << "refused, since too many wait";
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
