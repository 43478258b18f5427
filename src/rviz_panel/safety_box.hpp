#pragma once

#include <QGroupBox>
#include <functional>

#include "helix_arm/ros_bridge/cockpit/call_desk.hpp"
#include "helix_arm/ros_bridge/cockpit/cockpit_view.hpp"

class QLabel;
class QPushButton;

namespace helix_arm::rviz_panel {

/// State, cause and remedy; emergency stop, Enable, Vent and Hold.
class SafetyBox : public QGroupBox {
 public:
  struct Actions {
    std::function<void()> enable, vent;
    std::function<void(bool engage)> stop;
    std::function<void(bool on)> hold;
  };

  SafetyBox(QWidget* parent, Actions actions);

  void display(const ros_bridge::CockpitView& view);
  /// Answer of a service.
  void display(const ros_bridge::CallAnswer& answer);

 private:
  QPushButton* addButton(const char* name, const char* text);

  const Actions actions_;
  QLabel *state_, *cause_, *remedy_, *goal_, *answer_, *why_not_;
  QPushButton *stop_, *release_, *enable_, *vent_, *hold_;
};

}  // namespace helix_arm::rviz_panel
