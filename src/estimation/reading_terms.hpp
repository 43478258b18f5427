#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <vector>

#include <ceres/loss_function.h>

#include "parameter_blocks.hpp"
#include "reading_costs.hpp"

/// The readings of captures as terms of the least squares, and what they say of its parameters.
namespace helix_arm::estimation {

struct ReadingTerm {
  std::unique_ptr<ReadingCost> cost;
  std::vector<int> blocks;  ///< indices of its parameters' blocks, in the order of the cost
  /// None for twists, whose covariance is given.
  std::unique_ptr<ceres::LossFunction> loss;
  double limit;  ///< squared residuals beyond which it is an outlier

  /// At the present values; infinite where they have no shape.
  double square(const ParameterBlocks& blocks) const;
  /// That the robust loss leaves to a square, in (0, 1].
  double weight(double square) const;
};

/// The terms of a reading that was taken at some place.
std::vector<ReadingTerm> termsOf(Shared& shared, const Place& place, const Reading& reading,
                                 const ParameterBlocks& blocks);

/// The readings that an arm at these pressures would give: those of its captures, each tag once,
/// where it faces the camera.
std::vector<ReadingTerm> expectedTerms(Shared& shared, const ArmCaptures& arm,
                                       const Eigen::VectorXd& pressure,
                                       const ParameterBlocks& blocks);

/// Adds the weighted J'J of a term to that of all free parameters.
///
/// @param weigh  weight of a term with this square.
void addInformation(const ReadingTerm& term, const ParameterBlocks& blocks,
                    const std::function<double(double)>& weigh, Eigen::MatrixXd& H);

}  // namespace helix_arm::estimation
