#pragma once

#include <QGroupBox>
#include <array>
#include <functional>

#include "ros_bridge/cockpit/cockpit_view.hpp"

class QDoubleSpinBox;
class QLabel;
class QPushButton;

namespace helix_arm::rviz_panel {

/// The tip target as numbers, the tip itself, and the loop over vision.
class TipBox : public QGroupBox {
 public:
  /// Aims the tip at a position, base frame [m].
  using Aim = std::function<void(const std::array<double, 3>& position)>;

  TipBox(QWidget* parent, Aim aim);

  void display(const ros_bridge::CockpitView& view);

 private:
  void copyPresent();

  const Aim aim_;
  std::array<QDoubleSpinBox*, 3> numbers_{};  ///< [mm]
  QPushButton *go_, *present_;
  QLabel *tip_, *loop_, *why_not_;
  std::optional<std::vector<double>> present_tip_;  ///< [m]
  bool filled_ = false;                             ///< the numbers have begun at the arm's tip
};

}  // namespace helix_arm::rviz_panel
