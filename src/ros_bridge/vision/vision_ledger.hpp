#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include <diagnostic_msgs/DiagnosticStatus.h>

#include "helix_arm/VisionStatus.h"
#include "helix_arm/vision/arm_localizer.hpp"
#include "pictures.hpp"
#include "ros_bridge/common/diagnostics.hpp"

namespace helix_arm::ros_bridge {

/// Keeps account of what the camera sees: state, counters, and warnings that come once in a while
/// however often their reason does.
class VisionLedger {
 public:
  /// @param waiting  what the first picture is waited for.
  explicit VisionLedger(const std::string& waiting);

  void picture() { ++status_.pictures; }
  void skipped() { ++status_.skipped; }
  void refused(const PictureRefusal& refusal);
  /// What was seen in a picture.
  /// @param tags  of the arm in sight, each seen once.
  void saw(const vision::Observation& observation, int tags);

  /// Whose intrinsics hold, in words.
  void calibrated(const std::string& whose) { calibration_ = whose; }
  /// How far the models' stamps were behind the last picture's [s]; nothing without models.
  void modelLag(std::optional<double> lag) { model_lag_ = lag; }

  /// The state from now on: one of VisionStatus.
  /// @return true when it is another one than before.
  bool enter(std::uint8_t state, const std::string& message);
  std::uint8_t state() const { return status_.state; }
  bool measured() const { return status_.state == VisionStatus::MEASURED; }

  /// The account, to be stamped.
  const VisionStatus& status() const { return status_; }

  /// Adds it to diagnostics: `camera` tells of the pictures, `measurement` of what is seen in them.
  ///
  /// @param seconds  since the last call.
  void report(diagnostic_msgs::DiagnosticStatus& camera,
              diagnostic_msgs::DiagnosticStatus& measurement, double seconds);

 private:
  std::uint64_t& counterOf(PictureFault fault);

  VisionStatus status_;
  VisionStatus reported_;  ///< at the last report
  std::uint64_t reported_faults_ = 0;
  std::string calibration_;
  std::optional<double> model_lag_;
  std::array<FaultCount, kPictureFaultCount> faults_;
  std::array<FaultCount, VisionStatus::ENDED + 1> states_;
};

/// Name of a state of VisionStatus: `measured`, `few_tags`, ...
const char* nameOfState(std::uint8_t state);

}  // namespace helix_arm::ros_bridge
