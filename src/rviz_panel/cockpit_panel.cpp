#include <QComboBox>
#include <QDoubleSpinBox>
#include <QGridLayout>
#include <QGroupBox>
#include <QHBoxLayout>
#include <QLineEdit>
#include <QProgressBar>
#include <QPushButton>
#include <QScrollArea>
#include <QScrollBar>
#include <QSignalBlocker>
#include <QSize>
#include <QSlider>
#include <QTabBar>
#include <QTabWidget>
#include <QTimer>
#include <QVBoxLayout>
#include <algorithm>
#include <exception>

#include <OgreQuaternion.h>
#include <OgreVector3.h>
#include <pluginlib/class_list_macros.hpp>
#include <rviz/frame_manager.h>
#include <rviz/panel.h>
#include <rviz/properties/property.h>
#include <rviz/properties/vector_property.h>
#include <rviz/render_panel.h>
#include <rviz/view_controller.h>
#include <rviz/view_manager.h>
#include <rviz/visualization_manager.h>

#include "panel_parts.hpp"
#include "ros_bridge/cockpit/cockpit_link.hpp"

namespace helix_arm::rviz_panel {
namespace {

using namespace ros_bridge;

/// Runs an action of the link to the arm. @return whether there is one.
using Run = std::function<bool(const std::function<void(CockpitLink&)>& action)>;

/// @param clicked  may take whether the button is checked now.
template <class Clicked>
QPushButton* makeButton(QWidget* parent, const char* name, const char* text,
                        const Clicked& clicked) {
  auto* const button = new QPushButton(text, parent);
  button->setObjectName(name);
  button->setFocusPolicy(Qt::NoFocus);  // a space bar that was meant for rviz clicks nothing
  QObject::connect(button, &QPushButton::clicked, parent, clicked);
  return button;
}

/// The page of a tab: as wide as its content needs, scrolled where that is higher than the window.
class Page : public QScrollArea {
 public:
  Page(QTabWidget* tabs, const char* title, QWidget* content) : QScrollArea(tabs) {
    setWidgetResizable(true);
    setFrameShape(QFrame::NoFrame);
    setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
    setWidget(content);
    tabs->addTab(this, title);
  }
  QSize minimumSizeHint() const override {
    const int width = widget()->minimumSizeHint().width() + verticalScrollBar()->sizeHint().width();
    return {width, QScrollArea::minimumSizeHint().height()};
  }
};

constexpr int kMargin = 4;  // around the content of a page, and between its parts [px]
constexpr int kFrame = 20;  // beside a text in a button or title [px]

/// The layout of the content of a page, which keeps to its top.
QGridLayout* makeGrid(QWidget* content) {
  auto* const grid = new QGridLayout(content);
  grid->setContentsMargins(kMargin, kMargin, kMargin, kMargin);
  grid->setSpacing(kMargin);
  grid->setAlignment(Qt::AlignTop);
  return grid;
}

/// The first row of a page: what may run, or in its place how far the run is, and narrow buttons.
void addRunRow(QGridLayout* grid, QComboBox* choice, QProgressBar* progress,
               std::initializer_list<QPushButton*> buttons) {
  choice->setFocusPolicy(Qt::ClickFocus);
  choice->setSizeAdjustPolicy(QComboBox::AdjustToMinimumContentsLengthWithIcon);
  progress->setFixedHeight(choice->sizeHint().height());  // nothing moves when the run begins
  grid->setColumnStretch(0, 1);
  grid->addWidget(choice, 0, 0);
  grid->addWidget(progress, 0, 0);
  int column = 1;
  for (QPushButton* const button : buttons) {
    button->setFixedWidth(button->fontMetrics().horizontalAdvance(button->text()) + kFrame);
    grid->addWidget(button, 0, column++);
  }
}

/// Start, progress, end and result of a calibration.
class CalibrationBox : public QWidget {
 public:
  explicit CalibrationBox(const Run& run) {
    auto* const grid = makeGrid(this);
    fit_ = new QComboBox(this);
    fit_->setObjectName("fit");
    // The first one is usual: what a built arm and the places of its tags differ in from a scene.
    fit_->addItems({"stiffness length_scale placement", "stiffness", "stiffness length_scale",
                    "response stiffness length_scale", kWalk});
    fit_->setToolTip("What is fitted; walk: one muscle at a time, is all where the scene says?");
    start_ = makeButton(this, "calibration_start", "Start", [this, run] {
      std::vector<std::string> words;
      for (const QString& word : fit_->currentText().split(' '))
        words.push_back(word.toStdString());
      run([&](CockpitLink& link) { link.startCalibration(words); });
    });
    cancel_ = makeButton(this, "calibration_cancel", "Cancel",
                         [run] { run(&CockpitLink::cancelCalibration); });
    use_ =
        makeButton(this, "calibration_use", "Use it", [run] { run(&CockpitLink::useCalibration); });
    progress_ = new QProgressBar(this);
    progress_->setObjectName("calibration_progress");
    text_ = makeText(this, "calibration");
    warnings_ = makeText(this, "calibration_warnings");
    addRunRow(grid, fit_, progress_, {start_, cancel_, use_});
    grid->addWidget(text_, 1, 0, 1, -1);
    grid->addWidget(warnings_, 2, 0, 1, -1);
  }

