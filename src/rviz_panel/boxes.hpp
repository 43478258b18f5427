#pragma once

#include <QElapsedTimer>
#include <QGroupBox>
#include <array>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "ros_bridge/cockpit/cockpit_view.hpp"
#include "ros_bridge/cockpit/cockpit_words.hpp"

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

class QDoubleSpinBox;
class QGridLayout;
class QLabel;
class QSlider;
namespace helix_arm::rviz_panel {

/// One row per actuator: name, slider, its limits, number [kPa], reading.
class PressureBox : public QGroupBox {
 public:
  /// Commands one actuator, by its index [Pa].
  using Set = std::function<void(std::size_t channel, double pressure)>;

  PressureBox(QWidget* parent, Set set);

  void display(const ros_bridge::CockpitView& view);

 private:
  static constexpr int kColumns = 5;

  struct Row {
    std::string name;
    QLabel* label;
    QSlider* slider;        ///< [0.1 kPa]
    QDoubleSpinBox* value;  ///< [kPa]
    QLabel *limits, *reading;

    /// From left to right.
    std::array<QWidget*, kColumns> parts() const;
  };

  void makeRows(const ros_bridge::CockpitView& view);
  Row makeRow(int index, const std::string& name);

  const Set set_;
  QGridLayout* grid_;
  QLabel* why_not_;
  std::vector<Row> rows_;
};

}  // namespace helix_arm::rviz_panel

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
