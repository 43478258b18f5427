#pragma once

#include <QGroupBox>
#include <array>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "ros_bridge/cockpit/cockpit_view.hpp"

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
