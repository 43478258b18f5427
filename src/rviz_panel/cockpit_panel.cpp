#include "cockpit_panel.hpp"

#include <QFormLayout>
#include <QLabel>
#include <QLineEdit>
#include <QMetaObject>
#include <QScrollArea>
#include <QTimer>
#include <QVBoxLayout>
#include <cmath>
#include <exception>
#include <vector>

#include <OgreQuaternion.h>
#include <OgreVector3.h>
#include <pluginlib/class_list_macros.hpp>
#include <ros/time.h>
#include <rviz/frame_manager.h>
#include <rviz/properties/property.h>
#include <rviz/properties/vector_property.h>
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
constexpr double kSideways = 0.5;        // of a direction: beyond, the arm is beside the base
constexpr float kTextsHeight = 0.33F;    // above the base and beyond the tip [m]
constexpr float kTextsWidth = 0.38F;     // behind the base [m]
constexpr float kViewPerLength = 1.23F;  // distance of the view per height that it shows
constexpr float kViewPerWidth = 1.4F;    // and per width

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
  lookAt(view);
}

void CockpitPanel::lookAt(const ros_bridge::CockpitView& view) {
  if (vis_manager_ == nullptr || view.base_frame.empty() || !view.model_tip) return;
  rviz::ViewController* const camera = vis_manager_->getViewManager()->getCurrent();
  if (camera == nullptr) return;
  rviz::Property* const target = camera->subProp("Target Frame");
  const QString frame = QString::fromStdString(view.base_frame);
  const QString looked_at = target->getValue().toString();
  if (looked_at != frame && looked_at != ros_bridge::names::kBaseFrame) return;
  auto* const focus = dynamic_cast<rviz::VectorProperty*>(camera->subProp("Focal Point"));
  const bool placed = focus == nullptr || focus->getVector() != Ogre::Vector3::ZERO;
  if (placed && looked_at == frame) return;
  Ogre::Vector3 base;
  Ogre::Quaternion turn;
  if (!vis_manager_->getFrameManager()->getTransform(view.base_frame, ros::Time(), base, turn)) {
    return;
  }
  const Ogre::Vector3 from_base = placed ? focus->getVector() : Ogre::Vector3::ZERO;
  target->setValue(frame);  // moves the focal point
  if (placed) {
    if (focus != nullptr) focus->setVector(from_base);
    return;
  }
  const std::vector<double>& tip = *view.model_tip;
  const auto length = static_cast<float>(std::hypot(tip[0], std::hypot(tip[1], tip[2])));
  const Ogre::Vector3 along = turn * Ogre::Vector3::UNIT_X;
  // With the texts, which are above the base and on both sides of it, or behind it.
  if (std::hypot(along.x, along.y) > kSideways) {
    camera->subProp("Yaw")->setValue(std::atan2(-along.x, along.y));
    camera->subProp("Distance")->setValue(kViewPerWidth * (length + kTextsWidth));
    focus->setVector(along * 0.5F * (length - kTextsWidth));
  } else {
    camera->subProp("Distance")->setValue(kViewPerLength * (length + kTextsHeight));
    focus->setVector(along * 0.5F * length);
  }
}

template <class Action>
void CockpitPanel::with(const Action& action) {
  if (!link_) return;
  action(*link_);
  refresh();
}

}  // namespace helix_arm::rviz_panel

PLUGINLIB_EXPORT_CLASS(helix_arm::rviz_panel::CockpitPanel, rviz::Panel)
