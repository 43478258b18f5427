#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/model/arm_response.hpp"

namespace helix_arm::estimation {

/// Readings of what pressures did, as a polynomial of the effective pressures whose coefficients
/// are unknown and eliminated. Keeps a reference to the history.
class ResponseReadings {
 public:
  enum class Kind {
    kPerActuator,  ///< one reading per actuator and row, all of one curve
    kOfTheArm,     ///< up to three readings per row, of all pressures that move
  };
  /// @param degree  of the polynomial, of kOfTheArm; that of a curve follows from its readings.
  ResponseReadings(const model::InputHistory& history, const Eigen::MatrixXd& reading, Kind kind,
                   int degree = 2);

  /// Effective pressures (rows x actuators) [Pa].
  Eigen::MatrixXd effective(const model::Response& response) const;
  /// Deviation of the readings from the best polynomial.
  Eigen::VectorXd residual(const model::Response& response) const;

  /// RMS error of the readings of each trial, predicted with the polynomial of the others.
  Eigen::VectorXd heldOutErrors(const model::Response& response) const;

  /// Number of rows, or rows of actuators, with readings.
  Eigen::Index rows() const { return reading_.rows(); }
  Eigen::Index count() const { return reading_.size(); }
  int coefficients() const { return coefficients_; }  ///< of the polynomial, per output
  Eigen::Index outputs() const { return outputs_; }   ///< 1, or those of the arm
  double range() const { return range_; }             ///< of the pressures [Pa]
  bool perActuator() const { return kind_ == Kind::kPerActuator; }
  /// Factor by which residuals that are correlated in time raise a variance, >= 1.
  double correlationFactor(const Eigen::VectorXd& residual) const;
  /// Largest stroke back within one memory, relative to the range: the least of down and up.
  double largestReversal() const;
  /// Numbers of rows at which a pressure rises, or falls, too fast to be at rest.
  struct Motion {
    int rising = 0, falling = 0;
  };
  Motion motion() const;

  /// Weights of plays of these reaches by non-negative least squares, in which also the inverse
  /// curve is linear; those within two standard errors of 0 are left out. kPerActuator only.
  model::Response withWeights(const model::Response& lags,
                              const std::vector<double>& reaches) const;

 private:
  struct Entry {
    Eigen::Index row, actuator;  // -1: all
    int trial;
  };
  struct WeightProblem {
    Eigen::MatrixXd columns;  // (usable x (degree + 1 + plays))
    Eigen::VectorXd target;
  };
  Eigen::MatrixXd basis(const Eigen::MatrixXd& effective) const;
  WeightProblem weightProblem(const model::Response& lags,
                              const std::vector<double>& reaches) const;

  const model::InputHistory& history_;
  Kind kind_;
  std::vector<Eigen::Index> moving_;  // actuators
  std::vector<Entry> usable_;
  Eigen::MatrixXd reading_;  // (usable x outputs)
  Eigen::Index outputs_ = 1;
  int degree_;
  int trials_ = 0;
  int coefficients_ = 0;
  double range_ = 0.0, middle_ = 0.0;
};

}  // namespace helix_arm::estimation
