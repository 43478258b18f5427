#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <diagnostic_msgs/DiagnosticStatus.h>

#include "helix_arm/follow/visual_servo.hpp"
#include "ros_bridge/common/diagnostics.hpp"

namespace helix_arm::ros_bridge {

/// Notices that the arm differs lastingly from its calibration: parameters that lie beyond
/// kSigmas of their prior deviations for kPatience, and are known better than kKnown of these.
class CalibrationWatch {
 public:
  static constexpr double kPatience = 60.0;  ///< [s]
  static constexpr double kSigmas = 3.0;
  static constexpr double kKnown = 1.0 / 3.0;

  /// Logarithms of the factors on parameters of the arm, with their standard deviations.
  struct Estimate {
    const std::vector<std::string>& names;
    const Eigen::VectorXd& value;      ///< (parameters)
    const Eigen::VectorXd& deviation;  ///< (parameters)
    const Eigen::VectorXd& prior;      ///< (parameters) deviations of the calibration
  };

  /// Notes an estimate. @param time  [s]; one before the last starts anew.
  void note(double time, const Estimate& estimate);
  /// What to calibrate again, such as "length of muscle_2 +0.8 %"; empty if nothing.
  const std::string& advice() const { return advice_; }

 private:
  double last_time_ = 0.0;
  std::vector<std::optional<double>> since_;  ///< (parameters)
  std::string advice_;
};

/// Counts pictures, and says how the loop is doing.
class LoopDiagnostics {
 public:
  /// Notes what became of a picture. @param lead  of its stamp over that of the last reading [s].
  /// @param filter  the loop's tracker. @param with_tags  the tags of its fit are known.
  void saw(double time, double lead, const estimation::Observation& observation,
           const estimation::ArmFilter& filter, bool with_tags);
  /// Notes a `measured` that is not of this arm.
  void sawForeign(const std::string& why);

  std::uint64_t accepted() const { return accepted_; }
  std::uint64_t refused() const { return refused_; }
  /// If the last picture was refused for its stamp: how far that is off, and the remedy; else
  /// empty.
  const std::string& wrongStamp() const { return wrong_stamp_; }

  /// The status `<node>: loop`: its state, and pictures by their faults.
  diagnostic_msgs::DiagnosticStatus loop(const std::string& node, const follow::VisualServo& loop,
                                         const std::string& message) const;
  /// The status `<node>: correction`: how the arm differs from its model; WARN if it is to be
  /// calibrated again.
  diagnostic_msgs::DiagnosticStatus correction(const std::string& node,
                                               const follow::VisualServo& loop) const;

 private:
  std::uint64_t accepted_ = 0, refused_ = 0;
  std::uint64_t without_tags_ = 0;  ///< of accepted_
  std::array<std::uint64_t, estimation::kObservationFaultCount> by_fault_ = {};
  std::string wrong_stamp_;
  FaultCount foreign_;
  CalibrationWatch calibration_;
};

}  // namespace helix_arm::ros_bridge
