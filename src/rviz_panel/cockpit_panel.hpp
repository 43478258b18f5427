#pragma once

#include <QSize>
#include <memory>
#include <string>

#include <rviz/panel.h>

#include "helix_arm/ros_bridge/cockpit/cockpit_link.hpp"

class QLineEdit;
class QTimer;

namespace helix_arm::rviz_panel {

class CalibrationBox;
class PressureBox;
class SafetyBox;
class StripChart;
class TipBox;

/// The cockpit of one arm as a panel of rviz. Its namespace is saved in the configuration of rviz.
///
/// The thread of the window only reads CockpitLink::view() and asks for calls; none of it blocks.
class CockpitPanel : public rviz::Panel {
 public:
  explicit CockpitPanel(QWidget* parent = nullptr);
  ~CockpitPanel() override;

  void onInitialize() override;
  void load(const rviz::Config& config) override;
  void save(rviz::Config config) const override;

 private:
  /// Begins anew with the arm of this namespace. If it is no name, the answer says so, and the arm
  /// stays: its emergency stop must go on working. @return whether it is a name.
  bool connectTo(const QString& ns);
  void refresh();
  void stop(bool engage);
  /// Turns a view that looks at arm_base to the base of this arm, whose frame may have a prefix,
  /// and places one that looks exactly at the base so that it shows all of the arm from its side.
  void lookAt(const ros_bridge::CockpitView& view);
  /// Runs an action of the link, if there is one.
  template <class Action>
  void with(const Action& action);

  QLineEdit* namespace_;
  SafetyBox* safety_;
  PressureBox* pressures_;
  TipBox* tip_;
  CalibrationBox* calibration_;
  StripChart* chart_;
  QTimer* timer_;
  std::string connected_to_;
  QSize window_;    ///< of the 3D view
  int steady_ = 0;  ///< refreshes since it has this size
  std::unique_ptr<ros_bridge::CockpitLink> link_;
};

}  // namespace helix_arm::rviz_panel
