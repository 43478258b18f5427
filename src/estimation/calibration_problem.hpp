#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "helix_arm/estimation/calibration.hpp"
#include "parameter_blocks.hpp"

/// The least squares behind calibrate(): its parameters, its readings, and what they say.
namespace helix_arm::estimation {

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

/// Arms, their readings and the values of what is fitted to them.
///
/// What evaluates readings or shapes is not const: it sets the scale of the noise, and keeps the
/// last shapes that it found.
class CalibrationProblem {
 public:
  /// The data is sound; the problem refers to arms and options.
  CalibrationProblem(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options,
                     const Selection& selection);
  ~CalibrationProblem();

  const Selection& selection() const;
  int captures() const;          ///< of all arms
  int armOf(int capture) const;  ///< index of its arm
  /// Free parameters but those of shapes.
  const std::vector<ParameterInfo>& parameters() const;

  const Values& values() const;
  /// Their sizes are not to change.
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
  std::vector<Comparison> compare(double noise_scale);

  /// Weighted J'J of the readings included, without priors: all free parameters, then shapes.
  Eigen::MatrixXd information(double noise_scale, const Included& included);
  /// Free parameters of each shape; none where they are the model's.
  std::vector<int> shapeSizes() const;
  /// The same of readings that an arm at these pressures would give, as far as it can be told.
  Eigen::MatrixXd expectedInformation(const Eigen::VectorXd& pressure, double noise_scale);
  /// Of the priors: a diagonal.
  Eigen::VectorXd priorInformation() const;

  // What the values stand for.
  model::Stiffness stiffness() const;
  std::optional<double> K_eps() const;  ///< [N], where it is fitted
  Eigen::VectorXd lengthScale() const;  ///< (actuators of the first arm)
  lie::SE3 base() const;
  TagLayout layout() const;
  model::Shape shape(int capture);

 private:
  struct Workspace;
  // A pointer alone would let const methods write.
  Workspace& work() { return *work_; }
  const Workspace& work() const { return *work_; }

  std::unique_ptr<Workspace> work_;
};

}  // namespace helix_arm::estimation
