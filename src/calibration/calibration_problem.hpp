#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "helix_arm/calibration/calibration.hpp"
#include "parameter_blocks.hpp"
#include "readings.hpp"

/// The least-squares problem of calibrate(): its parameters, its readings and their information.
namespace helix_arm::estimation {

using Included = std::function<bool(int capture)>;
inline bool everyCapture(int) { return true; }

/// The readings of a capture at values of the parameters, in expected standard deviations.
struct LinearisedCapture {
  struct Term {
    double square;  ///< squared residuals; infinite if the term has none there
    Eigen::VectorXd residual;
    Eigen::MatrixXd J;  ///< if derivatives were asked for
  };
  enum Known : char { kNothing, kResiduals, kDerivatives } known = kNothing;
  CaptureState state;
  std::vector<Term> terms;
};

/// Normal equations of a calibration, H = J'WJ and g = J'Wr of its readings and priors, in the
/// order of the columns of ParameterBlocks.
///
/// Each reading depends on at most one of the blocks that are eliminated first, the shape of its
/// capture or, if shapes come from the model, its tag: only the Schur complement of the remaining
/// columns is factored as a whole.
class CalibrationEquations {
 public:
  /// @param blocks  of which it keeps a reference.
  CalibrationEquations(const ParameterBlocks& blocks, ParameterBlock eliminated);

  /// Starts anew.
  void clear();
  /// @param offset  of the values from the mean of their prior.
  void addPrior(const ParameterBlocks::Block& block, const Eigen::VectorXd& offset);
  /// @param J  (residuals x columns of the cost).
  void addTerm(const ReadingCost& cost, const Eigen::MatrixXd& J, const Eigen::VectorXd& residual,
               double weight);
  /// A prior of the value along a direction of a block.
  ///
  /// @param offset  of that value from its mean.
  void addDirection(const ParameterBlocks::Block& block, const Eigen::VectorXd& direction,
                    double deviation, double offset);

  const Eigen::MatrixXd& hessian() const { return H_; }
  const Eigen::VectorXd& gradient() const { return gradient_; }

  /// Factors H + diag(damping). @return false if it is not positive definite.
  bool factor(const Eigen::VectorXd& damping);
  // Results with the last factors.
  /// Solution of (H + diag(damping)) x = -g.
  Eigen::VectorXd step() const;
  /// The Schur complement, in the order of the columns that are not eliminated, and its inverse.
  const Eigen::MatrixXd& reduced() const { return reduced_; }
  Eigen::MatrixXd reducedInverse() const;
  /// Trace of (H + diag(damping))^-1 diag(weights).
  double inverseTrace(const Eigen::VectorXd& weights) const;

 private:
  using Cholesky = Eigen::LLT<Eigen::MatrixXd>;
  // A block, and its factors own + damping = L L', L^-1 H(block, at), L^-1 g(block).
  struct Eliminated {
    int column, size;
    std::vector<int> at = {};  // indices in the rest of the columns that its readings have, too
    Cholesky root = {};
    Eigen::MatrixXd scaled_cross = {};
    Eigen::VectorXd scaled_gradient = {};
  };

  const std::vector<ParameterBlocks::Block>& blocks_;
  std::vector<Eliminated> eliminated_;
  std::vector<int> rest_;  // columns that are not eliminated
  Eigen::MatrixXd H_;
  Eigen::VectorXd gradient_;
  Eigen::MatrixXd reduced_;
  Eigen::VectorXd reduced_gradient_;
  Cholesky root_;
};

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
  /// Requires sound data. Keeps a reference to the arms.
  CalibrationProblem(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options);
  // Not copyable, since its parts refer to each other.
  CalibrationProblem(const CalibrationProblem&) = delete;
  CalibrationProblem& operator=(const CalibrationProblem&) = delete;

  const std::vector<ArmCaptures>& arms() const { return shared_.arms; }
  const CalibrationOptions& options() const { return shared_.options; }
  std::vector<FitParameter> stiffnessEntries() const { return freeStiffness(shared_.options); }
  ReadingKind kind() const { return kind_; }
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

  // The captures at values of the numbers. Each is evaluated once per values, whatever asks for it:
  // fits at several noise scales, comparisons and information start from the same residuals.
  struct Linearisation {
    Eigen::VectorXd numbers;
    std::vector<LinearisedCapture> captures;
  };

  void addShapes();
  // Evaluates the included captures at the current values.
  void update(Linearisation& at, const Included& included, bool derivatives);
  void evaluate(std::size_t capture, bool derivatives, LinearisedCapture& out);
  // NaN if a reading has no residuals there.
  double cost(const Task& task, const Linearisation& at) const;
  void assemble(const Task& task, const Linearisation& at);
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
  Linearisation here_, there_;  // there: after a step
  Eigen::VectorXd start_;       // of a solution
  Eigen::MatrixXd by_pieces_;   // workspace
};

}  // namespace helix_arm::estimation
