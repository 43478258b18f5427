#pragma once

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "helix_arm/estimation/calibration.hpp"
#include "parameter_blocks.hpp"
#include "shape_model.hpp"

/// What the costs of a calibration share, and the arm and lengths of each.
namespace helix_arm::estimation {

// Entries of an arm's twists that are free if shapes are fitted.
inline std::vector<int> freeEntries(const ArmCaptures& arm) {
  std::vector<int> entries;
  for (int entry = 0; entry < 6 * arm.arm.sectionCount(); ++entry) {
    const int axis = entry % 6;
    if (!arm.planar || axis < 2 || axis == 5) entries.push_back(entry);
  }
  return entries;
}

// Data that all costs share.
struct Shared {
  const std::vector<ArmCaptures>& arms;
  const CalibrationOptions& options;
  Selection selection;
  ShapeModel model;
  double inverse_noise = 1;  // 1 / scale of the expected noise
  // (captures) shapes of the model before the search, for free shapes: the deviations of a
  // section's pieces from its mean are the model's.
  std::vector<model::Shape> expected_shapes;
  TwistFitOptions expected;  // noise of tags
  int held_tag;              // index of the tag that defines the reference frame

  Shared(const std::vector<ArmCaptures>& all, const CalibrationOptions& wanted,
         const Selection& chosen)
      : arms(all),
        options(wanted),
        selection(chosen),
        model(all, chosen.stiffness),
        held_tag(all.front().layout.baseTag()) {
    expected.corner_noise = options.corner_noise;
    expected.position_noise = options.position_noise;
    expected.rotation_noise = options.rotation_noise;
  }

  int scales() const { return lengthScales(selection, arms.front().arm); }
  double scaleOf(const double* logs, int actuator) const {
    if (scales() == 0) return 1;
    return std::exp(logs[scales() == 1 ? 0 : actuator]);
  }
};

// Arm, capture and lengths of a reading.
struct Place {
  int arm, capture;          // capture: index over all arms
  Eigen::VectorXd lengths;   // at its pressures [m]
  Eigen::MatrixXd by_curve;  // (actuators x numbers of the curve), if one is fitted [m]

  // With these values of the curve's numbers.
  Eigen::VectorXd lengthsAt(const double* curve) const {
    if (by_curve.size() == 0) return lengths;
    return lengths + by_curve * Eigen::Map<const Eigen::VectorXd>(curve, by_curve.cols());
  }
};

inline Place placeAt(const Shared& shared, int arm, int capture, const Eigen::VectorXd& pressure) {
  const ArmCaptures& data = shared.arms[arm];
  Place place{arm, capture, data.arm.lengths(pressure), {}};
  if (!shared.selection.has(ParameterBlock::kCurve)) return place;
  place.by_curve.setZero(pressure.size(), shared.arms.front().free_curve->spline.lengths.size());
  for (int i = 0; data.free_curve && i < pressure.size(); ++i) {
    if (!data.free_curve->actuators[i]) continue;
    const ContractionSpline& spline = data.free_curve->spline;
    const Eigen::RowVectorXd weights = spline.weights(pressure[i]);
    place.lengths[i] = weights * spline.lengths;
    place.by_curve.row(i) = weights * spline.root;
  }
  return place;
}

}  // namespace helix_arm::estimation
