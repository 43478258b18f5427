#include "fixed_text.hpp"

#include <QEvent>
#include <QFontMetrics>
#include <QPainter>
#include <QTextLayout>

namespace helix_arm::rviz_panel {

QStringList paintedLines(const QString& text, const QFont& font, int width, int most) {
  QStringList out;
  int start = 0;
  for (const QString& paragraph : text.split('\n')) {
    QTextLayout layout(paragraph, font);
    layout.setTextOption(QTextOption(Qt::AlignLeft));
    layout.beginLayout();
    for (QTextLine part = layout.createLine(); part.isValid(); part = layout.createLine()) {
      if (out.size() + 1 == most) {
        const QString rest = text.mid(start + part.textStart()).replace('\n', ' ');
        out << QFontMetrics(font).elidedText(rest, Qt::ElideRight, width);
        return out;
      }
      part.setLineWidth(width);
      out << paragraph.mid(part.textStart(), part.textLength());
    }
    layout.endLayout();
    start += paragraph.size() + 1;
  }
  return out;
}

FixedText::FixedText(QWidget* parent, const char* name, int lines) : QLabel(parent), lines_(lines) {
  setObjectName(name);
  setTextFormat(Qt::PlainText);
  QSizePolicy keeps(QSizePolicy::Ignored, QSizePolicy::Fixed);
  keeps.setRetainSizeWhenHidden(true);
  setSizePolicy(keeps);
  fixHeight();
}

void FixedText::fixHeight() { setFixedHeight(lines_ * fontMetrics().lineSpacing()); }

void FixedText::changeEvent(QEvent* event) {
  QLabel::changeEvent(event);
  if (event->type() == QEvent::FontChange) fixHeight();
}

void FixedText::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.setPen(palette().color(foregroundRole()));
  int base_line = fontMetrics().ascent();
  for (const QString& line : paintedLines(text(), font(), width(), lines_)) {
    painter.drawText(0, base_line, line);
    base_line += fontMetrics().lineSpacing();
  }
}

}  // namespace helix_arm::rviz_panel
