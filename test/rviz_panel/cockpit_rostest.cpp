// The panel of rviz, loaded as rviz loads it, under real clicks.
#include <QComboBox>
#include <QDoubleSpinBox>
#include <QLineEdit>
#include <QProgressBar>
#include <QScrollArea>
#include <QScrollBar>
#include <QSlider>
#include <QTabBar>
#include <QTabWidget>
#include <QtTest/QTest>

#include "helix_arm/SafetyState.h"
#include "panel_window.hpp"
#include "ros_bridge/cockpit/cockpit_link.hpp"
#include "rviz_panel/panel_parts.hpp"
#include "support/process.hpp"
#include "support/ros_rig.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_size.hpp"

namespace helix_arm::test {
namespace {

constexpr char kArm[] = "left";

constexpr QSize kWindow(460, 1100);
constexpr QSize kLaptop(418, 654);  // of the panel, in a window of rviz of 1366 x 768

double seconds() { return ros::SteadyTime::now().toSec(); }

class Cockpit : public PanelWindow {
 protected:
  void SetUp() override {
    startArm();
    show(kArm, kWindow);
    await([this] { return panel_->isVisible(); });
    await([this] { return !safety_.all().empty() && !command_.all().empty(); });
    await([this] { return !says("state", "NO "); });
  }

  static std::unique_ptr<Process> start(const std::string& program,
                                        std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.begin(), {program, "_scene:=demo", std::string("__ns:=/") + kArm});
    return std::make_unique<Process>(arguments);
  }

  virtual void startArm() {
    rig_ = start(HELIX_ARM_SIMULATED_RIG);
    pressure_ = start(HELIX_ARM_PRESSURE_COMMAND,
                      {"_regulator:=topic", "_auto_enable:=false", "_frame_prefix:=left_"});
  }

  // Lets so much time pass [s].
  void pass(double time) {
    const double end = seconds() + time;
    await([&] { return seconds() > end; });
  }

  // A click of the X server at a place of a widget, from its left (0) to its right (1). The panel
  // may offer it later than a subscriber of the test has what makes it possible.
  void click(const char* name, double place = 0.5) {
    QWidget* const widget = find<QWidget>(name);
    if (!widget->isEnabled()) awaitOffer(name);
    open(widget);
    clickAt(widget->mapToGlobal(
        QPoint(static_cast<int>(place * (widget->width() - 1)), widget->height() / 2)));
  }
  // Clicks on the tab of a widget, if it has one.
  void open(QWidget* widget) {
    auto* const tabs = find<QTabWidget>("tabs");
    for (int k = 0; k < tabs->count(); ++k) {
      if (!tabs->widget(k)->isAncestorOf(widget) || tabs->currentIndex() == k) continue;
      clickAt(tabs->tabBar()->mapToGlobal(tabs->tabBar()->tabRect(k).center()));
      await([&] { return tabs->currentIndex() == k || !panel_->isActiveWindow(); });
    }
  }
  void clickAt(const QPoint& at) {
    Process xdotool(
        {"xdotool", "mousemove", std::to_string(at.x()), std::to_string(at.y()), "click", "1"});
    await([&] { return xdotool.exitCode(0.01) != -1; });
    ASSERT_EQ(xdotool.exitCode(), 0) << xdotool.output();
  }

  // Comes to be without scrolling, and without another widget over it.
  void expectInSight(const char* name) {
    auto* const widget = find<QWidget>(name);
    EXPECT_TRUE(until([&] {
      return widget->isVisible() && widget->visibleRegion() == QRegion(widget->rect());
    })) << name
        << " is cut: " << widget->visibleRegion().boundingRect().height() << " of "
        << widget->height() << " px are in sight";
  }
  // What a FixedText shows of its text, in one line.
  QString painted(const char* label) {
    const auto* const widget = find<QLabel>(label);
    const int lines = widget->height() / widget->fontMetrics().lineSpacing();
    return rviz_panel::FixedText::paintedLines(widget->text(), widget->font(), widget->width(),
                                               lines)
        .join("")
        .simplified();
  }
  void expectPaintedWhole(const char* label) {
    EXPECT_FALSE(painted(label).contains(QChar(0x2026))) << painted(label).toStdString();
    EXPECT_EQ(painted(label), find<QLabel>(label)->text().simplified());
  }

