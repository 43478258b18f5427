#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <functional>
#include <vector>

#include "readings.hpp"

/// Residuals of all readings and their derivatives, at values of the parameters.
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

/// Evaluates each capture once per values, whatever asks for it: fits at several noise scales,
/// comparisons and information all start from the same residuals.
class LinearisedReadings {
 public:
  /// @param places, costs  (captures). Keeps references.
  LinearisedReadings(Shared& shared, const ParameterBlocks& blocks, ReadingKind kind,
                     const std::vector<Place>& places, const std::vector<ReadingCosts>& costs)
      : shared_(shared),
        blocks_(blocks),
        kind_(kind),
        places_(places),
        costs_(costs),
        captures_(places.size()) {}

  /// Evaluates the included captures at the values that the blocks have.
  void update(const Included& included, bool derivatives);

  /// Results at the last values, for a capture that was included.
  const LinearisedCapture& of(std::size_t capture) const { return captures_[capture]; }

 private:
  void evaluate(std::size_t capture, bool derivatives);

  Shared& shared_;
  const ParameterBlocks& blocks_;
  const ReadingKind kind_;
  const std::vector<Place>& places_;
  const std::vector<ReadingCosts>& costs_;
  Eigen::VectorXd at_;
  std::vector<LinearisedCapture> captures_;
  Eigen::MatrixXd by_pieces_;  // workspace
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

}  // namespace helix_arm::estimation
