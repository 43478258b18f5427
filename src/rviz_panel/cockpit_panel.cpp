#include "cockpit_panel.hpp"

#include <QHBoxLayout>
#include <QLineEdit>
#include <QPushButton>
#include <QScrollArea>
#include <QTimer>
#include <QVBoxLayout>
#include <exception>
#include <utility>

#include <OgreQuaternion.h>
#include <OgreVector3.h>
#include <pluginlib/class_list_macros.hpp>
#include <rviz/frame_manager.h>
#include <rviz/properties/property.h>
#include <rviz/properties/vector_property.h>
#include <rviz/render_panel.h>
#include <rviz/view_controller.h>
#include <rviz/view_manager.h>
#include <rviz/visualization_manager.h>

#include "boxes.hpp"
#include "panel_parts.hpp"
#include "ros_bridge/cockpit/arm_camera.hpp"

namespace helix_arm::rviz_panel {
namespace {

constexpr int kSteady = 5;          // refreshes
constexpr int kUpdatePeriod = 100;  // of what is shown [ms]
constexpr char kNamespaceKey[] = "Namespace";

}  // namespace

CockpitPanel::CockpitPanel(QWidget* parent) : rviz::Panel(parent) {
  auto* const column = new QVBoxLayout(this);
  column->setContentsMargins(4, 4, 4, 4);
  auto* const row = new QHBoxLayout;
  namespace_ = new QLineEdit(this);
  namespace_->setObjectName("namespace");
  namespace_->setPlaceholderText("namespace of the arm; empty: that of rviz");
  connect_ = new QPushButton("Connect", this);
  connect_->setObjectName("connect");
  connect_->setFocusPolicy(Qt::NoFocus);
  row->addWidget(namespace_);
  row->addWidget(connect_);
  column->addLayout(row);

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
  // Not where the field merely loses the focus: a name may be half typed.
  connect(namespace_, &QLineEdit::returnPressed, this, [this] { commit(); });
  connect(connect_, &QPushButton::clicked, this, [this] { commit(); });
  connect(namespace_, &QLineEdit::textChanged, this, [this] { markNamespace(view()); });
}

CockpitPanel::~CockpitPanel() = default;

void CockpitPanel::onInitialize() { connectTo(namespace_->text()); }

void CockpitPanel::load(const rviz::Config& config) {
  rviz::Panel::load(config);
  QString ns;
  if (!config.mapGetString(kNamespaceKey, &ns)) return;
  namespace_->setText(ns);
  if (connectTo(ns)) return;
  // That of onInitialize is not the arm of this configuration.
  builder_.cancel();
  ros_bridge::LinkBuilder::end(std::move(link_));
  wanted_.reset();
  refresh();
}

void CockpitPanel::save(rviz::Config config) const {
  rviz::Panel::save(config);
  config.mapSetValue(kNamespaceKey,
                     wanted_ ? QString::fromStdString(*wanted_) : namespace_->text().trimmed());
}

std::string CockpitPanel::typed() const { return namespace_->text().trimmed().toStdString(); }

void CockpitPanel::commit() {
  if (typed() == wanted_) return;
  if (connectTo(namespace_->text())) {
    Q_EMIT configChanged();
  } else if (wanted_) {
    namespace_->setText(QString::fromStdString(*wanted_));
  }
}

bool CockpitPanel::connectTo(const QString& ns) {
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

void CockpitPanel::tellNamespace(const std::string& fault, bool refused) {
  std::string stays;
  if (link_) stays = "; the panel stays with the arm of " + link_->view().ns;
  safety_->display({"Namespace", false, fault + stays, refused});
}

void CockpitPanel::takeLink() {
  std::unique_ptr<ros_bridge::CockpitLink> next;
  try {
    next = builder_.take();
  } catch (const std::exception& fault) {
    tellNamespace(fault.what(), false);
    wanted_.reset();
  }
  if (!next) return;
  if (link_) safety_->forgetAnswer();
  ros_bridge::LinkBuilder::end(std::exchange(link_, std::move(next)));
  chart_->clear();
}

ros_bridge::CockpitView CockpitPanel::view() const {
  ros_bridge::CockpitView out = link_ ? link_->view() : ros_bridge::CockpitView();
  out.connecting_to = builder_.connectingTo();
  out.silent_master = builder_.silentMaster();
  return out;
}

void CockpitPanel::stop(bool engage) {
  if (!link_ && engage) {
    safety_->display({"Emergency stop", false,
                      "the panel has no arm: " + ros_bridge::headline(view()).cause, false,
                      ros_bridge::kStopByHand});
  }
  with([engage](auto& link) { link.emergencyStop(engage); });
}

void CockpitPanel::markNamespace(const ros_bridge::CockpitView& view) {
  const bool edited = typed() != wanted_;
  const bool connected = !edited && link_ && view.connecting_to.empty();
  connect_->setEnabled(edited);
  const std::string arm = ros_bridge::armName(view);
  const QString tip = QString::fromStdString(
      connected ? "Namespace of the arm's nodes, such as left (launch argument ns)"
      : edited  ? "Not connected: Enter or Connect does. The buttons are those of " + arm
                : "Not connected yet. The buttons are those of " + arm);
  const QString style = connected ? ""
                                  : "QLineEdit { border: 2px solid " +
                                        colorOf(ros_bridge::Tone::kCaution).name() + "; }";
  if (namespace_->toolTip() != tip) namespace_->setToolTip(tip);
  if (namespace_->styleSheet() != style) namespace_->setStyleSheet(style);
}

void CockpitPanel::refresh() {
  takeLink();
  const ros_bridge::CockpitView view = this->view();
  if (link_) {
    for (const ros_bridge::CallAnswer& answer : link_->takeAnswers()) safety_->display(answer);
    if (!view.silent_master.empty() && !std::exchange(told_of_master_, true)) {
      tellNamespace(ros_bridge::masterWords(view), false);
    }
  }
  safety_->display(view);
  pressures_->display(view);
  tip_->display(view);
  calibration_->display(view);
  chart_->add(view);
  markNamespace(view);
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
  auto* const focus = dynamic_cast<rviz::VectorProperty*>(camera->subProp("Focal Point"));
  if (focus == nullptr) return;
  rviz::Property* const yaw = camera->subProp("Yaw");
  rviz::Property* const pitch = camera->subProp("Pitch");
  rviz::Property* const distance = camera->subProp("Distance");
  const Ogre::Vector3 looked_at = focus->getVector();
  const ros_bridge::ArmCamera now{target->getValue().toString().toStdString(),
                                  {looked_at.x, looked_at.y, looked_at.z},
                                  yaw->getValue().toDouble(),
                                  pitch->getValue().toDouble(),
                                  distance->getValue().toDouble()};
  if (!ros_bridge::isToChange(now, view.base_frame)) return;
  Ogre::Vector3 base;
  Ogre::Quaternion turn;
  rviz::FrameManager* const frames = vis_manager_->getFrameManager();
  if (!frames->getTransform(view.base_frame, /*time=*/{}, base, turn)) return;  // the latest
  const Ogre::Vector3 axis = turn.xAxis();
  const double aspect = static_cast<double>(window_.width()) / window_.height();
  const ros_bridge::ArmCamera next =
      ros_bridge::changed(now, view.base_frame, {axis.x, axis.y, axis.z}, view.arm_length, aspect);
  target->setValue(QString::fromStdString(next.target));  // moves the focal point
  yaw->setValue(next.yaw);
  pitch->setValue(next.pitch);
  distance->setValue(next.distance);
  focus->setVector(Ogre::Vector3(static_cast<float>(next.focus.x()),
                                 static_cast<float>(next.focus.y()),
                                 static_cast<float>(next.focus.z())));
}

template <class Action>
void CockpitPanel::with(const Action& action) {
  if (!link_) return;
  action(*link_);
  refresh();
}

}  // namespace helix_arm::rviz_panel

PLUGINLIB_EXPORT_CLASS(helix_arm::rviz_panel::CockpitPanel, rviz::Panel)