  // Types a namespace over the one in the field.
  void type(const char* ns) {
    click("namespace");
    auto* const field = find<QLineEdit>("namespace");
    await([&] { return field->hasFocus() || !panel_->isActiveWindow(); });
    field->selectAll();
    QTest::keyClick(field, Qt::Key_Delete);
    QTest::keyClicks(field, ns);
    ASSERT_EQ(field->text(), ns);
  }
  void enter(const char* ns) {
    type(ns);
    QTest::keyClick(find<QLineEdit>("namespace"), Qt::Key_Return);
  }
  bool isMarked() { return !find<QLineEdit>("namespace")->styleSheet().isEmpty(); }

  std::string state() { return safety_.all().empty() ? "" : safety_.last().state; }
  double commanded() { return command_.last().pressure.at(0); }

  void enable() {
    // The node may hear the first reading later than the panel, and then refuses.
    await([this] {
      if (isOffered("enable")) click("enable");
      return until([this] { return state() == SafetyState::ENABLED; }, 1);
    });
    awaitText("state", "ENABLED");
    awaitOffer("slider_0");
  }

  std::unique_ptr<Process> rig_, pressure_;
  ros::NodeHandle node_{kArm};
  Inbox<SafetyState> safety_{node_, names::kSafetyState};
  Inbox<PressureArray> command_{node_, names::kPressureCommand};
  Inbox<TipTarget> tips_{node_, names::kTipTarget};
};

TEST_F(Cockpit, AClickEnablesTheArmAndHoldsItAndTheWordsTellIt) {
  awaitText("limits_0", "0 to 413.7");
  awaitSaid("goal", "vents after 1 s");
  EXPECT_EQ(text("state"), "DISABLED");
  EXPECT_FALSE(isOffered("slider_0"));
  EXPECT_NE(tip("slider_0").find("enable it first"), std::string::npos) << tip("slider_0");
  EXPECT_EQ(text("pressures_why_not"), tip("slider_0"));
  enable();
  EXPECT_FALSE(isOffered("enable"));
  EXPECT_EQ(tip("enable"), "the arm is enabled already");
  awaitSaid("answer", "Enable: ");
  click("hold");  // the present pressures, beyond the time of a silent commander
  await([this] { return find<QPushButton>("hold")->isChecked(); });
  pass(2);
  EXPECT_EQ(state(), SafetyState::ENABLED);
  EXPECT_NEAR(commanded(), 0, 1);
  // An answer goes with time.
  await([this] { return text("answer").empty(); });
}

TEST_F(Cockpit, ASliderMovesThePressureAndHoldsItWithoutAnyOtherCommander) {
  enable();
  auto* const slider = find<QSlider>("slider_0");
  EXPECT_EQ(slider->minimum(), 0);
  EXPECT_EQ(slider->maximum(), 4136) << "413.6856 kPa in steps of 0.1 kPa, not beyond";
  while (slider->value() < 1000) click("slider_0", 0.9);  // a page at a time
  const int clicked = slider->value();
  QTest::keyClick(slider, Qt::Key_Right);
  EXPECT_EQ(slider->value(), clicked + 10) << "1 kPa";
  const double wanted = 100.0 * slider->value();
  await([&] { return std::abs(commanded() - wanted) < 1; });
  // Three times the time after which a silent commander is a fault.
  pass(3);
  EXPECT_EQ(state(), SafetyState::ENABLED) << safety_.last().reason;
  EXPECT_NEAR(commanded(), wanted, 1);
  await([&] { return text("reading_0") != "0.0 kPa" && text("reading_0") != "-"; });
  // No end of the slider is refused.
  slider->setValue(slider->maximum());
  await([&] { return std::abs(commanded() - 413600) < 1; });
  EXPECT_EQ(text("goal"), "Cockpit: holds the pressures: reached");
  // Let go: down to rest, without a fault.
  EXPECT_EQ(find<QPushButton>("hold")->text(), "Let go");
  click("hold");
  await([this] { return state() == SafetyState::DISABLED; });
  EXPECT_EQ(safety_.last().cause, "none");
}

TEST_F(Cockpit, ATipTargetInNumbersMovesTheArm) {
  enable();
  find<QDoubleSpinBox>("tip_x")->setValue(366);
  find<QDoubleSpinBox>("tip_y")->setValue(20);
  find<QDoubleSpinBox>("tip_z")->setValue(5);
  click("tip_go");
  await([this] { return !tips_.all().empty(); });
  EXPECT_NEAR(tips_.last().pose.position.y, 0.020, 1e-9);
  await([this] {
    const auto& p = command_.last().pressure;
    return *std::max_element(p.begin(), p.end()) > 2e4;
  });
  awaitSaid("goal", "tip target");
}

TEST_F(Cockpit, TheEmergencyStopLatchesUntilItIsReleased) {
  enable();
  click("stop");
  await([this] { return safety_.last().stopped; });
  await([this] { return find<QPushButton>("stop")->isChecked(); });
  EXPECT_EQ(safety_.last().cause, "emergency_stop");
  await([this] { return state() == SafetyState::VENTED; });
  awaitText("state", "STOPPED (VENTED)");
  click("stop");  // a second click does not release it
  awaitSaid("answer", "Emergency stop");
  pass(0.5);
  EXPECT_TRUE(safety_.last().stopped);
  EXPECT_TRUE(find<QPushButton>("stop")->isChecked());
  EXPECT_FALSE(isOffered("enable"));
  EXPECT_NE(tip("enable").find("release it first"), std::string::npos);
  click("release");
  await([this] { return !safety_.last().stopped; });
  await([this] { return !find<QPushButton>("stop")->isChecked(); });
  enable();
}

// What a hand is trained to hit stays where it is, whatever the texts above and below say.
TEST_F(Cockpit, NoButtonMovesWithTheText) {
  const auto places = [this] {
    std::vector<QPoint> out;
    for (const char* name : {"stop", "release", "enable", "vent", "hold", "slider_0", "slider_2"}) {
      QWidget* const widget = find<QWidget>(name);
      out.push_back(widget->mapTo(panel_.get(), widget->rect().center()));
    }
    return out;
  };
  awaitText("limits_0", "0 to 413.7");
  std::vector<QPoint> at_first;
  await([&] { return std::exchange(at_first, places()) == at_first; });
  enable();
  EXPECT_EQ(places(), at_first) << "enabled";
  while (find<QSlider>("slider_0")->value() < 500) click("slider_0", 0.9);
  await([this] { return text("goal").find("holds the pressures") == 9; });
  EXPECT_EQ(places(), at_first) << "held";
  click("stop");
  awaitText("state", "STOPPED (VENTED)");
  EXPECT_EQ(places(), at_first) << "stopped";
  click("release");
  awaitText("state", "VENTED");
  EXPECT_EQ(places(), at_first) << "vented";
  pressure_.reset();
  awaitText("state", "NO CONNECTION");
  EXPECT_TRUE(says("cause", "/left/pressure_command"));
  panel_->resize(360, 1100);
  click("stop");
  awaitSaid("answer", "by hand");
  EXPECT_FALSE(says("answer", "refused")) << text("answer");
  EXPECT_EQ(find<QLabel>("answer")->window()->width(), 360);
  expectPaintedWhole("answer");
  EXPECT_TRUE(painted("answer").startsWith(QString("Emergency stop: ") + ros_bridge::kStopByHand));
  panel_->resize(kWindow);
  await([&] { return places() == at_first; });  // without the arm
  EXPECT_EQ(find<QLabel>("cause")->toolTip(), find<QLabel>("cause")->text());
}

TEST_F(Cockpit, ARefusedNamespaceKeepsTheArmAndItsStop) {
  enable();
  auto* const field = find<QLineEdit>("namespace");
  enter("a b!/x");
  ASSERT_EQ(text("answer").find("Namespace: refused"), 0U) << text("answer");
  EXPECT_TRUE(says("answer", "stays with the arm of /left")) << text("answer");
  EXPECT_EQ(field->text(), kArm);
  EXPECT_EQ(text("state"), "ENABLED");
  click("stop");
  await([this] { return safety_.last().stopped; });
  awaitSaid("answer", "Emergency stop");
  enter("a b!/x");
  ASSERT_EQ(text("answer").find("Namespace: refused"), 0U);
  enter("right");
  EXPECT_EQ(text("answer"), "") << "it is a name";
  enter(kArm);
  awaitText("state", "STOPPED (VENTED)");
}

// The button that a hand hits in an emergency commands the arm whose name it bears, whatever stands
// in the field.
TEST_F(Cockpit, TheStopGoesToTheArmThatItNamesWhileAnotherNameIsTyped) {
  enable();
  EXPECT_EQ(named(), "/left");
  EXPECT_FALSE(isMarked());
  EXPECT_FALSE(isOffered("connect"));
  type("righ");
  EXPECT_TRUE(isMarked());
  EXPECT_NE(tip("namespace").find("The buttons are those of /left"), std::string::npos);
  EXPECT_EQ(named(), "/left");
  click("stop");
  await([this] { return safety_.last().stopped; });
  EXPECT_EQ(named(), "/left");
  EXPECT_TRUE(isMarked()) << "a click elsewhere connects to no half-typed name";
  click("release");
  await([this] { return !safety_.last().stopped; });
  enable();

  type("right");
  ASSERT_TRUE(isOffered("connect"));
  click("connect");
  await([this] { return named() == "/right"; });
  await([this] { return !isMarked(); });
  click("stop");
  await([this] { return !text("answer").empty(); });
  EXPECT_TRUE(says("answer", "/right/pressure_command/emergency_stop")) << text("answer");
  EXPECT_FALSE(safety_.last().stopped);
}

TEST_F(Cockpit, ALongNameWidensNothingAndKeepsItsEnds) {
  panel_->resize(360, 1100);
  const int least = panel_->minimumSizeHint().width();
  enter("laboratory_of_soft_robots/second_floor/bench_17/left_arm");
  await([this] { return named().find("/labo") == 0; });
  EXPECT_EQ(panel_->minimumSizeHint().width(), least);
  const std::string name = find<QPushButton>("stop")->text().section('\n', 1).toStdString();
  EXPECT_EQ(name.substr(name.size() - 3), "arm") << name;
  EXPECT_NE(tip("stop").find("/bench_17/"), std::string::npos) << tip("stop");
}

TEST_F(Cockpit, TheNamespaceIsKeptInTheConfiguration) {
  rviz::Config config;
  panel_->save(config);
  QString ns;
  ASSERT_TRUE(config.mapGetString("Namespace", &ns));
  EXPECT_EQ(ns, kArm);
  EXPECT_EQ(find<QLineEdit>("namespace")->text(), kArm);
  show("nowhere", kWindow);
  awaitSaid("cause", "/nowhere/");
  show("no name, this", kWindow);
  awaitSaid("answer", "Namespace");
  EXPECT_EQ(find<QLineEdit>("namespace")->text(), "no name, this");
  EXPECT_TRUE(isMarked());
  EXPECT_EQ(named(), "no arm");
  panel_->save(config);
  ASSERT_TRUE(config.mapGetString("Namespace", &ns));
  EXPECT_EQ(ns, "no name, this") << "rviz does not turn it into that of another arm";
  // Of an arm that the panel does not have.
  click("stop");
  awaitSaid("answer", "Emergency stop");
  EXPECT_TRUE(says("answer", "by hand")) << text("answer");
  // Another bad name stays to be corrected, and the default arm is within reach.
  enter("nor! this");
  EXPECT_EQ(text("answer").find("Namespace: refused"), 0U) << text("answer");
  EXPECT_EQ(find<QLineEdit>("namespace")->text(), "nor! this");
  enter("");
  await([this] { return named() == "/ (no namespace)"; });
  awaitSaid("cause", " /pressure_command");
  EXPECT_FALSE(isMarked());
  panel_->save(config);
  ASSERT_TRUE(config.mapGetString("Namespace", &ns));
  EXPECT_EQ(ns, "");
}

// An arm with all its nodes. Its calibration takes short looks and steep ramps.
class CockpitCalibration : public Cockpit {
 protected:
  void startArm() override {
    const std::string folder = "_scene_folder:=" + folder_.path();
    rig_ = start(HELIX_ARM_SIMULATED_RIG, {"_frame_prefix:=left_", "_camera_rate:=10"});
    pressure_ = start(HELIX_ARM_PRESSURE_COMMAND,
                      {"_regulator:=topic", "_auto_enable:=false", "_frame_prefix:=left_",
                       "_handle:=false", folder, "tip_target:=pressure_command/tip_target",
                       "shape_target:=pressure_command/shape_target"});
    loop_ = start(HELIX_ARM_VISUAL_SERVO, {"_frame_prefix:=left_", folder});
    vision_ = start(HELIX_ARM_VISION, {"_frame_prefix:=left_", "_stale_after_s:=5", folder});
    calibration_ =
        start(HELIX_ARM_CALIBRATION,
              {"_ramp_kpa_s:=500", "_window_s:=0.3", "_pressure_tolerance_kpa:=6", "_max_age_s:=5",
               "_data_folder:=" + folder_.path(), "_out_folder:=" + folder_.path(), folder});
  }

