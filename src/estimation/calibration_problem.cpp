#include "calibration_problem.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>

#include "helix_arm/model/curve.hpp"
#include "tag_models.hpp"

namespace helix_arm::estimation {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Of the logs: step of the central differences of the maps, with an error of its square.
constexpr double kMapStep = 1e-4;
// Of the bending stiffness of an arm that has none yet, in squares of its actuators' offset.
constexpr double kLikelyBending = 0.2;
// A tag whose normal is farther from the line of sight than this cosine is not counted on.
constexpr double kFacing = 0.3;

const char* parameterName(StiffnessEntry entry) {
  switch (entry) {
    case StiffnessEntry::kKappa:
      return "K_kappa";
    case StiffnessEntry::kGamma:
      return "K_gamma";
    case StiffnessEntry::kTau:
      break;
  }
  return "K_tau";
}

double& entryOf(model::Stiffness& stiffness, StiffnessEntry entry) {
  switch (entry) {
    case StiffnessEntry::kKappa:
      return stiffness.kappa;
    case StiffnessEntry::kGamma:
      return stiffness.gamma;
    case StiffnessEntry::kTau:
      break;
  }
  return stiffness.tau;
}

// The linear maps of all arms at some stiffness, and how they change with it.
class ShapeModel {
 public:
  ShapeModel(const std::vector<ArmCaptures>& arms, const std::vector<StiffnessEntry>& fitted)
      : arms_(arms), fitted_(fitted) {
    initial_ = arms.front().arm.actuator(0).stiffness;
    reference_ = initial_;
    double offset = 0;
    for (int i = 0; i < arms.front().arm.actuatorCount(); ++i) {
      offset = std::max(offset, arms.front().arm.actuator(i).X_O.translation.squaredNorm());
    }
    if (!(reference_.kappa > 0)) reference_.kappa = kLikelyBending * offset;
    if (!(reference_.gamma > 0)) reference_.gamma = 1.0;
    if (!(reference_.tau > 0)) reference_.tau = reference_.kappa;
  }

  double referenceOf(StiffnessEntry entry) const {
    model::Stiffness reference = reference_;
    return entryOf(reference, entry);
  }

  // With the fitted entries at these logs, the others as they are.
  model::Stiffness stiffnessAt(const double* logs, model::Stiffness stiffness) const {
    for (std::size_t e = 0; e < fitted_.size(); ++e) {
      entryOf(stiffness, fitted_[e]) = referenceOf(fitted_[e]) * std::exp(logs[e]);
    }
    return stiffness;
  }
  const model::Stiffness& initial() const { return initial_; }

  // Twists of arm `a` at these lengths, and, where asked for, their change with the logs.
  void twists(int a, const Eigen::VectorXd& lengths, const double* logs, model::Twists& twists,
              Eigen::MatrixXd* by_stiffness) {
    update(logs, by_stiffness != nullptr);
    const model::Arm& arm = arms_[a].arm;
    twists.resize(6, arm.sectionCount());
    if (by_stiffness) by_stiffness->resize(6 * arm.sectionCount(), size());
    for (int k = 0; k < arm.sectionCount(); ++k) {
      const auto l = lengths.segment(arm.firstActuator(k), count(arm, k));
      twists.col(k) = maps_[a][k] * l;
      for (int e = 0; by_stiffness && e < size(); ++e) {
        by_stiffness->block<6, 1>(6 * k, e) = changes_[a][k][e] * l;
      }
    }
  }

  // The map of the section that an actuator belongs to, at the logs last seen.
  const Eigen::MatrixXd& mapOf(int a, int section) const { return maps_[a][section]; }

  static int count(const model::Arm& arm, int k) {
    return arm.firstActuator(k + 1) - arm.firstActuator(k);
  }

 private:
  using Maps = std::vector<std::vector<Eigen::MatrixXd>>;  // [arm][section]

  int size() const { return static_cast<int>(fitted_.size()); }

  Maps mapsAt(const Eigen::VectorXd& logs) const {
    Maps maps(arms_.size());
    for (std::size_t a = 0; a < arms_.size(); ++a) {
      const model::Arm& arm = arms_[a].arm;
      for (int k = 0; k < arm.sectionCount(); ++k) {
        std::vector<model::Strand<lie::SE3>> strands;
        for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
          const model::Actuator& actuator = arm.actuator(i);
          strands.push_back(
              {actuator.X_O, stiffnessAt(logs.data(), actuator.stiffness).diagonal<lie::SE3>()});
        }
        maps[a].emplace_back(model::solveEquilibrium(strands).map);
      }
    }
    return maps;
  }