  void display(const CockpitView& view) {
    const CockpitCalibration& run = view.calibration;
    offer(start_, mayCalibrate(view), "Steps the arm through pressures and fits the scene");
    offer(cancel_, mayCancel(view), "Ends the calibration; the arm ramps down to rest");
    offer(use_, mayUse(view), "Saves the calibrated scene and loads it in all nodes of the arm");
    fit_->setEnabled(!run.running);
    fit_->setVisible(!run.running);
    progress_->setVisible(run.running);
    if (run.running) {
      progress_->setRange(0, static_cast<int>(run.progress.steps));
      progress_->setValue(static_cast<int>(run.progress.step));
      progress_->setFormat("%v of %m: " + fit_->currentText());
    }
    showWords(text_, calibrationWords(view));
    showWords(warnings_, calibrationWarnings(view));
  }

 private:
  QComboBox* fit_;
  QPushButton *start_, *cancel_, *use_;
  QProgressBar* progress_;
  QLabel *text_, *warnings_;
};

/// Start, progress, stop and figures of an experiment.
class ExperimentBox : public QWidget {
 public:
  explicit ExperimentBox(const Run& run) {
    auto* const grid = makeGrid(this);
    name_ = new QComboBox(this);
    name_->setObjectName("experiment_name");
    name_->addItems({"step", "hysteresis", "bode", "repeatability", "creep", "workspace", "all"});
    name_->setToolTip("What is measured: docs/experiments.md");
    start_ = makeButton(this, "experiment_start", "Start", [this, run] {
      const std::string name = name_->currentText().toStdString();
      run([&](CockpitLink& link) { link.startExperiment(name); });
    });
    stop_ =
        makeButton(this, "experiment_stop", "Stop", [run] { run(&CockpitLink::stopExperiment); });
    progress_ = new QProgressBar(this);
    progress_->setObjectName("experiment_progress");
    text_ = makeText(this, "experiment");
    addRunRow(grid, name_, progress_, {start_, stop_});
    grid->addWidget(text_, 1, 0, 1, -1);
  }

  void display(const CockpitView& view) {
    const CockpitExperiment& run = view.experiment;
    offer(start_, mayExperiment(view), "Moves the arm through all of its range, and measures it");
    offer(stop_, mayStopExperiment(view), "Vents the arm; what was recorded is kept");
    name_->setVisible(!run.running);
    progress_->setVisible(run.running);
    progress_->setValue(static_cast<int>(100 * run.progress.progress));
    showWords(text_, experimentWords(view));
  }

