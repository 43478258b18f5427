#pragma once

#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/FollowTipPathFeedback.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/procedures/tip_record.hpp"
#include "ros_bridge/common/diagnostics.hpp"

namespace helix_arm::ros_bridge {

/// Records a goal of follow_tip_path: a row for each picture that the loop used, with wanted,
/// model, predicted and measured tip, pressures and state at the time of the picture.
///
/// Subscribes to model, pressure_command and pressure_measured; the client of the action hands on
/// its feedback: roscpp reads an empty message out of bounds where a node subscribes to a topic
/// twice. For the thread of the node's callback queue.
class RunRecorder {
 public:
  /// Where a record goes; empty: nowhere.
  struct Files {
    std::string table;   ///< .csv
    std::string figure;  ///< .png
    bool any() const { return !table.empty() || !figure.empty(); }
  };

  /// @param path    file of the path, named in the record.
  /// @param end     time of the path's last point [s].
  RunRecorder(ros::NodeHandle& node, Files files, std::string path, double end);

  /// Adds a row, unless a number in it is not finite.
  void add(const FollowTipPathFeedback& feedback);
  /// Whether all rows have got what other topics say of their times.
  bool isComplete() const { return record_.isComplete(); }
  /// Writes the files. @param outcome  how the goal ended, in a line.
  /// @return why that failed; empty if it did not.
  std::string write(const std::string& outcome);

 private:
  void onModel(const ArmShapeConstPtr& model);
  void onCommand(const PressureArrayConstPtr& command);
  void onMeasured(const PressureArrayConstPtr& measured);
  void add(procedures::TimeSeries& series, const PressureArray& message);
  std::string tableOf(const std::vector<procedures::TipRow>& rows,
                      const std::string& outcome) const;
  std::string reportOf(const std::vector<procedures::TipRow>& rows) const;

  const Files files_;
  const std::string path_;
  const double end_;
  std::string frame_;               ///< of the tips, by the first feedback
  std::vector<std::string> names_;  ///< of the actuators, by the first pressures
  procedures::TipRecord record_;
  FaultCount foreign_;
  ros::Subscriber model_subscriber_, command_subscriber_, measured_subscriber_;
};

}  // namespace helix_arm::ros_bridge
