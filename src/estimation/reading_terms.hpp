#pragma once

#include <Eigen/Core>
#include <limits>
#include <memory>
#include <vector>

#include "calibration_checks.hpp"
#include "parameter_blocks.hpp"
#include "reading_costs.hpp"

/// Readings of captures as terms of the least-squares problem.
namespace helix_arm::estimation {

struct ReadingTerm {
  std::unique_ptr<ReadingCost> cost;
  std::vector<int> blocks;  ///< indices of its parameter blocks, in the order of its columns
  /// Squared residuals beyond which the reading is an outlier; infinite for twists, whose
  /// covariance is given.
  double limit = std::numeric_limits<double>::infinity();

  bool isRobust() const { return limit < std::numeric_limits<double>::infinity(); }
  /// Part of the robust sum of squares (Cauchy) that a square contributes.
  double loss(double square) const;
  /// Weight of a square from the robust loss, its derivative, in (0, 1].
  double weight(double square) const { return 1 / (1 + square / limit); }
};

/// The terms of one reading.
///
/// @param place  must outlive them.
std::vector<ReadingTerm> termsOf(const Shared& shared, const Place& place, const Reading& reading,
                                 const ParameterBlocks& blocks);

/// What the readings of a capture share at these values.
///
/// @param kind  of its readings.
CaptureState stateAt(Shared& shared, const Place& place, ReadingKind kind, const Values& values,
                     bool derivatives);

/// The readings that an arm is expected to give at the pressures of a place: those of its captures,
/// each tag once, if it faces the camera.
///
/// @param place  must outlive them. @param state  there, at the current values.
std::vector<ReadingTerm> expectedTerms(const Shared& shared, const Place& place,
                                       const CaptureState& state, const ParameterBlocks& blocks);

/// Adds the weighted J'J of a term to that of all free parameters.
///
/// @param J  (residuals x stride) row major.
void addInformation(const ReadingTerm& term, const ParameterBlocks& blocks, const double* J,
                    double weight, Eigen::MatrixXd& H);

}  // namespace helix_arm::estimation
