#include "boxes.hpp"

#include <QComboBox>
#include <QDoubleSpinBox>
#include <QGridLayout>
#include <QHBoxLayout>
#include <QLabel>
#include <QProgressBar>
#include <QPushButton>
#include <QSignalBlocker>
#include <QSlider>
#include <QStringList>
#include <QVBoxLayout>
#include <algorithm>
#include <cmath>
#include <utility>

#include "panel_parts.hpp"

namespace helix_arm::rviz_panel {

using namespace ros_bridge;

CalibrationBox::CalibrationBox(QWidget* parent, Actions actions)
    : QGroupBox("Calibration", parent), actions_(std::move(actions)) {
  auto* const grid = new QGridLayout(this);
  fit_ = new QComboBox(this);
  fit_->setObjectName("fit");
  // The first one is usual: what a built arm and the places of its tags differ in from a scene.
  fit_->addItems({"stiffness length_scale placement", "stiffness", "stiffness length_scale",
                  "response stiffness length_scale"});
  fit_->setToolTip("What is fitted");
  fit_->setFocusPolicy(Qt::ClickFocus);
  start_ = new QPushButton("Start", this);
  start_->setObjectName("calibration_start");
  cancel_ = new QPushButton("Cancel", this);
  cancel_->setObjectName("calibration_cancel");
  use_ = new QPushButton("Use it", this);
  use_->setObjectName("calibration_use");
  for (QPushButton* button : {start_, cancel_, use_}) button->setFocusPolicy(Qt::NoFocus);
  progress_ = new QProgressBar(this);
  progress_->setObjectName("calibration_progress");
  // In the place of what is fitted, which cannot be changed meanwhile: nothing moves.
  progress_->setFixedHeight(fit_->sizeHint().height());
  text_ = makeText(this, "calibration");
  warnings_ = makeText(this, "calibration_warnings");
  grid->addWidget(fit_, 0, 0, 1, 3);
  grid->addWidget(start_, 1, 0);
  grid->addWidget(cancel_, 1, 1);
  grid->addWidget(use_, 1, 2);
  grid->addWidget(progress_, 0, 0, 1, 3);
  grid->addWidget(warnings_, 2, 0, 1, 3);
  grid->addWidget(text_, 3, 0, 1, 3);
  connect(start_, &QPushButton::clicked, this, [this] {
    std::vector<std::string> words;
    for (const QString& word : fit_->currentText().split(' ')) words.push_back(word.toStdString());
    actions_.start(words);
  });
  connect(cancel_, &QPushButton::clicked, this, [this] { actions_.cancel(); });
  connect(use_, &QPushButton::clicked, this, [this] { actions_.use(); });
}

void CalibrationBox::display(const CockpitView& view) {
  const CockpitCalibration& run = view.calibration;
  offer(start_, mayCalibrate(view), "Steps the arm through pressures and fits the scene");
  offer(cancel_, mayCancel(view), "Ends the calibration; the arm ramps down to rest");
  offer(use_, mayUse(view), "Saves the calibrated scene and loads it in all nodes of the arm");
  fit_->setEnabled(!run.running);
  fit_->setVisible(!run.running);
  progress_->setVisible(run.running);
  if (run.running) {
    progress_->setRange(0, static_cast<int>(run.steps));
    progress_->setValue(static_cast<int>(run.step));
    progress_->setFormat("%v of %m: " + fit_->currentText());
  }
  const Words words = calibrationWords(view);
  showWords(text_, words.text, words.tone);
  const Words warnings = calibrationWarnings(view);
  showWords(warnings_, warnings.text, warnings.tone);
}

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
