#include "pressure_command_node.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/this_node.h>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/realtime.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "regulator_setup.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using control::SafetyCause;
using control::SafetyState;
using diagnostic_msgs::DiagnosticStatus;

constexpr double kSlowShare = 0.9;  // of ~rate; a slower loop is worth a warning

const char* textOf(control::Valve valve) {
  switch (valve) {
    case control::Valve::kRegulate:
      return "regulate";
    case control::Valve::kClose:
      return "close";
    case control::Valve::kVent:
      return "vent";
  }
  return "";
}

unsigned char diagnosticLevel(const control::SafetyReport& report) {
  if (report.vent_overdue) return DiagnosticStatus::ERROR;
  if (report.cause == SafetyCause::kNone) return DiagnosticStatus::OK;
  if (report.cause == SafetyCause::kVentRequested) return DiagnosticStatus::WARN;
  return report.state == SafetyState::kEnabled ? DiagnosticStatus::OK : DiagnosticStatus::ERROR;
}

DiagnosticStatus safetyStatus(const std::string& node, const io::Scene& scene,
                              const PressureLoop::Snapshot& path) {
  DiagnosticStatus out;
  out.name = statusName(node, names::kSafetyStatus);
  out.level = diagnosticLevel(path.report);
  out.message = path.reason;
  addValue(out, "state", nameOf(path.report.state));
  addValue(out, "cause", nameOf(path.report.cause));
  addValue(out, "emergency_stop", path.report.stopped ? "engaged" : "released");
  addValue(out, "vent_overdue", path.report.vent_overdue ? "true" : "false");
  addValue(out, names::kTargetTimeoutKey, fixed(scene.safety.rules.target_timeout, 3));
  return out;
}

DiagnosticStatus regulatorStatus(const std::string& node, const io::Scene& scene,
                                 const regulator::IoStatus& io) {
  DiagnosticStatus out;
  out.name = statusName(node, names::kRegulatorStatus);
  out.level = io.up ? DiagnosticStatus::OK : DiagnosticStatus::ERROR;
  out.message = io.up ? "the regulator answers" : "no link to the regulator: " + io.last_error;
  addValue(out, "regulator", regulator::describe(*scene.regulator));
  addValue(out, "writes", std::to_string(io.writes));
  addValue(out, "reads", std::to_string(io.reads));
  addValue(out, "bad_replies", std::to_string(io.bad_replies));
  addValue(out, "connections", std::to_string(io.connections));
  addValue(out, "breaks", std::to_string(io.breaks));
  addValue(out, "own_vents", std::to_string(io.own_vents));
  addValue(out, "last_error", io.last_error);
  return out;
}

DiagnosticStatus channelStatus(const std::string& node, const io::Scene& scene,
                               const PressureLoop::Snapshot& path, int channel) {
  const model::Actuator& actuator = scene.arm.actuator(channel);
  const bool culprit = path.report.channel == channel;
  DiagnosticStatus out;
  out.name = statusName(node, names::kChannelStatus + actuator.name);
  if (culprit) out.level = diagnosticLevel(path.report);
  const control::Valve valve = path.orders.valve[static_cast<std::size_t>(channel)];
  out.message = culprit ? path.reason : textOf(valve);
  const auto kpa = [](double pascals) { return fixed(1e-3 * pascals); };
  addValue(out, "valve", textOf(valve));
  addValue(out, "set_point_kpa", kpa(path.orders.set_point[channel]));
  addValue(out, "target_kpa", kpa(path.goal[channel]));
  addValue(out, "measured_kpa", kpa(path.reading[channel]));
  // Rounded to 0.1 kPa, a limit would let through what the arm refuses.
  addValue(out, names::kLowerLimitKey, fixed(1e-3 * actuator.limits.lower, 4));
  addValue(out, names::kUpperLimitKey, fixed(1e-3 * actuator.limits.upper, 4));
  return out;
}

}  // namespace

std::vector<DiagnosticStatus> pressureStatuses(const std::string& node, const io::Scene& scene,
                                               const PressureLoop::Snapshot& path) {
  std::vector<DiagnosticStatus> out = {safetyStatus(node, scene, path)};
  if (path.io) out.push_back(regulatorStatus(node, scene, *path.io));
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    out.push_back(channelStatus(node, scene, path, i));
  }
  return out;
}

DiagnosticStatus LoopRate::status(const std::string& node, const PressureLoop::Snapshot& path,
                                  const ros::SteadyTime& now) {
  const double rate = static_cast<double>(path.turns - turns_) / (now - last_look_).toSec();
  last_look_ = now;
  turns_ = path.turns;
  const bool slow = rate < kSlowShare * wanted_;
  DiagnosticStatus out;
  out.name = statusName(node, names::kLoopStatus);
  out.level = slow ? DiagnosticStatus::WARN : DiagnosticStatus::OK;
  out.message = slow ? "the loop is slower than ~rate" : "the loop keeps its rate";
  addValue(out, names::kRateKey, fixed(rate));
  addValue(out, names::kWantedRateKey, fixed(wanted_));
  addValue(out, names::kBadReadingsKey, std::to_string(path.bad_readings.total()));
  return out;
}

