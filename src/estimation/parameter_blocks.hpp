#pragma once

#include <Eigen/Core>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "helix_arm/estimation/calibration_parameters.hpp"
#include "shape_model.hpp"

/// The free parameters of a calibration, as blocks of its least squares.
namespace helix_arm::estimation {

/// Which parameters are free.
struct Selection {
  std::vector<StiffnessEntry> stiffness;
  LengthScaling length_scale = LengthScaling::kNone;
  std::set<ParameterBlock> rig;  ///< base, bleed and tags, those that are fitted
  bool free_shapes = false;

  bool has(ParameterBlock block) const;
};

/// All that is asked for.
Selection selectionOf(const CalibrationOptions& options);

/// How many length scales there are.
int lengthScales(const Selection& selection, const model::Arm& arm);

/// What a parameter is, for people and for its verdict.
struct ParameterInfo {
  std::string name, unit;
  double deviation;  ///< of its prior, in the parameter's own units; stiffness and scales: of logs
  bool logarithmic;
  double reference;  ///< the value is reference * exp(parameter) where logarithmic
  double initial;    ///< of the scenes; 0 where the reference stands in for none
  bool about_shape;  ///< stiffness or length scale
};

/// Parameters of a calibration, fitted or not.
struct Values {
  Eigen::VectorXd stiffness, length_scale;  ///< logs over their initial values
  /// Numbers of every parameter of the rig except the tags: right-hand motion [m, rad] of the base,
  /// bleed [m].
  std::map<ParameterBlock, Eigen::VectorXd> rig;
  std::vector<lie::Vector6> tags;       ///< shift along the arm and across it [m], rotation [rad]
  std::vector<Eigen::VectorXd> shapes;  ///< twists of captures, where shapes are free
};

/// Values of the free parameters, and how the least squares divides them into blocks: those of
/// ParameterInfo first, then the shapes of captures. Blocks of the least squares and the columns of
/// its information have the same order.
class ParameterBlocks {
 public:
  struct Block {
    ParameterBlock kind;
    int of;      ///< index of its tag or capture; 0 where there is one block of this kind
    int column;  ///< of its first number among all free parameters
    Eigen::VectorXd mean, deviation;  ///< of its prior

    int size() const { return static_cast<int>(deviation.size()); }
  };

  /// All blocks except those of shapes, at their initial values.
  ///
  /// @param arms  of which there is at least one.
  /// @param model  of these arms and the selected stiffness.
  ParameterBlocks(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options,
                  const Selection& selection, const ShapeModel& model);

  /// Adds the block of the next capture's shape, at the mean of its prior.
  void addShape(const Eigen::VectorXd& mean, const Eigen::VectorXd& deviation);

  const std::vector<Block>& all() const { return blocks_; }
  /// Index of a block; @throws std::out_of_range without it.
  int indexOf(ParameterBlock kind, int of) const;
  /// Free parameters of all blocks.
  int columns() const;

  /// Free parameters except those of shapes.
  const std::vector<ParameterInfo>& infos() const { return infos_; }
  /// Values of the free parameters in the order of infos().
  Eigen::VectorXd vector() const;

  const Values& values() const { return values_; }
  Values& values() { return values_; }

  /// The numbers of a block within the values; valid until the values are replaced.
  double* data(const Block& block);
  const double* data(const Block& block) const;
  /// The same of several, by their indices.
  std::vector<double*> data(const std::vector<int>& indices);
  std::vector<const double*> data(const std::vector<int>& indices) const;

 private:
  void add(ParameterBlock kind, int of, Eigen::VectorXd mean, Eigen::VectorXd deviation);
  void addStiffness(const CalibrationOptions& options, const Selection& selection,
                    const ShapeModel& model);
  void addLengthScales(const CalibrationOptions& options, const Selection& selection,
                       const model::Arm& arm);
  void addRig(const FitParameterInfo& info, const CalibrationOptions& options, int of,
              const std::string& name);

  Values values_;
  std::vector<Block> blocks_;
  std::vector<ParameterInfo> infos_;
};

}  // namespace helix_arm::estimation