 private:
  QComboBox* name_;
  QPushButton *start_, *stop_;
  QProgressBar* progress_;
  QLabel* text_;
};

constexpr double kStep = 100;            // of a slider [Pa]
constexpr int kKeyed = 10, kPage = 100;  // of its arrow and page keys [kStep]
constexpr double kKilo = 1e3;            // Pa per kPa
constexpr int kLeastSlider = 30;         // [px]

/// The first line of a page: what it is, or why nothing can be commanded there.
void showHeading(QLabel* label, const char* what, const std::string& why_not) {
  showWords(label, why_not.empty() ? Words{what} : Words{why_not, Tone::kCaution});
}

/// One row per actuator: name, slider, its limits, number [kPa], reading.
class PressureBox : public QWidget {
 public:
  explicit PressureBox(Run run) : run_(std::move(run)) {
    grid_ = makeGrid(this);
    grid_->setColumnStretch(1, 1);
    why_not_ = new FixedText(this, "pressures_why_not", 1);
    grid_->addWidget(why_not_, 0, 0, 1, kColumns);
  }

  void display(const CockpitView& view) {
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
      showWords(row.limits, {limitWords(channel)});
      showWords(row.reading, {kilopascals(channel.measured)});
      if (!(channel.lower < channel.upper)) continue;
      const QSignalBlocker quiet_slider(row.slider), quiet_value(row.value);
      // The widest scale inside the limits: the end of a slider is never refused.
      const double lowest = std::ceil(channel.lower / kStep - 1e-6);
      const double highest = std::floor(channel.upper / kStep + 1e-6);
      row.slider->setRange(static_cast<int>(lowest), static_cast<int>(highest));
      row.value->setRange(kStep * lowest / kKilo, kStep * highest / kKilo);
      // They follow the arm where the cockpit does not command it, and nobody is at them.
      const bool holds = view.goal == CockpitGoal::kPressures;
      const double shown = !holds                 ? channel.command
                           : i < view.held.size() ? view.held[i]
                                                  : kUnknown;
      const bool slides = row.slider->isSliderDown(), types = row.value->hasFocus();
      if (!std::isfinite(shown) || (!holds && (slides || types))) continue;
      if (!slides) row.slider->setValue(static_cast<int>(std::lround(shown / kStep)));
      if (!types) row.value->setValue(shown / kKilo);
    }
    if (rows_.empty()) why_not = "no pressure_command has come yet";
    showHeading(why_not_, "Gauge pressures [kPa]: limits, command, reading", why_not);
  }

 private:
  static constexpr int kColumns = 5;

  struct Row {
    std::string name;
    QLabel* label;
    QSlider* slider;        ///< [0.1 kPa]
    QDoubleSpinBox* value;  ///< [kPa]
    QLabel *limits, *reading;

    /// From left to right.
    std::array<QWidget*, kColumns> parts() const { return {label, slider, limits, value, reading}; }
  };

  void makeRows(const CockpitView& view) {
    if (std::equal(rows_.begin(), rows_.end(), view.channels.begin(), view.channels.end(),
                   [](const Row& row, const auto& channel) { return row.name == channel.name; })) {
      return;
    }
    for (const Row& row : rows_) {
      for (QWidget* part : row.parts()) part->deleteLater();
    }
    rows_.clear();
    for (const CockpitChannel& channel : view.channels) {
      rows_.push_back(makeRow(static_cast<int>(rows_.size()), channel.name));
    }
  }

