#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "basics/least_squares.hpp"
#include "helix_arm/calibration/series_fit.hpp"
#include "series_orientation.hpp"

/// The least squares of an arm and a series of its tip: the series in the form that fits need, and
/// the numbers of a fit.
namespace helix_arm::estimation {

/// Where base, body and beam are.
struct SeriesPlaces {
  lie::SE3 X_FB;
  Eigen::Matrix3d R_TM = Eigen::Matrix3d::Identity();
  Eigen::Vector3d p_TM = Eigen::Vector3d::Zero();
  std::optional<Eigen::Vector2d> beam = {};  ///< as SeriesPrior has it

  /// Point that is seen of a tip, in F [m]; NaN where the beam does not meet the plane.
  Eigen::Vector3d pointOf(const lie::SE3& X_FT) const;
};

/// Length by which a turn counts as a motion of the tip: orientations weigh as fitSeries() says
/// [m/rad].
double leverOf(const SeriesPrior& prior, const SeriesOptions& options);

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
  /// Whether the pressure of actuator i does.
  bool moves(int i) const { return moves_[static_cast<std::size_t>(i)]; }
  /// Effective pressures (used x actuators) within the limits.
  Eigen::MatrixXd effective(const model::Arm& arm,
                            const std::optional<model::Response>& response) const;
  /// (used) whether a pressure changes too fast for the arm to be at rest.
  std::vector<bool> inMotion(const model::Arm& arm) const;

  /// @param tips  (used) seen from the base.
  Eigen::MatrixXd deviation(const std::vector<lie::SE3>& tips, const SeriesPlaces& places) const;
  /// (used) orientations of the body; only if the series has them.
  Rotations rotations() const;
  /// With the mean of each trial taken off, over the rows that count; empty: all.
  Eigen::MatrixXd aboutOffsets(Eigen::MatrixXd deviation,
                               const std::vector<bool>& counts = {}) const;
  /// Its columns of positions.
  auto placesOf(const Eigen::MatrixXd& deviation) const {
    return deviation.leftCols(measured.cols());
  }
  /// @param about  the same about the trials' offsets. @param rows  empty: all.
  SeriesResidual residualOf(const Eigen::MatrixXd& deviation, const Eigen::MatrixXd& about,
                            const std::vector<bool>& rows = {}) const;

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

/// Parts of a series that are left out in turn: its trials, or groups of them; of fewer than five,
/// tenths of the rows.
struct Blocks {
  Blocks() = default;
  /// @param trial_at  (rows) index of the trial.
  Blocks(const std::vector<int>& trial_at, int trials);

  int count = 0;
  std::vector<int> of;  ///< (rows) index of the block
};

/// Root mean square of the distances of some rows; NaN of none. @param rows  empty: all.
double rmsOf(const Eigen::MatrixXd& deviation, const std::vector<bool>& rows = {});

/// Which optional parts the model has.
struct SeriesForm {
  bool lag = false, slow = false, play = false, scales = false, strokes = false;
  bool body = false;                    ///< its place
  bool phases = false;                  ///< of single actuators
  bool growth = false, others = false;  ///< of K_kappa, with which of BendingTable::Argument

  bool grows() const { return growth || others; }
};

/// The model that the numbers of a fit stand for.
struct SeriesModel {
  statics::ArmModel model;
  // The numbers: factors, but turns, motion and response.
  model::Stiffness stiffness{1, 1, 1};
  double K_eps = 1.0, growth = 1.0;  ///< of K_kappa, from one end of the limits to the other
  double common_scale = 1.0;
  Eigen::VectorXd scale = {}, stroke = {};     ///< (actuators) of lengths
  Eigen::VectorXd radius = {};                 ///< (sections)
  Eigen::VectorXd phase = {}, own_phase = {};  ///< (sections), (actuators) turns [rad]
  /// (curves, knots) length at rest, then the slopes
  std::vector<std::vector<double>> pieces = {};
  lie::Vector6 motion = lie::Vector6::Zero();       ///< right-hand, of the base
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();   ///< right-hand, of the body
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();  ///< of the body [m]
  Eigen::Vector2d beam = Eigen::Vector2d::Zero();   ///< turns of it [rad]
  std::optional<model::Response> response = {};     ///< absent: each actuator's own
  // Quantities that follow from these.
  SeriesPlaces places = {};
  std::vector<std::vector<double>> lengths = {};     ///< (curves) at their knots, if fitted [m]
  std::vector<model::Contraction> contraction = {};  ///< (actuators)
  model::BendingTable bending = {};  ///< unless empty, the model has it, curves and scales
  bool sound = true;                 ///< false: a length is not > 0, or a curve turns
};

/// A number of the fit: z, 0 at first.
struct SeriesNumber {
  enum Part { kArm, kCurve, kPlace, kResponse } part;  ///< kPlace: of base, body or beam
  /// Its entry is start * exp(z), z itself, or the share of `most` with start's odds times exp(z).
  enum Law { kFactor, kItself, kShare } law;
  std::string name, unit;
  double prior;  ///< standard deviation of z
  std::function<double&(SeriesModel&)> entry;
  const char* untold = nullptr;  ///< what the data may not tell apart
  double unit_value = 1.0;       ///< the value is so many times the entry
  double start = 1.0, most = 0.0;
  bool chained = false;  ///< the prior is of the difference from the number before it
  /// The value as it is reported, if it is not such a multiple.
  std::function<double(const SeriesModel&)> reported = nullptr;
};

/// z with the residuals there, in expected standard deviations.
struct SeriesEstimate {
  Eigen::VectorXd z, residual;
};

/// The least squares of one form of the model. Keeps references to its arguments.
class SeriesProblem {
 public:
  SeriesProblem(const SeriesPrior& prior, const SeriesRecording& recording,
                const SeriesOptions& options, const SeriesForm& form, const lie::SE3& X_FB);

