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
  double scaleOf(const Eigen::VectorXd& logs, int actuator) const {
    if (logs.size() == 0) return 1;
    return std::exp(logs[logs.size() == 1 ? 0 : actuator]);
  }
};

// Arm, capture and lengths of readings.
struct Place {
  int arm, capture;          // capture: index over all arms
  Eigen::VectorXd lengths;   // at its pressures [m]
  std::vector<int> entries;  // free entries of the twists, for free shapes
  Eigen::MatrixXd by_curve;  // (actuators x numbers of the curve), if one is fitted [m]

  // With these values of the curve's numbers.
  Eigen::VectorXd lengthsAt(const Eigen::VectorXd& curve) const {
    if (by_curve.size() == 0) return lengths;
    return lengths + by_curve * curve;
  }
};

inline Place placeAt(const Shared& shared, int arm, int capture, const Eigen::VectorXd& pressure) {
  const ArmCaptures& data = shared.arms[arm];
  Place place{arm, capture, data.arm.lengths(pressure), freeEntries(data), {}};
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

// The shape of a capture and, if the model determines it, its derivatives.
inline ShapeThere shapeAt(Shared& shared, const Place& place, const Values& values,
                          bool derivatives) {
  if (shared.selection.free_shapes) {
    model::Twists twists = model::Twists::Zero(6, shared.arms[place.arm].arm.sectionCount());
    for (std::size_t i = 0; i < place.entries.size(); ++i) {
      twists.data()[place.entries[i]] = values.shapes[place.capture][static_cast<Eigen::Index>(i)];
    }
    ShapeThere shape;
    shape.shape = shared.expected_shapes[place.capture].about(twists);
    return shape;
  }
  const Eigen::VectorXd unscaled = place.lengthsAt(values.curve);
  Eigen::VectorXd lengths = unscaled;
  for (int i = 0; i < lengths.size(); ++i) lengths[i] *= shared.scaleOf(values.length_scale, i);
  const double* const stiffness = values.stiffness.data();
  if (place.by_curve.size() == 0) {
    return shared.model.at(place.arm, lengths, stiffness, shared.scales(), derivatives);
  }
  // The derivatives with respect to each length give those with respect to scales and curve.
  ShapeThere shape =
      shared.model.at(place.arm, lengths, stiffness, static_cast<int>(lengths.size()), derivatives);
  if (!derivatives) return shape;
  shape.by_curve = shape.by_scale * unscaled.cwiseInverse().asDiagonal() * place.by_curve;
  if (shared.scales() == 1) shape.by_scale = shape.by_scale.rowwise().sum().eval();
  return shape;
}

}  // namespace helix_arm::estimation
