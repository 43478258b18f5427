#pragma once

#include <QColor>
#include <QElapsedTimer>
#include <QEvent>
#include <QFontMetrics>
#include <QLabel>
#include <QPainter>
#include <QPolygonF>
#include <QTextLayout>
#include <array>
#include <cmath>

#include "ros_bridge/cockpit/cockpit_view.hpp"

/// Parts that the boxes of the cockpit share, and its strip chart.
namespace helix_arm::rviz_panel {

/// A label of a fixed number of lines, so that nothing below it moves with its text. What does not
/// fit is elided; the tooltip holds the whole text.
class FixedText : public QLabel {
 public:
  FixedText(QWidget* parent, const char* name, int lines) : QLabel(parent), lines_(lines) {
    setObjectName(name);
    setTextFormat(Qt::PlainText);
    QSizePolicy keeps(QSizePolicy::Ignored, QSizePolicy::Fixed);
    keeps.setRetainSizeWhenHidden(true);
    setSizePolicy(keeps);
    fixHeight();
  }

  /// The lines in which a text is painted: at most so many, the last one elided where it does not
  /// fit.
  static QStringList paintedLines(const QString& text, const QFont& font, int width, int most) {
    QStringList out;
    int start = 0;
    for (const QString& paragraph : text.split('\n')) {
      QTextLayout layout(paragraph, font);
      layout.setTextOption(QTextOption(Qt::AlignLeft));
      layout.beginLayout();
      for (QTextLine part = layout.createLine(); part.isValid(); part = layout.createLine()) {
        if (out.size() + 1 == most) {
          const QString rest = text.mid(start + part.textStart()).replace('\n', ' ');
          return out << QFontMetrics(font).elidedText(rest, Qt::ElideRight, width);
        }
        part.setLineWidth(width);
        out << paragraph.mid(part.textStart(), part.textLength());
      }
      layout.endLayout();
      start += paragraph.size() + 1;
    }
    return out;
  }

 protected:
  void paintEvent(QPaintEvent*) override {
    QPainter painter(this);
    painter.setPen(palette().color(foregroundRole()));
    int base_line = fontMetrics().ascent();
    for (const QString& line : paintedLines(text(), font(), width(), lines_)) {
      painter.drawText(0, base_line, line);
      base_line += fontMetrics().lineSpacing();
    }
  }
  void changeEvent(QEvent* event) override {
    QLabel::changeEvent(event);
    if (event->type() == QEvent::FontChange) fixHeight();
  }

 private:
  void fixHeight() { setFixedHeight(lines_ * fontMetrics().lineSpacing() + kBelow); }

  static constexpr int kBelow = 2;  ///< of a letter such as g, beyond its line [px]

  const int lines_;
};

/// Legible on the light and on the dark themes of Qt.
inline QColor colorOf(ros_bridge::Tone tone) {
  static const std::array<QColor, 4> kColors = {QColor(110, 110, 115), QColor(30, 140, 60),
                                                QColor(200, 120, 0), QColor(205, 40, 35)};
  return kColors[static_cast<std::size_t>(tone)];  // in the order of Tone
}

/// Colour of an actuator's curve in the strip chart, and of its name beside the slider. None of
/// them means anything in the 3D view or as a Tone.
inline QColor colorOfChannel(int channel) {
  static const std::array<QColor, 6> kColors = {QColor(0, 105, 110),   QColor(135, 75, 55),
                                                QColor(60, 60, 65),    QColor(125, 125, 0),
                                                QColor(195, 150, 105), QColor(95, 130, 140)};
  return kColors[static_cast<std::size_t>(channel) % kColors.size()];
}

/// A label of plain text that wraps, with an object name.
inline QLabel* makeText(QWidget* parent, const char* name) {
  auto* const label = new QLabel(parent);
  label->setObjectName(name);
  label->setTextFormat(Qt::PlainText);
  label->setWordWrap(true);
  label->setTextInteractionFlags(Qt::TextSelectableByMouse);
  return label;
}

/// Shows words in the colour of their tone; hides the label where there are none. A FixedText keeps
/// its place.
inline void showWords(QLabel* label, const ros_bridge::Words& words) {
  const QString shown = QString::fromStdString(words.text);
  if (label->text() != shown) {
    label->setText(shown);
    if (dynamic_cast<FixedText*>(label) != nullptr) label->setToolTip(shown);
  }
  label->setVisible(!shown.isEmpty());
  const QString style = "color: " + colorOf(words.tone).name() + ";";
  if (label->styleSheet() != style) label->setStyleSheet(style);
}

/// Greys a widget out where its action is not possible, with the reason as its tooltip.
/// @param what  tooltip where it is possible.
inline void offer(QWidget* widget, const ros_bridge::Possibility& possibility, const char* what) {
  widget->setEnabled(possibility.possible());
  const QString tip =
      possibility.possible() ? QString(what) : QString::fromStdString(possibility.why_not);
  if (widget->toolTip() != tip) widget->setToolTip(tip);
}

/// Pressures (upper half, kPa) and tip error (lower half, mm) over the last seconds.
class StripChart : public QWidget {
 public:
  explicit StripChart(QWidget* parent) : QWidget(parent) {
    setObjectName("strip_chart");
    setMinimumHeight(kHeight);
    clock_.start();
  }