  void update(const double* logs, bool derivatives) {
    const Eigen::VectorXd at = Eigen::Map<const Eigen::VectorXd>(logs, size());
    const bool known = !maps_.empty() && at_ == at;
    if (known && (has_changes_ || !derivatives)) return;
    if (!known) maps_ = mapsAt(at);
    at_ = at;
    has_changes_ = derivatives;
    if (!derivatives) return;
    changes_.assign(arms_.size(), {});
    for (std::size_t a = 0; a < arms_.size(); ++a) {
      changes_[a].assign(arms_[a].arm.sectionCount(), std::vector<Eigen::MatrixXd>(fitted_.size()));
    }
    for (int e = 0; e < size(); ++e) {
      const Eigen::VectorXd step = kMapStep * Eigen::VectorXd::Unit(size(), e);
      const Maps above = mapsAt(at + step), below = mapsAt(at - step);
      for (std::size_t a = 0; a < arms_.size(); ++a) {
        for (std::size_t k = 0; k < above[a].size(); ++k) {
          changes_[a][k][e] = (above[a][k] - below[a][k]) / (2 * kMapStep);
        }
      }
    }
  }

  const std::vector<ArmCaptures>& arms_;
  const std::vector<StiffnessEntry> fitted_;
  model::Stiffness initial_, reference_;
  Eigen::VectorXd at_;
  bool has_changes_ = false;
  Maps maps_;
  std::vector<std::vector<std::vector<Eigen::MatrixXd>>> changes_;  // [arm][section][entry]
};

// Of one arm: which entries of its twists are free where shapes are.
std::vector<int> freeEntries(const ArmCaptures& arm) {
  std::vector<int> entries;
  for (int entry = 0; entry < 6 * arm.arm.sectionCount(); ++entry) {
    const int axis = entry % 6;
    if (!arm.planar || axis < 2 || axis == 5) entries.push_back(entry);
  }
  return entries;
}

// What all costs share.
struct Shared {
  const std::vector<ArmCaptures>& arms;
  const CalibrationOptions& options;
  Selection selection;
  ShapeModel model;
  double inverse_noise = 1;  // 1 / scale of the expected noise
  TwistFitOptions expected;  // noise of tags

  Shared(const std::vector<ArmCaptures>& all, const CalibrationOptions& wanted,
         const Selection& chosen)
      : arms(all), options(wanted), selection(chosen), model(all, chosen.stiffness) {
    expected.corner_noise = options.corner_noise;
    expected.position_noise = options.position_noise;
    expected.rotation_noise = options.rotation_noise;
  }

  int scales() const {
    if (selection.length_scale == LengthScaling::kNone) return 0;
    return selection.length_scale == LengthScaling::kCommon ? 1 : arms.front().arm.actuatorCount();
  }
  double scaleOf(const double* logs, int actuator) const {
    if (scales() == 0) return 1;
    return std::exp(logs[scales() == 1 ? 0 : actuator]);
  }
};

// Where a reading was taken.
struct Place {
  int arm, capture;         // capture: over all arms
  Eigen::VectorXd lengths;  // at its pressures [m]
};

// Parameters of a cost in Ceres' order, and where each stands in it.
struct Blocks {
  int stiffness = -1, scale = -1, shape = -1, base = -1, bleed = -1, tag = -1;
};

// The twists that a cost sees, and how its blocks change them.
struct ShapeThere {
  model::Twists twists;
  Eigen::MatrixXd by_stiffness, by_scale;  // (6 sections x entries)
};

class ReadingCost : public ceres::CostFunction {
 public:
  ReadingCost(Shared& shared, Place place, int residuals, bool takes_base, bool takes_bleed,
              bool takes_tag)
      : shared_(shared), place_(std::move(place)), entries_(freeEntries(shared.arms[place_.arm])) {
    set_num_residuals(residuals);
    const auto take = [this](bool taken, int size, int& index) {
      if (!taken || size == 0) return;
      index = static_cast<int>(parameter_block_sizes().size());
      mutable_parameter_block_sizes()->push_back(size);
    };
    const Selection& selection = shared.selection;
    const bool free = selection.free_shapes;
    take(!free, static_cast<int>(selection.stiffness.size()), blocks_.stiffness);
    take(!free, shared.scales(), blocks_.scale);
    take(free, static_cast<int>(entries_.size()), blocks_.shape);
    take(takes_base && selection.base, 6, blocks_.base);
    take(takes_bleed && selection.bleed, 1, blocks_.bleed);
    take(takes_tag && selection.tags, 6, blocks_.tag);
  }

  const Blocks& blocks() const { return blocks_; }
  const Place& place() const { return place_; }
  int parameterBlocks() const { return static_cast<int>(parameter_block_sizes().size()); }
  virtual int tag() const { return -1; }
  // The error as people see it, of residuals that this cost gave.
  virtual double shown(const double* const* parameters, double square) const = 0;

