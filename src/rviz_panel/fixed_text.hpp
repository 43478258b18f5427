#pragma once

#include <QFont>
#include <QLabel>
#include <QString>
#include <QStringList>

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

}  // namespace helix_arm::rviz_panel
