#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "readings.hpp"
#include "shape_model.hpp"

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
  /// (residuals x stride) row major: derivatives, residual, zeros. Undefined without residuals.
  const double* jacobian(std::size_t term) const { return &jacobians_[first_entry_[term]]; }
  const CaptureState& state(int capture) const { return states_[capture]; }

 private:
  enum Known : char { kNothing, kResiduals, kDerivatives };

  void evaluate(int capture, const Values& values, bool derivatives);

  Shared& shared_;
  const ReadingKind kind_;
  const std::vector<Place>& places_;
  const std::vector<ReadingTerm>& terms_;
  std::vector<std::size_t> first_term_;   // (captures + 1)
  std::vector<std::size_t> first_entry_;  // (terms)
  Eigen::VectorXd at_;
  std::vector<Known> known_;          // (captures)
  std::vector<CaptureState> states_;  // (captures)
  std::vector<double> squares_;       // (terms)
  std::vector<double> jacobians_;
  // Workspace.
  std::vector<double> residuals_;
  Eigen::MatrixXd by_pieces_;
};

// Normal equations of a calibration.

/// J'WJ and J'Wr of readings and priors, as an arrow: each reading depends on at most one of the
/// blocks that are eliminated first, the shape of its capture or, if shapes come from the model,
/// its tag. Only the Schur complement of the remaining blocks is factored as a whole.
class ArrowEquations {
 public:
  ArrowEquations(const ParameterBlocks& blocks, const std::vector<ReadingTerm>& terms,
                 ParameterBlock eliminated);

  /// Starts anew.
  ///
  /// @param active  whether a block takes part; the others have no step.
  void clear(const std::function<bool(const ParameterBlocks::Block&)>& active);
  /// @param offset  of the values from the mean of their prior.
  void addPrior(std::size_t block, const Eigen::VectorXd& offset);
  /// @param J  (residuals x stride) row major: derivatives, residual, zeros.
  void addTerm(std::size_t term, const double* J, double weight);
  /// A prior of the value along a direction of a block that is not eliminated.
  ///
  /// @param offset  of that value from its mean.
  void addDirection(std::size_t block, const Eigen::VectorXd& direction, double deviation,
                    double offset);

  // In the order of the columns of ParameterBlocks; blocks that take no part are 0.
  Eigen::VectorXd gradient() const;
  Eigen::VectorXd diagonal() const;
  Eigen::MatrixXd dense() const;

  /// Factors J'WJ + diag(damping). @return false if it is not positive definite.
  bool factor(const Eigen::VectorXd& damping);
  // Results with the last factors.
  /// Solution of (J'WJ + diag(damping)) x = -J'Wr.
  Eigen::VectorXd step() const;
  /// Inverse of the Schur complement, in the order of the blocks that are not eliminated.
  RowMajor reducedInverse() const;
  /// Trace of (J'WJ + diag(damping))^-1 diag(weights). @param reduced  reducedInverse().
  double inverseTrace(const Eigen::VectorXd& weights, const RowMajor& reduced) const;
  /// The Schur complement, if the damping was 0, in that order.
  Eigen::MatrixXd reduced() const;

 private:
  // A block of a term, or several that follow each other there and among all.
  struct Part {
    int column, size;  // among the term's
    int at;            // first row among those that are not eliminated; -1 if it is
    int local;         // first column of Eliminated::cross, if the term has an eliminated block
  };
  struct TermParts {
    std::vector<Part> parts;
    int eliminated = -1;
    int size = 0;
    int residuals = 0;
  };
  struct Eliminated {
    std::size_t block;
    int column, size;
    bool active = true;
    std::vector<int> at;  // (columns of cross before its padding) among those not eliminated
    RowMajor own, cross;
    Eigen::VectorXd gradient;
    // Factors: own + damping = root'root; root'^-1 cross, root'^-1 gradient.
    RowMajor root, scaled_cross;
    Eigen::VectorXd scaled_gradient;

    auto scaledCross() const { return scaled_cross.leftCols(static_cast<Eigen::Index>(at.size())); }
  };

  TermParts partsOf(const ReadingTerm& term) const;
  // Sizes the eliminated blocks by the terms that have them.
  void placeCrossColumns();

  std::vector<int> at_;          // (blocks) first row among those not eliminated, or -1
  std::vector<int> eliminated_;  // (blocks) index, or -1
  std::vector<int> columns_;     // (rows of rest_) columns of ParameterBlocks
  std::vector<TermParts> terms_;
  std::vector<Eliminated> shapes_or_tags_;
  int count_ = 0;  // columns of ParameterBlocks
  const ParameterBlocks& blocks_;
  RowMajor rest_, root_;  // upper triangles
  Eigen::VectorXd gradient_, scaled_gradient_;
  std::size_t largest_ = 0;     // square of a term
  std::vector<double> square_;  // workspace
};

}  // namespace helix_arm::estimation
