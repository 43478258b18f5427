#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/tracking/arm_filter.hpp"
#include "helix_arm/tracking/load_forks.hpp"
#include "helix_arm/tracking/tip_compliance.hpp"

namespace helix_arm::follow {

/// Finds loads on the arm, and drifts, from the pictures of a filter that watches it.
class ContactWatch {
 public:
  ContactWatch(const statics::ArmModel& model, const VisualServoConfig& config);

  /// Gives the watch a picture. @param tags  indices of the fitted tags; nothing if unknown.
  /// @param settled  as for LoadForks::see().
  void see(estimation::ArmFilter::Input picture, const std::optional<std::vector<int>>& tags,
           bool settled, estimation::ArmFilter& watch);
  /// Forgets the pictures.
  void reset();

  const estimation::ExternalLoad& load() const { return forks_.load(); }
  const estimation::Drift& drift() const { return forks_.drift(); }

 private:
  void takeTags(const std::vector<int>& tags, estimation::ArmFilter::Input& picture,
                estimation::ArmFilter& watch);

  const model::Arm arm_;
  const std::optional<estimation::PlacedView> placed_;
  estimation::TipCompliance compliance_;
  estimation::LoadForks forks_;
  // The tags whose error by placements is part of the watch's bias.
  std::optional<std::vector<int>> usual_tags_;
  int unusual_ = 0;  // pictures in a row with others
};

}  // namespace helix_arm::follow
