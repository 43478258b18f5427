#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <utility>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/localization/arm_view.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/curve.hpp"

/// Residuals of tags against a shape, and their derivatives by motions of the arm's parts.
namespace helix_arm::estimation {

/// Residuals of one tag, in expected standard deviations. A small rigid motion [v; w] of the tag,
/// about the origin of the nominal base B0, changes them by by_v v + by_w w, border shift by
/// by_border_shift.
template <int kRows>
struct TagRows {
  static constexpr int kCount = kRows;
  Eigen::Matrix<double, kRows, 1> residual;
  Eigen::Matrix<double, kRows, 3> by_v, by_w;
  Eigen::Matrix<double, kRows, 1> by_border_shift;
};

struct CornerModel {
  using Observation = CornerObservation;
  using Rows = TagRows<8>;
  static constexpr bool kBorderShifts = true;

  lie::SE3 X_CB0;  // nominal base seen from the camera
  double weight;   // focal length / noise
  const TwistFitOptions& options;

  static int residuals(const Observation&) { return 8; }
  // Factor on the noise's variance: four corners that err together by this tell as one does [m].
  double excess(const Observation&, double deviation, const lie::SE3& X_B0T) const {
    const double noises = weight * deviation / (X_CB0 * X_B0T.translation).z();
    return 1 + 4 * noises * noises;
  }
  // RMS of the corners' distances along one axis [px].
  double shown(const Observation& seen, const lie::SE3&, double square) const {
    return options.corner_noise * std::sqrt(square / residuals(seen));
  }

  // False if a corner is behind the camera.
  bool evaluate(const Observation& seen, const lie::SE3& X_B0T, const Corners& plane,
                Rows& rows) const {
    const Eigen::Matrix3d& R = X_B0T.rotation;
    for (int c = 0; c < 4; ++c) {
      const Eigen::Vector3d arm = R.col(0) * plane(0, c) + R.col(1) * plane(1, c);
      const Eigen::Vector3d p = arm + X_B0T.translation;
      const Eigen::Vector3d p_C = X_CB0 * p;
      if (!(p_C.z() > 0)) return false;
      const double per_z = 1.0 / p_C.z(), scale = weight * per_z;
      // Towards the centre of the tag, along both of its axes.
      const Eigen::Vector3d inward =
          R.col(0) * (plane(0, c) > 0 ? -1.0 : 1.0) + R.col(1) * (plane(1, c) > 0 ? -1.0 : 1.0);
      for (int axis = 0; axis < 2; ++axis) {
        const int row = 2 * c + axis;
        const double direction = p_C[axis] * per_z;
        const Eigen::Vector3d n =
            scale * (X_CB0.rotation.row(axis) - direction * X_CB0.rotation.row(2)).transpose();
        rows.residual[row] = weight * (direction - seen.direction(axis, c));
        rows.by_v.row(row) = n.transpose();
        rows.by_w.row(row) = p.cross(n).transpose();
        rows.by_border_shift[row] = n.dot(inward);
      }
    }
    return true;
  }
};

struct PoseModel {
  using Observation = PoseObservation;
  using Rows = TagRows<6>;
  static constexpr bool kBorderShifts = false;

  const TwistFitOptions& options;
  const TagLayout& layout;

  // Noise of the body, or of tags.
  PoseNoise noiseOf(const Observation& seen) const {
    const auto& noise = layout.tags[static_cast<std::size_t>(seen.tag)].noise;
    return noise ? *noise : PoseNoise{options.position_noise, options.rotation_noise};
  }
  int residuals(const Observation& seen) const { return noiseOf(seen).rotation > 0 ? 6 : 3; }
  double excess(const Observation& seen, double deviation, const lie::SE3&) const {
    const double noises = deviation / noiseOf(seen).position;
    return 1 + noises * noises;
  }
  // Distance of the positions [m].
  double shown(const Observation& seen, const lie::SE3& X_B0T, double) const {
    return (X_B0T.translation - seen.X_BT.translation).norm();
  }