  Row makeRow(int index, const std::string& name) {
    const std::string number = std::to_string(index);
    Row row{name,
            makeText(this, ("name_" + number).c_str()),
            new QSlider(Qt::Horizontal, this),
            new QDoubleSpinBox(this),
            makeText(this, ("limits_" + number).c_str()),
            makeText(this, ("reading_" + number).c_str())};
    row.label->setText(QString::fromStdString(name));
    row.label->setStyleSheet("color: " + colorOfChannel(index).name() + "; font-weight: bold;");
    for (QLabel* text : {row.label, row.limits, row.reading}) text->setWordWrap(false);
    // It has a fixed width, so that a slider keeps its own.
    row.slider->setMinimumWidth(kLeastSlider);
    row.reading->setMinimumWidth(row.reading->fontMetrics().horizontalAdvance("-9999.9 kPa"));
    row.slider->setObjectName(("slider_" + number).c_str());
    row.value->setObjectName(("value_" + number).c_str());
    row.value->setDecimals(1);
    row.value->setSingleStep(1);
    row.slider->setSingleStep(kKeyed);
    row.slider->setPageStep(kPage);
    row.value->setKeyboardTracking(false);      // half a number is no command
    row.value->setFocusPolicy(Qt::ClickFocus);  // the wheel scrolls past it
    row.slider->setFocusPolicy(Qt::ClickFocus);
    const auto set = [this, channel = static_cast<std::size_t>(index)](double pressure) {
      run_([&](CockpitLink& link) { link.setPressure(channel, pressure); });
    };
    connect(row.slider, &QSlider::valueChanged, this, [set](int steps) { set(kStep * steps); });
    connect(row.value, QOverload<double>::of(&QDoubleSpinBox::valueChanged), this,
            [set](double kilopascal) { set(kKilo * kilopascal); });
    int column = 0;
    for (QWidget* part : row.parts()) grid_->addWidget(part, index + 1, column++);
    return row;
  }

  const Run run_;
  QGridLayout* grid_;
  QLabel* why_not_;
  std::vector<Row> rows_;
};

constexpr int kStopHeight = 54;         // [px]
constexpr int kStopWidth = 190;         // at least: its first line [px]
constexpr qint64 kAnswerShown = 10000;  // of a success [ms]
constexpr qint64 kAnswerRead = 3000;    // of a failure, at least [ms]

// A name as far as it fits; both of its ends tell arms apart.
QString fitted(const std::string& name, const QWidget* widget, int used) {
  return widget->fontMetrics().elidedText(QString::fromStdString(name), Qt::ElideMiddle,
                                          std::max(widget->width() - kFrame - used, kFrame));
}

/// Emergency stop, Enable, Vent and Hold; below them state, cause and remedy. Title and stop name
/// the arm that they command. Texts have a fixed height: a button stays where it is, whatever they
/// say.
class SafetyBox : public QGroupBox {
 public:
  SafetyBox(QWidget* parent, const Run& run) : QGroupBox("Arm", parent) {
    auto* const column = new QVBoxLayout(this);
    column->setSpacing(kMargin / 2);
    column->setContentsMargins(2 * kMargin, kMargin, 2 * kMargin, kMargin);
    auto* const stop_row = new QHBoxLayout;
    stop_ = makeButton(this, "stop", "EMERGENCY STOP", [this, run] {
      if (run([](CockpitLink& link) { link.emergencyStop(true); })) return;
      display(CallAnswer{"Emergency stop", false,
                         "the panel has no arm: " + cause_->text().toStdString(), false,
                         kStopByHand});
    });
    stop_->setCheckable(true);
    stop_->setMinimumSize(kStopWidth, kStopHeight);
    stop_->setSizePolicy(QSizePolicy::Ignored, QSizePolicy::Fixed);  // a long name widens nothing
    stop_->setStyleSheet(
        "QPushButton { background: #c8201c; color: white; font-weight: bold; font-size: 18px; "
        "border: 3px solid #7a1210; border-radius: 8px; }"
        "QPushButton:checked { background: #5a0f0d; border-style: inset; }");
    release_ = makeButton(this, "release", "Release",
                          [run] { run([](CockpitLink& link) { link.emergencyStop(false); }); });
    release_->setMinimumHeight(kStopHeight);
    stop_row->addWidget(stop_, 4);
    stop_row->addWidget(release_, 1);
    column->addLayout(stop_row);

    auto* const row = new QHBoxLayout;
    enable_ = makeButton(this, "enable", "Enable", [run] { run(&CockpitLink::enable); });
    vent_ = makeButton(this, "vent", "Vent", [run] { run(&CockpitLink::vent); });
    hold_ = makeButton(this, "hold", "Hold",
                       [run](bool on) { run([on](CockpitLink& link) { link.hold(on); }); });
    hold_->setCheckable(true);
    for (QPushButton* button : {enable_, vent_, hold_}) row->addWidget(button);
    column->addLayout(row);

    state_ = new FixedText(this, "state", 1);
    QFont large = state_->font();
    large.setPointSizeF(1.4 * large.pointSizeF());
    large.setBold(true);
    state_->setFont(large);
    cause_ = new FixedText(this, "cause", 2);
    remedy_ = new FixedText(this, "remedy", 2);
    goal_ = new FixedText(this, "goal", 2);
    answer_ = new FixedText(this, "answer", 3);
    for (QLabel* text : {state_, cause_, remedy_, goal_, answer_}) column->addWidget(text);
  }