  // Clicks Start until the node has seen enough to begin.
  void begin() {
    enable();
    awaitOffer("calibration_start");
    await([this] {
      if (isOffered("calibration_start")) click("calibration_start");
      return until([this] { return text("calibration").find("step ") == 0; }, 1);
    });
    EXPECT_TRUE(find<QProgressBar>("calibration_progress")->isVisible());
  }

  bool rests() {
    return until([this] {
      const auto& p = command_.last().pressure;
      return state() == SafetyState::DISABLED && *std::max_element(p.begin(), p.end()) == 0;
    });
  }

  const TemporaryFolder folder_;
  std::unique_ptr<Process> loop_, vision_, calibration_;
  Inbox<PressureArray> readings_{node_, names::kPressureMeasured};
  Inbox<ModelError> errors_{node_, names::kModelError};
};

TEST_F(CockpitCalibration, CancelEndsTheRunAndTheArmIsVented) {
  EXPECT_FALSE(isOffered("calibration_cancel"));
  panel_->resize(kLaptop);
  begin();
  for (const char* name : {"calibration_start", "calibration_cancel", "calibration_progress",
                           "calibration", "strip_chart", "stop", "answer"}) {
    expectInSight(name);
  }
  // It tells where it is, and the arm moves.
  await([this] {
    return find<QProgressBar>("calibration_progress")->value() == 3 &&
           text("calibration").find("step 3 of 12, 2 samples") == 0;
  });
  EXPECT_EQ(find<QProgressBar>("calibration_progress")->maximum(), 12);
  await([this] {
    const auto& p = readings_.last().pressure;
    return *std::max_element(p.begin(), p.end()) > 5e4;
  });
  for (const char* name : {"slider_0", "tip_go", "hold", "calibration_start", "calibration_use"}) {
    EXPECT_FALSE(isOffered(name)) << name;
    EXPECT_NE(tip(name).find("calibration"), std::string::npos) << name << ": " << tip(name);
  }
  ASSERT_TRUE(isOffered("calibration_cancel"));
  click("calibration_cancel");
  awaitSaid("calibration", "cancelled");
  EXPECT_FALSE(find<QProgressBar>("calibration_progress")->isVisible());
  EXPECT_FALSE(isOffered("calibration_cancel"));
  EXPECT_FALSE(isOffered("calibration_use"));
  ASSERT_TRUE(rests()) << safety_.last().reason;
  EXPECT_EQ(safety_.last().cause, "none") << safety_.last().reason;
  // Readings have a noise of 5 kPa.
  await([this] {
    const auto& p = readings_.last().pressure;
    return *std::max_element(p.begin(), p.end()) < 2e4;
  });
  // It can begin again.
  begin();
  EXPECT_EQ(text("calibration").find("step 1 of 12, 0 samples"), 0U) << text("calibration");
}

TEST_F(CockpitCalibration, AnExperimentTellsItsProgressAndStopsAtAClick) {
  if (!isFullSize()) GTEST_SKIP() << kFullSizeOnly;
  EXPECT_NE(tip("experiment_start").find("no experiment node"), std::string::npos);
  const auto experiment = start(
      HELIX_ARM_EXPERIMENT, {"_out_folder:=" + folder_.path(), "_scene_folder:=" + folder_.path()});
  enable();
  awaitOffer("experiment_start");
  await([this] {
    if (isOffered("experiment_start")) click("experiment_start");
    return until([this] { return says("experiment", " left"); }, 2);
  });
  EXPECT_EQ(text("experiment").find("step muscle_1, "), 0U) << text("experiment");
  for (const char* name : {"slider_0", "calibration_start", "experiment_start"}) {
    EXPECT_NE(tip(name).find("an experiment"), std::string::npos) << name << ": " << tip(name);
  }
  await([this] { return find<QProgressBar>("experiment_progress")->value() > 1; });
  click("experiment_stop");
  awaitSaid("experiment", "stopped: muscle_1: cancelled; what was recorded is in ");
  EXPECT_TRUE(says("experiment", folder_.path().c_str())) << text("experiment");
  await([this] { return state() == SafetyState::VENTED; });
  EXPECT_FALSE(isOffered("experiment_stop"));
}

TEST_F(CockpitCalibration, TheResultIsUsedByAllNodesAtAClick) {
  find<QComboBox>("fit")->setCurrentText("stiffness length_scale");
  begin();
  EXPECT_FALSE(find<QComboBox>("fit")->isEnabled());
  await([this] { return text("calibration").find("tip error") == 0; }, 90);
  const std::string result = text("calibration");
  double before = 0, after = 0;
  ASSERT_EQ(std::sscanf(result.c_str(), "tip error %lf mm before, %lf mm after", &before, &after),
            2)
      << result;
  EXPECT_GT(before, 5) << result;
  EXPECT_LT(after, 0.5 * before) << result;
  EXPECT_NE(result.find("\nlength_scale 1 -> 1.0"), std::string::npos) << result;
  EXPECT_NE(result.find("\nK_gamma 100 -> "), std::string::npos) << result;
  panel_->resize(kLaptop);
  await([this] { return panel_->size() == kLaptop; });
  for (const char* name : {"calibration", "calibration_use", "strip_chart"}) expectInSight(name);
  ASSERT_TRUE(rests()) << safety_.last().reason;
  await([this] { return !errors_.all().empty(); });
  const double error_before = errors_.last().tip_error;

  ASSERT_TRUE(isOffered("calibration_use")) << tip("calibration_use");
  click("calibration_use");
  awaitSaid("answer", "Use it: ");
  const std::string answer = text("answer");
  const std::size_t cut =
      answer.find(" is used by visual_servo, pressure_command, vision, calibration");
  ASSERT_NE(cut, std::string::npos) << answer;
  const std::string path = answer.substr(std::string("Use it: ").size(), cut - 8);
  EXPECT_EQ(path.find(folder_.path() + "/calibrated_"), 0U) << path;

  // The model is nearer to what the camera sees.
  EXPECT_GT(error_before, 2e-3);
  EXPECT_TRUE(until([&] { return errors_.last().tip_error < 0.5 * error_before; }))
      << errors_.last().tip_error << " m, before " << error_before << " m";
}

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) {
  // Its own X server: the test neither needs a screen nor disturbs one.
  // What it says of displays that others have is not its answer.
  helix_arm::test::Process server(
      {"sh", "-c", "exec Xvfb -displayfd 1 -screen 0 1280x1200x24 -nolisten tcp 2>/dev/null"});
  if (!server.prints("\n")) return 2;
  const std::string display = ":" + server.output().substr(0, server.output().find('\n'));
  setenv("DISPLAY", display.c_str(), 1);
  unsetenv("QT_QPA_PLATFORM");
  QApplication application(argc, argv);
  return helix_arm::test::runRostest(argc, argv);
}
