// The panel of rviz, loaded as rviz loads it, under real clicks.
#include <QLineEdit>
#include <QSlider>
#include <QTabBar>
#include <QTabWidget>
#include <QtTest/QTest>
#include <fstream>

#include "helix_arm/SafetyState.h"
#include "panel_window.hpp"
#include "support/process.hpp"
#include "support/ros_rig.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

constexpr char kArm[] = "left";

constexpr QSize kWindow(460, 1100);

double seconds() { return ros::SteadyTime::now().toSec(); }

// The shipped scene demo, whose readings may be late for longer: the machine is busy.
std::string patientDemo(const std::string& folder) {
  std::string text = contentOf(HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml");
  const std::string key = "reading_timeout_s: ", usual = "0.5";
  text.replace(text.find(key + usual) + key.size(), usual.size(), "10");
  std::ofstream(folder + "/demo.yaml") << text;
  return folder + "/demo.yaml";
}

class Cockpit : public PanelWindow {
 protected:
  void SetUp() override {
    startArm();
    show(kArm, kWindow);
    await([this] { return panel_->isVisible(); });
    await([this] { return !safety_.all().empty() && !command_.all().empty(); });
    await([this] { return !says("state", "NO "); });
  }

  std::unique_ptr<Process> start(const std::string& program,
                                 std::vector<std::string> arguments = {}) const {
    arguments.insert(arguments.begin(),
                     {program, "_scene:=" + scene_, std::string("__ns:=/") + kArm});
    return std::make_unique<Process>(arguments);
  }

  void startArm() {
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

  const TemporaryFolder folder_;
  const std::string scene_ = patientDemo(folder_.path());
  std::unique_ptr<Process> rig_, pressure_;
  ros::NodeHandle node_{kArm};
  Inbox<SafetyState> safety_{node_, names::kSafetyState};
  Inbox<PressureArray> command_{node_, names::kPressureCommand};
};

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
