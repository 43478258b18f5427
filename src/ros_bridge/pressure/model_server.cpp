#include "ros_bridge/pressure/model_server.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/unit_watch.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
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

}  // namespace helix_arm::ros_bridge