  const std::vector<SeriesNumber>& numbers() const { return numbers_; }
  Eigen::Index size() const { return static_cast<Eigen::Index>(numbers_.size()); }
  /// The start, or another fit's z of the same names; and those of a fit.
  Eigen::VectorXd startFrom(const std::map<std::string, double>& known) const;
  std::map<std::string, double> named(const Eigen::VectorXd& z) const;

  /// Which of the used rows count.
  void take(std::vector<bool> rows) { takes_part_ = std::move(rows); }
  Eigen::Index rowsTaken() const {
    return std::count(takes_part_.begin(), takes_part_.end(), true);
  }
  /// Variance of a coordinate, with its correlation in time [m^2].
  void setVariance(double variance) { variance_ = variance; }

  SeriesModel decode(const Eigen::VectorXd& z) const;
  /// Value of number k as it is reported; those of curves have none.
  double valueOf(Eigen::Index k, SeriesModel now) const {
    const SeriesNumber& one = numbers_[static_cast<std::size_t>(k)];
    return one.reported ? one.reported(now) : one.unit_value * one.entry(now);
  }
  SeriesEstimate at(const Eigen::VectorXd& z) const;
  /// See SeriesRecording; of all used rows.
  Eigen::MatrixXd deviationAt(const Eigen::VectorXd& z) const;
  /// The base with these axes at which the mean of what is seen, at z = 0, is the measured one. A
  /// beam has its height above the plane from the start. Nothing if it does not meet the plane.
  std::optional<lie::SE3> baseWith(const Eigen::Matrix3d& axes) const;
  /// (used) orientations of the tip seen from F.
  Rotations rotationsAt(const Eigen::VectorXd& z) const;

  // For basics::descend().
  double cost(const SeriesEstimate& one) const { return one.residual.squaredNorm(); }
  SeriesEstimate moved(const SeriesEstimate& from, const Eigen::VectorXd& step) const;
  basics::DenseEquations linearise(const SeriesEstimate& one) const;
  Eigen::MatrixXd covariance(const SeriesEstimate& one) const;

 private:
  void add(SeriesNumber one) { numbers_.push_back(std::move(one)); }
  void addArm();
  void addCurves();
  void addPlace(const std::string& name, const char* unit, double prior, const char* untold,
                const std::function<double&(SeriesModel&)>& entry,
                const std::function<double(const SeriesModel&)>& reported);
  void addRings();
  void addPhases();
  void addBase();
  void addBody();
  void addBeam();
  void addResponse();
  void setContractions(SeriesModel& out) const;
  Eigen::MatrixXd effective(const SeriesModel& now) const {
    return recording_.effective(prior_.model.arm(), now.response);
  }
  Eigen::VectorXd whole(const Eigen::VectorXd& z, Eigen::MatrixXd deviation) const;
  Eigen::MatrixXd jacobian(const SeriesEstimate& one) const;

  const SeriesPrior& prior_;
  const SeriesRecording& recording_;
  const SeriesOptions& options_;
  SeriesForm form_;
  SeriesPlaces places_;
  std::vector<SeriesNumber> numbers_;
  std::vector<bool> takes_part_;
  double variance_;
};

}  // namespace helix_arm::estimation
