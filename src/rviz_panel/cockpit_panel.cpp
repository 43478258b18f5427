#include "cockpit_panel.hpp"

#include <QFormLayout>
#include <QLabel>
#include <QLineEdit>
#include <QMetaObject>
#include <QScrollArea>
#include <QTimer>
#include <QVBoxLayout>
#include <exception>

#include <pluginlib/class_list_macros.hpp>
#include <ros/time.h>
#include <rviz/properties/property.h>
#include <rviz/view_controller.h>
#include <rviz/view_manager.h>
#include <rviz/visualization_manager.h>

#include "calibration_box.hpp"
#include "helix_arm/ros_bridge/common/names.hpp"
#include "pressure_box.hpp"
#include "safety_box.hpp"
#include "strip_chart.hpp"
#include "tip_box.hpp"

namespace helix_arm::rviz_panel {
namespace {

constexpr int kUpdatePeriod = 100;  // of what is shown [ms]
constexpr char kNamespaceKey[] = "Namespace";

}  // namespace

CockpitPanel::CockpitPanel(QWidget* parent) : rviz::Panel(parent) {
  auto* const column = new QVBoxLayout(this);
  column->setContentsMargins(4, 4, 4, 4);
  namespace_ = new QLineEdit(this);
  namespace_->setObjectName("namespace");
  namespace_->setPlaceholderText("namespace of the arm; empty: that of rviz");
  namespace_->setToolTip("Namespace of the arm's nodes, such as left (launch argument ns)");
  column->addWidget(namespace_);

  safety_ = new SafetyBox(
      this, {[this] { with([](auto& link) { link.enable(); }); },
             [this] { with([](auto& link) { link.vent(); }); },
             [this](bool engage) { with([engage](auto& link) { link.emergencyStop(engage); }); },
             [this](bool on) { with([on](auto& link) { link.hold(on); }); }});
  column->addWidget(safety_);  // outside the scrolled part: the stop is always in sight

  auto* const scroll = new QScrollArea(this);
  scroll->setWidgetResizable(true);
  scroll->setFrameShape(QFrame::NoFrame);
  scroll->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  auto* const inner = new QWidget(scroll);
  auto* const boxes = new QVBoxLayout(inner);
  boxes->setContentsMargins(0, 0, 0, 0);
  pressures_ = new PressureBox(inner, [this](std::size_t channel, double pressure) {
    with([=](auto& link) { link.setPressure(channel, pressure); });
  });
  tip_ = new TipBox(inner, [this](const std::array<double, 3>& position) {
    with([&](auto& link) { link.aimTip(position); });
  });
  chart_ = new StripChart(inner);
  calibration_ =
      new CalibrationBox(inner, {[this](const std::vector<std::string>& fit) {
                                   with([&](auto& link) { link.startCalibration(fit); });
                                 },
                                 [this] { with([](auto& link) { link.cancelCalibration(); }); },
                                 [this] { with([](auto& link) { link.useCalibration(); }); }});
  for (QWidget* box : std::initializer_list<QWidget*>{pressures_, tip_, chart_, calibration_}) {
    boxes->addWidget(box);
  }
  boxes->addStretch(1);
  scroll->setWidget(inner);
  column->addWidget(scroll, 1);

  timer_ = new QTimer(this);
  connect(timer_, &QTimer::timeout, this, [this] { refresh(); });
  connect(namespace_, &QLineEdit::editingFinished, this, [this] {
    if (namespace_->text().trimmed().toStdString() == connected_to_) return;
    connectTo(namespace_->text());
    Q_EMIT configChanged();
  });
}

CockpitPanel::~CockpitPanel() = default;

void CockpitPanel::onInitialize() { connectTo(namespace_->text()); }

void CockpitPanel::load(const rviz::Config& config) {
  rviz::Panel::load(config);
  QString ns;
  if (!config.mapGetString(kNamespaceKey, &ns)) return;
  namespace_->setText(ns);
  connectTo(ns);
}

void CockpitPanel::save(rviz::Config config) const {
  rviz::Panel::save(config);
  config.mapSetValue(kNamespaceKey, QString::fromStdString(connected_to_));
}

void CockpitPanel::connectTo(const QString& ns) {
  connected_to_ = ns.trimmed().toStdString();
  link_.reset();
  chart_->clear();
  try {
    // The answers come from other threads: they wait for the window's own.
    link_ = std::make_unique<ros_bridge::CockpitLink>(
        connected_to_, [this](const ros_bridge::CallAnswer& answer) {
          QMetaObject::invokeMethod(
              this, [this, answer] { safety_->display(answer); }, Qt::QueuedConnection);
        });
  } catch (const std::exception& fault) {
    safety_->display({"Namespace", false, fault.what()});
  }
  refresh();
  timer_->start(kUpdatePeriod);
}

void CockpitPanel::refresh() {
  const ros_bridge::CockpitView view = link_ ? link_->view() : ros_bridge::CockpitView();
  safety_->display(view);
  pressures_->display(view);
  tip_->display(view);
  calibration_->display(view);
  chart_->add(ros::SteadyTime::now().toSec(), view);
  lookAt(view.base_frame);
}

void CockpitPanel::lookAt(const std::string& base_frame) {
  if (vis_manager_ == nullptr || base_frame.empty()) return;
  rviz::ViewController* const camera = vis_manager_->getViewManager()->getCurrent();
  if (camera == nullptr) return;
  rviz::Property* const target = camera->subProp("Target Frame");
  if (target->getValue().toString() != ros_bridge::names::kBaseFrame) return;
  const QString frame = QString::fromStdString(base_frame);
  if (frame != ros_bridge::names::kBaseFrame) target->setValue(frame);
}

template <class Action>
void CockpitPanel::with(const Action& action) {
  if (!link_) return;
  action(*link_);
  refresh();
}

}  // namespace helix_arm::rviz_panel

PLUGINLIB_EXPORT_CLASS(helix_arm::rviz_panel::CockpitPanel, rviz::Panel)
