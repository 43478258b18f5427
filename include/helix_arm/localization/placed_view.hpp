#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "helix_arm/localization/arm_view.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/shape.hpp"

namespace helix_arm::estimation {

/// Standard deviations of the errors of placements, each along or about one axis [m, rad].
struct PlacementDeviations {
  std::vector<lie::Vector6> tags;            ///< (tags of the layout) displacements as of movedBy()
  lie::Vector6 base = lie::Vector6::Zero();  ///< of xi: the true base is at exp(xi) of the nominal

  /// Deviations by the priors. The base tag has none: it defines the reference frame.
  PlacementDeviations(const TagLayout& layout, const TagPrior& tag, const BasePrior& base);
};

/// A camera whose tags measure an arm, and how well their placements are known.
struct PlacedView {
  ArmView view;  ///< nominal
  TwistFitOptions fit;
  PlacementDeviations deviations;

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const { view.validate(); }
};

/// Covariance (6 sections x 6 sections) [m, rad] of the errors of fitted mean twists that errors of
/// the placements cause. Every fit of the same tags has the same error: it does not average out.
///
/// With x the fit's parameters, C the corners' derivative by x, D that by the placements and W the
/// weights, x errs by (C' W C)^-1 C' W D d for placements that err by d. Priors of the fit are part
/// of C' W C; a free base and a free border shift are part of x.
///
/// @param shape  the arm's, seen from the base.
/// @param tags   indices of the fitted tags, each once.
/// @return nothing if a corner is behind the camera.
std::optional<Eigen::MatrixXd> placementCovariance(const PlacedView& placed, const model::Arm& arm,
                                                   const model::Shape& shape,
                                                   const std::vector<int>& tags);

/// Covariance of how fits of two sets of tags differ by errors of the placements, which are the
/// same for the tags that both contain. Otherwise as placementCovariance().
std::optional<Eigen::MatrixXd> placementDifference(const PlacedView& placed, const model::Arm& arm,
                                                   const model::Shape& shape,
                                                   const std::vector<int>& tags,
                                                   const std::vector<int>& others);

/// Covariance of what errors of the placements make of base and border shift, as far as they are
/// fitted, in a fit without priors of them. Arguments, result and exceptions as above.
std::optional<RigEstimate::Matrix> rigByPlacements(const PlacedView& placed, const model::Arm& arm,
                                                   const model::Shape& shape,
                                                   const std::vector<int>& tags);

}  // namespace helix_arm::estimation