  /// Adds the present moment.
  void add(const ros_bridge::CockpitView& view) {
    std::vector<double> pressures;
    for (const auto& channel : view.channels) pressures.push_back(channel.measured);
    from_target_ = view.loop && std::isfinite(view.loop->error);
    history_.add(1e-9 * static_cast<double>(clock_.nsecsElapsed()), pressures,
                 from_target_ ? view.loop->error : view.tip_error);
    update();
  }
  void clear() {
    history_.clear();
    update();
  }

 protected:
  void paintEvent(QPaintEvent*) override {
    QPainter painter(this);
    painter.setRenderHint(QPainter::Antialiasing);
    QFont small = painter.font();
    small.setPixelSize(11);
    painter.setFont(small);
    const double half = 0.5 * height();
    drawPressures(painter, {2, kText, width() - 4.0, half - kText - 3});
    drawError(painter, {2, half + kText, width() - 4.0, half - kText - 3});
  }

 private:
  using Row = ros_bridge::StripHistory::Row;

  static constexpr double kSpan = 30;            // [s]
  static constexpr double kPeriod = 0.05;        // between rows [s]
  static constexpr double kLeastPressure = 1e5;  // of the axis [Pa]
  static constexpr double kLeastError = 1e-3;    // of the axis [m]
  static constexpr int kHeight = 76;             // at least [px]
  static constexpr double kText = 14;            // height of a line of text [px]
  static constexpr double kLine = 1.5;           // [px]

  void drawPressures(QPainter& painter, const QRectF& area) const {
    const double top = history_.pressureTop(kLeastPressure);
    drawFrame(painter, area,
              QString("pressures, 0 to %1, last %2 s")
                  .arg(QString::fromStdString(ros_bridge::kilopascals(top)))
                  .arg(kSpan));
    if (history_.rows().empty()) return;
    for (std::size_t i = 0; i < history_.rows().back().pressures.size(); ++i) {
      drawCurve(painter, area, top, colorOfChannel(static_cast<int>(i)),
                [i](const Row& row) { return row.pressures[i]; });
    }
  }
  void drawError(QPainter& painter, const QRectF& area) const {
    const double top = history_.errorTop(kLeastError);
    drawFrame(painter, area,
              QString("tip error (measured - %1), 0 to %2")
                  .arg(from_target_ ? "target" : "model")
                  .arg(QString::fromStdString(ros_bridge::millimetres(top))));
    drawCurve(painter, area, top, QColor(230, 120, 20),
              [](const Row& row) { return row.tip_error; });
  }

  static void drawFrame(QPainter& painter, const QRectF& area, const QString& text) {
    painter.setPen(QPen(QColor(150, 150, 155), 0.5));
    for (int k = 0; k <= 2; ++k) {
      const double y = area.bottom() - 0.5 * k * area.height();
      painter.drawLine(QPointF(area.left(), y), QPointF(area.right(), y));
    }
    painter.drawText(QPointF(area.left() + 2, area.top() - 3), text);
  }

  /// A curve with gaps where its value is unknown.
  template <class Value>
  void drawCurve(QPainter& painter, const QRectF& area, double top, const QColor& color,
                 const Value& value) const {
    painter.setPen(QPen(color, kLine));
    painter.setClipRect(area.adjusted(0, -1, 0, 1));
    QPolygonF curve;
    const auto flush = [&] {
      if (curve.size() > 1) painter.drawPolyline(curve);
      curve.clear();
    };
    for (const Row& row : history_.rows()) {
      const double y = value(row);
      if (!std::isfinite(y)) {
        flush();
        continue;
      }
      const double x = 1 - (history_.newest() - row.time) / kSpan;
      curve << QPointF(area.left() + x * area.width(), area.bottom() - y / top * area.height());
    }
    flush();
    painter.setClipping(false);
  }

  QElapsedTimer clock_;
  ros_bridge::StripHistory history_{kSpan, kPeriod};
  bool from_target_ = false;  ///< the error is that of the closed loop, not that of the model
};

}  // namespace helix_arm::rviz_panel
