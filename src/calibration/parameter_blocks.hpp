#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "helix_arm/calibration/calibration_parameters.hpp"
#include "shape_model.hpp"

/// The free parameters of a calibration, as blocks of its least-squares problem.
namespace helix_arm::estimation {

/// Whether a block is free by these options: with free shapes, only those of shapes and rig.
bool isFree(const CalibrationOptions& options, ParameterBlock block);
/// Entries of the stiffness that are free.
std::vector<FitParameter> freeStiffness(const CalibrationOptions& options);
/// Number of length scales.
int lengthScales(const CalibrationOptions& options, const model::Arm& arm);

/// Properties of a parameter, for reports and for its verdict.
struct ParameterInfo {
  std::string name, unit;
  double deviation;  ///< of its prior, in the parameter's units; for stiffness and scales, of the
                     ///< logarithm
  bool logarithmic;
  double reference;      ///< if logarithmic, the value is reference * exp(parameter)
  double initial;        ///< value in the scenes; 0 if they have none and a reference replaces it
  bool about_shape;      ///< stiffness or scale
  bool reported = true;  ///< false for the numbers of a curve, which mean nothing on their own
};

/// Values of the free parameters and their division into blocks: those of ParameterInfo first, then
/// the shapes of captures. The blocks of the least-squares problem and the columns of its
/// information matrix have the same order.
class ParameterBlocks {
 public:
  struct Block {
    ParameterBlock kind;
    int of;      ///< index of its tag or capture; 0 for kinds with a single block
    int column;  ///< index of its first number among all free parameters
    Eigen::VectorXd mean, deviation;  ///< of its prior

    int size() const { return static_cast<int>(deviation.size()); }
  };

  /// Creates all blocks except those of shapes, at their initial values.
  ///
  /// @param arms  at least one.
  /// @param model  model of these arms and the free stiffness.
  ParameterBlocks(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options,
                  const ShapeModel& model);

  /// Multiplies the deviation of the curve's prior.
  void loosenCurve(double factor);

  /// Adds the block of a capture's shape, at the mean of its prior.
  void addShape(int capture, const Eigen::VectorXd& mean, const Eigen::VectorXd& deviation) {
    add(ParameterBlock::kShape, capture, mean, deviation);
  }

  const std::vector<Block>& all() const { return blocks_; }
  /// Index of a block. @throws std::out_of_range if there is none.
  int indexOf(ParameterBlock kind, int of) const;
  /// Number of free parameters of all blocks.
  int columns() const { return static_cast<int>(numbers_.size()); }

  /// Free parameters except those of shapes.
  const std::vector<ParameterInfo>& infos() const { return infos_; }
  /// Values of the free parameters in the order of infos().
  Eigen::VectorXd vector() const { return numbers_.head(static_cast<Eigen::Index>(infos_.size())); }
  /// Values of all free parameters, by their columns: logs of stiffness and scales, of a FreeCurve
  /// its numbers, right-hand motion [m, rad] of the base, shift along and across the arm [m] and
  /// rotation [rad] of tags, border shift [m], twists of captures.
  const Eigen::VectorXd& numbers() const { return numbers_; }
  /// The size must not change.
  void setNumbers(const Eigen::VectorXd& numbers) { numbers_ = numbers; }
  /// Values of a block; empty if it is not free.
  Eigen::Map<const Eigen::VectorXd> of(ParameterBlock kind, int of = 0) const;
  /// Motion of the base or of a tag; 0 if it is not free.
  lie::Vector6 motionOf(ParameterBlock kind, int of = 0) const;
  double borderShift() const;  ///< 0 if it is not free [m]

 private:
  std::vector<Block>::const_iterator find(ParameterBlock kind, int of) const;
  void add(ParameterBlock kind, int of, const Eigen::VectorXd& mean,
           const Eigen::VectorXd& deviation);
  void add(ParameterBlock kind, int of, const std::vector<ParameterInfo>& infos);
  void addStiffness(const CalibrationOptions& options, const ShapeModel& model);
  void addCurve(const FreeCurve& curve);
  void addNumbers(const FitParameterInfo& info, const CalibrationOptions& options, int of,
                  const std::vector<std::string>& names);

  std::vector<Block> blocks_;
  std::vector<ParameterInfo> infos_;
  Eigen::VectorXd numbers_;
};

}  // namespace helix_arm::estimation
