#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <vector>

#include "calibration_equations.hpp"
#include "helix_arm/calibration/calibration.hpp"
#include "parameter_blocks.hpp"

/// The least-squares problem of calibrate(): its parameters, its readings and their information.
namespace helix_arm::estimation {

/// Residual of one tag, curvature or twist.
struct Comparison {
  int capture;    ///< index over all arms
  int tag;        ///< index in the layout; -1 if it is not a tag
  int residuals;  ///< number of its residuals
  double square;  ///< sum of squared residuals, in expected variances
  double limit;   ///< value of `square` beyond which it is an outlier; infinite if it cannot be one
  double error;   ///< error for reports [rad, px or m]
};

/// Result of a least-squares solution.
struct Solved {
  bool converged = false;
  double cost = 0;  ///< readings and priors: half the robust sum of squares
};

/// A least squares ends once a step lowers its cost by less than this fraction.
inline constexpr double kSolvedTolerance = 1e-9;

/// Arms, their readings and the values of the fitted parameters.
///
/// Functions that evaluate readings or shapes are not const: they cache what they evaluated.
class CalibrationProblem {
 public:
  /// Requires sound data. Keeps references to arms and options.
  CalibrationProblem(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options,
                     const Selection& selection);
  // Not copyable, since its parts refer to each other.
  CalibrationProblem(const CalibrationProblem&) = delete;
  CalibrationProblem& operator=(const CalibrationProblem&) = delete;

  const Selection& selection() const { return shared_.selection; }
  int captures() const { return static_cast<int>(places_.size()); }  ///< of all arms
  int armOf(int capture) const { return places_[capture].arm; }      ///< index of its arm
  /// Free parameters except those of shapes.
  const std::vector<ParameterInfo>& parameters() const { return blocks_.infos(); }

  const ParameterBlocks& blocks() const { return blocks_; }
  /// Values of all free parameters, those of parameters() first, and of these the stiffness first.
  const Eigen::VectorXd& numbers() const { return blocks_.numbers(); }
  void setNumbers(const Eigen::VectorXd& numbers) { blocks_.setNumbers(numbers); }

  /// Multiplies the standard errors of the free lengths.
  void loosenCurve(double factor) { blocks_.loosenCurve(factor); }

  /// Least squares over the included captures, starting from the current values: Levenberg and
  /// Marquardt's method, with the radius of the trust region by Nielsen's rule and weights of the
  /// robust loss renewed at every step.
  ///
  /// @param noise_scale  noise as a multiple of the expected noise.
  /// @param held  direction in the space of the selected stiffness logs along which they keep their
  /// value; null: none.
  /// @param tolerance  ends once a step lowers the cost by less than this fraction.
  Solved solve(double noise_scale, const Included& included, const Eigen::VectorXd* held = nullptr,
               double tolerance = kSolvedTolerance);

  /// Compares all readings with the current values.
  ///
  /// @param errors  whether `error` is of interest.
  std::vector<Comparison> compare(double noise_scale, bool errors = true);

  /// Equations of the included readings and of the priors at the current values, until the next
  /// call of any function that is not const.
  CalibrationEquations& equations(double noise_scale, const Included& included = everyCapture);
  /// Weighted J'J of the included readings, without priors. Requires shapes of the model.
  Eigen::MatrixXd information(double noise_scale, const Included& included);
  /// Likewise for the readings that the arm is expected to give at these pressures.
  Eigen::MatrixXd expectedInformation(const Eigen::VectorXd& pressure, double noise_scale);
  /// Diagonal matrix of the priors' information.
  Eigen::VectorXd priorInformation() const;

  // The physical quantities of the current values.
  model::Stiffness stiffness() const { return elasticity().ratios; }
  std::optional<double> K_eps() const;              ///< [N], if fitted
  Eigen::VectorXd lengthScale() const;              ///< (actuators of the first arm)
  std::optional<ContractionSpline> spline() const;  ///< the FreeCurve, with its initial covariance
  lie::SE3 base() const;
  TagLayout layout() const;
  model::Shape shape(int capture);

 private:
  // The cost to minimise; see solve().
  struct Task {
    double noise_scale;
    const Included& included;
    const Eigen::VectorXd* held = nullptr;
  };

  void addShapes();
  // The readings at the current values.
  const LinearisedReadings& readings(const Included& included, bool derivatives);
  // NaN if a reading has no residuals there.
  double cost(const Task& task, const LinearisedReadings& readings,
              const Eigen::VectorXd& numbers) const;
  void assemble(const Task& task, const LinearisedReadings& readings,
                const Eigen::VectorXd& numbers);
  bool takesPart(const ParameterBlocks::Block& block, const Included& included) const {
    return block.kind != ParameterBlock::kShape || included(block.of);
  }
  Elasticity elasticity() const {
    return shared_.model.elasticityAt(blocks_.of(ParameterBlock::kStiffness).data(),
                                      shared_.model.initial());
  }

  Shared shared_;
  ParameterBlocks blocks_;
  ReadingKind kind_;
  std::vector<Place> places_;        // (captures)
  std::vector<ReadingCosts> costs_;  // (captures)
  std::optional<CalibrationEquations> equations_;
  std::unique_ptr<LinearisedReadings> here_, there_;  // there: after a step
  Eigen::VectorXd start_;                             // of a solution
};

}  // namespace helix_arm::estimation
