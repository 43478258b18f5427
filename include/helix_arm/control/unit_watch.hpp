#pragma once

#include <map>
#include <string>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::control {

/// Notices a commander that seems to send kilopascals where pascals are expected: all its pressures
/// have been below 1 kPa, and not all 0, for kPatience since its first target. A slow ramp from 0
/// passes 1 kPa sooner. No clock: times are arguments [s].
class UnitWatch {
 public:
  static constexpr double kSuspicious = 1e3;  ///< pressures of arms are higher [Pa]
  static constexpr double kPatience = 2.0;    ///< [s]
  /// Commanders that are remembered; further ones are not watched.
  static constexpr int kMost = 32;

  /// @param largest  largest pressure of a target that was accepted, gauge [Pa].
  void note(double now, const std::string& commander, double largest);

  /// The warning about one commander, once for each; empty if there is none.
  std::string warning(double now);

 private:
  struct Record {
    double since = 0;      ///< first target that was not all 0
    double largest = 0;    ///< so far [Pa]
    bool settled = false;  ///< warned of, or known to send pascals
  };
  std::map<std::string, Record> records_;
};

/// The warning about inputs (rows x n, [Pa or rad]) whose pressures are all below
/// UnitWatch::kSuspicious and not all 0; empty if there is none.
/// @param what  their name in it, such as "--input".
std::string kilopascalWarning(const std::string& what, const model::Arm& arm,
                              const Eigen::Ref<const Eigen::MatrixXd>& inputs);

}  // namespace helix_arm::control
