#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

#include "basics/mutex.hpp"
#include "helix_arm/PressureArray.h"
#include "helix_arm/SafetyState.h"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/model/arm.hpp"
#include "regulator/guard_process.hpp"
#include "regulator/realtime.hpp"
#include "regulator/regulator_io.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/run_node.hpp"

namespace helix_arm::ros_bridge {

/// The pressure path of a node in its own thread: no other work of the node delays it, or a stop.
///
/// Readings from a topic have their own thread too, so that they cannot delay a stop.
///
/// Publishes pressure_command, immediately on a new target and with every turn; pressure_measured,
/// if the regulator is the node's own; and safety_state, latched, on every change, with a line in
/// the log. Serves ~enable, ~rest, ~vent and ~emergency_stop. All times are of the steady clock.
class PressureLoop {
 public:
  /// A reading, and the command in force.
  struct Reading {
    Eigen::VectorXd pressure, set_point;  ///< (n) gauge [Pa]
    ros::Time stamp;
  };
  using Take = std::function<void(const Reading&)>;
  /// Why a target (n) [Pa] is not let through; nothing if it may be commanded.
  using Gate = std::function<std::optional<control::Refusal>(const PressureLoop& loop,
                                                             const Eigen::VectorXd& target)>;

  /// The pressure path at one moment.
  struct Snapshot {
    control::SafetyReport report;
    std::string reason;
    control::ValveOrders orders;
    Eigen::VectorXd goal, reading;          ///< (n) [Pa]; reading NaN before the first
    std::optional<regulator::IoStatus> io;  ///< where the regulator is the node's own
    std::uint64_t turns = 0;                ///< so far
    FaultCount bad_readings;
  };

  /// @param arm                Its actuators are named in the messages.
  /// @param rate               Turns of the loop per second [Hz].
  /// @param realtime_priority  Of its thread, as scheduleRealtime(), where that is allowed.
  /// @param path               Without I/O, readings come from pressure_measured of another node.
  /// @param auto_enable        A target enables the path, as SafetyCore::mayEnableItself() allows.
  /// @param gate               Asked before each command, in the thread that commands.
  /// @param take               Receives the readings, in order, from the node's own callback
  ///                           queue; only the last where it cannot keep up.
  PressureLoop(ros::NodeHandle node, const model::Arm& arm, double rate, int realtime_priority,
               regulator::PressurePath path, bool auto_enable, Gate gate, Take take);

  ~PressureLoop();

  /// Sets the target of a commander: (n), inside the limits [Pa]. After a rest that another asked
  /// for, it is refused until it pauses for target_timeout, asks for rest, or the arm is enabled.
  /// A target that the gate refuses leaves the command as it is; its commander is not silent.
  std::optional<control::Refusal> command(const std::string& commander,
                                          const Eigen::VectorXd& pressure)
      HELIX_ARM_EXCLUDES(mutex_);

  /// Keeps the set points where they are, unless the arm goes to rest.
  void hold() HELIX_ARM_EXCLUDES(mutex_);

  /// Replaces the rules of the same channels, and the arm with the same actuators.
  /// @throws std::invalid_argument as SafetyCore::adopt; the old ones stay.
  void adopt(const model::Arm& arm, std::vector<control::ChannelRules> channels,
             const control::SafetyRules& rules) HELIX_ARM_EXCLUDES(mutex_);

  /// As PressurePath::guardedBy().
  void guardedBy(std::shared_ptr<const regulator::GuardProcess> guard) HELIX_ARM_EXCLUDES(mutex_);
  /// If the regulator is the node's own, vents and waits for a limited time until no pressure
  /// remains. Does nothing from then on.
  /// @return whether the readings confirm that it is vented.
  bool end() HELIX_ARM_EXCLUDES(mutex_);
  /// Exit code of the node as far as the loop is concerned.
  int verdict() const { return thread_.verdict(); }

  /// (n) target of the commands [Pa]
  Eigen::VectorXd goal() const HELIX_ARM_EXCLUDES(mutex_);

  Snapshot snapshot() const HELIX_ARM_EXCLUDES(mutex_);

 private:
  using Trigger = std_srvs::Trigger;
  using SetBool = std_srvs::SetBool;

  /// If more readings wait, the receiver is slower than the loop and gets only the last one.
  static constexpr std::size_t kMostReadings = 4;

  /// Takes the readings that wait, as an entry of the node's callback queue.
  struct Taking : ros::CallbackInterface {
    explicit Taking(PressureLoop* of) : loop(of) {}
    CallResult call() override {
      loop->takeWaiting();
      return Success;
    }
    PressureLoop* const loop;
  };

  static ros::NodeHandle onQueue(ros::NodeHandle node, ros::CallbackQueue& queue);

  /// Age of a reading [s]; 0 without a stamp, and in simulated time, which may outrun real time.
  static double ageOf(const ros::Time& stamp);
  static SafetyState toSafetyMsg(const ros::Time& stamp, const regulator::PressurePath& path);
  static LogLevel levelOf(const control::SafetyReport& report);
  bool onEnable(const Trigger::Request&, Trigger::Response& response);
  bool onRest(ros::ServiceEvent<Trigger::Request, Trigger::Response>& call);
  bool onVent(const Trigger::Request&, Trigger::Response& response);
  bool onStop(const SetBool::Request& request, SetBool::Response& response);
  void onReading(const PressureArrayConstPtr& reading);
  void turn(double now) HELIX_ARM_REQUIRES(mutex_);
  void publish(double now) HELIX_ARM_REQUIRES(mutex_);
  void noteChanges(const ros::Time& stamp) HELIX_ARM_REQUIRES(mutex_);
  void post(Reading reading) HELIX_ARM_REQUIRES(mutex_);
  void run();
  void takeWaiting() HELIX_ARM_EXCLUDES(mutex_);

  const double period_;  ///< [s]
  const int realtime_priority_;
  const bool auto_enable_;
  const Gate gate_;
  const Take take_;

  mutable regulator::PriorityMutex mutex_;  ///< also orders the commands
  model::Arm arm_ HELIX_ARM_GUARDED_BY(mutex_);
  regulator::PressurePath path_ HELIX_ARM_GUARDED_BY(mutex_);
  std::string commander_ HELIX_ARM_GUARDED_BY(mutex_);  ///< of the last target
  control::RestedCommanders rested_ HELIX_ARM_GUARDED_BY(mutex_);
  std::uint64_t turns_ HELIX_ARM_GUARDED_BY(mutex_) = 0;
  std::optional<std::uint64_t> changes_noted_ HELIX_ARM_GUARDED_BY(mutex_);
  FaultCount bad_readings_ HELIX_ARM_GUARDED_BY(mutex_);
  std::vector<Reading> waiting_ HELIX_ARM_GUARDED_BY(mutex_);

  ros::CallbackQueue queue_;  ///< queue of the members below, which leave it when destroyed
  ros::Publisher command_publisher_, measured_publisher_, safety_publisher_;
  ros::ServiceServer enable_server_, rest_server_, vent_server_, stop_server_;
  /// For the readings only, so that no reading, however large, delays a stop.
  ros::CallbackQueue reading_queue_;
  ros::Subscriber reading_subscriber_;
  ros::AsyncSpinner reading_spinner_;
  FaultGuard take_guard_;
  std::atomic<bool> ends_{false};
  GuardedThread thread_;  ///< of the queue and the turns
};

}  // namespace helix_arm::ros_bridge