 protected:
  ShapeThere shapeAt(const double* const* p, bool derivatives) const {
    ShapeThere shape;
    const ArmCaptures& data = shared_.arms[place_.arm];
    const int sections = data.arm.sectionCount();
    if (blocks_.shape >= 0) {
      shape.twists = model::Twists::Zero(6, sections);
      for (std::size_t i = 0; i < entries_.size(); ++i) {
        shape.twists.data()[entries_[i]] = p[blocks_.shape][i];
      }
      return shape;
    }
    Eigen::VectorXd lengths = place_.lengths;
    const double* scales = blocks_.scale >= 0 ? p[blocks_.scale] : nullptr;
    for (int i = 0; i < lengths.size(); ++i) lengths[i] *= shared_.scaleOf(scales, i);
    shared_.model.twists(place_.arm, lengths,
                         blocks_.stiffness >= 0 ? p[blocks_.stiffness] : nullptr, shape.twists,
                         derivatives ? &shape.by_stiffness : nullptr);
    if (derivatives && scales != nullptr) {
      shape.by_scale.setZero(6 * sections, shared_.scales());
      for (int k = 0; k < sections; ++k) {
        for (int i = data.arm.firstActuator(k); i < data.arm.firstActuator(k + 1); ++i) {
          shape.by_scale.block<6, 1>(6 * k, shared_.scales() == 1 ? 0 : i) +=
              shared_.model.mapOf(place_.arm, k).col(i - data.arm.firstActuator(k)) * lengths[i];
        }
      }
    }
    return shape;
  }

  // Passes derivatives by the twists on to the blocks that make them.
  void passOn(const Eigen::MatrixXd& by_twists, const ShapeThere& shape, double** J) const {
    const auto block = [&](int index, const Eigen::MatrixXd& derivatives) {
      if (index < 0 || J[index] == nullptr) return;
      Eigen::Map<RowMajor>(J[index], derivatives.rows(), derivatives.cols()) = derivatives;
    };
    if (blocks_.stiffness >= 0) block(blocks_.stiffness, by_twists * shape.by_stiffness);
    if (blocks_.scale >= 0) block(blocks_.scale, by_twists * shape.by_scale);
    if (blocks_.shape < 0 || J[blocks_.shape] == nullptr) return;
    Eigen::Map<RowMajor> out(J[blocks_.shape], by_twists.rows(),
                             static_cast<Eigen::Index>(entries_.size()));
    for (std::size_t i = 0; i < entries_.size(); ++i) out.col(i) = by_twists.col(entries_[i]);
  }

  Shared& shared_;
  const Place place_;
  const std::vector<int> entries_;  // of the twists, where shapes are free
  Blocks blocks_;
};

// |(w_y, w_z)| of the only section.
class CurvatureCost final : public ReadingCost {
 public:
  CurvatureCost(Shared& shared, Place place, double measured)
      : ReadingCost(shared, std::move(place), 1, false, false, false), measured_(measured) {}

  bool Evaluate(const double* const* p, double* residual, double** J) const override {
    const double weight = shared_.inverse_noise / shared_.options.curvature_noise;
    const ShapeThere shape = shapeAt(p, J != nullptr);
    const double curvature = model::curvatureOf(shape.twists.col(0));
    residual[0] = weight * (curvature - measured_);
    if (J == nullptr) return true;
    Eigen::MatrixXd by_twists = Eigen::MatrixXd::Zero(1, 6);
    // A straight arm bends alike to all sides: no direction is the one of change.
    if (curvature > 0)
      by_twists.rightCols(2) = weight / curvature * shape.twists.col(0).tail<2>().transpose();
    passOn(by_twists, shape, J);
    return true;
  }

  double shown(const double* const*, double square) const override {
    return std::sqrt(square) * shared_.options.curvature_noise / shared_.inverse_noise;
  }

 private:
  const double measured_;
};

class TwistCost final : public ReadingCost {
 public:
  TwistCost(Shared& shared, Place place, const TwistReading& reading)
      : ReadingCost(shared, std::move(place), static_cast<int>(reading.twists.size()), false, false,
                    false),
        measured_(reading.twists) {
    const Eigen::LLT<Eigen::MatrixXd> factors(reading.covariance);
    whitening_ = factors.matrixL().solve(
        Eigen::MatrixXd::Identity(reading.covariance.rows(), reading.covariance.cols()));
  }

  bool Evaluate(const double* const* p, double* residual, double** J) const override {
    const ShapeThere shape = shapeAt(p, J != nullptr);
    const model::Twists difference = shape.twists - measured_;
    Eigen::Map<Eigen::VectorXd>(residual, num_residuals()) =
        shared_.inverse_noise * whitening_ *
        Eigen::Map<const Eigen::VectorXd>(difference.data(), difference.size());
    if (J != nullptr) passOn(shared_.inverse_noise * whitening_, shape, J);
    return true;
  }

  // Distance of the tips [m].
  double shown(const double* const* p, double) const override {
    return (model::tipPose(shapeAt(p, false).twists).translation -
            model::tipPose(measured_).translation)
        .norm();
  }

 private:
  const model::Twists measured_;
  Eigen::MatrixXd whitening_;
};

template <class Model>
class TagCost final : public ReadingCost {
 public:
  TagCost(Shared& shared, Place place, const Model& model, typename Model::Observation seen,
          bool takes_tag)
      : ReadingCost(shared, std::move(place), model.residuals(), true, Model::kBleeds, takes_tag),
        model_(model),
        seen_(std::move(seen)) {
    const model::Arm& arm = shared.arms[place_.arm].arm;
    const TagPlacement& tag = placement();
    rest_length_ = arm.restTwist(tag.section).template head<3>().norm();
  }

