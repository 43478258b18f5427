#include "model_server.hpp"

#include <utility>

#include "helix_arm/control/target_check.hpp"
#include "helix_arm/lie/so3.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/statics/payload.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

ModelServer::ModelServer(const ros::NodeHandle& private_node, const statics::ArmModel& model)
    : model_(std::make_shared<statics::ArmModel>(model)),
      node_(private_node),
      spinner_(1, &queue_) {
  node_.setCallbackQueue(&queue_);
  forward_ = serve(node_, names::kForward, &ModelServer::onForward, this);
  inverse_ = serve(node_, names::kInverse, &ModelServer::onInverse, this);
  payload_ = serve(node_, names::kPayload, &ModelServer::onPayload, this);
  spinner_.start();
}

ModelServer::~ModelServer() {
  ends_ = true;
  forward_.shutdown();
  inverse_.shutdown();
  payload_.shutdown();
  spinner_.stop();
}

void ModelServer::adopt(const statics::ArmModel& model) {
  auto next = std::make_shared<const statics::ArmModel>(model);
  const basics::MutexLock lock(mutex_);
  model_ = std::move(next);
}

ModelServer::Table ModelServer::tableOf(const std::vector<double>& numbers, const char* name,
                                        int columns, int most) {
  const auto count = static_cast<Eigen::Index>(numbers.size());
  basics::require(count % columns == 0, name, " has ", count, " numbers; expected rows of ",
                  columns);
  basics::require(count / columns <= most, name, " has ", count / columns,
                  " rows; expected at most ", most, ": call again with the rest");
  return {numbers.data(), count / columns, columns};
}

void ModelServer::requireFinite(const std::vector<double>& table, const char* name) {
  for (std::size_t i = 0; i < table.size(); ++i) {
    basics::require(std::isfinite(table[i]), name, "[", i, "] is ", table[i],
                    "; expected finite numbers");
  }
}

bool ModelServer::onForward(const Forward::Request& request, Forward::Response& response) {
  return answer(response, [&] {
    const auto model = this->model();
    const Table pressure =
        tableOf(request.pressure, "pressure", model->arm().actuatorCount(), kMostForwardRows);
    watchUnit("a call to ~forward", model->arm(), pressure);
    response.rows = static_cast<std::uint32_t>(pressure.rows());
    response.sections = static_cast<std::uint32_t>(model->arm().sectionCount());
    for (Eigen::Index row = 0; row < pressure.rows(); ++row) {
      goOn();
      // Pressures outside the limits throw, naming the actuator.
      const statics::Solution found = model->solve(Eigen::VectorXd(pressure.row(row)));
      const bool converged = found.converged();
      response.converged.push_back(converged);
      appendNumbers(found.tip.translation, converged, response.position);
      appendNumbers(lie::quaternionXyzw(found.tip.rotation), converged, response.orientation);
      appendNumbers(found.shape.twists(), converged, response.twist);
    }
  });
}

bool ModelServer::onInverse(const Inverse::Request& request, Inverse::Response& response) {
  return answer(response, [&] {
    const auto model = this->model();
    const int n = model->arm().actuatorCount(), starts = request.start.empty() ? 0 : 1;
    const Table position = tableOf(request.position, "position", 3, kMostInverseRows);
    requireFinite(request.position, "position");
    requireFinite(request.start, "start");
    basics::require(request.start.size() == static_cast<std::size_t>(starts * n), "start has ",
                    request.start.size(), " pressures; expected ", n, " or none");
    const Table given(request.start.data(), starts, n);
    watchUnit("start of a call to ~inverse", model->arm(), given);
    statics::InverseOptions options;
    if (!request.prefer.empty()) options.preference = statics::preferenceOf(request.prefer);
    const Eigen::VectorXd start =
        starts == 0 ? model->arm().inputAt(0.0) : Eigen::VectorXd(given.row(0));
    statics::InverseSolver solver(*model, options);
    response.rows = static_cast<std::uint32_t>(position.rows());
    for (Eigen::Index row = 0; row < position.rows(); ++row) {
      goOn();
      const statics::InverseResult& found =
          solver.toPosition(Eigen::Vector3d(position.row(row)), start);
      response.status.emplace_back(inverseWord(found.status));
      appendNumbers(found.input, true, response.pressure);
      response.position_error.push_back(found.position_error);
    }
  });
}

bool ModelServer::onPayload(const Payload::Request& request, Payload::Response& response) {
  return answer(response, [&] {
    requireFinite(request.position, "position");
    requireFinite(request.direction, "direction");
    basics::require(request.position.size() == 3, "position has ", request.position.size(),
                    " numbers; expected 3");
    const Table given = tableOf(request.direction, "direction", 3, kMostInverseRows);
    Eigen::Matrix3Xd directions = statics::payloadDirections();
    if (given.rows() > 0) directions = given.transpose().colwise().normalized();
    statics::PayloadSolver solver(*model());
    solver.moveTo(Eigen::Vector3d(request.position.data()));
    response.reached = solver.isThere();
    response.rows = static_cast<std::uint32_t>(directions.cols());
    appendNumbers(directions, true, response.direction);
    for (const auto& direction : directions.colwise()) {
      goOn();
      const statics::Payload found = solver.along(direction);
      response.force.push_back(found.force);
      response.end.emplace_back(statics::nameOf(found.end));
    }
  });
}

std::shared_ptr<const statics::ArmModel> ModelServer::model() const {
  const basics::MutexLock lock(mutex_);
  return model_;
}

void ModelServer::watchUnit(const std::string& what, const model::Arm& arm, const Table& pressure) {
  if (warned_) return;
  const std::string warning = control::kilopascalWarning(what, arm, pressure);
  if (warning.empty()) return;
  warned_ = true;
  logWarning("%s", warning.c_str());
}

void ModelServer::goOn() const {
  if (ends_) throw std::runtime_error("the node ends; call again when it runs");
}

}  // namespace helix_arm::ros_bridge
