#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/control/target_check.hpp"
#include "helix_arm/model/arm.hpp"

namespace helix_arm::procedures {

/// The paper's calibration pressures (12 x actuators) [Pa]: 0, 10, 15, 20 .. 60 psi of 60 psi, as
/// shares of each actuator's own range. Level j is on actuator j mod n, the others are at their
/// lower limits.
Eigen::MatrixXd defaultPressurePlan(const model::Arm& arm);

/// The plan (steps x actuators) [Pa] from a row-by-row list; the default plan if it is empty. With
/// `loop` there and back, by default actuator by actuator, so that each pressure is reached from
/// below and from above.
///
/// A list is refused if its size is not a multiple of the number of actuators, a pressure is
/// outside the limits, or no two pressures differ.
control::Checked<Eigen::MatrixXd> checkPlan(const model::Arm& arm, const std::vector<double>& rows,
                                            bool loop = false);

/// Pressures (rows x actuators) [Pa] of a round trip that bends every section in all its
/// directions.
///
/// From rest, once around with each muscle leading in turn, all muscles shortened together, back to
/// rest: a series for playing in a loop. Neighbouring sections lead with different muscles, so that
/// the arm takes S shapes.
/// @param fraction  of each actuator's range that the tour uses, in (0, 1].
/// @throws std::invalid_argument if fraction is outside (0, 1].
Eigen::MatrixXd pressureTour(const model::Arm& arm, double fraction = 0.8);

/// How a series of pressures is played.
struct SeriesTiming {
  double ramp = 1.0;  ///< duration of the linear ramp between rows, >= 0 [s]
  double hold = 1.0;  ///< duration at each row, >= 0; ramp + hold > 0 [s]
  bool loop = false;  ///< restart after the last row
};

/// Plays rows of pressures: ramps to each and holds it. Time advances by steps.
class SeriesPlayer {
 public:
  /// @param rows  (rows x actuators) [Pa], at least one row.
  /// @param from  (actuators) start of the first ramp [Pa].
  /// @throws std::invalid_argument naming the value and its rule.
  SeriesPlayer(Eigen::MatrixXd rows, const Eigen::VectorXd& from, const SeriesTiming& timing);

  /// Restarts the ramp to the current row, from pressures that another commander has set.
  /// @throws std::invalid_argument if their number is not that of the actuators.
  void resume(const Eigen::VectorXd& from);

  /// Advances time by dt >= 0 [s].
  void advance(double dt);

  /// (actuators) [Pa] at the current time; after the end, the last row.
  Eigen::VectorXd pressure() const;
  /// Index of the row being reached or held.
  int row() const { return row_; }
  /// True after the hold of the last row; never in a loop.
  bool finished() const { return finished_; }

 private:
  Eigen::MatrixXd rows_;
  SeriesTiming timing_;
  Eigen::VectorXd from_;
  int row_ = 0;
  double time_ = 0.0;  ///< since the ramp to the row began [s]
  bool finished_ = false;
};

}  // namespace helix_arm::procedures