namespace {

using statics::InverseOptions;
using statics::InverseResult;

constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();

// Number of rows of a table that a call gives as one array.
std::size_t rowsOf(const std::vector<double>& table, const char* name, std::size_t columns,
                   std::size_t most) {
  basics::require(table.size() % columns == 0, name, " has ", table.size(),
                  " numbers; expected rows of ", columns);
  const std::size_t rows = table.size() / columns;
  basics::require(rows <= most, name, " has ", rows, " rows; expected at most ", most,
                  ": call again with the rest");
  return rows;
}

void requireFinite(const std::vector<double>& table, const char* name) {
  for (std::size_t i = 0; i < table.size(); ++i) {
    basics::require(std::isfinite(table[i]), name, "[", i, "] is ", table[i],
                    "; expected finite numbers");
  }
}

Eigen::VectorXd rowOf(const std::vector<double>& table, std::size_t row, std::size_t columns) {
  return Eigen::VectorXd::Map(table.data() + row * columns, static_cast<Eigen::Index>(columns));
}

template <class Numbers>
void appendNumbers(const Numbers& numbers, bool found, std::vector<double>& to) {
  for (Eigen::Index i = 0; i < numbers.size(); ++i) {
    to.push_back(found ? numbers.data()[i] : kNoNumber);
  }
}

Eigen::Vector4d quaternionXyzw(const Eigen::Matrix3d& rotation) {
  const Eigen::Quaterniond q = Eigen::Quaterniond(rotation).normalized();
  return q.w() < 0 ? Eigen::Vector4d(-q.coeffs()) : Eigen::Vector4d(q.coeffs());
}

const char* statusWord(statics::InverseStatus status) {
  if (status == statics::InverseStatus::kReached) return "reached";
  return status == statics::InverseStatus::kUnreachable ? "unreachable" : "not_converged";
}

// Runs the body, whose exceptions are the answer.
template <class Response, class Body>
bool answer(Response& response, const Body& body) {
  try {
    body();
    response.success = true;
  } catch (const std::exception& fault) {
    response = Response();
    response.message = basics::printableLines(fault.what());
  }
  return true;
}

ros::NodeHandle onQueue(ros::NodeHandle node, ros::CallbackQueue& queue) {
  node.setCallbackQueue(&queue);
  return node;
}

}  // namespace

ModelServer::ModelServer(const ros::NodeHandle& private_node, const statics::ArmModel& model)
    : model_(std::make_shared<statics::ArmModel>(model)),
      node_(onQueue(private_node, queue_)),
      forward_(serve(node_, names::kForward, &ModelServer::onForward, this)),
      inverse_(serve(node_, names::kInverse, &ModelServer::onInverse, this)),
      spinner_(1, &queue_) {
  spinner_.start();
}

ModelServer::~ModelServer() {
  ends_ = true;
  forward_.shutdown();
  inverse_.shutdown();
  spinner_.stop();
}

void ModelServer::adopt(const statics::ArmModel& model) {
  auto next = std::make_shared<const statics::ArmModel>(model);
  const basics::MutexLock lock(mutex_);
  model_ = std::move(next);
}

std::shared_ptr<const statics::ArmModel> ModelServer::model() const {
  const basics::MutexLock lock(mutex_);
  return model_;
}

void ModelServer::goOn() const {
  if (ends_) throw std::runtime_error("the node ends; call again when it runs");
}

void ModelServer::watchUnit(const std::string& what, const model::Arm& arm,
                            const std::vector<double>& rows) {
  if (warned_) return;
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Eigen::Index n = arm.actuatorCount();
  const std::string warning = control::kilopascalWarning(
      what, arm, RowMajor::Map(rows.data(), static_cast<Eigen::Index>(rows.size()) / n, n));
  if (warning.empty()) return;
  warned_ = true;
  logWarning("%s", warning.c_str());
}

bool ModelServer::onForward(Forward::Request& request, Forward::Response& response) {
  return answer(response, [&] {
    const auto model = this->model();
    const auto n = static_cast<std::size_t>(model->arm().actuatorCount());
    const std::size_t rows = rowsOf(request.pressure, "pressure", n, kMostForwardRows);
    watchUnit("a call to ~forward", model->arm(), request.pressure);
    response.rows = static_cast<std::uint32_t>(rows);
    response.sections = static_cast<std::uint32_t>(model->arm().sectionCount());
    for (std::size_t row = 0; row < rows; ++row) {
      goOn();
      // Pressures outside the limits throw, naming the actuator.
      const statics::Solution found = model->solve(rowOf(request.pressure, row, n));
      const bool converged = found.converged();
      response.converged.push_back(converged);
      appendNumbers(found.tip.translation, converged, response.position);
      appendNumbers(quaternionXyzw(found.tip.rotation), converged, response.orientation);
      appendNumbers(found.shape.twists(), converged, response.twist);
    }
  });
}

