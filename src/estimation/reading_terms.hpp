#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <vector>

#include <ceres/loss_function.h>

#include "parameter_blocks.hpp"
#include "reading_costs.hpp"

/// Readings of captures as terms of the least-squares problem, and their information about its
/// parameters.
namespace helix_arm::estimation {

struct ReadingTerm {
  std::unique_ptr<ReadingCost> cost;
  std::vector<int> blocks;  ///< indices of its parameter blocks, in the order of the cost
  /// Absent for twists, whose covariance is given.
  std::unique_ptr<ceres::LossFunction> loss;
  double limit;  ///< squared residuals beyond which the reading is an outlier

  /// Squared residuals at the current values; infinite if they have no shape.
  double square(const ParameterBlocks& blocks) const;
  /// Weight of a square from the robust loss, in (0, 1].
  double weight(double square) const;
};

/// The terms of one reading.
std::vector<ReadingTerm> termsOf(Shared& shared, const Place& place, const Reading& reading,
                                 const ParameterBlocks& blocks);

/// The readings that an arm is expected to give at these pressures: those of its captures, each tag
/// once, if it faces the camera.
std::vector<ReadingTerm> expectedTerms(Shared& shared, const ArmCaptures& arm,
                                       const Eigen::VectorXd& pressure,
                                       const ParameterBlocks& blocks);

/// Adds the weighted J'J of a term to that of all free parameters.
///
/// @param weigh  returns the weight of a term with this square.
void addInformation(const ReadingTerm& term, const ParameterBlocks& blocks,
                    const std::function<double(double)>& weigh, Eigen::MatrixXd& H);

}  // namespace helix_arm::estimation
