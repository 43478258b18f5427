#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "arrow_equations.hpp"
#include "linearised_readings.hpp"

/// Least squares of a calibration.
namespace helix_arm::estimation {

/// Result of a least-squares solution.
struct Solved {
  bool converged = false;
  double cost = 0;  ///< readings and priors: half the robust sum of squares
};

/// A least squares ends once a step lowers its cost by less than this fraction.
inline constexpr double kSolvedTolerance = 1e-9;

/// What to minimise.
struct DescentTask {
  double noise_scale;  ///< noise as a multiple of the expected noise
  const Included& included;
  /// Direction in the space of the selected stiffness logs along which they keep their value;
  /// null: none.
  const Eigen::VectorXd* held = nullptr;
  int max_iterations = 100;
  double tolerance = kSolvedTolerance;  ///< the fraction at which this one ends
};

/// Levenberg and Marquardt's method over the values of the parameters, with the radius of the trust
/// region by Nielsen's rule, weights of the robust loss renewed at every step.
class CalibrationDescent {
 public:
  /// Keeps references.
  CalibrationDescent(Shared& shared, ReadingKind kind, const std::vector<Place>& places,
                     const std::vector<ReadingTerm>& terms, ParameterBlocks& blocks);

  /// Starts from the current values.
  Solved solve(const DescentTask& task);

  /// The readings at the current values.
  const LinearisedReadings& readings(const Included& included, bool derivatives);
  /// The equations of included readings and priors at the current values.
  ArrowEquations& equations(double noise_scale, const Included& included);

 private:
  // NaN if a reading has no residuals there.
  double cost(const DescentTask& task, const LinearisedReadings& readings,
              const Eigen::VectorXd& numbers) const;
  void assemble(const DescentTask& task, const LinearisedReadings& readings,
                const Eigen::VectorXd& numbers);
  bool takesPart(const ParameterBlocks::Block& block, const Included& included) const {
    return block.kind != ParameterBlock::kShape || included(block.of);
  }

  const std::vector<ReadingTerm>& terms_;
  ParameterBlocks& blocks_;
  ArrowEquations equations_;
  std::unique_ptr<LinearisedReadings> here_, there_;  // there: after a step
  Eigen::VectorXd start_;                             // of a solution
};

}  // namespace helix_arm::estimation
