#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "calibration_descent.hpp"
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

  const Values& values() const { return blocks_.values(); }
  /// The sizes must not change.
  Values& values() { return blocks_.values(); }
  /// Values of the free parameters in the order of parameters().
  Eigen::VectorXd vector() const { return blocks_.vector(); }

  /// Multiplies the standard errors of the free lengths.
  void loosenCurve(double factor) { blocks_.loosenCurve(factor); }

  /// Least squares over the included captures, starting from the current values.
  ///
  /// @param noise_scale  noise as a multiple of the expected noise.
  /// @param held  direction in the space of the selected stiffness logs along which they keep their
  /// value; null: none.
  /// @param tolerance  ends once a step lowers the cost by less than this fraction.
  Solved solve(double noise_scale, const Included& included, const Eigen::VectorXd* held = nullptr,
               double tolerance = kSolvedTolerance);

  /// Compares all readings with the current values.
  std::vector<Comparison> compare(double noise_scale);
  /// Likewise without `error`.
  std::vector<Comparison> compareSquares(double noise_scale);

  /// Equations of all readings and priors at the current values, until the next call of any
  /// function that is not const.
  ArrowEquations& equations(double noise_scale) {
    return descent_->equations(noise_scale, everyCapture);
  }
  /// Weighted J'J of the included readings, without priors: all free parameters, then shapes.
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
  void addShapes();
  Elasticity elasticity() const {
    return shared_.model.elasticityAt(values().stiffness.data(), shared_.model.initial());
  }

  Shared shared_;
  ParameterBlocks blocks_;
  ReadingKind kind_;
  std::vector<Place> places_;  // (captures)
  std::vector<ReadingTerm> terms_;
  std::optional<CalibrationDescent> descent_;
};

}  // namespace helix_arm::estimation
