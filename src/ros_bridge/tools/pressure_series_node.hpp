#pragma once

#include <optional>
#include <string>

#include <ros/node_handle.h>
#include <ros/steady_timer.h>

#include "helix_arm/PressureArray.h"
#include "helix_arm/TargetStatus.h"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/pressure_plan.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/rest_request.hpp"
#include "ros_bridge/common/run_node.hpp"

namespace helix_arm::ros_bridge {

/// Private parameters of pressure_series.
struct PressureSeriesOptions {
  std::string scene;                ///< ~scene: as pressure_command's; required
  std::string data;                 ///< ~data: CSV file, or name of a shipped series; none: a tour
  procedures::SeriesTiming timing;  ///< ~ramp_s, ~hold_s (0 to 3600 [s]), ~loop
  double rate = 50.0;               ///< ~rate: of the targets, 1 to 1000 [Hz]
  bool yields = false;              ///< ~yields: pause while another commander wants the arm
  double resume_after = 3.0;  ///< ~resume_after_s: silence of the others that ends the pause [s]

  /// @throws ParameterError with every fault.
  static PressureSeriesOptions load();
};

/// Plays a table of pressures to pressure_command: the columns pressure_<i>_kpa of a data set, row
/// by row.
///
/// Subscribes
/// - pressure_command (PressureArray): start of the first ramp; nothing is sent before it arrives
/// - target_status (TargetStatus): shows that another commander has the arm, or wants it
///
/// Publishes
/// - pressure_target (PressureArray): all actuators, gauge [Pa]; those without a column stay at 0,
///   with a warning at the start
///
/// Calls pressure_command/rest after the last row and when asked to end, if the arm follows it: the
/// arm ramps down and rests. Without that service it ends all the same.
///
/// Parameters: PressureSeriesOptions.
///
/// While the arm is not enabled, or targets arrive late (or clocks differ), it sends the arm's own
/// pressures as target, and continues from there once these are accepted.
///
/// Ends with 0 after the last row or when asked to, 1 if the ROS master is lost, or if for two
/// seconds all commands are of another arm, or all targets are refused for their values; 2 on a bad
/// parameter, scene or data set, or if a row is outside the limits of the scene. No single message
/// ends it.
class PressureSeriesNode {
 public:
  /// @throws io::DocumentError, ParameterError or std::invalid_argument with every fault found.
  PressureSeriesNode();

  int finish() const { return verdict_; }
  /// The arm follows the series, or is about to: it is to be brought to rest first.
  bool mayCommand() const;

 private:
  /// Consecutive messages that indicate that the series is not for this arm.
  struct Trouble {
    int messages = 0;
    ros::SteadyTime since;
    FaultCount warnings;
    /// Counts one more; true once they are more than one or two stray messages.
    bool goesOn();
  };

  void onCommand(const PressureArrayConstPtr& command);
  void onStatus(const TargetStatusConstPtr& status);
  void onTick(const ros::SteadyTimerEvent& event);
  void publishTarget();
  /// Once no target is on its way any more, asks for rest where the arm follows; ends the node.
  /// Where no target was answered yet, repeats the last one, for CommandTrace::kPatience at most.
  /// Ends after twice that time at the latest.
  void endSeries();
  /// Targets were sent and none was answered, neither to this node nor to another that it gives way
  /// to.
  bool mayBeUnheard() const;
  /// Warns, and ends the node if the trouble persists.
  void suffer(Trouble& trouble, const std::string& what);

  const PressureSeriesOptions options_;
  const io::Scene scene_;
  const Eigen::MatrixXd rows_;                      ///< (rows x actuators) [Pa]
  std::optional<procedures::SeriesPlayer> player_;  ///< from the first command on
  Eigen::VectorXd command_;                         ///< last one in force, inside the limits [Pa]
  CommandTrace trace_;
  bool over_ = false;  ///< the last row was played
  int told_row_ = -1;
  bool yielding_ = false;
  FaultCount waits_;
  bool held_back_ = false;     ///< targets are dropped for now, whatever their values
  Trouble foreign_, refused_;  ///< commands of another arm; targets refused for their values
  int verdict_ = kDone;
  ros::SteadyTime last_of_others_;
  ros::SteadyTime last_tick_, end_began_;

  ros::NodeHandle node_;
  ros::Publisher target_publisher_;
  ros::Subscriber command_subscriber_, status_subscriber_;
  ros::SteadyTimer timer_;
};

inline bool mayEnd(const PressureSeriesNode& node) { return !node.mayCommand(); }

}  // namespace helix_arm::ros_bridge
