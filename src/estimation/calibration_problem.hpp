#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/estimation/calibration.hpp"

/// The least squares behind calibrate(): its parameters, its readings, and what they say.
namespace helix_arm::estimation {

/// The entries of a stiffness that can be fitted; kEps is the one that the others are ratios to.
enum class StiffnessEntry { kKappa, kGamma, kTau, kEps };

/// Which parameters are free.
struct Selection {
  std::vector<StiffnessEntry> stiffness;
  LengthScaling length_scale = LengthScaling::kNone;
  bool base = false, bleed = false, tags = false, free_shapes = false;
};

/// All that is asked for.
Selection selectionOf(const CalibrationOptions& options);

/// What a parameter is, for people and for its verdict.
struct ParameterInfo {
  std::string name, unit;
  double deviation;  ///< of its prior, in the parameter's own units; stiffness and scales: of logs
  bool logarithmic;
  double reference;  ///< the value is reference * exp(parameter) where logarithmic
  double initial;    ///< of the scenes; 0 where the reference stands in for none
  bool about_shape;  ///< stiffness or length scale
};

/// Parameters of a calibration: logs of stiffness and length scales over their initial values,
/// right-hand motion of the base, bleed, motions of the tags, and, where shapes are free, twists.
struct Values {
  Eigen::VectorXd stiffness, length_scale;
  lie::Vector6 base = lie::Vector6::Zero();
  double bleed = 0;
  std::vector<lie::Vector6> tags;  ///< shift along the arm and across it [m], rotation [rad]
  std::vector<Eigen::VectorXd> shapes;
};

/// How a least squares ended.
struct Solved {
  bool converged = false;
  double cost = 0;  ///< of readings and priors: half the robust sum of squares
};

/// One tag, curvature or twist, compared.
struct Comparison {
  int capture;    ///< index over all arms
  int tag;        ///< index in the layout; -1 where it is no tag
  int residuals;  ///< how many numbers it consists of
  double square;  ///< of its residuals, in expected variances
  double limit;   ///< of the square, beyond which it is an outlier; infinite where none can be
  double error;   ///< as people see it [rad, px or m]
  double weight;  ///< that the robust loss leaves it, in (0, 1]
};

class CalibrationProblem {
 public:
  /// The data is sound.
  CalibrationProblem(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options,
                     const Selection& selection);
  ~CalibrationProblem();

  const Selection& selection() const;
  int captures() const;          ///< of all arms
  int armOf(int capture) const;  ///< index of its arm
  /// Free parameters but those of shapes.
  const std::vector<ParameterInfo>& parameters() const;

  Values& values();
  /// Values of the free parameters in the order of parameters().
  Eigen::VectorXd vector() const;

  using Included = std::function<bool(int capture)>;
  /// Least squares over the captures that are included, from where the values stand.
  ///
  /// @param noise_scale  of the expected noise.
  /// @param held  entry of the selected stiffness that stays at its value, if any.
  Solved solve(double noise_scale, const Included& included, std::optional<int> held = {});

  /// All readings at the present values.
  std::vector<Comparison> compare(double noise_scale) const;

  /// Weighted J'J of the readings included, without priors: all free parameters, then shapes.
  Eigen::MatrixXd information(double noise_scale, const Included& included) const;
  /// Free parameters of each shape; none where they are the model's.
  std::vector<int> shapeSizes() const;
  /// The same of readings that an arm at these pressures would give, as far as it can be told.
  Eigen::MatrixXd expectedInformation(const Eigen::VectorXd& pressure, double noise_scale) const;
  /// Of the priors: a diagonal.
  Eigen::VectorXd priorInformation() const;

  // What the values stand for.
  model::Stiffness stiffness() const;
  std::optional<double> K_eps() const;  ///< [N], where it is fitted
  Eigen::VectorXd lengthScale() const;  ///< (actuators of the first arm)
  lie::SE3 base() const;
  TagLayout layout() const;
  model::Shape shape(int capture) const;

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

}  // namespace helix_arm::estimation