bool ModelServer::onInverse(Inverse::Request& request, Inverse::Response& response) {
  return answer(response, [&] {
    const auto model = this->model();
    const auto n = static_cast<std::size_t>(model->arm().actuatorCount());
    const std::size_t rows = rowsOf(request.position, "position", 3, kMostInverseRows);
    requireFinite(request.position, "position");
    requireFinite(request.start, "start");
    basics::require(request.start.empty() || request.start.size() == n, "start has ",
                    request.start.size(), " pressures; expected ", n, " or none");
    watchUnit("start of a call to ~inverse", model->arm(), request.start);
    InverseOptions options;
    if (!request.prefer.empty()) options.preference = statics::preferenceOf(request.prefer);
    const Eigen::VectorXd start =
        request.start.empty() ? model->arm().inputAt(0.0) : rowOf(request.start, 0, n);
    statics::InverseSolver solver(*model, options);
    response.rows = static_cast<std::uint32_t>(rows);
    for (std::size_t row = 0; row < rows; ++row) {
      goOn();
      const InverseResult& found = solver.toPosition(rowOf(request.position, row, 3), start);
      response.status.emplace_back(statusWord(found.status));
      appendNumbers(found.input, true, response.pressure);
      response.position_error.push_back(found.position_error);
    }
  });
}

PressureCommandNode::PressureCommandNode()
    : options_(PressureCommandOptions::load()),
      scene_(requirePneumatic(io::loadScene(options_.scene))),
      first_safety_(scene_.safety),
      loop_rate_(options_.rate),
      diagnostics_publisher_(
          node_.advertise<diagnostic_msgs::DiagnosticArray>(names::kDiagnostics, 10)),
      shapes_(node_, scene_, options_,
              [this](const TipTarget& target) { intake_.takeFromHandle(target); }),
      intake_(node_, scene_, shapes_.baseFrame(), shapes_.response(),
              {[this] { return loop_->goal(); },
               [this](const std::string& commander, const Eigen::VectorXd& pressure) {
                 return loop_->command(commander, pressure);
               }}),
      model_server_(ros::NodeHandle("~"), scene_.model) {
  reload_ =
      std::make_unique<ReloadServer>(ros::NodeHandle("~"), options_.scene, options_.scene_folder,
                                     [this](io::Scene next) { adopt(std::move(next)); });

  const bool own = options_.regulator == "scene";
  const bool hardware = own && regulator::isHardware(requireRegulator(scene_));
  if (hardware) {
    refuseSimulatedTime();
    guard_ = startGuardProcess(options_.scene, options_.realtime_priority);
  }
  tellRealtime(hardware);
  std::unique_ptr<regulator::RegulatorIo> io;
  try {
    if (own) io = startRegulatorIo(scene_, options_.rate, options_.realtime_priority);
  } catch (...) {
    if (guard_) guard_->dismiss();  // nothing was connected
    throw;
  }
  regulator::PressurePath path({scene_.safety.channels, scene_.safety.rules}, std::move(io),
                               longestGap(options_.rate));
  path.guardedBy(guard_);
  loop_.emplace(
      node_, scene_.arm, options_.rate, options_.realtime_priority, std::move(path),
      options_.auto_enable && scene_.regulator && !regulator::isHardware(*scene_.regulator),
      [this](const PressureLoop::Reading& reading) {
        shapes_.take(reading.pressure, reading.stamp);
      });
  using Node = PressureCommandNode;
  draw_timer_ = repeat(node_, "the drawing", 1.0 / options_.draw_rate, &Node::onDraw, this);
  diagnose_timer_ = repeat(node_, "the diagnostics", 1.0, &Node::onDiagnose, this);
  logInfo("%s: %d actuators in %d sections, loop at %g Hz", scene_.name.c_str(),
          scene_.arm.actuatorCount(), scene_.arm.sectionCount(), options_.rate);
  tellTier();
}

PressureCommandNode::~PressureCommandNode() { finish(); }

int PressureCommandNode::finish() {
  const bool vented = loop_->end();
  if (guard_ && vented) guard_->dismiss();
  return loop_->verdict();
}

void PressureCommandNode::refuseSimulatedTime() const {
  if (!ros::Time::isSimTime()) return;
  if (!options_.allow_sim_time) {
    throw ParameterError("/use_sim_time is true, but scene " + scene_.name +
                         " drives hardware; end the recording or simulation that sets it, or set "
                         "~allow_sim_time to true if that is intended");
  }
  logWarning("%s: drives hardware under simulated time (~allow_sim_time)", scene_.name.c_str());
}

