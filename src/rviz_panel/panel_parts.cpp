#include "panel_parts.hpp"

#include <array>

namespace helix_arm::rviz_panel {

using ros_bridge::Tone;

// Legible on the light and on the dark themes of Qt.
QColor colorOf(Tone tone) {
  switch (tone) {
    case Tone::kGood:
      return {30, 140, 60};
    case Tone::kCaution:
      return {200, 120, 0};
    case Tone::kBad:
      return {205, 40, 35};
    case Tone::kQuiet:
      break;
  }
  return {110, 110, 115};
}

QColor colorOfChannel(int channel) {
  static const std::array<QColor, 6> kColors = {QColor(0, 105, 110),   QColor(135, 75, 55),
                                                QColor(60, 60, 65),    QColor(125, 125, 0),
                                                QColor(195, 150, 105), QColor(95, 130, 140)};
  return kColors[static_cast<std::size_t>(channel) % kColors.size()];
}

QLabel* makeText(QWidget* parent, const char* name) {
  auto* const label = new QLabel(parent);
  label->setObjectName(name);
  label->setTextFormat(Qt::PlainText);
  label->setWordWrap(true);
  label->setTextInteractionFlags(Qt::TextSelectableByMouse);
  return label;
}

void showWords(QLabel* label, const std::string& text, Tone tone) {
  const QString shown = QString::fromStdString(text);
  if (label->text() != shown) {
    label->setText(shown);
    if (dynamic_cast<FixedText*>(label) != nullptr) label->setToolTip(shown);
  }
  label->setVisible(!shown.isEmpty());
  const QString style = "color: " + colorOf(tone).name() + ";";
  if (label->styleSheet() != style) label->setStyleSheet(style);
}

void offer(QWidget* widget, const ros_bridge::Possibility& possibility, const char* what) {
  widget->setEnabled(possibility.possible());
  const QString tip =
      possibility.possible() ? QString(what) : QString::fromStdString(possibility.why_not);
  if (widget->toolTip() != tip) widget->setToolTip(tip);
}

}  // namespace helix_arm::rviz_panel
