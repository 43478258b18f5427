// The panel while its ROS master is gone or hangs: the window goes on, and the words tell it.
#include <QLineEdit>
#include <QtTest/QTest>
#include <csignal>
#include <cstdlib>

#include <ros/ros.h>

#include "panel_window.hpp"
#include "support/process.hpp"

namespace helix_arm::test {
namespace {

class CockpitMaster : public PanelWindow {
 protected:
  void SetUp() override {
    for (const auto& [name, value] : master_.variables()) setenv(name.c_str(), value.c_str(), 1);
    int argc = 0;
    ros::init(argc, nullptr, "cockpit_master_test", ros::init_options::NoSigintHandler);
    ros::start();
  }
  void TearDown() override { panel_.reset(); }  // while there is a master

  void enter(const char* ns) {
    auto* const field = find<QLineEdit>("namespace");
    field->selectAll();
    QTest::keyClicks(field, ns);
    QTest::keyClick(field, Qt::Key_Return);
  }

  Master master_;
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
