#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "helix_arm/calibration/calibration.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/model/response.hpp"
#include "helix_arm/statics/arm_model.hpp"

/// An arm fitted to recorded motions of its tip, in its own geometry.
namespace helix_arm::estimation {

/// Positions of the tip, and its orientations if they were measured, through motions.
struct TipSeries {
  model::InputHistory history;  ///< measured pressures (rows x actuators), with times [Pa], [s]
  /// (rows x 3) seen from a frame F at rest, or (rows x 2) in its x-y plane [m]; NaN where there is
  /// none.
  Eigen::MatrixXd position;
  /// (rows) rotation of a body M, which the tip carries, seen from F; or empty
  std::vector<Eigen::Matrix3d> rotation = {};
};

/// Prior knowledge of the arm.
struct SeriesPrior {
  statics::ArmModel model;
  lie::SE3 X_BF;  ///< frame of the positions seen from the base
  /// Rotation of the measured body M, whose orientation a series has, seen from the tip's frame T.
  /// Nothing: unknown, and found from the series.
  std::optional<Eigen::Matrix3d> R_TM = {};
  Eigen::Vector3d p_TM = Eigen::Vector3d::Zero();  ///< place of that body likewise [m]
  /// The positions are those of a dot in the x-y plane of F, where a beam from the tip meets it:
  /// its direction, x of the tip's frame turned about its y and then its z [rad]. Nothing: of the
  /// tip.
  std::optional<Eigen::Vector2d> beam = {};
};

/// Quantities to fit. Stiffness, scales of lengths and strokes, contraction, base and their priors
/// are those of CalibrationOptions: contraction frees the curves of the actuators that move.
struct SeriesOptions {
  CalibrationOptions arm;
  std::string curve;      ///< the only one that contraction frees; empty: all
  bool response = false;  ///< lag, play and slow state, one for all actuators
  /// Radius and phase of the rings of all sections. A turn of the first one, if the base is fitted,
  /// is the base's.
  bool ring_radius = false, ring_phase = false;
  /// Where it predicts better, the angle about the axis of each actuator that moves, against the
  /// first one that moves in its section.
  bool phases = false;
  /// Standard deviation of the tip's offset from trial to trial, per axis: where an arm rests moves
  /// from hour to hour. Large ones also take up what the curves should explain. 0: no offset. [m]
  double rest_offset = 0.0005;
};

/// A part of the model that is kept where it predicts what was left out.
struct Choice {
  /// Such as "lag", "play", "phases", "place of the body" or "K_kappa against pressure".
  std::string part;
  bool kept = false;
  /// By how much the RMS error of what was left out falls, about the trials' offsets: the mean of
  /// the logs over the blocks, times the error, and the standard error of that mean [m].
  double gain = 0.0, scatter = 0.0;
};

/// Agreement of the model with a trial, or with all.
struct SeriesResidual {
  int rows = 0;                   ///< with a position
  double rms = 0.0, worst = 0.0;  ///< distance [m]
  double rms_about_offset = 0.0;  ///< with the mean deviation of each trial taken off [m]
  double rms_at_rest = 0.0, rms_in_motion = 0.0;  ///< NaN where there are no such rows [m]
  double rms_turn = 0.0;                          ///< of the orientation; NaN without [rad]
  Eigen::VectorXd offset;                         ///< (2 or 3) mean of model - measured, in F [m]
};

/// The model against a series.
struct SeriesComparison {
  std::vector<SeriesResidual> trials;
  SeriesResidual all;
  double baseline_rms = 0.0;       ///< cubicHeldOutError() of the series [m]
  std::vector<Eigen::Index> rows;  ///< of the series, with a position
  Eigen::MatrixXd deviation;       ///< (these rows x 2 or 3) model - measured, in F [m]
};

/// Result of fitSeries().
struct SeriesFit {
  std::string failure;  ///< cause and remedy; empty if fitted
  std::vector<Parameter> parameters;
  std::optional<model::Stiffness> stiffness;  ///< of every actuator, if fitted
  /// Factor on K_kappa of every section as a function of its inputs, if it is kept; stiffness
  /// then has the least K_kappa.
  std::optional<model::BendingTable> bending;
  std::optional<double> K_eps;                  ///< [N], if fitted
  std::optional<Eigen::VectorXd> length_scale;  ///< (actuators), if fitted
  std::optional<Eigen::VectorXd> stroke_scale;  ///< likewise
  /// If fitted: (sections) factors on the distance of the actuators from the axis, and (actuators)
  /// turns about it [rad].
  std::optional<Eigen::VectorXd> ring_radius, ring_phase;
  /// Tables by the name of their curve, if contraction is fitted.
  std::vector<std::pair<std::string, ContractionFit>> curves;
  lie::SE3 X_BF;
  /// Rotation of the body seen from the tip's frame, if orientations took part.
  std::optional<Eigen::Matrix3d> R_TM;
  std::optional<Eigen::Vector3d> p_TM;  ///< its place likewise, if it predicts better [m]
  std::optional<Eigen::Vector2d> beam;  ///< its direction, if the positions are of a dot [rad]
  std::string orientation_fault;        ///< why they did not: what they contradict, and the remedy
  std::string order_fault;   ///< that the actuators seem to follow each other in the other sense
  model::Response response;  ///< as fitted or as before
  std::vector<Choice> choices;
  /// Parameters that the data cannot tell apart, and the rule that decides.
  std::vector<std::string> rules;
  double rms = 0.0;                    ///< distance over all rows used [m]
  double rms_about_offset = 0.0;       ///< with the trials' offsets [m]
  double held_out_rms = 0.0;           ///< of blocks that were left out [m]
  double baseline_rms = 0.0;           ///< cubicError() of the same rows [m]
  double baseline_held_out_rms = 0.0;  ///< cubicHeldOutError() of them [m]
  double rms_turn = 0.0;               ///< of the orientation over all rows used; NaN without [rad]
};

/// Fits the arm to the series, in its own geometry: pressures through lag, play and slow state to
/// free lengths, to a shape, to the tip.
///
/// It begins with all parts that were asked for, and K_kappa that is linear in a pressure of its
/// section. Lag, slow state, one play, length scales beyond a common one, strokes and that slope
/// are dropped one after the other unless leaving out trials (of fewer than five, tenths of the
/// series) shows that they predict better: by 2 %, by a standard error or in so many blocks that
/// chance is unlikely, and with the offsets not worse. Residuals count as about as many readings as
/// there are numbers, since what the model cannot describe repeats with the motion. Orientations
/// are of a body that the tip carries with a rotation of its own, R_TM, which is found from the
/// motion unless it is known. They take part unless they contradict the positions; then they are
/// left out, and orientation_fault says what they look like. Orientations weigh as those of
/// captures: rotation_noise against position_noise, and without a rotation_noise, 1 rad as half of
/// the arm's length, by which such a bend moves the tip. Standard errors are the larger of those of
/// the normal equations and those of leaving out blocks, with Student's factor for their number.
/// They are about what a fit to the same motions without noise would find: of an arm that creeps in
/// two ways, the one creep that describes both best.
SeriesFit fitSeries(const SeriesPrior& prior, const TipSeries& series,
                    const SeriesOptions& options);

/// Rows of a series that cannot be positions of the tip.
struct SeriesFaults {
  std::vector<Eigen::Index> zero;    ///< exactly at the origin, where no other row comes near
  std::vector<Eigen::Index> frozen;  ///< the same to the last digit while pressures change
  std::vector<Eigen::Index> far;     ///< far away from all others, or from the rows about them
};
SeriesFaults faultyRows(const TipSeries& series);  ///< finds them

/// RMS distance of the positions from a cubic of the pressures behind the best of some lags, fitted
/// to the same rows: as near as a model comes that knows nothing of arms, so that it tells the
/// noise of a recording. NaN without positions or pressures [m].
double cubicError(const TipSeries& series);
/// The same of positions that were left out, with the cubic of the others: each trial in turn, or
/// group of trials; of fewer than five trials, each tenth of the rows [m].
double cubicHeldOutError(const TipSeries& series);
/// Times this error, on what was left out, from which on an arm is not one of constant twist.
inline constexpr double kMostOfBaseline = 1.5;
/// Advice on such an arm, as the end of a sentence.
inline constexpr char kBeyondBaseline[] =
    "the arm may not be one of constant twist: check its geometry in the scene, whether chambers "
    "stiffen each other, hysteresis and wiring (docs/real_arms.md)";

/// The model, with the responses of its actuators, against a series. Where it finds no shape under
/// its load, the deviation is NaN.
SeriesComparison compareSeries(const SeriesPrior& arm, const TipSeries& series);

}  // namespace helix_arm::estimation
