#include "calibration_box.hpp"

#include <QComboBox>
#include <QGridLayout>
#include <QLabel>
#include <QProgressBar>
#include <QPushButton>
#include <QStringList>
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

}  // namespace helix_arm::rviz_panel
