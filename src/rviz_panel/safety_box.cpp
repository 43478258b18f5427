#include "safety_box.hpp"

#include <QHBoxLayout>
#include <QLabel>
#include <QPushButton>
#include <QSignalBlocker>
#include <QVBoxLayout>
#include <utility>

#include "panel_parts.hpp"

namespace helix_arm::rviz_panel {
namespace {

using ros_bridge::CockpitView;

constexpr int kStopHeight = 64;  // [px]

}  // namespace

SafetyBox::SafetyBox(QWidget* parent, Actions actions)
    : QGroupBox("Arm", parent), actions_(std::move(actions)) {
  auto* const column = new QVBoxLayout(this);
  state_ = makeText(this, "state");
  QFont large = state_->font();
  large.setPointSizeF(1.8 * large.pointSizeF());
  large.setBold(true);
  state_->setFont(large);
  column->addWidget(state_);
  cause_ = makeText(this, "cause");
  remedy_ = makeText(this, "remedy");
  column->addWidget(cause_);
  column->addWidget(remedy_);

  auto* const stop_row = new QHBoxLayout;
  stop_ = addButton("stop", "EMERGENCY STOP");
  stop_->setCheckable(true);
  stop_->setMinimumHeight(kStopHeight);
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
  why_not_ = makeText(this, "why_not");
  goal_ = makeText(this, "goal");
  answer_ = makeText(this, "answer");
  column->addWidget(why_not_);
  column->addWidget(goal_);
  column->addWidget(answer_);

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

void SafetyBox::display(const CockpitView& view) {
  using namespace ros_bridge;
  const Headline words = headline(view);
  showWords(state_, words.state, words.tone);
  showWords(cause_, words.cause, words.tone);
  showWords(remedy_, words.remedy.empty() ? "" : "Next: " + words.remedy, Tone::kQuiet);

  offer(enable_, mayEnable(view), "Enables the arm: it then follows targets");
  offer(vent_, mayVent(view), "Vents all channels");
  offer(hold_, mayHold(view),
        "Holds the present pressures. Pressed again: lets go, the arm ramps down to rest");
  offer(release_, mayRelease(view), "Releases the emergency stop; the arm stays vented");
  // Greyed out it could not be clicked while the first answer is under way.
  stop_->setToolTip(mayStop(view).possible() ? "Vents all channels at once, and latches"
                                             : "Engaged; Release ends it");
  stop_->setChecked(!mayStop(view).possible());
  hold_->setChecked(view.goal != CockpitGoal::kNone);
  hold_->setText(view.goal != CockpitGoal::kNone ? "Let go" : "Hold");

  const Possibility& enable = mayEnable(view);
  const bool tells = view.connected && !enable.possible() && !mayHold(view).possible();
  showWords(why_not_, tells ? "Enable: " + enable.why_not : "", Tone::kCaution);
  const Words goal = goalWords(view);
  showWords(goal_, "Cockpit: " + goal.text, goal.tone);
}

void SafetyBox::display(const ros_bridge::CallAnswer& answer) {
  using ros_bridge::Tone;
  showWords(answer_, answer.what + ": " + (answer.success ? "" : "refused: ") + answer.message,
            answer.success ? Tone::kQuiet : Tone::kBad);
}

}  // namespace helix_arm::rviz_panel
