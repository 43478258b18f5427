#pragma once

#include <QSize>
#include <memory>
#include <optional>
#include <string>

#include <rviz/panel.h>

#include "ros_bridge/cockpit/cockpit_link.hpp"

class QLineEdit;
class QPushButton;
class QTimer;

namespace helix_arm::rviz_panel {

class CalibrationBox;
class PressureBox;
class SafetyBox;
class StripChart;
class TipBox;

/// The cockpit of one arm as a panel of rviz. Its namespace is saved in the configuration of rviz.
///
/// The thread of the window only reads CockpitLink::view() and asks for calls and links; none of it
/// blocks. Until the link to another arm is there, the buttons are those of the arm before; title
/// and stop name it.
class CockpitPanel : public rviz::Panel {
 public:
  explicit CockpitPanel(QWidget* parent = nullptr);
  ~CockpitPanel() override;

  void onInitialize() override;
  void load(const rviz::Config& config) override;
  void save(rviz::Config config) const override;

 private:
  /// Begins to connect to the arm of this namespace. If it is no name, the answer says so, and the
  /// arm stays: its emergency stop must go on working. @return whether it is a name.
  bool connectTo(const QString& ns);
  /// Connects to the name in the field, unless that is the one already. What is no name gives way
  /// to the one before, if there is one.
  void commit();
  /// The name in the field.
  std::string typed() const;
  /// Shows whether the panel is connected to the name in the field.
  void markNamespace(const ros_bridge::CockpitView& view);
  void tellNamespace(const std::string& fault, bool refused);
  /// Begins anew with the arm to which a connection was made, if one was.
  void takeLink();
  ros_bridge::CockpitView view() const;
  void refresh();
  void stop(bool engage);
  /// Turns a view that looks at arm_base to the base of this arm, whose frame may have a prefix,
  /// and places one that looks exactly at the base so that it shows all of the arm from its side
  /// (ArmCamera).
  void lookAt(const ros_bridge::CockpitView& view);
  /// Runs an action of the link, if there is one.
  template <class Action>
  void with(const Action& action);

  QLineEdit* namespace_;
  QPushButton* connect_;
  SafetyBox* safety_;
  PressureBox* pressures_;
  TipBox* tip_;
  CalibrationBox* calibration_;
  StripChart* chart_;
  QTimer* timer_;
  std::optional<std::string> wanted_;  ///< last namespace that is a name, as it was typed
  bool told_of_master_ = false;        ///< that it does not answer
  QSize window_;                       ///< of the 3D view
  int steady_ = 0;                     ///< refreshes since it has this size
  ros_bridge::LinkBuilder builder_;
  std::unique_ptr<ros_bridge::CockpitLink> link_;
};

}  // namespace helix_arm::rviz_panel
