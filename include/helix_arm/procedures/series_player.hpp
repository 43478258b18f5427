#pragma once

#include <Eigen/Core>

namespace helix_arm::procedures {

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