  int tag() const override { return seen_.tag; }

  bool Evaluate(const double* const* p, double* residual, double** J) const override {
    const ShapeThere shape = shapeAt(p, J != nullptr);
    const Pose pose = poseAt(p, shape.twists);
    typename Model::Rows rows;
    if (!model_.evaluate(seen_, pose.X_B0T, corners(p), rows)) return false;
    const int m = num_residuals();
    rows.residual *= shared_.inverse_noise;
    Eigen::Map<Eigen::VectorXd>(residual, m) = rows.residual.head(m);
    if (J == nullptr) return true;
    rows.by_v *= shared_.inverse_noise;
    rows.by_w *= shared_.inverse_noise;
    if (Model::kBleeds) rows.by_bleed *= shared_.inverse_noise;

    const TagPlacement& tag = placement();
    Eigen::MatrixXd by_twists = Eigen::MatrixXd::Zero(Model::Rows::kCount, shape.twists.size());
    for (int k = 0; k <= tag.section; ++k) {
      const double reach = k < tag.section ? 1.0 : pose.s;
      Mover(pose.starts[k], shape.twists.col(k), reach).fill(rows, 6 * k, by_twists);
    }
    passOn(by_twists.topRows(m), shape, J);
    if (blocks_.base >= 0 && J[blocks_.base] != nullptr) {
      Eigen::MatrixXd moved(Model::Rows::kCount, 6);
      Mover(pose.starts[0]).fill(rows, 0, moved);
      const Eigen::Map<const lie::Vector6> base(p[blocks_.base]);
      Eigen::Map<RowMajor>(J[blocks_.base], m, 6) =
          (moved * lie::SE3::rightJacobian(base)).topRows(m);
    }
    if constexpr (Model::kBleeds) {
      if (blocks_.bleed >= 0 && J[blocks_.bleed] != nullptr) {
        Eigen::Map<Eigen::VectorXd>(J[blocks_.bleed], m) = rows.by_bleed.head(m);
      }
    }
    if (blocks_.tag >= 0 && J[blocks_.tag] != nullptr) {
      Eigen::Map<RowMajor>(J[blocks_.tag], m, 6) =
          byPlacement(p, shape.twists, pose, rows).topRows(m);
    }
    return true;
  }

  double shown(const double* const* p, double square) const override {
    const double expected = square / (shared_.inverse_noise * shared_.inverse_noise);
    return model_.shown(seen_, poseAt(p, shapeAt(p, false).twists).X_B0T, expected);
  }

  // Whether it turns its face to the camera.
  bool faces(const double* const* p) const {
    if constexpr (Model::kBleeds) {
      const lie::SE3 X_CT = model_.X_CB0 * poseAt(p, shapeAt(p, false).twists).X_B0T;
      return X_CT.translation.z() > 0 &&
             -X_CT.rotation.col(2).dot(X_CT.translation.normalized()) > kFacing;
    }
    return true;
  }

 private:
  struct Pose {
    double s;
    std::vector<lie::SE3> starts;  // X_B0k of the sections up to the tag's
    lie::SE3 X_B0S, X_B0T;
  };

  const TagPlacement& placement() const { return shared_.arms[place_.arm].layout.tags[seen_.tag]; }

  Corners corners(const double* const* p) const {
    return shared_.arms[place_.arm].layout.corners(blocks_.bleed >= 0 ? p[blocks_.bleed][0] : 0.0);
  }

  Pose poseAt(const double* const* p, const model::Twists& twists) const {
    TagPlacement tag = placement();
    if (blocks_.tag >= 0) {
      tag = movedBy(tag, Eigen::Map<const lie::Vector6>(p[blocks_.tag]), rest_length_);
    }
    Pose pose;
    pose.s = tag.s;
    lie::SE3 X_B0k;
    if (blocks_.base >= 0) {
      X_B0k = lie::SE3::exp(Eigen::Map<const lie::Vector6>(p[blocks_.base]));
    }
    for (int k = 0; k <= tag.section; ++k) {
      pose.starts.push_back(X_B0k);
      if (k < tag.section) X_B0k = X_B0k * lie::SE3::exp(twists.col(k));
    }
    pose.X_B0S = X_B0k * lie::SE3::exp(pose.s * twists.col(tag.section));
    pose.X_B0T = pose.X_B0S * tag.X_ST;
    return pose;
  }

