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

/// Evaluates each capture once per values, whatever asks for it: fits at several noise scales,
/// comparisons and information all start from the same residuals.
class LinearisedReadings {
 public:
  /// @param places  (captures) @param terms  grouped by capture, ascending. Keeps references.
  LinearisedReadings(Shared& shared, ReadingKind kind, const std::vector<Place>& places,
                     const std::vector<ReadingTerm>& terms);

  /// Evaluates the included captures at these values.
  ///
  /// @param numbers  the same values as one vector, by which they are recognised.
  void update(const Values& values, const Eigen::VectorXd& numbers, const Included& included,
              bool derivatives);

  // Results at the last values, for captures that were included. Residuals are in expected standard
  // deviations.
  /// Squared residuals; infinite if the term has none there.
  double square(std::size_t term) const { return squares_[term]; }
  // Undefined where the term has none.
  const Eigen::VectorXd& residual(std::size_t term) const { return residuals_[term]; }
  const Eigen::MatrixXd& jacobian(std::size_t term) const { return jacobians_[term]; }
  const CaptureState& state(int capture) const { return states_[capture]; }

 private:
  enum Known : char { kNothing, kResiduals, kDerivatives };

  void evaluate(int capture, const Values& values, bool derivatives);

  Shared& shared_;
  const ReadingKind kind_;
  const std::vector<Place>& places_;
  const std::vector<ReadingTerm>& terms_;
  std::vector<std::size_t> first_term_;  // (captures + 1)
  Eigen::VectorXd at_;
  std::vector<Known> known_;          // (captures)
  std::vector<CaptureState> states_;  // (captures)
  // (terms)
  std::vector<double> squares_;
  std::vector<Eigen::VectorXd> residuals_;
  std::vector<Eigen::MatrixXd> jacobians_;
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
  CalibrationEquations(const ParameterBlocks& blocks, const std::vector<ReadingTerm>& terms,
                       ParameterBlock eliminated);

  /// Starts anew.
  void clear();
  /// @param offset  of the values from the mean of their prior.
  void addPrior(std::size_t block, const Eigen::VectorXd& offset);
  /// @param J  (residuals x columns of the term).
  void addTerm(const ReadingTerm& term, const Eigen::MatrixXd& J, const Eigen::VectorXd& residual,
               double weight);
  /// A prior of the value along a direction of a block that is not eliminated.
  ///
  /// @param offset  of that value from its mean.
  void addDirection(std::size_t block, const Eigen::VectorXd& direction, double deviation,
                    double offset);

  /// Diagonal of H.
  Eigen::VectorXd diagonal() const;
  Eigen::MatrixXd hessian() const;
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
  // A block: H(block, block) and H(block, at), and their factors own + damping = L L', L^-1 cross,
  // L^-1 g(block).
  struct Eliminated {
    int column, size;
    std::vector<int> at;  // indices in the rest of the columns that its readings have, too
    Eigen::MatrixXd own, cross;
    Cholesky root;
    Eigen::MatrixXd scaled_cross;
    Eigen::VectorXd scaled_gradient;
  };

  const ParameterBlocks& blocks_;
  std::vector<Eliminated> eliminated_;
  std::vector<int> rest_;    // columns that are not eliminated
  std::vector<int> places_;  // (blocks) index in the rest, or -1 - index among the eliminated
  Eigen::MatrixXd H_rest_;   // H(rest, rest)
  Eigen::VectorXd gradient_;
  Eigen::MatrixXd reduced_;
  Eigen::VectorXd reduced_gradient_;
  Cholesky root_;
};

}  // namespace helix_arm::estimation
