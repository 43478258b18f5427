// What the cockpit says of an arm, and what it offers.
#include <gtest/gtest.h>

#include "ros_bridge/cockpit/cockpit_view.hpp"

namespace helix_arm::ros_bridge {
namespace {

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
  EXPECT_NE(words.cause.find("/left/pressure_command"), std::string::npos);
  EXPECT_NE(words.cause.find("namespace"), std::string::npos);
  view.ns.clear();  // the panel has no arm
  EXPECT_EQ(headline(view).cause.find("no pressure_command"), std::string::npos);
  EXPECT_NE(headline(view).cause.find("namespace"), std::string::npos);
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

TEST(Possibility, AnEnabledArmTakesCommandsButNoSecondEnable) {
  const CockpitView view = enabled();
  EXPECT_EQ(mayEnable(view).why_not, "the arm is enabled already");
  EXPECT_TRUE(mayVent(view).possible());
  EXPECT_TRUE(mayStop(view).possible());
  EXPECT_FALSE(mayRelease(view).possible());
  EXPECT_TRUE(mayHold(view).possible());
  EXPECT_TRUE(mayAimTip(view).possible());
  EXPECT_TRUE(maySetPressure(view, view.channels[0]).possible());
}

TEST(Possibility, ATipIsAimedAtOnlyWhereSomebodyListens) {
  CockpitView view = enabled();
  view.tip_heard = false;
  EXPECT_NE(mayAimTip(view).why_not.find("visual_servo"), std::string::npos);
  EXPECT_TRUE(mayHold(view).possible());
}

TEST(Possibility, AnArmThatIsNotEnabledTakesNoTargets) {
  for (const char* state : {"disabled", "vented", "fault"}) {
    const CockpitView view = arm(state);
    EXPECT_FALSE(mayHold(view).possible()) << state;
    EXPECT_FALSE(mayAimTip(view).possible()) << state;
    EXPECT_NE(maySetPressure(view, view.channels[0]).why_not.find("enable"), std::string::npos);
    EXPECT_EQ(mayEnable(view).possible(), state != std::string("fault"));
  }
}

TEST(Possibility, AnArmWithoutReadingsIsNotEnabled) {
  CockpitView view = arm("disabled");
  EXPECT_TRUE(mayEnable(view).possible());
  view.channels[0].measured = kUnknown;
  EXPECT_NE(mayEnable(view).why_not.find("reading of muscle_1"), std::string::npos);
}

TEST(Possibility, AnEngagedStopIsReleasedFirst) {
  CockpitView view = arm("vented");
  view.safety->stopped = true;
  EXPECT_FALSE(mayStop(view).possible());
  EXPECT_TRUE(mayRelease(view).possible());
  EXPECT_NE(mayEnable(view).why_not.find("release"), std::string::npos);
  EXPECT_NE(mayHold(view).why_not.find("release"), std::string::npos);
}

TEST(Possibility, ASliderNeedsItsLimits) {
  CockpitView view = enabled();
  view.channels[0].upper = kUnknown;
  EXPECT_NE(maySetPressure(view, view.channels[0]).why_not.find("limits of muscle_1"),
            std::string::npos);
}

TEST(Possibility, WhatIsHeldCanBeLetGoWhateverTheStateIs) {
  CockpitView view = arm("fault");
  view.goal = CockpitGoal::kPressures;
  EXPECT_TRUE(mayHold(view).possible());
}

TEST(Possibility, ACalibrationExcludesOtherCommandsAndViceVersa) {
  CockpitView view = enabled();
  EXPECT_NE(mayCalibrate(view).why_not.find("calibration:=true"), std::string::npos);
  view.calibration.there = true;
  EXPECT_TRUE(mayCalibrate(view).possible());
  EXPECT_FALSE(mayCancel(view).possible());
  view.goal = CockpitGoal::kTip;
  EXPECT_FALSE(mayCalibrate(view).possible());
  view.goal = CockpitGoal::kNone;
  view.calibration.running = true;
  EXPECT_FALSE(mayCalibrate(view).possible());
  EXPECT_TRUE(mayCancel(view).possible());
  EXPECT_FALSE(mayHold(view).possible());
  EXPECT_FALSE(mayAimTip(view).possible());
  EXPECT_FALSE(maySetPressure(view, view.channels[0]).possible());
}

TEST(Possibility, OnlyACalibrationThatSucceededCanBeUsed) {
  CockpitView view = enabled();
  EXPECT_FALSE(mayUse(view).possible());
  view.calibration.ended = true;
  EXPECT_FALSE(mayUse(view).possible());
  view.calibration.result.success = true;
  EXPECT_TRUE(mayUse(view).possible());
  view.calibration.is_loaded = true;
  EXPECT_FALSE(mayUse(view).possible()) << "a second time meanwhile";
  view.calibration.is_loaded = false;
  view.calibration.running = true;
  EXPECT_FALSE(mayUse(view).possible());
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
  EXPECT_NE(words.text.find("\nK_kappa"), std::string::npos);
  EXPECT_EQ(words.tone, Tone::kGood);
  result.success = false;
  result.message = "nothing was seen";
  EXPECT_EQ(calibrationWords(view).text, "failed: nothing was seen");
  EXPECT_EQ(calibrationWords(view).tone, Tone::kBad);
  view.calibration.cancelled = true;
  EXPECT_EQ(calibrationWords(view).text.find("cancelled"), 0U);
  EXPECT_NE(calibrationWords(view).tone, Tone::kBad);
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
  EXPECT_NE(loopWords(view).text.find("closed_loop:=true"), std::string::npos);
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
  EXPECT_NE(goalWords(view).text.find("vents after 1.5 s"), std::string::npos);
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
  EXPECT_NE(headline(view).cause.find("no name"), std::string::npos);
  view.connecting_to = "/left";
  EXPECT_EQ(headline(view).cause, "connects to /left");
  view.silent_master = "http://rig:11311/";
  EXPECT_NE(headline(view).cause.find("the ROS master at http://rig:11311/ does not answer"),
            std::string::npos)
      << headline(view).cause;
  view.ns = "/";
  EXPECT_EQ(armName(view), "/ (no namespace)");
  view.ns = "/right";
  EXPECT_EQ(armName(view), "/right");
  EXPECT_NE(headline(view).cause.find("/right/pressure_command"), std::string::npos);
}

}  // namespace
}  // namespace helix_arm::ros_bridge