  Eigen::MatrixXd byPlacement(const double* const* p, const model::Twists& twists, const Pose& pose,
                              const typename Model::Rows& rows) const {
    const TagPlacement& tag = placement();
    const Eigen::Vector3d turned(p[blocks_.tag][3], p[blocks_.tag][4], p[blocks_.tag][5]);
    Eigen::MatrixXd out(Model::Rows::kCount, 6);
    Eigen::MatrixXd moved(Model::Rows::kCount, 6);
    Mover(pose.X_B0S).fill(rows, 0, moved);
    const double s = tag.s + p[blocks_.tag][0] / rest_length_;
    if (s == pose.s) {
      out.col(0) = moved * twists.col(tag.section) / rest_length_;
    } else {  // beyond an end, along x
      out.col(0) = moved.col(0);
    }
    out.middleCols<2>(1) = rows.by_v * pose.X_B0S.rotation.template rightCols<2>();
    lie::Vector6 phi = lie::Vector6::Zero();
    phi.tail<3>() = turned;
    const Eigen::Matrix3d w =
        pose.X_B0T.rotation * lie::SE3::rightJacobian(phi).template bottomRightCorner<3, 3>();
    out.rightCols<3>() = rows.by_v * lie::skew(pose.X_B0T.translation) * w + rows.by_w * w;
    return out;
  }

  const Model model_;
  const typename Model::Observation seen_;
  double rest_length_;  // of the section [m]
};

Eigen::VectorXd lengthsAt(const model::Arm& arm, const Eigen::VectorXd& pressure) {
  return arm.lengths(pressure);
}

}  // namespace

struct CalibrationProblem::Workspace {
  struct Term {
    std::unique_ptr<ReadingCost> cost;
    std::vector<double*> parameters;
    std::unique_ptr<ceres::LossFunction> loss;  // none for twists, whose covariance is given
    double limit;                               // squared residuals beyond which it is an outlier
  };
  // A block of parameters as Ceres has it.
  struct Block {
    double* data;
    Eigen::VectorXd deviation;  // of its prior
    bool shape;                 // of one capture
    int capture = -1;
    const double* prior = nullptr;  // mean; 0 without one
  };

  const std::vector<ArmCaptures>& arms;
  Shared shared;
  Values values;
  std::vector<Block> blocks;  // global ones first
  std::vector<ParameterInfo> infos;
  std::vector<Term> terms;
  std::vector<std::pair<int, int>> places;  // arm and index of each capture
  std::vector<Eigen::VectorXd> shape_means;
  int held_tag = -1;

  Workspace(const std::vector<ArmCaptures>& data, const CalibrationOptions& options,
            const Selection& selection)
      : arms(data), shared(data, options, selection) {
    for (std::size_t a = 0; a < arms.size(); ++a) {
      for (std::size_t c = 0; c < arms[a].captures.size(); ++c) {
        places.emplace_back(static_cast<int>(a), static_cast<int>(c));
      }
    }
    values.stiffness.setZero(static_cast<Eigen::Index>(selection.stiffness.size()));
    values.length_scale.setZero(shared.scales());
    const TagLayout& layout = arms.front().layout;
    values.tags.assign(layout.tags.size(), lie::Vector6::Zero());
    // It fixes the frame that all is seen from.
    held_tag = layout.baseTag();
    addParameters();
    for (std::size_t c = 0; c < places.size(); ++c) addTerms(static_cast<int>(c));
  }

  const ArmCaptures& armOf(int capture) const { return arms[places[capture].first]; }
  const Capture& captureOf(int capture) const {
    return armOf(capture).captures[places[capture].second];
  }

  void addBlock(double* data, Eigen::VectorXd deviation) {
    blocks.push_back({data, std::move(deviation), false});
  }

  void addParameters() {
    const Selection& selection = shared.selection;
    const CalibrationOptions& options = shared.options;
    if (!selection.free_shapes && values.stiffness.size() > 0) {
      addBlock(values.stiffness.data(),
               Eigen::VectorXd::Constant(values.stiffness.size(), options.stiffness_prior));
      for (const StiffnessEntry entry : selection.stiffness) {
        infos.push_back({parameterName(entry), entry == StiffnessEntry::kGamma ? "" : "m^2",
                         options.stiffness_prior, true, shared.model.referenceOf(entry), true});
      }
    }
    if (!selection.free_shapes && shared.scales() > 0) {
      addBlock(values.length_scale.data(),
               Eigen::VectorXd::Constant(shared.scales(), options.length_scale_prior));
      for (int i = 0; i < shared.scales(); ++i) {
        const std::string suffix =
            shared.scales() == 1 ? "" : "_" + arms.front().arm.actuator(i).name;
        infos.push_back({"length_scale" + suffix, "", options.length_scale_prior, true, 1.0, true});
      }
    }
    const auto addMotion = [this](const std::string& prefix, const char* const(&names)[6],
                                  const Eigen::VectorXd& deviation) {
      for (int i = 0; i < 6; ++i) {
        infos.push_back({prefix + names[i], i < 3 ? "m" : "rad", deviation[i], false, 0.0, false});
      }
    };
    if (selection.base) {
      Eigen::VectorXd deviation(6);
      deviation << Eigen::Vector3d::Constant(options.base_prior.translation),
          Eigen::Vector3d::Constant(options.base_prior.rotation);
      addBlock(values.base.data(), deviation);
      addMotion("base_", {"x", "y", "z", "rx", "ry", "rz"}, deviation);
    }
    if (selection.bleed) {
      addBlock(&values.bleed, Eigen::VectorXd::Constant(1, options.bleed_prior));
      infos.push_back({"bleed", "m", options.bleed_prior, false, 0.0, false});
    }
    if (selection.tags) {
      Eigen::VectorXd deviation(6);
      deviation << Eigen::Vector3d::Constant(options.tag_prior.translation),
          Eigen::Vector3d::Constant(options.tag_prior.rotation);
      const TagLayout& layout = arms.front().layout;
      for (std::size_t i = 0; i < layout.tags.size(); ++i) {
        if (static_cast<int>(i) == held_tag) continue;
        addBlock(values.tags[i].data(), deviation);
        addMotion("tag_" + std::to_string(layout.tags[i].id) + "_",
                  {"along", "y", "z", "rx", "ry", "rz"}, deviation);
      }
    }
    if (!selection.free_shapes) return;
    // Ceres keeps pointers to these.
    values.shapes.reserve(places.size());
    shape_means.reserve(places.size());
    for (std::size_t c = 0; c < places.size(); ++c) {
      const ArmCaptures& data = armOf(static_cast<int>(c));
      const std::vector<int> entries = freeEntries(data);
      const model::Twists model = data.arm.twists(captureOf(static_cast<int>(c)).pressure);
      Eigen::VectorXd mean(entries.size()), deviation(entries.size());
      for (std::size_t i = 0; i < entries.size(); ++i) {
        mean[i] = model.data()[entries[i]];
        deviation[i] =
            entries[i] % 6 < 3 ? options.model_prior.translation : options.model_prior.rotation;
      }
      values.shapes.push_back(mean);
      shape_means.push_back(mean);
      blocks.push_back({values.shapes.back().data(), deviation, true, static_cast<int>(c),
                        shape_means.back().data()});
    }
  }

