#pragma once

#include <QApplication>
#include <QGroupBox>
#include <QLabel>
#include <QPushButton>
#include <algorithm>
#include <chrono>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

#include <gtest/gtest.h>
#include <pluginlib/class_loader.hpp>
#include <ros/ros.h>
#include <rviz/config.h>
#include <rviz/panel.h>

#include "support/has.hpp"

namespace helix_arm::test {

/// A panel that is made as rviz makes it, by pluginlib and with its configuration; the test runs
/// its window.
class PanelWindow : public ::testing::Test {
 protected:
  /// Less than what a master or a service gets to answer [s].
  static constexpr double kMostStill = 1.5;

  void show(const char* ns, const QSize& size = {}) {
    panel_.reset(loader_.createUnmanagedInstance("helix_arm/Cockpit"));
    panel_->initialize(nullptr);
    rviz::Config config;
    config.mapSetValue("Namespace", ns);
    panel_->load(config);
    if (size.isValid()) panel_->setGeometry({{0, 0}, size});
    panel_->show();
  }

  template <class Widget>
  Widget* find(const char* name) {
    auto* const found = panel_->findChild<Widget*>(name);
    if (found == nullptr) throw std::runtime_error(std::string("no widget ") + name);
    return found;
  }
  std::string text(const char* label) { return find<QLabel>(label)->text().toStdString(); }
  bool says(const char* label, const char* words) {
    return text(label).find(words) != std::string::npos;
  }
  bool isOffered(const char* name) { return find<QWidget>(name)->isEnabled(); }
  std::string tip(const char* name) { return find<QWidget>(name)->toolTip().toStdString(); }
  /// The arm that the stop and the title of its box name; both are the same.
  std::string named() {
    auto* const stop = find<QPushButton>("stop");
    const QString arm = stop->text().section('\n', 1);
    const QString title = dynamic_cast<QGroupBox&>(*stop->parentWidget()).title();
    EXPECT_TRUE(title == "Arm: " + arm || arm.contains(QChar(0x2026))) << title.toStdString();
    return arm.toStdString();
  }

  /// Runs an action, then window and callbacks until the condition holds. @return the longest time
  /// for which the window stood still, 1000 if the condition did not come to hold [s].
  static double stillness(const std::function<void()>& action,
                          const std::function<bool()>& condition, double deadline = 40) {
    const double begin = ros::SteadyTime::now().toSec();
    double longest = 0, last = begin;
    action();
    for (bool holds = false; !holds;) {
      QApplication::processEvents(QEventLoop::AllEvents, 10);
      ros::spinOnce();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));  // not all of a core
      holds = condition();
      const double now = ros::SteadyTime::now().toSec();
      longest = std::max(longest, now - last);
      last = now;
      if (!holds && now - begin > deadline) return 1000;
    }
    return longest;
  }
  static bool until(const std::function<bool()>& condition, double deadline = 40) {
    return stillness([] {}, condition, deadline) < 1000;
  }

  /// The same. @throws std::runtime_error with all words of the panel if it does not come to hold.
  void await(const std::function<bool()>& condition, double deadline = 40) {
    if (until(condition, deadline)) return;
    std::string words = "what was waited for did not come";
    for (const auto* const label : panel_->findChildren<QLabel*>()) {
      words += "\n" + (label->objectName() + ": " + label->text()).toStdString();
    }
    throw std::runtime_error(words);
  }
  void awaitSaid(const char* label, const char* words) {
    await([=] { return says(label, words); });
  }
  void awaitText(const char* label, const char* words) {
    await([=] { return text(label) == words; });
  }
  void awaitOffer(const char* name) {
    await([=] { return isOffered(name); });
  }

  pluginlib::ClassLoader<rviz::Panel> loader_{"rviz", "rviz::Panel"};
  std::unique_ptr<rviz::Panel> panel_;
};

}  // namespace helix_arm::test