  void display(const CockpitView& view) {
    arm_ = armName(view);
    nameArm();
    const Headline words = headline(view);
    showWords(state_, {words.state, words.tone});
    showWords(cause_, {words.cause, words.tone});
    showWords(remedy_, {remedyWords(view)});

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
    showWords(goal_, {"Cockpit: " + goal.text, goal.tone});
  }

  /// Answer of a service. A failure stays until the arm's state changes, a success for seconds.
  void display(const CallAnswer& answer) {
    answered_.start();
    answered_well_ = answer.success;
    answered_in_ = state_->text().toStdString();
    showWords(answer_, answerWords(answer));
  }

  /// Removes the answer: it is that of another arm.
  void forgetAnswer() {
    answered_.invalidate();
    showWords(answer_, {});
  }

  /// Without the title, whose name is elided to the width that there is.
  QSize minimumSizeHint() const override {
    return {QWidget::minimumSizeHint().width(), QGroupBox::minimumSizeHint().height()};
  }

 protected:
  void resizeEvent(QResizeEvent* event) override {
    QGroupBox::resizeEvent(event);
    layout()->activate();  // the stop's width, too
    nameArm();
  }

 private:
  void nameArm() {
    const QString title = "Arm: " + fitted(arm_, this, fontMetrics().horizontalAdvance("Arm: "));
    const QString stop = "EMERGENCY STOP\n" + fitted(arm_, stop_, 0);
    if (this->title() != title) setTitle(title);
    if (stop_->text() != stop) stop_->setText(stop);
  }

  QLabel *state_, *cause_, *remedy_, *goal_, *answer_;
  QPushButton *stop_, *release_, *enable_, *vent_, *hold_;
  std::string arm_;
  QElapsedTimer answered_;
  bool answered_well_ = false;
  std::string answered_in_;  ///< state of the arm at the answer
};

constexpr double kMilli = 1e-3;    // m per mm
constexpr double kShown = 1e-4;    // last digit of a number [m]
constexpr double kFarthest = 1e4;  // that can be entered [mm]

/// The tip target as numbers, the tip itself, and the loop over vision.
class TipBox : public QWidget {
 public:
  explicit TipBox(const Run& run) {
    auto* const grid = makeGrid(this);
    static const std::array<const char*, 3> kNames = {"tip_x", "tip_y", "tip_z"};
    for (int axis = 0; axis < 3; ++axis) {
      auto* const number = new QDoubleSpinBox(this);
      number->setObjectName(kNames[static_cast<std::size_t>(axis)]);
      number->setRange(-kFarthest, kFarthest);
      number->setDecimals(1);
      number->setPrefix(QString("%1 ").arg(QChar("xyz"[axis])));
      number->setFocusPolicy(Qt::ClickFocus);
      numbers_[static_cast<std::size_t>(axis)] = number;
      grid->addWidget(number, 1, axis);
    }
    go_ = makeButton(this, "tip_go", "Go", [this, run] {
      std::array<double, 3> position{};
      for (std::size_t axis = 0; axis < 3; ++axis)
        position[axis] = kMilli * numbers_[axis]->value();
      run([&](CockpitLink& link) { link.aimTip(position); });
    });
    present_ = makeButton(this, "tip_present", "Take present", [this] { copyPresent(); });
    payload_ = makeButton(this, "tip_payload", "Payload", [this, run] {
      std::array<double, 3> position{};
      std::copy_n(present_tip_->begin(), 3, position.begin());
      run([&](CockpitLink& link) { link.askPayload(position); });
    });
    grid->addWidget(go_, 2, 0);
    grid->addWidget(present_, 2, 1);
    grid->addWidget(payload_, 2, 2);
    tip_ = new FixedText(this, "tip", 2);
    loop_ = new FixedText(this, "loop", 4);
    why_not_ = new FixedText(this, "tip_why_not", 1);
    grid->addWidget(tip_, 3, 0, 1, 3);
    grid->addWidget(loop_, 4, 0, 1, 3);
    grid->addWidget(why_not_, 0, 0, 1, 3);
  }

