#include "cockpit_panel.hpp"

#include <QFormLayout>
#include <QLabel>
#include <QLineEdit>
#include <QMetaObject>
#include <QScrollArea>
#include <QTimer>
#include <QVBoxLayout>
#include <exception>
#include <utility>

#include <OgreQuaternion.h>
#include <OgreVector3.h>
#include <pluginlib/class_list_macros.hpp>
#include <ros/time.h>
#include <rviz/frame_manager.h>
#include <rviz/properties/property.h>
#include <rviz/properties/vector_property.h>
#include <rviz/render_panel.h>
#include <rviz/view_controller.h>
#include <rviz/view_manager.h>
#include <rviz/visualization_manager.h>

#include "calibration_box.hpp"
#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/common/side_view.hpp"
#include "pressure_box.hpp"
#include "safety_box.hpp"
#include "strip_chart.hpp"
#include "tip_box.hpp"

namespace helix_arm::rviz_panel {
namespace {

constexpr int kSteady = 5;              // refreshes
constexpr int kUpdatePeriod = 100;      // of what is shown [ms]
constexpr double kFieldOfView = 0.785;  // of rviz, from bottom to top [rad]
constexpr double kRadius = 0.1;         // of an arm's discs, in its lengths
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

  safety_ = new SafetyBox(this, {[this] { with([](auto& link) { link.enable(); }); },
                                 [this] { with([](auto& link) { link.vent(); }); },
                                 [this](bool engage) { stop(engage); },
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
  for (QWidget* box : std::initializer_list<QWidget*>{pressures_, tip_, calibration_, chart_}) {
    boxes->addWidget(box);
  }
  boxes->addStretch(1);
  scroll->setWidget(inner);
  column->addWidget(scroll, 1);

  timer_ = new QTimer(this);
  connect(timer_, &QTimer::timeout, this, [this] { refresh(); });
  connect(namespace_, &QLineEdit::editingFinished, this, [this] {
    if (namespace_->text().trimmed().toStdString() == connected_to_) return;
    if (connectTo(namespace_->text())) {
      Q_EMIT configChanged();
    } else {
      namespace_->setText(QString::fromStdString(connected_to_));
    }
  });
}

CockpitPanel::~CockpitPanel() = default;

void CockpitPanel::onInitialize() { connectTo(namespace_->text()); }

void CockpitPanel::load(const rviz::Config& config) {
  rviz::Panel::load(config);
  QString ns;
  if (!config.mapGetString(kNamespaceKey, &ns)) return;
  namespace_->setText(ns);
  if (connectTo(ns)) return;
  link_.reset();  // that of onInitialize is not the arm of this configuration
  refresh();
}

void CockpitPanel::save(rviz::Config config) const {
  rviz::Panel::save(config);
  config.mapSetValue(kNamespaceKey, QString::fromStdString(connected_to_));
}

bool CockpitPanel::connectTo(const QString& ns) {
  const std::string name = ns.trimmed().toStdString();
  timer_->start(kUpdatePeriod);
  try {
    // The answers come from other threads: they wait for the window's own.
    auto link = std::make_unique<ros_bridge::CockpitLink>(
        name, [this](const ros_bridge::CallAnswer& answer) {
          QMetaObject::invokeMethod(
              this, [this, answer] { safety_->display(answer); }, Qt::QueuedConnection);
        });
    link_ = std::move(link);
  } catch (const std::exception& fault) {
    std::string stays;
    if (link_) stays = "; the panel stays with the arm of " + link_->view().ns;
    safety_->display({"Namespace", false, fault.what() + stays});
    return false;
  }
  connected_to_ = name;
  chart_->clear();
  safety_->forgetAnswer();
  refresh();
  return true;
}

void CockpitPanel::stop(bool engage) {
  if (!link_ && engage) {
    safety_->display({"Emergency stop", false,
                      "the panel has no arm: shut the supply and open the relief valve by hand, "
                      "then correct the namespace"});
  }
  with([engage](auto& link) { link.emergencyStop(engage); });
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
  if (vis_manager_ == nullptr || view.base_frame.empty() || !(view.arm_length > 0)) return;
  rviz::ViewController* const camera = vis_manager_->getViewManager()->getCurrent();
  rviz::RenderPanel* const window = vis_manager_->getRenderPanel();
  // At the start, rviz still arranges its window.
  steady_ = window->size() == window_ ? steady_ + 1 : 0;
  window_ = window->size();
  if (camera == nullptr || steady_ < kSteady || window_.height() < 1) return;
  rviz::Property* const target = camera->subProp("Target Frame");
  const QString frame = QString::fromStdString(view.base_frame);
  const QString looked_at = target->getValue().toString();
  if (looked_at != frame && looked_at != ros_bridge::names::kBaseFrame) return;
  auto* const focus = dynamic_cast<rviz::VectorProperty*>(camera->subProp("Focal Point"));
  if (focus == nullptr) return;
  const Ogre::Vector3 from_base = focus->getVector();
  const bool placed = from_base != Ogre::Vector3::ZERO;
  if (placed && looked_at == frame) return;
  Ogre::Vector3 base;
  Ogre::Quaternion turn;
  if (!vis_manager_->getFrameManager()->getTransform(view.base_frame, ros::Time(), base, turn)) {
    return;
  }
  target->setValue(frame);  // moves the focal point
  if (placed) {
    focus->setVector(from_base);
    return;
  }
  const Ogre::Vector3 axis = turn.xAxis();
  const ros_bridge::SideView side =
      ros_bridge::sideView({axis.x, axis.y, axis.z}, view.arm_length, kRadius * view.arm_length);
  const double aspect = static_cast<double>(window_.width()) / window_.height();
  camera->subProp("Yaw")->setValue(side.yaw);
  camera->subProp("Pitch")->setValue(side.pitch);
  camera->subProp("Distance")->setValue(side.distance(kFieldOfView, aspect));
  focus->setVector(Ogre::Vector3(static_cast<float>(side.centre.x()),
                                 static_cast<float>(side.centre.y()),
                                 static_cast<float>(side.centre.z())));
}

template <class Action>
void CockpitPanel::with(const Action& action) {
  if (!link_) return;
  action(*link_);
  refresh();
}

}  // namespace helix_arm::rviz_panel

PLUGINLIB_EXPORT_CLASS(helix_arm::rviz_panel::CockpitPanel, rviz::Panel)
