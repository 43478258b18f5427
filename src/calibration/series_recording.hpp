#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/calibration/series_fit.hpp"

/// A series of an arm's tip in the form that fits need, and what deviations from it amount to.
namespace helix_arm::estimation {

/// The rows of a series that are compared ("used"), with what follows from pressures alone. Keeps a
/// reference to the series. Deviations are those of a model, model - measured: (used x 2 or 3) of
/// positions, and three more columns of orientations times the lever [m].
class SeriesRecording {
 public:
  /// Curve of free length that several actuators share.
  struct Curve {
    std::string name;
    std::vector<double> knots, lengths;  ///< [Pa], [m] before a fit
    bool free = false;                   ///< an actuator that moves has it
  };

  /// @param most_rows  at most so many are used; between them the pressures count.
  /// @param turn_weight  lever of orientations, if there are any [m/rad].
  SeriesRecording(const model::Arm& arm, const TipSeries& tips, Eigen::Index most_rows,
                  double turn_weight);

  Eigen::Index rows() const { return measured.rows(); }
  /// Effective pressures (used x actuators) within the limits.
  Eigen::MatrixXd effective(const model::Arm& arm,
                            const std::optional<model::Response>& response) const;
  /// (used) whether a pressure changes too fast for the arm to be at rest.
  std::vector<bool> inMotion(const model::Arm& arm) const;

  /// @param tips  (used) seen from the base.
  Eigen::MatrixXd deviation(const std::vector<lie::SE3>& tips, const lie::SE3& X_FB) const;
  /// With the mean of each trial taken off, over the rows that count; empty: all.
  Eigen::MatrixXd aboutOffsets(Eigen::MatrixXd deviation,
                               const std::vector<bool>& counts = {}) const;
  /// Its columns of positions.
  auto placesOf(const Eigen::MatrixXd& deviation) const {
    return deviation.leftCols(measured.cols());
  }
  /// @param about  the same about the trials' offsets.
  SeriesResidual residualOf(const Eigen::MatrixXd& deviation, const Eigen::MatrixXd& about,
                            const std::vector<bool>& rows) const;

  const TipSeries& series;
  double lever;                    ///< [m/rad]; 0 without orientations
  std::vector<Eigen::Index> used;  ///< rows of the series
  std::vector<int> trial_at;       ///< (used)
  Eigen::MatrixXd measured;        ///< (used x 2 or 3) positions [m]
  int trials = 0;
  double range = 0.0;  ///< of the pressures [Pa]
  std::vector<Curve> curves;
  std::vector<int> curve_of;  ///< (actuators) index of its curve

 private:
  void addCurves(const model::Arm& arm);
  void setKnots(const model::Arm& arm, int c);

  std::vector<bool> moves_;  // (actuators)
};

/// Root mean square of the distances of some rows; NaN of none.
double rmsOf(const Eigen::MatrixXd& deviation, const std::vector<bool>& rows);

}  // namespace helix_arm::estimation