  void display(const CockpitView& view) {
    // A loop takes the measured tip anywhere; without one, the model's own tip is in its reach.
    present_tip_ = view.loop && view.measured_tip ? view.measured_tip : view.model_tip;
    if (!filled_ && present_tip_) {
      filled_ = true;
      copyPresent();
    }
    const Possibility may = mayAimTip(view);
    offer(go_, may, "Moves the tip there and holds it; out of reach, to the closest point");
    offer(
        present_,
        {present_tip_ ? "" : "no tip comes: neither of the model nor, with a loop, a measured one"},
        "Copies where the tip is now");
    offer(payload_, {present_tip_ ? "" : "no tip comes"},
          "Least and largest force that the tip carries where it is now; nothing moves");
    showHeading(why_not_, "Tip, seen from the arm's base [mm]", may.why_not);
    std::string text =
        "measured " + placeWords(view.measured_tip) + "\nmodel " + placeWords(view.model_tip);
    if (std::isfinite(view.tip_error)) text += ", difference " + millimetres(view.tip_error);
    showWords(tip_, {text});
    const Words loop = loopWords(view);
    showWords(loop_, {"Loop " + loop.text, loop.tone});
  }

 private:
  void copyPresent() {
    if (!present_tip_) return;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double shown = std::round((*present_tip_)[axis] / kShown) * kShown / kMilli;
      numbers_[axis]->setValue(shown + 0.0);  // never "-0.0"
    }
  }

  std::array<QDoubleSpinBox*, 3> numbers_{};  ///< [mm]
  QPushButton *go_, *present_, *payload_;
  QLabel *tip_, *loop_, *why_not_;
  std::optional<std::vector<double>> present_tip_;  ///< [m]
  bool filled_ = false;                             ///< the numbers have begun at the arm's tip
};

constexpr int kSteady = 5;          // refreshes
constexpr int kUpdatePeriod = 100;  // of what is shown [ms]

constexpr char kNamespaceKey[] = "Namespace";

/// The cockpit of one arm as a panel of rviz. Its namespace is saved in the configuration of rviz.
///
/// The thread of the window only reads CockpitLink::view() and asks for calls and links; none of it
/// blocks. Until the link to another arm is there, the buttons are those of the arm before; title
/// and stop name it.
class CockpitPanel : public rviz::Panel {
 public:
  explicit CockpitPanel(QWidget* parent = nullptr) : rviz::Panel(parent) {
    auto* const column = new QVBoxLayout(this);
    column->setContentsMargins(kMargin, kMargin, kMargin, kMargin);
    column->setSpacing(kMargin);
    auto* const row = new QHBoxLayout;
    namespace_ = new QLineEdit(this);
    namespace_->setObjectName("namespace");
    namespace_->setPlaceholderText("namespace of the arm; empty: that of rviz");
    connect_ = makeButton(this, "connect", "Connect", [this] { commit(); });
    row->addWidget(namespace_);
    row->addWidget(connect_);
    column->addLayout(row);

    const Run run = [this](const std::function<void(CockpitLink&)>& action) {
      if (link_ == nullptr) return false;
      action(*link_);
      refresh();
      return true;
    };
    safety_ = new SafetyBox(this, run);
    column->addWidget(safety_);  // outside the tabs: the stop is always in sight

    // At 768 lines of a screen, state, a page and the chart are in sight together.
    auto* const tabs = new QTabWidget(this);
    tabs->setObjectName("tabs");
    tabs->setDocumentMode(true);  // without a frame
    tabs->tabBar()->setFocusPolicy(Qt::NoFocus);
    pressures_ = new PressureBox(run);
    tip_ = new TipBox(run);
    calibration_ = new CalibrationBox(run);
    new Page(tabs, "Pressures", pressures_);
    new Page(tabs, "Tip", tip_);
    new Page(tabs, "Calibration", calibration_);
    experiment_ = new ExperimentBox(run);
    new Page(tabs, "Experiment", experiment_);
    chart_ = new StripChart(this);
    column->addWidget(tabs, 3);
    column->addWidget(chart_, 1);

    timer_ = new QTimer(this);
    connect(timer_, &QTimer::timeout, this, [this] { refresh(); });
    // Not where the field merely loses the focus: a name may be half typed.
    connect(namespace_, &QLineEdit::returnPressed, this, [this] { commit(); });
    connect(namespace_, &QLineEdit::textChanged, this, [this] { markNamespace(view()); });
  }

