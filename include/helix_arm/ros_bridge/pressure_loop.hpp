#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <vector>

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>
#include <ros/steady_timer.h>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"

namespace helix_arm::ros_bridge {

/// The pressure path of a node, in a thread of its own: nothing that the node computes delays it.
///
/// Publishes pressure_command, at once on a new one and with every turn of the loop, and, where it
/// simulates the regulator, pressure_measured. All times are of a steady clock.
class PressureLoop {
 public:
  /// What the simulated regulator reported.
  struct Reading {
    Eigen::VectorXd pressure;  ///< (n) gauge [Pa]
    ros::Time stamp;
  };
  using Take = std::function<void(const Reading&)>;

  /// @param arm        whose actuators are named in the messages.
  /// @param start      (n) first command, inside the limits [Pa].
  /// @param rate       of the loop [Hz].
  /// @param regulator  that is simulated here; none where another node reports the pressures.
  /// @param take       gets the readings, in order, from the node's own callback queue; the last
  /// alone where it cannot keep up.
  PressureLoop(ros::NodeHandle node, const model::Arm& arm, const Eigen::VectorXd& start,
               double rate, std::optional<regulator::SimulatedRegulator> regulator, Take take);
  ~PressureLoop();
  PressureLoop(const PressureLoop&) = delete;
  PressureLoop& operator=(const PressureLoop&) = delete;

  /// In force from now on: (n), inside the limits [Pa].
  void command(const Eigen::VectorXd& pressure);

  /// Turns so far.
  std::uint64_t turns() const { return turns_; }

 private:
  void turn();
  void publishCommand(const ros::Time& stamp);
  void takeWaiting();

  const model::Arm arm_;
  const Take take_;
  std::atomic<std::uint64_t> turns_{0};

  std::mutex mutex_;  ///< of all that follows, and of the order of commands
  Eigen::VectorXd command_;
  std::optional<regulator::SimulatedRegulator> regulator_;
  ros::SteadyTime last_step_;  ///< of the regulator
  std::vector<Reading> waiting_;

  ros::Publisher command_publisher_, measured_publisher_;
  ros::CallbackQueue queue_;
  ros::SteadyTimer timer_;
  ros::AsyncSpinner spinner_;
};

}  // namespace helix_arm::ros_bridge
