#pragma once

#include <QGroupBox>
#include <functional>
#include <string>
#include <vector>

#include "ros_bridge/cockpit/cockpit_view.hpp"

class QComboBox;
class QLabel;
class QProgressBar;
class QPushButton;

namespace helix_arm::rviz_panel {

/// Start, progress, end and result of a calibration.
class CalibrationBox : public QGroupBox {
 public:
  struct Actions {
    std::function<void(const std::vector<std::string>& fit)> start;
    std::function<void()> cancel, use;
  };

  CalibrationBox(QWidget* parent, Actions actions);

  void display(const ros_bridge::CockpitView& view);

 private:
  const Actions actions_;
  QComboBox* fit_;
  QPushButton *start_, *cancel_, *use_;
  QProgressBar* progress_;
  QLabel *text_, *warnings_;
};

}  // namespace helix_arm::rviz_panel