  void onInitialize() override { connectTo(namespace_->text()); }

  void load(const rviz::Config& config) override {
    rviz::Panel::load(config);
    QString ns;
    if (!config.mapGetString(kNamespaceKey, &ns)) return;
    namespace_->setText(ns);
    if (connectTo(ns)) return;
    // The builder of onInitialize is not the arm of this configuration.
    builder_.cancel();
    LinkBuilder::end(std::move(link_));
    wanted_.reset();
    refresh();
  }

  void save(rviz::Config config) const override {
    rviz::Panel::save(config);
    config.mapSetValue(kNamespaceKey,
                       wanted_ ? QString::fromStdString(*wanted_) : namespace_->text().trimmed());
  }

 private:
  /// Begins to connect to the arm of this namespace. If it is no name, the answer says so, and the
  /// arm stays: its emergency stop must go on working. @return whether it is a name.
  bool connectTo(const QString& ns) {
    timer_->start(kUpdatePeriod);
    std::string name = ns.trimmed().toStdString();
    try {
      builder_.begin(name);
    } catch (const std::exception& fault) {
      tellNamespace(fault.what(), true);
      return false;
    }
    wanted_ = std::move(name);
    told_of_master_ = false;
    safety_->forgetAnswer();
    refresh();
    return true;
  }

  /// Connects to the name in the field, unless that is the one already. What is no name gives way
  /// to the one before, if there is one.
  void commit() {
    if (typed() == wanted_) return;
    if (connectTo(namespace_->text())) {
      Q_EMIT configChanged();
    } else if (wanted_) {
      namespace_->setText(QString::fromStdString(*wanted_));
    }
  }

  /// The name in the field.
  std::string typed() const { return namespace_->text().trimmed().toStdString(); }

  /// Shows whether the panel is connected to the name in the field.
  void markNamespace(const CockpitView& view) {
    const bool edited = typed() != wanted_;
    const bool connected = !edited && link_ && view.connecting_to.empty();
    connect_->setEnabled(edited);
    const std::string arm = armName(view);
    const QString tip = QString::fromStdString(
        connected ? "Namespace of the arm's nodes, such as left (launch argument ns)"
        : edited  ? "Not connected: Enter or Connect does. The buttons are those of " + arm
                  : "Not connected yet. The buttons are those of " + arm);
    const QString style =
        connected ? "" : "QLineEdit { border: 2px solid " + colorOf(Tone::kCaution).name() + "; }";
    if (namespace_->toolTip() != tip) namespace_->setToolTip(tip);
    if (namespace_->styleSheet() != style) namespace_->setStyleSheet(style);
  }

  void tellNamespace(const std::string& fault, bool refused) {
    std::string stays;
    if (link_) stays = "; the panel stays with the arm of " + link_->view().ns;
    safety_->display({"Namespace", false, fault + stays, refused});
  }

  /// Begins anew with the arm to which a connection was made, if one was.
  void takeLink() {
    std::unique_ptr<CockpitLink> next;
    try {
      next = builder_.take();
    } catch (const std::exception& fault) {
      tellNamespace(fault.what(), false);
      wanted_.reset();
    }
    if (!next) return;
    if (link_) safety_->forgetAnswer();
    LinkBuilder::end(std::exchange(link_, std::move(next)));
    chart_->clear();
  }

