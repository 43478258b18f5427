#pragma once

#include <QColor>
#include <QElapsedTimer>
#include <QFont>
#include <QLabel>
#include <QString>
#include <QStringList>
#include <QWidget>
#include <string>

#include "ros_bridge/cockpit/cockpit_view.hpp"

namespace helix_arm::rviz_panel {

/// The lines in which a text is painted: at most so many, the last one elided where it does not
/// fit.
QStringList paintedLines(const QString& text, const QFont& font, int width, int most);

/// A label of a fixed number of lines, so that nothing below it moves with its text. What does not
/// fit is elided; the tooltip holds the whole text.
class FixedText : public QLabel {
 public:
  FixedText(QWidget* parent, const char* name, int lines);

 protected:
  void paintEvent(QPaintEvent* event) override;
  void changeEvent(QEvent* event) override;

 private:
  void fixHeight();

  const int lines_;
};

// What the boxes of the cockpit share.

QColor colorOf(ros_bridge::Tone tone);

/// Colour of an actuator's curve in the strip chart, and of its name beside the slider. None of
/// them means anything in the 3D view or as a Tone.
QColor colorOfChannel(int channel);

/// A label of plain text that wraps, with an object name.
QLabel* makeText(QWidget* parent, const char* name);

/// Shows words in the colour of their tone; hides the label where there are none. A FixedText keeps
/// its place.
void showWords(QLabel* label, const ros_bridge::Words& words);

/// Greys a widget out where its action is not possible, with the reason as its tooltip.
/// @param what  tooltip where it is possible.
void offer(QWidget* widget, const ros_bridge::Possibility& possibility, const char* what);

/// Pressures (upper half, kPa) and tip error (lower half, mm) over the last seconds.
class StripChart : public QWidget {
 public:
  explicit StripChart(QWidget* parent);

  /// Adds the present moment.
  void add(const ros_bridge::CockpitView& view);
  void clear();

 protected:
  void paintEvent(QPaintEvent* event) override;

 private:
  void drawPressures(QPainter& painter, const QRectF& area) const;
  void drawError(QPainter& painter, const QRectF& area) const;

  QElapsedTimer clock_;
  ros_bridge::StripHistory history_;
  bool from_target_ = false;  ///< the error is that of the closed loop, not that of the model
};

}  // namespace helix_arm::rviz_panel
