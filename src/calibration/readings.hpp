#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include "calibration_checks.hpp"
#include "helix_arm/calibration/calibration.hpp"
#include "localization/twist_equations.hpp"
#include "parameter_blocks.hpp"
#include "shape_model.hpp"

/// State that the costs of a calibration share, and the arm and lengths of each.
namespace helix_arm::estimation {

// Data that all costs share.
struct Shared {
  const std::vector<ArmCaptures>& arms;
  const CalibrationOptions options;
  const std::vector<ArmCaptures> states;  // see statesOf()
  ShapeModel model;
  // (captures) shapes of the model before the search, for free shapes: the deviations of a
  // section's pieces from its mean are the model's.
  std::vector<model::Shape> expected_shapes;
  TwistFitOptions expected;  // noise of tags
  int held_tag;              // index of the tag that defines the reference frame

  Shared(const std::vector<ArmCaptures>& all, const CalibrationOptions& wanted)
      : arms(all),
        options(wanted),
        states(statesOf(all)),
        model(states, freeStiffness(wanted)),
        held_tag(all.front().layout.baseTag()) {
    expected.corner_noise = options.corner_noise;
    expected.position_noise = options.position_noise;
    expected.rotation_noise = options.rotation_noise;
  }

  int scales() const { return lengthScales(options, arms.front().arm); }
  double scaleOf(const Eigen::VectorXd& logs, int actuator) const {
    if (logs.size() == 0) return 1;
    return std::exp(logs[logs.size() == 1 ? 0 : actuator]);
  }
};

// Arm, capture and lengths of readings.
struct Place {
  int arm, capture;          // capture: index over all arms
  Eigen::VectorXd lengths;   // at its pressures [m]
  Eigen::VectorXd rest;      // at the lower end of the curves [m]
  std::vector<int> entries;  // free entries of the twists, for free shapes
  // Derivatives of lengths and rest (actuators x numbers of the fitted curve, if there is one) [m].
  Eigen::MatrixXd by_curve, rest_by_curve;
  int state;  // of Shared::states

  // With these values of the curve's numbers.
  Eigen::VectorXd lengthsAt(const Eigen::VectorXd& curve) const {
    return lengths + by_curve * curve;
  }
  Eigen::VectorXd restAt(const Eigen::VectorXd& curve) const {
    return rest + rest_by_curve * curve;
  }
};

Place placeAt(const Shared& shared, int arm, int capture, const Eigen::VectorXd& pressure);

// The shape of a capture and, if the model determines it, its derivatives.
LinearisedShape shapeAt(Shared& shared, const Place& place, const ParameterBlocks& values,
                        bool derivatives);

// Residuals of a calibration's readings, in expected standard deviations, and their derivatives.

// State that all readings of a capture share at given values of the parameters.
struct CaptureState {
  LinearisedShape shape;
  // The rest is for readings of tags.
  Corners corners;
  std::vector<lie::SE3> starts;  // X_B0j of the pieces
  // With derivatives: motion of the whole arm with the base, and beyond each piece with its twist.
  std::vector<PointJacobian> base, whole;
};

// One reading as a term of the least-squares problem.
class ReadingCost {
 public:
  // @param place  must outlive the cost.
  // @param tag  index in the layout; -1 if it is not of a tag, so that the rig is not fitted.
  ReadingCost(const Shared& shared, const Place& place, int residuals,
              const ParameterBlocks& blocks, int tag = -1);
  virtual ~ReadingCost() = default;
  ReadingCost(const ReadingCost&) = delete;
  ReadingCost& operator=(const ReadingCost&) = delete;

  // Indices of its parameter blocks, in the order of its columns.
  const std::vector<int>& blocks() const { return blocks_; }
  int residuals() const { return residuals_; }
  int tag() const { return tag_; }

  // Whether the tag, if it is one, faces the camera.
  virtual bool faces(const CaptureState&, const ParameterBlocks&) const { return true; }

  // Squared residuals beyond which the reading is an outlier; infinite for twists, whose covariance
  // is given.
  double limit() const { return limit_; }
  // Part of the robust sum of squares (Cauchy) that a square contributes.
  double loss(double square) const {
    return std::isfinite(limit_) ? limit_ * std::log1p(square / limit_) : square;
  }
  // Weight of a square from the robust loss, its derivative, in (0, 1].
  double weight(double square) const { return 1 / (1 + square / limit_); }

  // False if it has no residuals there.
  // @param J  (residuals x columns); null: without derivatives, which the state then lacks, too.
  // @param by_pieces  workspace.
  virtual bool evaluate(const CaptureState& state, const ParameterBlocks& values,
                        Eigen::VectorXd& residual, Eigen::MatrixXd* J,
                        Eigen::MatrixXd& by_pieces) const = 0;
  // The error for reports. @param square  of its residuals.
  virtual double shown(const CaptureState& state, const ParameterBlocks& values,
                       double square) const = 0;

 protected:
  // First column of the derivatives by a block; -1 without one.
  int columnOf(ParameterBlock kind) const { return first_[static_cast<std::size_t>(kind)]; }
  // Converts derivatives with respect to the pieces' twists to derivatives with respect to the
  // parameter blocks. Uses as many rows as there are residuals.
  void passOn(const Eigen::MatrixXd& by_pieces, const LinearisedShape& shape,
              Eigen::MatrixXd& J) const;

  const Shared& shared_;
  const Place& place_;
  double limit_;

 private:
  const int residuals_, tag_;
  std::vector<int> blocks_;
  std::array<int, kParameterBlockCount> first_;
  int columns_ = 0;
};
using ReadingCosts = std::vector<std::unique_ptr<ReadingCost>>;

/// The terms of one reading.
///
/// @param place  must outlive them.
ReadingCosts termsOf(const Shared& shared, const Place& place, const Reading& reading,
                     const ParameterBlocks& blocks);

/// State that the readings of a capture share at these values.
///
/// @param kind  of its readings.
CaptureState stateAt(Shared& shared, const Place& place, ReadingKind kind,
                     const ParameterBlocks& values, bool derivatives);

/// The readings that an arm is expected to give at the pressures of a place: those of its captures,
/// each tag once, if it faces the camera.
///
/// @param place  must outlive them. @param state  there, at the current values.
ReadingCosts expectedTerms(const Shared& shared, const Place& place, const CaptureState& state,
                           const ParameterBlocks& blocks);

}  // namespace helix_arm::estimation