  CockpitView view() const {
    CockpitView out = link_ ? link_->view() : CockpitView();
    out.connecting_to = builder_.connectingTo();
    out.silent_master = builder_.silentMaster();
    return out;
  }

  void refresh() {
    takeLink();
    const CockpitView view = this->view();
    if (link_) {
      for (const CallAnswer& answer : link_->takeAnswers()) safety_->display(answer);
      if (!view.silent_master.empty() && !std::exchange(told_of_master_, true)) {
        tellNamespace(masterWords(view), false);
      }
    }
    safety_->display(view);
    pressures_->display(view);
    tip_->display(view);
    calibration_->display(view);
    experiment_->display(view);
    chart_->add(view);
    markNamespace(view);
    lookAt(view);
  }

  /// Turns a view that looks at arm_base to the base of this arm, whose frame may have a prefix,
  /// and places one that looks exactly at the base so that it shows all of the arm from its side
  /// (ArmCamera).
  void lookAt(const CockpitView& view) {
    if (vis_manager_ == nullptr || view.base_frame.empty() || !(view.arm_length > 0)) return;
    rviz::ViewController* const camera = vis_manager_->getViewManager()->getCurrent();
    rviz::RenderPanel* const window = vis_manager_->getRenderPanel();
    // At the start, rviz still arranges its window.
    steady_ = window->size() == window_ ? steady_ + 1 : 0;
    window_ = window->size();
    if (camera == nullptr || steady_ < kSteady || window_.height() < 1) return;
    rviz::Property* const target = camera->subProp("Target Frame");
    auto* const focus = dynamic_cast<rviz::VectorProperty*>(camera->subProp("Focal Point"));
    if (focus == nullptr) return;
    rviz::Property* const yaw = camera->subProp("Yaw");
    rviz::Property* const pitch = camera->subProp("Pitch");
    rviz::Property* const distance = camera->subProp("Distance");
    const Ogre::Vector3 looked_at = focus->getVector();
    const ArmCamera now{target->getValue().toString().toStdString(),
                        {looked_at.x, looked_at.y, looked_at.z},
                        yaw->getValue().toDouble(),
                        pitch->getValue().toDouble(),
                        distance->getValue().toDouble()};
    if (!isToChange(now, view.base_frame)) return;
    Ogre::Vector3 base;
    Ogre::Quaternion turn;
    rviz::FrameManager* const frames = vis_manager_->getFrameManager();
    if (!frames->getTransform(view.base_frame, /*time=*/{}, base, turn)) return;  // the latest
    const Ogre::Vector3 axis = turn.xAxis();
    const double aspect = static_cast<double>(window_.width()) / window_.height();
    const ArmCamera next =
        changed(now, view.base_frame, {axis.x, axis.y, axis.z}, view.arm_length, aspect);
    target->setValue(QString::fromStdString(next.target));  // moves the focal point
    yaw->setValue(next.yaw);
    pitch->setValue(next.pitch);
    distance->setValue(next.distance);
    focus->setVector(Ogre::Vector3(static_cast<float>(next.focus.x()),
                                   static_cast<float>(next.focus.y()),
                                   static_cast<float>(next.focus.z())));
  }

  QLineEdit* namespace_;
  QPushButton* connect_;
  SafetyBox* safety_;
  PressureBox* pressures_;
  TipBox* tip_;
  CalibrationBox* calibration_;
  ExperimentBox* experiment_;
  StripChart* chart_;
  QTimer* timer_;
  std::optional<std::string> wanted_;  ///< last namespace that is a name, as it was typed
  bool told_of_master_ = false;        ///< that it does not answer
  QSize window_;                       ///< of the 3D view
  int steady_ = 0;                     ///< refreshes since it has this size
  LinkBuilder builder_;
  std::unique_ptr<CockpitLink> link_;
};

}  // namespace
}  // namespace helix_arm::rviz_panel

PLUGINLIB_EXPORT_CLASS(helix_arm::rviz_panel::CockpitPanel, rviz::Panel)
