// The panel while its ROS master is gone or hangs: the window goes on, and the words tell it.
#include <QApplication>
#include <QLabel>
#include <QLineEdit>
#include <QPushButton>
#include <QtTest/QTest>
#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <functional>
#include <memory>
#include <string>

#include <gtest/gtest.h>
#include <pluginlib/class_loader.hpp>
#include <ros/ros.h>
#include <rviz/config.h>
#include <rviz/panel.h>

#include "support/process.hpp"

namespace helix_arm::test {
namespace {

constexpr double kMostStill = 1.5;  // less than MasterWatch::kPatience [s]

class CockpitMaster : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const auto& [name, value] : master_.variables()) setenv(name.c_str(), value.c_str(), 1);
    int argc = 0;
    ros::init(argc, nullptr, "cockpit_master_test", ros::init_options::NoSigintHandler);
    ros::start();
  }

  void show(const char* ns) {
    panel_.reset(loader_.createUnmanagedInstance("helix_arm/Cockpit"));
    panel_->initialize(nullptr);
    rviz::Config config;
    config.mapSetValue("Namespace", ns);
    panel_->load(config);
    panel_->show();
  }
  template <class Widget>
  Widget* find(const char* name) {
    auto* const found = panel_->findChild<Widget*>(name);
    if (found == nullptr) throw std::runtime_error(std::string("no widget ") + name);
    return found;
  }
  bool says(const char* label, const char* words) {
    return find<QLabel>(label)->text().contains(words);
  }
  std::string named() { return find<QPushButton>("stop")->text().section('\n', 1).toStdString(); }
  void enter(const char* ns) {
    auto* const field = find<QLineEdit>("namespace");
    field->selectAll();
    QTest::keyClicks(field, ns);
    QTest::keyClick(field, Qt::Key_Return);
  }

  // Runs an action, then the window until the condition holds. @return the longest time for which
  // the window stood still, 1000 if the condition did not come to hold [s].
  static double stillness(const std::function<void()>& action,
                          const std::function<bool()>& condition) {
    const double begin = ros::SteadyTime::now().toSec();
    double longest = 0, last = begin;
    action();
    for (bool holds = false; !holds;) {
      QApplication::processEvents(QEventLoop::AllEvents, 10);
      holds = condition();
      const double now = ros::SteadyTime::now().toSec();
      longest = std::max(longest, now - last);
      last = now;
      if (now - begin > 40) return 1000;
    }
    return longest;
  }

  Master master_;
  pluginlib::ClassLoader<rviz::Panel> loader_{"rviz", "rviz::Panel"};
  std::unique_ptr<rviz::Panel> panel_;
};

TEST_F(CockpitMaster, NeitherItsEndNorItsSilenceStopsTheWindow) {
  const auto nothing = [] {};
  // Another user of the node, as the displays of rviz are.
  const ros::NodeHandle node;
  EXPECT_LT(stillness([this] { show("left"); }, [this] { return named() == "/left"; }), 5);

  master_.stop();
  const auto told = [this] { return says("answer", "does not answer"); };
  EXPECT_LT(stillness([this] { enter("right"); }, told), kMostStill) << "gone";
  EXPECT_TRUE(says("answer", "stays with the arm of /left"));
  EXPECT_EQ(named(), "/left");
  EXPECT_FALSE(find<QLineEdit>("namespace")->styleSheet().isEmpty());
  EXPECT_LT(stillness([this] { find<QPushButton>("stop")->click(); },
                      [this] { return says("answer", "relief valve by hand"); }),
            kMostStill);

  // One that starts without a master has no arm, and says why.
  EXPECT_LT(stillness([this] { show("left"); },
                      [this] { return says("cause", "the ROS master at http://"); }),
            kMostStill);
  EXPECT_EQ(named(), "no arm");
  find<QPushButton>("stop")->click();
  EXPECT_TRUE(says("answer", "relief valve by hand"));

  master_.start();
  EXPECT_LT(stillness(nothing, [this] { return named() == "/left"; }), kMostStill) << "back";

  master_.signal(SIGSTOP);
  EXPECT_LT(stillness([this] { enter("right"); }, told), kMostStill) << "hangs";
  EXPECT_EQ(named(), "/left");
  master_.signal(SIGCONT);
  EXPECT_LT(stillness(nothing, [this] { return named() == "/right"; }), kMostStill) << "awake";
}

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) {
  QApplication application(argc, argv);
  ::testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
