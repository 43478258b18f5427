#include "tip_box.hpp"

#include <QDoubleSpinBox>
#include <QGridLayout>
#include <QLabel>
#include <QPushButton>
#include <cmath>
#include <utility>

#include "panel_parts.hpp"

namespace helix_arm::rviz_panel {
namespace {

using namespace ros_bridge;

constexpr double kMilli = 1e-3;    // m per mm
constexpr double kShown = 1e-4;    // last digit of a number [m]
constexpr double kFarthest = 1e4;  // that can be entered [mm]

}  // namespace

TipBox::TipBox(QWidget* parent, Aim aim)
    : QGroupBox("Tip, seen from the arm's base [mm]", parent), aim_(std::move(aim)) {
  auto* const grid = new QGridLayout(this);
  static const std::array<const char*, 3> kNames = {"tip_x", "tip_y", "tip_z"};
  for (int axis = 0; axis < 3; ++axis) {
    auto* const number = new QDoubleSpinBox(this);
    number->setObjectName(kNames[static_cast<std::size_t>(axis)]);
    number->setRange(-kFarthest, kFarthest);
    number->setDecimals(1);
    number->setPrefix(QString("%1 ").arg(QChar("xyz"[axis])));
    number->setFocusPolicy(Qt::ClickFocus);
    numbers_[static_cast<std::size_t>(axis)] = number;
    grid->addWidget(number, 0, axis);
  }
  go_ = new QPushButton("Go", this);
  go_->setObjectName("tip_go");
  present_ = new QPushButton("Take present", this);
  present_->setObjectName("tip_present");
  for (QPushButton* button : {go_, present_}) button->setFocusPolicy(Qt::NoFocus);
  grid->addWidget(go_, 1, 0);
  grid->addWidget(present_, 1, 1, 1, 2);
  tip_ = new FixedText(this, "tip", 2);
  loop_ = new FixedText(this, "loop", 2);
  why_not_ = new FixedText(this, "tip_why_not", 1);
  grid->addWidget(tip_, 2, 0, 1, 3);
  grid->addWidget(loop_, 3, 0, 1, 3);
  grid->addWidget(why_not_, 4, 0, 1, 3);
  connect(present_, &QPushButton::clicked, this, [this] { copyPresent(); });
  connect(go_, &QPushButton::clicked, this, [this] {
    std::array<double, 3> position{};
    for (std::size_t axis = 0; axis < 3; ++axis) position[axis] = kMilli * numbers_[axis]->value();
    aim_(position);
  });
}

void TipBox::copyPresent() {
  if (!present_tip_) return;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double shown = std::round((*present_tip_)[axis] / kShown) * kShown / kMilli;
    numbers_[axis]->setValue(shown + 0.0);  // never "-0.0"
  }
}

void TipBox::display(const CockpitView& view) {
  // A loop takes the measured tip anywhere; without one, the model's own tip is in its reach.
  present_tip_ = view.loop && view.measured_tip ? view.measured_tip : view.model_tip;
  if (!filled_ && present_tip_) {
    filled_ = true;
    copyPresent();
  }
  const Possibility may = mayAimTip(view);
  offer(go_, may, "Moves the tip there and holds it; out of reach, to the closest point");
  offer(present_,
        {present_tip_ ? "" : "no tip comes: neither of the model nor, with a loop, a measured one"},
        "Copies where the tip is now");
  showWords(why_not_, may.why_not, Tone::kCaution);
  std::string text =
      "measured " + placeWords(view.measured_tip) + "\nmodel " + placeWords(view.model_tip);
  if (std::isfinite(view.tip_error)) text += ", difference " + millimetres(view.tip_error);
  showWords(tip_, text, Tone::kQuiet);
  const Words loop = loopWords(view);
  showWords(loop_, "Loop " + loop.text, loop.tone);
}

}  // namespace helix_arm::rviz_panel
