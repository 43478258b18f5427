#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

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

}  // namespace helix_arm::ros_bridge