  bool evaluate(const Observation& seen, const lie::SE3& X_B0T, const Corners&, Rows& rows) const {
    const PoseNoise noise = noiseOf(seen);
    const double weight = 1.0 / noise.position;
    const Eigen::Matrix3d& R = X_B0T.rotation;
    rows.residual.setZero();
    rows.by_v.setZero();
    rows.by_w.setZero();
    rows.residual.head<3>() = weight * (X_B0T.translation - seen.X_BT.translation);
    rows.by_v.topRows<3>().setIdentity();
    rows.by_v *= weight;
    rows.by_w.topRows<3>() = -weight * lie::skew(X_B0T.translation);
    if (noise.rotation > 0) {
      const lie::SE3 turn{seen.X_BT.rotation.transpose() * R, Eigen::Vector3d::Zero()};
      const lie::Vector6 phi = turn.log();
      rows.residual.tail<3>() = phi.tail<3>() / noise.rotation;
      rows.by_w.bottomRows<3>() = lie::SE3::rightJacobianInverse(phi).bottomRightCorner<3, 3>() *
                                  R.transpose() / noise.rotation;
    }
    return true;
  }
};

/// Motion of a part of the arm due to a change of a twist, about the origin of B0 and seen from B0:
/// v = v_by_v dv + v_by_w dw, w = v_by_v dw.
struct PointJacobian {
  Eigen::Matrix3d v_by_v = Eigen::Matrix3d::Zero(), v_by_w = Eigen::Matrix3d::Zero();

  PointJacobian() = default;
  // Motion of all parts beyond s on a piece that starts at X_B0k.
  PointJacobian(const lie::SE3& X_B0k, const lie::Vector6& twist, double s) {
    const lie::Matrix6 J = lie::SE3::leftJacobian(s * twist);
    v_by_v = s * X_B0k.rotation * J.topLeftCorner<3, 3>();
    v_by_w = s * X_B0k.rotation * J.topRightCorner<3, 3>();
    v_by_w += lie::skew(X_B0k.translation) * v_by_v;
  }
  // Motion of the whole arm with the base.
  explicit PointJacobian(const lie::SE3& X_B0B)
      : v_by_v(X_B0B.rotation), v_by_w(lie::skew(X_B0B.translation) * X_B0B.rotation) {}

  // Sum over several pieces that change together.
  PointJacobian& operator+=(const PointJacobian& other) {
    v_by_v += other.v_by_v;
    v_by_w += other.v_by_w;
    return *this;
  }
  PointJacobian& operator*=(double share) {
    v_by_v *= share;
    v_by_w *= share;
    return *this;
  }

  template <class Rows, class Jacobian>
  void fill(const Rows& rows, int column, Jacobian& J) const {
    J.template middleCols<3>(column).noalias() = rows.by_v.lazyProduct(v_by_v);
    J.template middleCols<3>(column + 3).noalias() = rows.by_v.lazyProduct(v_by_w);
    J.template middleCols<3>(column + 3).noalias() += rows.by_w.lazyProduct(v_by_v);
  }
};

// The robust least-squares problem of a twist fit: its cost and its normal equations.

inline constexpr int kBaseParameters = 6;
inline constexpr int kMaxParameters = 6 * model::kMaxSections + kBaseParameters + 1;

/// An iterate of the search.
struct FitPoint {
  model::Twists twists;
  model::Shape shape;  ///< with these mean twists
  lie::SE3 X_B0B;
  lie::Vector6 base_offset = lie::Vector6::Zero();  ///< log of X_B0B, for the prior
  double border_shift = 0;
  double cost = std::numeric_limits<double>::infinity();
  std::vector<TagResidual> residuals;
  std::vector<double> squares;  ///< per tag: sum of squared residuals, in expected variances
  std::vector<double> counts;   ///< per tag: number of residuals
};

/// Normal equations of all parameters: twists, base, border shift. Their number is known at run
/// time only: each fixed size would compile for half a minute, and fit eight tags 2 % faster.
struct NormalEquations {
  using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxParameters, 1>;
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor,
                               kMaxParameters, kMaxParameters>;
  Vector gradient;
  Matrix hessian;  ///< lower triangle
};

/// Owns its workspace: nothing allocates once a point has capacity for its tags.
class TwistEquations {
 public:
  /// Requires a valid layout, number of sections and options.
  TwistEquations(TagLayout layout, int sections, const TwistFitOptions& options)
      : layout_(std::move(layout)), sections_(sections), options_(options), rig_(options) {
    know(rig_);
    deviations_.resize(6, sections_);
    deviations_.topRows<3>().setConstant(options.model_prior.translation);
    deviations_.bottomRows<3>().setConstant(options.model_prior.rotation);
    starts_.resize(model::kMaxPieces);
    partial_jacobians_.resize(model::kMaxPieces);
    weighTags();
    jacobians_.reserve(sections_);
  }

