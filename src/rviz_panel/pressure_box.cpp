#include "pressure_box.hpp"

#include <QDoubleSpinBox>
#include <QGridLayout>
#include <QLabel>
#include <QSignalBlocker>
#include <QSlider>
#include <cmath>
#include <utility>

#include "panel_parts.hpp"

namespace helix_arm::rviz_panel {
namespace {

using namespace ros_bridge;

constexpr double kStep = 100;  // of a slider [Pa]
constexpr double kKilo = 1e3;  // Pa per kPa

// The widest scale inside the limits: the end of a slider is never refused.
int lowestStep(const CockpitChannel& channel) {
  return static_cast<int>(std::ceil(channel.lower / kStep - 1e-6));
}
int highestStep(const CockpitChannel& channel) {
  return static_cast<int>(std::floor(channel.upper / kStep + 1e-6));
}

}  // namespace

PressureBox::PressureBox(QWidget* parent, Set set)
    : QGroupBox("Pressures [kPa gauge]", parent), set_(std::move(set)) {
  grid_ = new QGridLayout(this);
  grid_->setColumnStretch(1, 1);
  why_not_ = new FixedText(this, "pressures_why_not", 1);
  grid_->addWidget(why_not_, 0, 0, 1, kColumns);
}

std::array<QWidget*, PressureBox::kColumns> PressureBox::Row::parts() const {
  return {label, slider, limits, value, reading};
}

PressureBox::Row PressureBox::makeRow(int index, const std::string& name) {
  const std::string number = std::to_string(index);
  Row row{name,
          makeText(this, ("name_" + number).c_str()),
          new QSlider(Qt::Horizontal, this),
          new QDoubleSpinBox(this),
          makeText(this, ("limits_" + number).c_str()),
          makeText(this, ("reading_" + number).c_str())};
  row.label->setText(QString::fromStdString(name));
  row.label->setStyleSheet("color: " + colorOfChannel(index).name() + "; font-weight: bold;");
  row.label->setWordWrap(false);
  row.limits->setWordWrap(false);
  row.reading->setWordWrap(false);
  // Of a fixed width, so that a slider keeps its own.
  row.reading->setMinimumWidth(row.reading->fontMetrics().horizontalAdvance("-9999.9 kPa"));
  row.slider->setObjectName(("slider_" + number).c_str());
  row.value->setObjectName(("value_" + number).c_str());
  row.value->setDecimals(1);
  row.value->setSingleStep(5);
  row.value->setKeyboardTracking(false);      // half a number is no command
  row.value->setFocusPolicy(Qt::ClickFocus);  // the wheel scrolls past it
  row.slider->setFocusPolicy(Qt::ClickFocus);
  const auto channel = static_cast<std::size_t>(index);
  connect(row.slider, &QSlider::valueChanged, this,
          [this, channel](int steps) { set_(channel, kStep * steps); });
  connect(row.value, QOverload<double>::of(&QDoubleSpinBox::valueChanged), this,
          [this, channel](double kilopascal) { set_(channel, kKilo * kilopascal); });
  int column = 0;
  for (QWidget* part : row.parts()) grid_->addWidget(part, index + 1, column++);
  return row;
}

void PressureBox::makeRows(const CockpitView& view) {
  bool same = rows_.size() == view.channels.size();
  for (std::size_t i = 0; same && i < rows_.size(); ++i) {
    same = rows_[i].name == view.channels[i].name;
  }
  if (same) return;
  for (const Row& row : rows_) {
    for (QWidget* part : row.parts()) part->deleteLater();
  }
  rows_.clear();
  for (const CockpitChannel& channel : view.channels) {
    rows_.push_back(makeRow(static_cast<int>(rows_.size()), channel.name));
  }
}

void PressureBox::display(const CockpitView& view) {
  makeRows(view);
  std::string why_not;
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const Row& row = rows_[i];
    const CockpitChannel& channel = view.channels[i];
    const Possibility may = maySetPressure(view, channel);
    if (why_not.empty()) why_not = may.why_not;
    const std::string limits =
        "from " + kilopascals(channel.lower) + " to " + kilopascals(channel.upper);
    offer(row.slider, may, limits.c_str());
    offer(row.value, may, limits.c_str());
    showWords(row.limits, limitWords(channel), Tone::kQuiet);
    showWords(row.reading, kilopascals(channel.measured), Tone::kQuiet);
    if (!(channel.lower < channel.upper)) continue;
    const QSignalBlocker quiet_slider(row.slider), quiet_value(row.value);
    row.slider->setRange(lowestStep(channel), highestStep(channel));
    row.value->setRange(kStep * lowestStep(channel) / kKilo, kStep * highestStep(channel) / kKilo);
    // They follow the arm where the cockpit does not command it, and nobody is at them.
    const bool follows = view.goal != CockpitGoal::kPressures && !row.value->hasFocus();
    if (std::isfinite(channel.command) && follows && !row.slider->isSliderDown()) {
      row.slider->setValue(static_cast<int>(std::lround(channel.command / kStep)));
      row.value->setValue(channel.command / kKilo);
    } else if (view.goal == CockpitGoal::kPressures && i < view.held.size()) {
      if (!row.slider->isSliderDown()) {
        row.slider->setValue(static_cast<int>(std::lround(view.held[i] / kStep)));
      }
      if (!row.value->hasFocus()) row.value->setValue(view.held[i] / kKilo);
    }
  }
  if (rows_.empty()) why_not = "no pressure_command has come yet";
  showWords(why_not_, why_not, Tone::kCaution);
}

}  // namespace helix_arm::rviz_panel
