#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>

#include "basics/mutex.hpp"
#include "basics/quote.hpp"
#include "helix_arm/Forward.h"
#include "helix_arm/Inverse.h"
#include "helix_arm/Payload.h"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/arm_model.hpp"

namespace helix_arm::ros_bridge {

/// Serves a node's `~forward`, `~inverse` and `~payload`: the model of its scene, for batches.
///
/// Calls are served one after the other in a thread of their own, so that a large batch delays
/// neither targets nor the pressure loop. A call that breaks a rule is answered with the rule.
class ModelServer {
 public:
  ModelServer(const ros::NodeHandle& private_node, const statics::ArmModel& model);

  /// Ends a call that is being served.
  ~ModelServer();

  /// From now on of this model; calls that are being served end with the one before.
  void adopt(const statics::ArmModel& model) HELIX_ARM_EXCLUDES(mutex_);

 private:
  /// Numbers that a call gives as one array.
  using Table =
      Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;
  static constexpr int kMostForwardRows = 10'000, kMostInverseRows = 1000;
  static Table tableOf(const std::vector<double>& numbers, const char* name, int columns, int most);
  static void requireFinite(const std::vector<double>& table, const char* name);

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

  bool onForward(const Forward::Request& request, Forward::Response& response);
  bool onInverse(const Inverse::Request& request, Inverse::Response& response);
  bool onPayload(const Payload::Request& request, Payload::Response& response);
  std::shared_ptr<const statics::ArmModel> model() const HELIX_ARM_EXCLUDES(mutex_);

  /// Warns once of a call whose pressures seem to be in kPa.
  void watchUnit(const std::string& what, const model::Arm& arm, const Table& pressure);

  /// @throws std::runtime_error once the node ends.
  void goOn() const;

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