  const TagLayout& layout() const { return layout_; }
  int sections() const { return sections_; }
  const TwistFitOptions& options() const { return options_; }

  /// Sets the centre of the model's prior, and resets the noise to the expected noise.
  ///
  /// @param deviations  (6 x sections) standard deviations of that prior; default: the options'.
  void expect(const model::Shape& model, const model::Twists& deviations) {
    deviations_ = deviations;
    expect(model);
  }
  void expect(const model::Shape& model) {
    expected_ = model;
    prior_ = model.twists();
    noise_scale_ = 1;
  }
  /// Sets what is known of base and border shift where they are free. The covariance is positive
  /// definite.
  void know(const RigEstimate& rig);
  const RigEstimate& rig() const { return rig_; }
  const model::Twists& prior() const { return prior_; }
  /// Sets the factor on the tags' expected errors.
  void setNoiseScale(double scale) { noise_scale_ = scale; }

  /// Number of parameters.
  template <class Model>
  int parameters() const {
    return borderShiftColumn() + (fitsBorderShift<Model>() ? 1 : 0);
  }
  /// Mean of a tag's squared residuals beyond which it is an outlier.
  double threshold() const {
    const double scale = options_.robust_scale * noise_scale_;
    return scale * scale;
  }
  /// Standard deviation of the model's prior of one entry of the twists.
  double modelDeviation(int entry) const { return deviations_.data()[entry]; }
  /// The twists' deviations from the model's prior, in its standard deviations.
  model::Twists deviationsOf(const FitPoint& point) const {
    return (point.twists - prior_).cwiseQuotient(deviations_);
  }
  /// Whether an entry of the twists is fixed at 0.
  bool held(int entry) const {
    return options_.planar && std::find(std::begin(kOutOfPlane), std::end(kOutOfPlane),
                                        entry % 6) != std::end(kOutOfPlane);
  }

  /// Sets a point to these twists, with held entries at 0, and to the known base and border shift.
  void start(const model::Twists& twists, FitPoint& point) const {
    point.squares.clear();
    point.twists = twists;
    for (int entry = 0; entry < 6 * sections_; ++entry) {
      if (held(entry)) point.twists.data()[entry] = 0;
    }
    point.shape = expected_.about(point.twists);
    point.base_offset.setZero();
    if (options_.free_base) point.base_offset = rig_.mean.head<kBaseParameters>();
    point.X_B0B = lie::SE3::exp(point.base_offset);
    point.border_shift = options_.free_border_shift ? rig_.mean[kBaseParameters] : 0.0;
  }

  /// Sets `to` to the point one step away from `from`.
  template <class Model, class Step>
  void move(const FitPoint& from, const Step& step, FitPoint& to) const {
    to.twists = from.twists;
    for (int k = 0; k < sections_; ++k) to.twists.col(k) += step.template segment<6>(6 * k);
    to.shape = expected_.about(to.twists);
    to.X_B0B = from.X_B0B;
    to.base_offset = from.base_offset;
    if (options_.free_base) {
      to.X_B0B = from.X_B0B * lie::SE3::exp(step.template segment<6>(baseColumn()));
      to.base_offset = to.X_B0B.log();
    }
    to.border_shift =
        from.border_shift + (fitsBorderShift<Model>() ? step[borderShiftColumn()] : 0.0);
  }

