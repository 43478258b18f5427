#include "safety_box.hpp"

#include <QHBoxLayout>
#include <QLabel>
#include <QPushButton>
#include <QVBoxLayout>
#include <algorithm>
#include <utility>

#include "panel_parts.hpp"

namespace helix_arm::rviz_panel {
namespace {

using ros_bridge::CockpitView;

constexpr int kStopHeight = 64;         // [px]
constexpr int kStopWidth = 190;         // at least: its first line [px]
constexpr int kFrame = 24;              // beside a text in a button or title [px]
constexpr qint64 kAnswerShown = 10000;  // of a success [ms]
constexpr qint64 kAnswerRead = 3000;    // of a failure, at least [ms]

// A name as far as it fits; both of its ends tell arms apart.
QString fitted(const std::string& name, const QWidget* widget, int used) {
  return widget->fontMetrics().elidedText(QString::fromStdString(name), Qt::ElideMiddle,
                                          std::max(widget->width() - kFrame - used, kFrame));
}

}  // namespace

SafetyBox::SafetyBox(QWidget* parent, Actions actions)
    : QGroupBox("Arm", parent), actions_(std::move(actions)) {
  auto* const column = new QVBoxLayout(this);
  auto* const stop_row = new QHBoxLayout;
  stop_ = addButton("stop", "EMERGENCY STOP");
  stop_->setCheckable(true);
  stop_->setMinimumSize(kStopWidth, kStopHeight);
  stop_->setSizePolicy(QSizePolicy::Ignored, QSizePolicy::Fixed);  // a long name widens nothing
  stop_->setStyleSheet(
      "QPushButton { background: #c8201c; color: white; font-weight: bold; font-size: 18px; "
      "border: 3px solid #7a1210; border-radius: 8px; }"
      "QPushButton:checked { background: #5a0f0d; border-style: inset; }");
  release_ = addButton("release", "Release");
  release_->setMinimumHeight(kStopHeight);
  stop_row->addWidget(stop_, 4);
  stop_row->addWidget(release_, 1);
  column->addLayout(stop_row);

  auto* const row = new QHBoxLayout;
  enable_ = addButton("enable", "Enable");
  vent_ = addButton("vent", "Vent");
  hold_ = addButton("hold", "Hold");
  hold_->setCheckable(true);
  for (QPushButton* button : {enable_, vent_, hold_}) row->addWidget(button);
  column->addLayout(row);

  state_ = new FixedText(this, "state", 1);
  QFont large = state_->font();
  large.setPointSizeF(1.6 * large.pointSizeF());
  large.setBold(true);
  state_->setFont(large);
  cause_ = new FixedText(this, "cause", 3);
  remedy_ = new FixedText(this, "remedy", 3);
  goal_ = new FixedText(this, "goal", 2);
  answer_ = new FixedText(this, "answer", 3);
  for (QLabel* text : {state_, cause_, remedy_, goal_, answer_}) column->addWidget(text);

  connect(stop_, &QPushButton::clicked, this, [this] { actions_.stop(true); });
  connect(release_, &QPushButton::clicked, this, [this] { actions_.stop(false); });
  connect(enable_, &QPushButton::clicked, this, [this] { actions_.enable(); });
  connect(vent_, &QPushButton::clicked, this, [this] { actions_.vent(); });
  connect(hold_, &QPushButton::clicked, this, [this](bool on) { actions_.hold(on); });
}

QPushButton* SafetyBox::addButton(const char* name, const char* text) {
  auto* const button = new QPushButton(text, this);
  button->setObjectName(name);
  button->setFocusPolicy(Qt::NoFocus);  // a space bar that was meant for rviz clicks nothing
  return button;
}

void SafetyBox::nameArm() {
  const QString title = "Arm: " + fitted(arm_, this, fontMetrics().horizontalAdvance("Arm: "));
  const QString stop = "EMERGENCY STOP\n" + fitted(arm_, stop_, 0);
  if (this->title() != title) setTitle(title);
  if (stop_->text() != stop) stop_->setText(stop);
}

QSize SafetyBox::minimumSizeHint() const {
  return {QWidget::minimumSizeHint().width(), QGroupBox::minimumSizeHint().height()};
}

void SafetyBox::resizeEvent(QResizeEvent* event) {
  QGroupBox::resizeEvent(event);
  layout()->activate();  // the stop's width, too
  nameArm();
}

void SafetyBox::display(const CockpitView& view) {
  using namespace ros_bridge;
  arm_ = armName(view);
  nameArm();
  const Headline words = headline(view);
  showWords(state_, words.state, words.tone);
  showWords(cause_, words.cause, words.tone);
  showWords(remedy_, remedyWords(view), Tone::kQuiet);

  offer(enable_, mayEnable(view), "Enables the arm: it then follows targets");
  offer(vent_, mayVent(view), "Vents all channels");
  offer(hold_, mayHold(view),
        "Holds the present pressures. Pressed again: lets go, the arm ramps down to rest");
  offer(release_, mayRelease(view), "Releases the emergency stop; the arm stays vented");
  // Greyed out it could not be clicked while the first answer is under way.
  const std::string at = " (" + arm_ + ")";
  stop_->setToolTip(
      QString::fromStdString((mayStop(view).possible() ? "Vents all channels at once, and latches"
                                                       : "Engaged; Release ends it") +
                             at));
  stop_->setChecked(!mayStop(view).possible());
  hold_->setChecked(view.goal != CockpitGoal::kNone);
  hold_->setText(view.goal != CockpitGoal::kNone ? "Let go" : "Hold");

  const bool changed = words.state != answered_in_;
  if (answered_.isValid() && (answered_well_ ? answered_.hasExpired(kAnswerShown)
                                             : changed && answered_.hasExpired(kAnswerRead))) {
    forgetAnswer();
  }
  const Words goal = goalWords(view);
  showWords(goal_, "Cockpit: " + goal.text, goal.tone);
}

void SafetyBox::display(const ros_bridge::CallAnswer& answer) {
  answered_.start();
  answered_well_ = answer.success;
  answered_in_ = state_->text().toStdString();
  const ros_bridge::Words words = ros_bridge::answerWords(answer);
  showWords(answer_, words.text, words.tone);
}

void SafetyBox::forgetAnswer() {
  answered_.invalidate();
  showWords(answer_, "", ros_bridge::Tone::kQuiet);
}

}  // namespace helix_arm::rviz_panel
