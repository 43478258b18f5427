#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "reading_terms.hpp"

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

  // Of the last values, for captures that were included. Residuals are in expected standard
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

}  // namespace helix_arm::estimation