  /// Computes a point's cost (infinite if a tag is behind the camera), residuals, normal equations.
  ///
  /// @param skipped  index in `seen` of a tag to omit, or -1.
  template <class Model>
  void evaluate(const Model& model, const std::vector<typename Model::Observation>& seen,
                int skipped, FitPoint& point, NormalEquations& system) {
    const int size = parameters<Model>();
    system.gradient.setZero(size);
    system.hessian.setZero(size, size);
    point.residuals.clear();
    point.squares.clear();
    point.counts.clear();
    point.cost = std::numeric_limits<double>::infinity();
    starts_[0] = point.X_B0B;
    base_jacobian_ = PointJacobian(point.X_B0B);
    const model::Shape::Pieces& pieces = point.shape.pieces();
    const int per_section = point.shape.piecesPerSection();
    jacobians_.clear();
    for (int j = 0; j + 1 < pieces.cols(); ++j) {
      starts_[j + 1] = point.shape.beyond(starts_[j], j);
      PointJacobian jacobian(starts_[j], pieces.col(j), 1.0);
      if (per_section > 1) {
        if (j % per_section > 0) jacobian += partial_jacobians_[j - 1];
        partial_jacobians_[j] = jacobian;
        jacobian *= 1.0 / per_section;
      }
      if ((j + 1) % per_section == 0) jacobians_.push_back(jacobian);
    }
    const Corners plane = layout_.corners(point.border_shift);
    double cost = 0;
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const TagPlacement& tag = layout_.tags[seen[i].tag];
      const PiecePlace place = placeOnPieces(tag, per_section);
      const lie::SE3 X_B0T = poseOf(tag, place, point.shape);
      typename Model::Rows rows;
      if (!model.evaluate(seen[i], X_B0T, plane, rows)) return;
      const double excess = model.excess(seen[i], worse_[seen[i].tag], X_B0T);
      const double limit = threshold() * model.residuals(seen[i]);
      const double shown = rows.residual.squaredNorm(), square = shown / excess;
      const double weight = 1.0 / (1.0 + square / limit);
      point.squares.push_back(square);
      point.counts.push_back(model.residuals(seen[i]));
      point.residuals.push_back({seen[i].tag, model.shown(seen[i], X_B0T, shown), weight, false});
      if (static_cast<int>(i) == skipped) continue;
      cost += limit * std::log1p(square / limit);
      accumulate<Model>(tag.section, place, weight / excess, rows, point.shape, system);
    }
    point.cost = cost + addPriors<Model>(point, system);
  }

  /// Derivative (parameters x 6) of the gradient by a small rigid motion [v; w] of one tag, about
  /// the origin of the nominal base, with the weight 1. `point` is that of the last evaluate().
  template <class Model>
  Eigen::MatrixXd gradientByMotion(const Model& model, const typename Model::Observation& seen,
                                   const FitPoint& point) const {
    const TagPlacement& tag = layout_.tags[seen.tag];
    const PiecePlace place = placeOnPieces(tag, point.shape.piecesPerSection());
    const lie::SE3 X_B0T = poseOf(tag, place, point.shape);
    typename Model::Rows rows;
    model.evaluate(seen, X_B0T, layout_.corners(point.border_shift), rows);
    const auto J = jacobian<Model>(tag.section, place, rows, point.shape);
    Eigen::MatrixXd out(J.cols(), 6);
    out << J.transpose() * rows.by_v, J.transpose() * rows.by_w;
    return out / model.excess(seen, worse_[seen.tag], X_B0T);
  }

  /// Adds the priors' equations; returns their cost.
  template <class Model>
  double addPriors(const FitPoint& point, NormalEquations& system) const {
    return addPriors(point, fitsBorderShift<Model>(), system.gradient, system.hessian);
  }

