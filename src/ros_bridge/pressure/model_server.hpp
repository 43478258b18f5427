#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>

#include "helix_arm/Forward.h"
#include "helix_arm/Inverse.h"
#include "helix_arm/Payload.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/lie/so3.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/statics/payload.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

/// Serves a node's `~forward`, `~inverse` and `~payload`: the model of its scene, for batches.
///
/// Calls are served one after the other in a thread of their own, so that a large batch delays
/// neither targets nor the pressure loop. A call that breaks a rule is answered with the rule.
class ModelServer {
 public:
  ModelServer(const ros::NodeHandle& private_node, const statics::ArmModel& model)
      : model_(std::make_shared<statics::ArmModel>(model)),
        node_(private_node),
        spinner_(1, &queue_) {
    node_.setCallbackQueue(&queue_);
    forward_ = serve(node_, names::kForward, &ModelServer::onForward, this);
    inverse_ = serve(node_, names::kInverse, &ModelServer::onInverse, this);
    payload_ = serve(node_, names::kPayload, &ModelServer::onPayload, this);
    spinner_.start();
  }

  /// Ends a call that is being served.
  ~ModelServer() {
    ends_ = true;
    forward_.shutdown();
    inverse_.shutdown();
    payload_.shutdown();
    spinner_.stop();
  }

  /// From now on of this model; calls that are being served end with the one before.
  void adopt(const statics::ArmModel& model) HELIX_ARM_EXCLUDES(mutex_) {
    auto next = std::make_shared<const statics::ArmModel>(model);
    const basics::MutexLock lock(mutex_);
    model_ = std::move(next);
  }

 private:
  /// Numbers that a call gives as one array.
  using Table =
      Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;
  static constexpr int kMostForwardRows = 10'000, kMostInverseRows = 1000;

  static Table tableOf(const std::vector<double>& numbers, const char* name, int columns,
                       int most) {
    const auto count = static_cast<Eigen::Index>(numbers.size());
    basics::require(count % columns == 0, name, " has ", count, " numbers; expected rows of ",
                    columns);
    basics::require(count / columns <= most, name, " has ", count / columns,
                    " rows; expected at most ", most, ": call again with the rest");
    return {numbers.data(), count / columns, columns};
  }

  static void requireFinite(const std::vector<double>& table, const char* name) {
    for (std::size_t i = 0; i < table.size(); ++i) {
      basics::require(std::isfinite(table[i]), name, "[", i, "] is ", table[i],
                      "; expected finite numbers");
    }
  }

  template <class Numbers>
  static void appendNumbers(const Numbers& numbers, bool found, std::vector<double>& to) {
    for (Eigen::Index i = 0; i < numbers.size(); ++i) {
      to.push_back(found ? numbers.data()[i] : std::numeric_limits<double>::quiet_NaN());
    }
  }

  /// Runs the body, whose exceptions are the answer.
  template <class Response, class Body>
  static bool answer(Response& response, const Body& body) {
    try {
      body();
      response.success = true;
    } catch (const std::exception& fault) {
      response = Response();
      response.message = basics::printableLines(fault.what());
    }
    return true;
  }

  bool onForward(const Forward::Request& request, Forward::Response& response) {
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

  bool onInverse(const Inverse::Request& request, Inverse::Response& response) {
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

  bool onPayload(const Payload::Request& request, Payload::Response& response) {
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

  std::shared_ptr<const statics::ArmModel> model() const HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    return model_;
  }

  /// Warns once of a call whose pressures seem to be in kPa.
  void watchUnit(const std::string& what, const model::Arm& arm, const Table& pressure) {
    if (warned_) return;
    const std::string warning = control::kilopascalWarning(what, arm, pressure);
    if (warning.empty()) return;
    warned_ = true;
    logWarning("%s", warning.c_str());
  }

  /// @throws std::runtime_error once the node ends.
  void goOn() const {
    if (ends_) throw std::runtime_error("the node ends; call again when it runs");
  }

  mutable basics::Mutex mutex_;
  std::shared_ptr<const statics::ArmModel> model_ HELIX_ARM_GUARDED_BY(mutex_);
  std::atomic<bool> ends_{false};
  bool warned_ = false;  // of kilopascals; touched by the thread that serves alone
  ros::CallbackQueue queue_;
  ros::NodeHandle node_;
  ros::ServiceServer forward_, inverse_, payload_;
  ros::AsyncSpinner spinner_;
};

}  // namespace helix_arm::ros_bridge
