#pragma once

#include <QElapsedTimer>
#include <QGroupBox>
#include <functional>
#include <string>

#include "ros_bridge/cockpit/call_desk.hpp"
#include "ros_bridge/cockpit/cockpit_view.hpp"

class QLabel;
class QPushButton;

namespace helix_arm::rviz_panel {

/// Emergency stop, Enable, Vent and Hold; below them state, cause and remedy. Title and stop name
/// the arm that they command. Texts have a fixed
/// height: a button stays where it is, whatever they say.
class SafetyBox : public QGroupBox {
 public:
  struct Actions {
    std::function<void()> enable, vent;
    std::function<void(bool engage)> stop;
    std::function<void(bool on)> hold;
  };

  SafetyBox(QWidget* parent, Actions actions);

  void display(const ros_bridge::CockpitView& view);
  /// Answer of a service. A failure stays until the arm's state changes, a success for seconds.
  void display(const ros_bridge::CallAnswer& answer);
  /// Removes the answer: it is that of another arm.
  void forgetAnswer();

  /// Without the title, whose name is elided to the width that there is.
  QSize minimumSizeHint() const override;

 protected:
  void resizeEvent(QResizeEvent* event) override;

 private:
  void nameArm();
  QPushButton* addButton(const char* name, const char* text);

  const Actions actions_;
  QLabel *state_, *cause_, *remedy_, *goal_, *answer_;
  QPushButton *stop_, *release_, *enable_, *vent_, *hold_;
  std::string arm_;
  QElapsedTimer answered_;
  bool answered_well_ = false;
  std::string answered_in_;  ///< state of the arm at the answer
};

}  // namespace helix_arm::rviz_panel