 private:
  // v_z, w_x and w_y, which are 0 for a planar arm.
  static constexpr int kOutOfPlane[] = {2, 3, 4};

  int baseColumn() const { return 6 * sections_; }
  int borderShiftColumn() const {
    return 6 * sections_ + (options_.free_base ? kBaseParameters : 0);
  }
  double addPriors(const FitPoint& point, bool fits_border_shift,
                   Eigen::Ref<Eigen::VectorXd> gradient, Eigen::Ref<Eigen::MatrixXd> hessian) const;
  // By how much each tag's place is known worse than that of the best one: a calibration's errors
  // do not average out, so a tag that it did not see must not count like the others.
  void weighTags();

  template <class Model>
  bool fitsBorderShift() const {
    return Model::kBorderShifts && options_.free_border_shift;
  }

  lie::SE3 poseOf(const TagPlacement& tag, const PiecePlace& place,
                  const model::Shape& shape) const {
    return starts_[place.piece] * lie::SE3::exp(place.s * shape.pieces().col(place.piece)) *
           tag.X_ST;
  }

  // Derivative of one tag's residuals by all parameters.
  template <class Model>
  auto jacobian(int k, const PiecePlace& place, const typename Model::Rows& rows,
                const model::Shape& shape) const {
    constexpr int kRows = Model::Rows::kCount;
    using Jacobian =
        Eigen::Matrix<double, kRows, Eigen::Dynamic, Eigen::ColMajor, kRows, kMaxParameters>;
    Jacobian J = Jacobian::Zero(kRows, parameters<Model>());
    for (int j = 0; j < k; ++j) jacobians_[j].fill(rows, 6 * j, J);
    PointJacobian jacobian(starts_[place.piece], shape.pieces().col(place.piece), place.s);
    if (shape.piecesPerSection() > 1) {
      if (place.piece % shape.piecesPerSection() > 0)
        jacobian += partial_jacobians_[place.piece - 1];
      jacobian *= 1.0 / shape.piecesPerSection();
    }
    jacobian.fill(rows, 6 * k, J);
    if (options_.free_base) base_jacobian_.fill(rows, baseColumn(), J);
    if (fitsBorderShift<Model>()) J.col(borderShiftColumn()) = rows.by_border_shift;
    if (options_.planar) {
      for (int j = 0; j <= k; ++j) {
        for (const int entry : kOutOfPlane) J.col(6 * j + entry).setZero();
      }
    }
    return J;
  }

  // Adds one tag's equations.
  template <class Model>
  void accumulate(int k, const PiecePlace& place, double weight, const typename Model::Rows& rows,
                  const model::Shape& shape, NormalEquations& system) const {
    const auto J = jacobian<Model>(k, place, rows, shape);
    const int size = static_cast<int>(system.gradient.size());
    for (int column = 0; column < size; ++column) {
      const Eigen::Matrix<double, Model::Rows::kCount, 1> weighted = weight * J.col(column);
      system.gradient[column] += weighted.dot(rows.residual);
      for (int row = column; row < size; ++row) {
        system.hessian(row, column) += weighted.dot(J.col(row));
      }
    }
  }

  TagLayout layout_;
  int sections_;
  TwistFitOptions options_;
  RigEstimate rig_;                                          // known of base and border shift
  RigEstimate::Matrix both_information_, base_information_;  // of rig_, and of its base alone
  model::Shape expected_;                                    // the model's
  model::Twists prior_, deviations_;                         // of the twists
  double noise_scale_ = 1;
  std::vector<double> worse_;     // deviation of each tag's corners beyond that of the best tag [m]
  std::vector<lie::SE3> starts_;  // X_B0j of each piece's start
  // For sections of several pieces: motion of what lies beyond a piece, due to the pieces of its
  // section up to it, as if each changed by the whole change of the twist.
  std::vector<PointJacobian> partial_jacobians_;
  std::vector<PointJacobian> jacobians_;  // of what lies beyond each section except the last
  PointJacobian base_jacobian_;           // of the whole arm
};

