#pragma once

#include <Eigen/Core>

namespace helix_arm::procedures {

/// How a series of pressures is played.
struct SeriesTiming {
  double ramp = 1.0;  ///< from one row to the next, in a straight line, >= 0 [s]
  double hold = 1.0;  ///< at each row, >= 0; with the ramp > 0 [s]
  bool loop = false;  ///< begin again after the last row
};

/// Plays rows of pressures: ramps to each, holds it, goes on. Time comes in as steps.
class SeriesPlayer {
 public:
  /// @param rows  (rows x actuators) [Pa], at least one row.
  /// @param from  (actuators) where the first ramp begins [Pa].
  /// @throws std::invalid_argument naming the value and its rule.
  SeriesPlayer(Eigen::MatrixXd rows, const Eigen::VectorXd& from, const SeriesTiming& timing);

  /// Ramps to the row at hand once more, from pressures that someone else has set meanwhile.
  /// @throws std::invalid_argument when their number is not that of the actuators.
  void resume(const Eigen::VectorXd& from);

  /// Advances time by dt >= 0 [s].
  void advance(double dt);

  /// (actuators) [Pa] at this time; after the end, the last row.
  Eigen::VectorXd pressure() const;
  /// Index of the row being reached or held.
  int row() const { return row_; }
  /// True once the last row was held; never in a loop.
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