// Real-time priority is optional; without it, only a busy machine is affected.
void PressureCommandNode::tellRealtime(bool hardware) const {
  const int priority = options_.realtime_priority;
  if (priority == 0) return;
  const auto tell = [hardware](const std::string& refusal, const char* success) {
    if (refusal.empty()) {
      logInfo("%s", success);
    } else {
      logLine(hardware ? ros::console::levels::Warn : ros::console::levels::Info,
              "%s; without it other programs may delay a vent", refusal.c_str());
    }
  };
  tell(regulator::tryRealtime(priority), "the pressure loop has real-time priority");
  if (hardware) tell(regulator::lockMemory(), "the node's memory is locked");
}

void PressureCommandNode::tellTier() const {
  const statics::TierChoice& choice = scene_.model.choice();
  logInfo("%s: tier %s: %s", scene_.name.c_str(), choice.setting.name().c_str(),
          choice.reason.c_str());
}

void PressureCommandNode::requireSameRegulator(const io::Scene& next) const {
  const auto describe = [](const io::Scene& scene) {
    if (!scene.regulator) return std::string("none");
    const std::string channels = regulator::describeChannels(*scene.regulator);
    return regulator::describe(*scene.regulator) + (channels.empty() ? "" : ", " + channels);
  };
  if (describe(scene_) != describe(next)) {
    throw std::invalid_argument("scene " + next.name + " has another regulator: " + describe(next) +
                                ", expected " + describe(scene_) +
                                "; restart the nodes to change it");
  }
  if (!guard_) return;
  const std::string looser = control::loosened(first_safety_.channels, first_safety_.rules,
                                               next.safety.channels, next.safety.rules);
  if (!looser.empty()) {
    throw std::invalid_argument(
        "scene " + next.name + " is less safe than the one that this node started with: " + looser +
        "; restart the nodes to change that");
  }
}

void PressureCommandNode::adopt(io::Scene next) {
  next = requirePneumatic(std::move(next));
  requireSameRig(scene_, next);
  requireSameRegulator(next);
  loop_->adopt(next.arm, next.safety.channels, next.safety.rules);
  scene_ = std::move(next);
  intake_.adopt();
  model_server_.adopt(scene_.model);
  tellTier();
  shapes_.adopt();
}

// Each new error of the line once.
void PressureCommandNode::tellLineError(const regulator::IoStatus& line) {
  if (line.last_error.empty() || line.last_error == told_line_error_) return;
  told_line_error_ = line.last_error;
  logWarning("regulator: %s", line.last_error.c_str());
}

void PressureCommandNode::onDraw(const ros::SteadyTimerEvent&) {
  if (options_.handle) shapes_.moveHandle(loop_->goal());
  const PressureLoop::Snapshot path = loop_->snapshot();
  shapes_.tell(path.report, path.reason);
  shapes_.draw();
}

void PressureCommandNode::onDiagnose(const ros::SteadyTimerEvent&) {
  using diagnostic_msgs::DiagnosticStatus;
  const ros::SteadyTime now = ros::SteadyTime::now();
  const PressureLoop::Snapshot path = loop_->snapshot();
  const std::string& node = ros::this_node::getName();

  diagnostic_msgs::DiagnosticArray msg;
  msg.header.stamp = ros::Time::now();
  DiagnosticStatus loop = loop_rate_.status(node, path, now);
  shapes_.reportSilence(loop);
  msg.status = {intake_.status(node), std::move(loop), shapes_.status(node)};
  if (path.io) tellLineError(*path.io);
  for (DiagnosticStatus& status : pressureStatuses(node, scene_, path)) {
    msg.status.push_back(std::move(status));
  }
  if (guard_ && control::isGone(guard_->state())) replaceGuard();
  for (DiagnosticStatus& status : msg.status) status.hardware_id = scene_.name;
  diagnostics_publisher_.publish(msg);
  const std::string units = intake_.unitWarning();
  if (!units.empty()) logWarning("%s", units.c_str());
}

void PressureCommandNode::replaceGuard() {
  const bool tell = guard_losses_.add();
  if (tell) {
    logError(
        "the guard, which vents the arm if this node is killed, has ended or does not respond (%lu "
        "times so far): the arm vents, and another guard is started",
        guard_losses_.total());
  }
  guard_->dismiss();  // if it resumes, it must not vent an arm that the next one guards
  try {
    auto next = startGuardProcess(options_.scene, options_.realtime_priority);
    loop_->guardedBy(next);
    guard_ = std::move(next);
  } catch (const std::runtime_error& error) {
    if (tell) logError("%s; the arm stays vented until one is started", error.what());
  }
}

}  // namespace helix_arm::ros_bridge