  // Pointers of a cost's parameters, in its order.
  std::vector<double*> parametersOf(const ReadingCost& cost) {
    std::vector<double*> out(cost.parameterBlocks());
    const Blocks& at = cost.blocks();
    const auto put = [&out](int index, double* data) {
      if (index >= 0) out[index] = data;
    };
    put(at.stiffness, values.stiffness.data());
    put(at.scale, values.length_scale.data());
    if (at.shape >= 0) out[at.shape] = values.shapes[cost.place().capture].data();
    put(at.base, values.base.data());
    put(at.bleed, &values.bleed);
    if (at.tag >= 0) out[at.tag] = values.tags[cost.tag()].data();
    return out;
  }

  template <class Observation>
  std::unique_ptr<ReadingCost> tagCost(const Place& place, const Observation& seen) {
    const ArmCaptures& data = arms[place.arm];
    const bool free = seen.tag != held_tag;
    if constexpr (std::is_same_v<Observation, CornerObservation>) {
      const CornerModel model{data.X_CB, data.focal / shared.options.corner_noise, shared.expected};
      return std::make_unique<TagCost<CornerModel>>(shared, place, model, seen, free);
    } else {
      return std::make_unique<TagCost<PoseModel>>(shared, place, PoseModel{shared.expected}, seen,
                                                  free);
    }
  }

  std::vector<std::unique_ptr<ReadingCost>> costsOf(const Place& place, const Reading& reading) {
    std::vector<std::unique_ptr<ReadingCost>> costs;
    if (const auto* curvature = std::get_if<CurvatureReading>(&reading)) {
      costs.push_back(std::make_unique<CurvatureCost>(shared, place, curvature->curvature));
    } else if (const auto* twists = std::get_if<TwistReading>(&reading)) {
      costs.push_back(std::make_unique<TwistCost>(shared, place, *twists));
    } else if (const auto* poses = std::get_if<std::vector<PoseObservation>>(&reading)) {
      for (const PoseObservation& seen : *poses) costs.push_back(tagCost(place, seen));
    } else {
      for (const CornerObservation& seen : std::get<std::vector<CornerObservation>>(reading)) {
        costs.push_back(tagCost(place, seen));
      }
    }
    return costs;
  }

  void addTerms(int capture) {
    const Capture& measured = captureOf(capture);
    const Place place{places[capture].first, capture,
                      lengthsAt(armOf(capture).arm, measured.pressure)};
    const bool robust = !std::holds_alternative<TwistReading>(measured.reading);
    for (std::unique_ptr<ReadingCost>& cost : costsOf(place, measured.reading)) {
      Term term;
      const double scale = shared.options.robust_scale * std::sqrt(cost->num_residuals());
      term.limit = scale * scale;
      if (robust) term.loss = std::make_unique<ceres::CauchyLoss>(scale);
      term.parameters = parametersOf(*cost);
      term.cost = std::move(cost);
      terms.push_back(std::move(term));
    }
  }

  double squareOf(const Term& term, std::vector<double>& residuals) const {
    residuals.resize(term.cost->num_residuals());
    if (!term.cost->Evaluate(term.parameters.data(), residuals.data(), nullptr)) {
      return std::numeric_limits<double>::infinity();
    }
    return Eigen::Map<const Eigen::VectorXd>(residuals.data(),
                                             static_cast<Eigen::Index>(residuals.size()))
        .squaredNorm();
  }

