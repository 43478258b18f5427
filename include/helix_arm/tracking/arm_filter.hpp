#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/localization/gaussian.hpp"
#include "helix_arm/model/shape.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/correction.hpp"
#include "helix_arm/tracking/tracking_options.hpp"

namespace helix_arm::estimation {

/// Why a measurement was not used.
enum class ObservationFault {
  kNone,
  kFuture,       ///< its stamp is ahead of the clock
  kNotNewer,     ///< its stamp is not after that of the last one
  kTooOld,       ///< its stamp is more than a second before the readings
  kWrongSize,    ///< not of this arm
  kNotFinite,    ///< holds a value that is not finite
  kNotPositive,  ///< its covariance is not symmetric or not positive definite
  kImplausible,  ///< a deviation that no camera has: below 1e-8 or above 10 [m, rad]
  kUnbalanced,   ///< the model finds no shape at these pressures
  kOutlier,      ///< farther from the prediction than chance allows
};
inline constexpr int kObservationFaultCount = 10;  ///< number of values
/// "none", "future", "not_newer", "too_old", "wrong_size", "not_finite", "not_positive",
/// "implausible", "unbalanced" or "outlier".
const char* nameOf(ObservationFault fault);

/// Verdict on a measurement.
struct Observation {
  ObservationFault fault = ObservationFault::kNone;
  double distance2 = 0.0;  ///< squared Mahalanobis distance from the prediction
  bool accepted() const { return fault == ObservationFault::kNone; }
};

/// Estimates how the arm differs from its model: a Kalman filter over pairs of pressures and
/// measured twists of the same instant.
///
/// State: theta, the logarithms of factors on stiffness, lengths and strokes, and b, what theta
/// does not explain, so that g = G(p; theta) + b. Both are held while nothing is measured. Theta is
/// not a calibration: parameters that act alike share their part of it.
class ArmFilter {
 public:
  /// One measurement with the pressures of its time.
  struct Input {
    double time = 0.0;           ///< [s]
    Eigen::VectorXd pressure;    ///< (n) gauge [Pa]
    Eigen::VectorXd variance;    ///< (n) of the pressures [Pa^2]
    model::Twists twists;        ///< (6 x sections) mean twists
    Eigen::MatrixXd covariance;  ///< (6 sections x 6 sections) of the twists
  };
  /// The model about the state at a picture. Rows are the measured entries of the twists.
  struct Linearisation {
    Eigen::VectorXd twists;       ///< (d) G
    Eigen::MatrixXd by_theta;     ///< (d x parameters)
    Eigen::MatrixXd by_pressure;  ///< (d x n) [1/Pa]
    Eigen::MatrixXd by_lengths;   ///< (d x n) [1/m]
  };
  /// Record of the last picture, for filters that run beside this one.
  struct Step {
    Linearisation model;
    Eigen::VectorXd theta;          ///< (parameters) at which `model` holds
    Eigen::VectorXd measured;       ///< (d)
    Eigen::MatrixXd noise;          ///< (d x d) of the measurement, pressures and swinging included
    Eigen::MatrixXd picture_noise;  ///< (d x d) likewise, but of a single picture: nothing persists
    Eigen::VectorXd swing;          ///< (d) how far the model is from where it settles
    Eigen::MatrixXd bias_growth;    ///< (d x d) added to the covariance of b before the update
    Eigen::MatrixXd play_growth;    ///< (d x d) what play may add to it, which a force must not be
    double dt = 0.0;                ///< since the picture before [s]
  };

  /// @throws std::invalid_argument naming the option that breaks its rule.
  ArmFilter(const statics::ArmModel& model, const ArmFilterOptions& options);
  ~ArmFilter();
  ArmFilter(ArmFilter&&) noexcept;
  ArmFilter& operator=(ArmFilter&&) noexcept;

  /// Why see() would refuse a measurement before it compares it with the model; else kNone.
  ObservationFault check(const Input& input) const;
  /// Compares a measurement with the model and learns from it.
  Observation see(const Input& input);
  /// Back to the start: no difference, with the deviations of the options.
  void reset();
  /// Forgets the time of the last picture, keeps what was learnt.
  void forgetTime();
  /// Replaces what was learnt, as by a filter that ran beside this one and knows better.
  /// @param state  [theta; b] and its covariance, as state().
  void setState(const Gaussian& state);

  int parameterCount() const;
  /// "K_gamma", "K_kappa", "K_tau", "K_eps", "length of muscle_1" or "lengths of section 1",
  /// "stroke of muscle_1".
  const std::vector<std::string>& parameterNames() const;
  /// (parameters) standard deviations of theta at the start.
  Eigen::VectorXd parameterPrior() const;
  /// Entries of the twists that are measured, as indices into all 6 sections entries.
  const std::vector<int>& rows() const;

  /// [theta; b] and its covariance; b of the measured rows [m, rad].
  const Gaussian& state() const;
  /// The state as a correction of the model.
  statics::Correction correction() const;
  /// Mean twists (6 x sections) that the corrected model gives at pressures (n) [Pa]; nothing if no
  /// shape balances the load.
  std::optional<model::Shape> shape(const Eigen::VectorXd& pressure) const;
  /// The model about the present theta at pressures (n) [Pa]; nothing as above.
  std::optional<Linearisation> linearise(const Eigen::VectorXd& pressure) const;
  /// Covariance of the corrected twists (6 sections x 6 sections) near the pressures of the last
  /// picture, `elapsed` >= 0 [s] after it.
  Eigen::MatrixXd twistCovariance(double elapsed) const;
  /// (n) variance by which unknown play, lags and vibrations let effective pressures differ from
  /// pressures (n) [Pa]: grows with their change since about ArmFilterOptions::settling_time before
  /// the last picture; 0 without one [Pa^2].
  Eigen::VectorXd changeVariance(const Eigen::VectorXd& pressure) const;
  /// (d) standard deviations of b at the start.
  const Eigen::VectorXd& biasDeviation() const;
  /// Nothing before the first picture.
  const std::optional<Step>& lastStep() const;

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

/// Chi-square's 99.99 % point for this many degrees of freedom, to 4 %.
double outlierLimit(int degrees);

}  // namespace helix_arm::estimation