/// Fills in the results that follow from the equations at the end of a search: outliers, RMS,
/// covariances, and the status if the tags do not explain or determine the twists.
///
/// @param at       end of the search.
/// @param hessian  (parameters x parameters, lower triangle) of the normal equations there.
/// @param priors   (parameters x parameters) the priors' part of it.
void reportStatistics(const TwistEquations& equations, const FitPoint& at,
                      const Eigen::Ref<const Eigen::MatrixXd>& hessian,
                      const Eigen::Ref<const Eigen::MatrixXd>& priors, TwistFit& result);

/// Covariance of the tip's position seen from B0, due to that of the twists followed by the base.
Eigen::Matrix3d tipCovarianceOf(const lie::SE3& X_B0B, const model::Shape& shape, bool free_base,
                                const Eigen::Ref<const Eigen::MatrixXd>& covariance);

/// Second moment of what the tip's path adds to its linear motion, where it bends within the errors
/// of the twists and the base: with the even part q_i of its motion along each principal direction
/// of the covariance, E[(sum q_i z_i^2)(sum q_i z_i^2)'] for independent standard normal z_i.
Eigen::Matrix3d tipCurvatureOf(const lie::SE3& X_B0B, const model::Shape& shape, bool free_base,
                               const Eigen::Ref<const Eigen::MatrixXd>& covariance);

/// Rigid motion [v; w] of a tag per displacement of movedBy(), about the base's origin (6 x 6).
inline lie::Matrix6 motionsOf(const TagPlacement& tag, double rest_length,
                              const model::Shape& shape) {
  // Half the step of the differences; large compared with rounding.
  constexpr double kMountStep = 1e-5;  // [m, rad]
  lie::Matrix6 out;
  for (int entry = 0; entry < 6; ++entry) {
    const auto at = [&](double moved) {
      const TagPlacement placed = movedBy(tag, moved * lie::Vector6::Unit(entry), rest_length);
      return model::poseAt(shape, placed.section, placed.s) * placed.X_ST;
    };
    out.col(entry) = (at(kMountStep) * at(-kMountStep).inverse()).log() / (2 * kMountStep);
  }
  return out;
}

/// Corners that an ideal camera at this place sees; not finite where one is not in front of it.
inline CornerObservation observe(const TagLayout& layout, const model::Shape& shape,
                                 const lie::SE3& X_CB, int tag) {
  const TagPlacement& placed = layout.tags[static_cast<std::size_t>(tag)];
  const lie::SE3 X_CT = X_CB * model::poseAt(shape, placed.section, placed.s) * placed.X_ST;
  const Corners plane = layout.corners();
  CornerObservation out{tag, {}};
  for (int c = 0; c < 4; ++c) {
    const Eigen::Vector3d p_C = X_CT * Eigen::Vector3d(plane(0, c), plane(1, c), 0.0);
    out.direction.col(c) = p_C.head<2>() / p_C.z();
    if (!(p_C.z() > 0)) out.direction.setConstant(std::numeric_limits<double>::infinity());
  }
  return out;
}

/// Calls `use(model, observe)` with the model of the instrument that sees the arm, and with what an
/// ideal one tells of the tag of this index: observe(shape, tag).
template <class Use>
auto withInstrument(const ArmView& view, const TwistFitOptions& options, const Use& use) {
  if (view.layout.hasBodies()) {
    return use(PoseModel{options, view.layout}, [&view](const model::Shape& shape, int tag) {
      const TagPlacement& placed = view.layout.tags[static_cast<std::size_t>(tag)];
      return PoseObservation{tag, model::poseAt(shape, placed.section, placed.s) * placed.X_ST};
    });
  }
  return use(CornerModel{view.X_CB, view.camera.focal() / options.corner_noise, options},
             [&view](const model::Shape& shape, int tag) {
               return observe(view.layout, shape, view.X_CB, tag);
             });
}

}  // namespace helix_arm::estimation