  double weightOf(const Term& term, double square) const {
    return term.loss ? 1 / (1 + square / term.limit) : 1.0;
  }

  // First column of a block among all free parameters, and how many there are.
  int columnOf(const double* data) const {
    int column = 0;
    for (const Block& block : blocks) {
      if (block.data == data) return column;
      column += static_cast<int>(block.deviation.size());
    }
    return -1;
  }
  int columns() const {
    int count = 0;
    for (const Block& block : blocks) count += static_cast<int>(block.deviation.size());
    return count;
  }

  void addInformation(const ReadingCost& cost, const std::vector<double*>& parameters,
                      const std::function<double(double)>& weigh, Eigen::MatrixXd& H) const {
    const int rows = cost.num_residuals();
    std::vector<double> residuals(rows);
    std::vector<RowMajor> jacobians;
    std::vector<double*> pointers;
    for (const int size : cost.parameter_block_sizes()) jacobians.emplace_back(rows, size);
    for (RowMajor& jacobian : jacobians) pointers.push_back(jacobian.data());
    if (!cost.Evaluate(parameters.data(), residuals.data(), pointers.data())) return;
    const double weight =
        weigh(Eigen::Map<const Eigen::VectorXd>(residuals.data(), rows).squaredNorm());
    for (std::size_t i = 0; i < jacobians.size(); ++i) {
      const int row = columnOf(parameters[i]);
      for (std::size_t j = 0; j < jacobians.size(); ++j) {
        const int column = columnOf(parameters[j]);
        H.block(row, column, jacobians[i].cols(), jacobians[j].cols()) +=
            weight * (jacobians[i].transpose() * jacobians[j]);
      }
    }
  }
};

CalibrationProblem::CalibrationProblem(const std::vector<ArmCaptures>& arms,
                                       const CalibrationOptions& options,
                                       const Selection& selection)
    : work_(std::make_unique<Workspace>(arms, options, selection)) {}
CalibrationProblem::~CalibrationProblem() = default;

const Selection& CalibrationProblem::selection() const { return work_->shared.selection; }
int CalibrationProblem::captures() const { return static_cast<int>(work_->places.size()); }
int CalibrationProblem::armOf(int capture) const { return work_->places[capture].first; }
const std::vector<ParameterInfo>& CalibrationProblem::parameters() const { return work_->infos; }
Values& CalibrationProblem::values() { return work_->values; }

Eigen::VectorXd CalibrationProblem::vector() const {
  Eigen::VectorXd out(static_cast<Eigen::Index>(work_->infos.size()));
  int at = 0;
  for (const Workspace::Block& block : work_->blocks) {
    if (block.shape) continue;
    out.segment(at, block.deviation.size()) =
        Eigen::Map<const Eigen::VectorXd>(block.data, block.deviation.size());
    at += static_cast<int>(block.deviation.size());
  }
  return out;
}

bool CalibrationProblem::solve(double noise_scale, const Included& included) {
  Workspace& work = *work_;
  work.shared.inverse_noise = 1 / noise_scale;
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(options);
  std::vector<std::unique_ptr<ceres::NormalPrior>> priors;
  ceres::Solver::Options solver;
  solver.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (const Workspace::Block& block : work.blocks) {
    if (block.shape && !included(block.capture)) continue;
    const int size = static_cast<int>(block.deviation.size());
    ceres::Vector mean = ceres::Vector::Zero(size);
    if (block.prior != nullptr) mean = Eigen::Map<const Eigen::VectorXd>(block.prior, size);
    const ceres::Matrix precision = block.deviation.cwiseInverse().asDiagonal();
    priors.push_back(std::make_unique<ceres::NormalPrior>(precision, mean));
    problem.AddResidualBlock(priors.back().get(), nullptr, block.data);
    // What each reading sees only one of is eliminated first: the shape of its capture, or, where
    // shapes are the model's, its tag.
    const bool is_tag = !work.values.tags.empty() &&
                        block.data >= work.values.tags.front().data() &&
                        block.data <= work.values.tags.back().data();
    const bool first = work.shared.selection.free_shapes ? block.shape : is_tag;
    solver.linear_solver_ordering->AddElementToGroup(block.data, first ? 0 : 1);
  }
  for (const Workspace::Term& term : work.terms) {
    if (!included(term.cost->place().capture)) continue;
    problem.AddResidualBlock(term.cost.get(), term.loss.get(), term.parameters);
  }
  solver.linear_solver_type = ceres::SPARSE_SCHUR;
  solver.max_num_iterations = work.shared.options.max_iterations;
  solver.function_tolerance = 1e-9;
  solver.parameter_tolerance = 1e-10;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  return summary.termination_type == ceres::CONVERGENCE;
}

std::vector<Comparison> CalibrationProblem::compare(double noise_scale) const {
  Workspace& work = *work_;
  work.shared.inverse_noise = 1 / noise_scale;
  std::vector<Comparison> out;
  std::vector<double> residuals;
  for (const Workspace::Term& term : work.terms) {
    const double square = work.squareOf(term, residuals);
    out.push_back({term.cost->place().capture, term.cost->tag(), term.cost->num_residuals(), square,
                   term.cost->shown(term.parameters.data(), square), work.weightOf(term, square)});
  }
  return out;
}

Eigen::MatrixXd CalibrationProblem::information(double noise_scale,
                                                const Included& included) const {
  Workspace& work = *work_;
  work.shared.inverse_noise = 1 / noise_scale;
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(work.columns(), work.columns());
  for (const Workspace::Term& term : work.terms) {
    if (!included(term.cost->place().capture)) continue;
    work.addInformation(
        *term.cost, term.parameters, [&](double square) { return work.weightOf(term, square); }, H);
  }
  return H;
}

Eigen::MatrixXd CalibrationProblem::expectedInformation(const Eigen::VectorXd& pressure,
                                                        double noise_scale) const {
  Workspace& work = *work_;
  work.shared.inverse_noise = 1 / noise_scale;
  const ArmCaptures& data = work.arms.front();
  const Place place{0, 0, lengthsAt(data.arm, pressure)};
  // The readings of the captures there are, each tag once.
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(work.columns(), work.columns());
  std::vector<bool> seen(data.layout.tags.size(), false);
  const auto add = [&](const Reading& reading) {
    for (const std::unique_ptr<ReadingCost>& cost : work.costsOf(place, reading)) {
      const std::vector<double*> parameters = work.parametersOf(*cost);
      if (const auto* tag = dynamic_cast<const TagCost<CornerModel>*>(cost.get())) {
        if (!tag->faces(parameters.data())) continue;
      }
      work.addInformation(
          *cost, parameters, [](double) { return 1.0; }, H);
    }
  };
  const auto addNew = [&](const auto& observations) {
    auto fresh = observations;
    fresh.erase(std::remove_if(fresh.begin(), fresh.end(),
                               [&seen](const auto& one) {
                                 const bool known = seen[one.tag];
                                 seen[one.tag] = true;
                                 return known;
                               }),
                fresh.end());
    add(fresh);
  };
  for (const Capture& capture : data.captures) {
    if (const auto* poses = std::get_if<std::vector<PoseObservation>>(&capture.reading)) {
      addNew(*poses);
    } else if (const auto* corners =
                   std::get_if<std::vector<CornerObservation>>(&capture.reading)) {
      addNew(*corners);
    } else {
      add(capture.reading);
      break;
    }
  }
  return H;
}

std::vector<int> CalibrationProblem::shapeSizes() const {
  std::vector<int> sizes;
  for (const Workspace::Block& block : work_->blocks) {
    if (block.shape) sizes.push_back(static_cast<int>(block.deviation.size()));
  }
  return sizes;
}

Eigen::VectorXd CalibrationProblem::priorInformation() const {
  Eigen::VectorXd out(work_->columns());
  int at = 0;
  for (const Workspace::Block& block : work_->blocks) {
    out.segment(at, block.deviation.size()) = block.deviation.array().square().inverse();
    at += static_cast<int>(block.deviation.size());
  }
  return out;
}

model::Stiffness CalibrationProblem::stiffness() const {
  const ShapeModel& model = work_->shared.model;
  return model.stiffnessAt(work_->values.stiffness.data(), model.initial());
}

Eigen::VectorXd CalibrationProblem::lengthScale() const {
  Eigen::VectorXd out(work_->arms.front().arm.actuatorCount());
  for (int i = 0; i < out.size(); ++i) {
    out[i] = work_->shared.scaleOf(work_->values.length_scale.data(), i);
  }
  return out;
}

lie::SE3 CalibrationProblem::base() const { return lie::SE3::exp(work_->values.base); }

TagLayout CalibrationProblem::layout() const {
  TagLayout layout = work_->arms.front().layout;
  for (std::size_t i = 0; i < layout.tags.size(); ++i) {
    const int section = layout.tags[i].section;
    const double length = work_->arms.front().arm.restTwist(section).head<3>().norm();
    layout.tags[i] = movedBy(layout.tags[i], work_->values.tags[i], length);
  }
  return layout;
}

model::Twists CalibrationProblem::shape(int capture) const {
  const ArmCaptures& data = work_->armOf(capture);
  if (selection().free_shapes) {
    model::Twists twists = model::Twists::Zero(6, data.arm.sectionCount());
    const std::vector<int> entries = freeEntries(data);
    for (std::size_t i = 0; i < entries.size(); ++i) {
      twists.data()[entries[i]] = work_->values.shapes[capture][i];
    }
    return twists;
  }
  Eigen::VectorXd lengths = lengthsAt(data.arm, work_->captureOf(capture).pressure);
  for (int i = 0; i < lengths.size(); ++i) {
    lengths[i] *= work_->shared.scaleOf(work_->values.length_scale.data(), i);
  }
  model::Twists twists;
  work_->shared.model.twists(work_->places[capture].first, lengths, work_->values.stiffness.data(),
                             twists, nullptr);
  return twists;
}

}  // namespace helix_arm::estimation
