#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include "calibration_checks.hpp"
#include "helix_arm/calibration/calibration.hpp"
#include "helix_arm/model/curve.hpp"
#include "localization/twist_equations.hpp"
#include "parameter_blocks.hpp"
#include "shape_model.hpp"

/// State that the costs of a calibration share, and the arm and lengths of each.
namespace helix_arm::estimation {

// Entries of an arm's twists that are free if shapes are fitted.
inline std::vector<int> freeEntries(const ArmCaptures& arm) {
  std::vector<int> entries;
  for (int entry = 0; entry < 6 * arm.arm.sectionCount(); ++entry) {
    const int axis = entry % 6;
    if (!arm.planar || axis < 2 || axis == 5) entries.push_back(entry);
  }
  return entries;
}

// Data that all costs share.
struct Shared {
  const std::vector<ArmCaptures>& arms;
  const CalibrationOptions& options;
  Selection selection;
  const std::vector<ArmCaptures> states;  // see statesOf()
  ShapeModel model;
  // (captures) shapes of the model before the search, for free shapes: the deviations of a
  // section's pieces from its mean are the model's.
  std::vector<model::Shape> expected_shapes;
  TwistFitOptions expected;  // noise of tags
  int held_tag;              // index of the tag that defines the reference frame

  Shared(const std::vector<ArmCaptures>& all, const CalibrationOptions& wanted,
         const Selection& chosen)
      : arms(all),
        options(wanted),
        selection(chosen),
        states(statesOf(all)),
        model(states, chosen.stiffness),
        held_tag(all.front().layout.baseTag()) {
    expected.corner_noise = options.corner_noise;
    expected.position_noise = options.position_noise;
    expected.rotation_noise = options.rotation_noise;
  }

  int scales() const { return lengthScales(selection, arms.front().arm); }
  double scaleOf(const Eigen::VectorXd& logs, int actuator) const {
    if (logs.size() == 0) return 1;
    return std::exp(logs[logs.size() == 1 ? 0 : actuator]);
  }
};

// Arm, capture and lengths of readings.
struct Place {
  int arm, capture;          // capture: index over all arms
  Eigen::VectorXd lengths;   // at its pressures [m]
  Eigen::VectorXd rest;      // at the lower end of the curves [m]
  std::vector<int> entries;  // free entries of the twists, for free shapes
  // Derivatives of lengths and rest (actuators x numbers of the curve), if one is fitted [m].
  Eigen::MatrixXd by_curve, rest_by_curve;
  int state;  // of Shared::states

  // With these values of the curve's numbers.
  Eigen::VectorXd lengthsAt(const Eigen::VectorXd& curve) const {
    if (by_curve.size() == 0) return lengths;
    return lengths + by_curve * curve;
  }
  Eigen::VectorXd restAt(const Eigen::VectorXd& curve) const {
    if (by_curve.size() == 0) return rest;
    return rest + rest_by_curve * curve;
  }
};

inline Place placeAt(const Shared& shared, int arm, int capture, const Eigen::VectorXd& pressure) {
  const ArmCaptures& data = shared.arms[arm];
  Place place{arm, capture, data.arm.lengths(pressure), pressure, freeEntries(data), {}, {}, arm};
  for (int i = 0; i < pressure.size(); ++i) {
    place.rest[i] = data.arm.actuator(i).contraction.restLength();
  }
  if (!shared.selection.has(ParameterBlock::kCurve)) return place;
  place.by_curve.setZero(pressure.size(), shared.arms.front().free_curve->spline.lengths.size());
  place.rest_by_curve = place.by_curve;
  for (int i = 0; data.free_curve && i < pressure.size(); ++i) {
    if (!data.free_curve->actuators[i]) continue;
    const ContractionSpline& spline = data.free_curve->spline;
    const Eigen::RowVectorXd weights = spline.weights(pressure[i]);
    place.lengths[i] = weights * spline.lengths;
    place.by_curve.row(i) = weights * spline.root;
    const Eigen::RowVectorXd at_rest = spline.weights(spline.knots.front());
    place.rest[i] = at_rest * spline.lengths;
    place.rest_by_curve.row(i) = at_rest * spline.root;
  }
  return place;
}

// The shape of a capture and, if the model determines it, its derivatives.
inline LinearisedShape shapeAt(Shared& shared, const Place& place, const Values& values,
                               bool derivatives) {
  if (shared.selection.free_shapes) {
    model::Twists twists = model::Twists::Zero(6, shared.arms[place.arm].arm.sectionCount());
    for (std::size_t i = 0; i < place.entries.size(); ++i) {
      twists.data()[place.entries[i]] = values.shapes[place.capture][static_cast<Eigen::Index>(i)];
    }
    LinearisedShape shape;
    shape.shape = shared.expected_shapes[place.capture].about(twists);
    return shape;
  }
  // Strokes first, then length scales, as in Contraction::scaledBy().
  const bool has_strokes = shared.selection.has(ParameterBlock::kStrokeScale);
  Eigen::VectorXd unscaled = place.lengthsAt(values.curve), stroke, change;
  if (has_strokes) {
    const Eigen::VectorXd rest = place.restAt(values.curve);
    stroke = values.own_blocks.at(ParameterBlock::kStrokeScale).array().exp();
    change = stroke.cwiseProduct(unscaled - rest);
    unscaled = rest + change;
  }
  Eigen::VectorXd lengths = unscaled;
  for (int i = 0; i < lengths.size(); ++i) lengths[i] *= shared.scaleOf(values.length_scale, i);
  const double* const stiffness = values.stiffness.data();
  if (place.by_curve.size() == 0 && !has_strokes) {
    return shared.model.at(place.state, lengths, stiffness, shared.scales(), derivatives);
  }
  // The derivatives with respect to each length give those with respect to all that changes it.
  LinearisedShape shape = shared.model.at(place.state, lengths, stiffness,
                                          static_cast<int>(lengths.size()), derivatives);
  if (!derivatives) return shape;
  const Eigen::MatrixXd by_unscaled = shape.by_scale * unscaled.cwiseInverse().asDiagonal();
  if (has_strokes) shape.by_stroke = by_unscaled * change.asDiagonal();
  if (place.by_curve.size() > 0) {
    Eigen::MatrixXd moved = place.by_curve;
    if (has_strokes) {
      moved = stroke.asDiagonal() * (place.by_curve - place.rest_by_curve) + place.rest_by_curve;
    }
    shape.by_curve = by_unscaled * moved;
  }
  if (shared.scales() == 1) shape.by_scale = shape.by_scale.rowwise().sum().eval();
  return shape;
}

// Residuals of a calibration's readings, in expected standard deviations, and their derivatives.

// State that all readings of a capture share at given values of the parameters.
struct CaptureState {
  LinearisedShape shape;
  // The rest is for readings of tags.
  Corners corners;
  std::vector<lie::SE3> starts;  // X_B0j of the pieces
  // With derivatives: motion of the whole arm with the base, and beyond each piece with its twist.
  std::vector<PointJacobian> base, whole;
};

// Columns of a term: where the derivatives with respect to each parameter block begin, or -1.
struct TermColumns {
  int stiffness = -1, scale = -1, stroke = -1, curve = -1, shape = -1, base = -1, border_shift = -1,
      tag = -1;
  int count = 0;
};

class ReadingCost {
 public:
  // @param place  must outlive the cost.
  // @param rig  the blocks that the cost depends on, besides those of the shape.
  ReadingCost(const Shared& shared, const Place& place, int residuals,
              const std::set<ParameterBlock>& rig)
      : shared_(shared), place_(place), residuals_(residuals) {
    const auto take = [this](ParameterBlock kind, int size, int& first) {
      if (!shared_.selection.has(kind)) return;
      first = columns_.count;
      columns_.count += size;
      kinds_.push_back(kind);
    };
    const auto takeOfRig = [&](ParameterBlock kind, int size, int& first) {
      if (rig.count(kind) > 0) take(kind, size, first);
    };
    take(ParameterBlock::kStiffness, static_cast<int>(shared.selection.stiffness.size()),
         columns_.stiffness);
    take(ParameterBlock::kLengthScale, shared.scales(), columns_.scale);
    take(ParameterBlock::kStrokeScale, static_cast<int>(place_.lengths.size()), columns_.stroke);
    take(ParameterBlock::kCurve, static_cast<int>(place_.by_curve.cols()), columns_.curve);
    take(ParameterBlock::kShape, static_cast<int>(place_.entries.size()), columns_.shape);
    takeOfRig(ParameterBlock::kBase, 6, columns_.base);
    takeOfRig(ParameterBlock::kBorderShift, 1, columns_.border_shift);
    takeOfRig(ParameterBlock::kTag, 6, columns_.tag);
  }
  virtual ~ReadingCost() = default;
  ReadingCost(const ReadingCost&) = delete;
  ReadingCost& operator=(const ReadingCost&) = delete;

  // Its parameter blocks in the order of its columns.
  const std::vector<ParameterBlock>& kinds() const { return kinds_; }
  const Place& place() const { return place_; }
  int residuals() const { return residuals_; }
  int columns() const { return columns_.count; }
  // Length of a row of the derivatives: the residual follows them, then padding.
  int stride() const { return padded(columns_.count + 1); }
  virtual int tag() const { return -1; }

  // False if it has no residuals there.
  // @param J  (residuals x stride) row major, of which the columns are written; null: without
  // derivatives, which the state then lacks, too.
  // @param by_pieces  workspace.
  virtual bool evaluate(const CaptureState& state, const Values& values, double* residual,
                        double* J, Eigen::MatrixXd& by_pieces) const = 0;
  // The error for reports. @param square  of its residuals.
  virtual double shown(const CaptureState& state, const Values& values, double square) const = 0;

 protected:
  using Jacobian = Eigen::Map<RowMajor, 0, Eigen::OuterStride<>>;
  Jacobian jacobian(double* J) const {
    return {J, residuals_, columns_.count, Eigen::OuterStride<>(stride())};
  }

  // Converts derivatives with respect to mean twists to derivatives with respect to the pieces,
  // whose sums are the mean twists.
  static Eigen::MatrixXd overPieces(const Eigen::MatrixXd& by_twists, const model::Shape& shape) {
    Eigen::MatrixXd out(by_twists.rows(), shape.pieces().size());
    for (int j = 0; j < shape.pieces().cols(); ++j) {
      out.middleCols<6>(6 * j) = by_twists.middleCols<6>(6 * (j / shape.piecesPerSection()));
    }
    return out;
  }

  // Converts derivatives with respect to the pieces' twists to derivatives with respect to the
  // parameter blocks. Uses as many rows as there are residuals.
  void passOn(const Eigen::MatrixXd& by_pieces, const LinearisedShape& shape, Jacobian& J) const {
    const auto block = [&](int first, const Eigen::MatrixXd& derivatives) {
      if (first < 0) return;
      J.middleCols(first, derivatives.cols()).noalias() =
          by_pieces.topRows(residuals_).lazyProduct(derivatives);
    };
    block(columns_.stiffness, shape.by_stiffness);
    block(columns_.scale, shape.by_scale);
    block(columns_.stroke, shape.by_stroke);
    block(columns_.curve, shape.by_curve);
    if (columns_.shape < 0) return;
    // Each piece takes an equal part of a mean twist.
    const int per_section = shape.shape.piecesPerSection();
    for (std::size_t i = 0; i < place_.entries.size(); ++i) {
      auto out = J.col(columns_.shape + static_cast<int>(i));
      out.setZero();
      const int first = place_.entries[i] / 6 * per_section;
      for (int j = first; j < first + per_section; ++j) {
        out += by_pieces.col(6 * j + place_.entries[i] % 6).head(residuals_) / per_section;
      }
    }
  }

  const Shared& shared_;
  const Place& place_;
  TermColumns columns_;

 private:
  const int residuals_;
  std::vector<ParameterBlock> kinds_;
};

// |(w_y, w_z)| of the only section.
class CurvatureCost final : public ReadingCost {
 public:
  CurvatureCost(const Shared& shared, const Place& place, double measured)
      : ReadingCost(shared, place, 1, {}), measured_(measured) {}

  bool evaluate(const CaptureState& state, const Values&, double* residual, double* J,
                Eigen::MatrixXd&) const override {
    const double weight = 1 / shared_.options.curvature_noise;
    const model::Shape& shape = state.shape.shape;
    const lie::Vector6 twist = shape.twists().col(0);
    const double curvature = model::curvatureOf(twist);
    residual[0] = weight * (curvature - measured_);
    if (J == nullptr) return true;
    Eigen::MatrixXd by_twists = Eigen::MatrixXd::Zero(1, 6);
    // A straight arm has no preferred direction of bending, so its derivative stays zero.
    if (curvature > 0) by_twists.rightCols(2) = weight / curvature * twist.tail<2>().transpose();
    Jacobian out = jacobian(J);
    passOn(overPieces(by_twists, shape), state.shape, out);
    return true;
  }

  double shown(const CaptureState&, const Values&, double square) const override {
    return std::sqrt(square) * shared_.options.curvature_noise;
  }

 private:
  const double measured_;
};

class TwistCost final : public ReadingCost {
 public:
  TwistCost(const Shared& shared, const Place& place, const TwistReading& reading)
      : ReadingCost(shared, place, static_cast<int>(reading.twists.size()), {}),
        measured_(reading.twists) {
    const Eigen::LLT<Eigen::MatrixXd> factors(reading.covariance);
    whitening_ = factors.matrixL().solve(
        Eigen::MatrixXd::Identity(reading.covariance.rows(), reading.covariance.cols()));
  }

  bool evaluate(const CaptureState& state, const Values&, double* residual, double* J,
                Eigen::MatrixXd&) const override {
    const model::Shape& shape = state.shape.shape;
    const model::Twists difference = shape.twists() - measured_;
    Eigen::Map<Eigen::VectorXd>(residual, residuals()) =
        whitening_ * Eigen::Map<const Eigen::VectorXd>(difference.data(), difference.size());
    if (J == nullptr) return true;
    Jacobian out = jacobian(J);
    passOn(overPieces(whitening_, shape), state.shape, out);
    return true;
  }

  // Distance of the tips [m].
  double shown(const CaptureState& state, const Values&, double) const override {
    const model::Shape& shape = state.shape.shape;
    return (model::tipPose(shape).translation - model::tipPose(shape.about(measured_)).translation)
        .norm();
  }

 private:
  const model::Twists measured_;
  Eigen::MatrixXd whitening_;
};

template <class Model>
class TagCost final : public ReadingCost {
  // Minimum cosine between a tag's normal and the line of sight for a tag to count as facing.
  static constexpr double kFacing = 0.3;
  using Rows = typename Model::Rows;
  using ByMotion = Eigen::Matrix<double, Rows::kCount, 6>;

 public:
  TagCost(const Shared& shared, const Place& place, const Model& model,
          typename Model::Observation seen, bool takes_tag)
      : ReadingCost(shared, place, model.residuals(), rigOf(takes_tag)),
        model_(model),
        seen_(std::move(seen)) {
    rest_length_ = shared.arms[place.arm].arm.restLength(placement().section);
  }

  int tag() const override { return seen_.tag; }

  bool evaluate(const CaptureState& state, const Values& values, double* residual, double* J,
                Eigen::MatrixXd& by_pieces) const override {
    const Pose pose = poseAt(state, values);
    Rows rows;
    if (!model_.evaluate(seen_, pose.X_B0T, state.corners, rows)) return false;
    const int m = residuals();
    Eigen::Map<Eigen::VectorXd>(residual, m) = rows.residual.head(m);
    if (J == nullptr) return true;
    Jacobian out = jacobian(J);
    const model::Shape::Pieces& pieces = state.shape.shape.pieces();
    by_pieces.setZero(Rows::kCount, pieces.size());
    for (int j = 0; j < pose.place.piece; ++j) state.whole[j].fill(rows, 6 * j, by_pieces);
    const int own = pose.place.piece;
    PointJacobian(state.starts[own], pieces.col(own), pose.place.s).fill(rows, 6 * own, by_pieces);
    passOn(by_pieces, state.shape, out);
    if (columns_.base >= 0) {
      ByMotion moved;
      state.base.front().fill(rows, 0, moved);
      out.template middleCols<6>(columns_.base) = moved.topRows(m);
    }
    if constexpr (Model::kBorderShifts) {
      if (columns_.border_shift >= 0) out.col(columns_.border_shift) = rows.by_border_shift;
    }
    if (columns_.tag >= 0) {
      out.template middleCols<6>(columns_.tag) =
          byPlacement(values, state.shape.shape, pose, rows).topRows(m);
    }
    return true;
  }

  double shown(const CaptureState& state, const Values& values, double square) const override {
    return model_.shown(seen_, poseAt(state, values).X_B0T, square);
  }

  // Whether the tag faces the camera.
  bool faces(const CaptureState& state, const Values& values) const {
    if constexpr (Model::kBorderShifts) {
      const lie::SE3 X_CT = model_.X_CB0 * poseAt(state, values).X_B0T;
      return X_CT.translation.z() > 0 &&
             -X_CT.rotation.col(2).dot(X_CT.translation.normalized()) > kFacing;
    }
    return true;
  }

 private:
  static std::set<ParameterBlock> rigOf(bool takes_tag) {
    std::set<ParameterBlock> rig{ParameterBlock::kBase};
    if (Model::kBorderShifts) rig.insert(ParameterBlock::kBorderShift);
    if (takes_tag) rig.insert(ParameterBlock::kTag);
    return rig;
  }

  struct Pose {
    double s;  // along its section
    PiecePlace place;
    lie::SE3 X_B0S, X_B0T;
  };

  const TagPlacement& placement() const { return shared_.arms[place_.arm].layout.tags[seen_.tag]; }

  Pose poseAt(const CaptureState& state, const Values& values) const {
    const TagPlacement tag =
        columns_.tag < 0 ? placement() : movedBy(placement(), values.tags[seen_.tag], rest_length_);
    const model::Shape& shape = state.shape.shape;
    Pose pose;
    pose.s = tag.s;
    pose.place = placeOnPieces(tag, shape.piecesPerSection());
    pose.X_B0S = state.starts[pose.place.piece] *
                 lie::SE3::exp(pose.place.s * shape.pieces().col(pose.place.piece));
    pose.X_B0T = pose.X_B0S * tag.X_ST;
    return pose;
  }

  ByMotion byPlacement(const Values& values, const model::Shape& shape, const Pose& pose,
                       const Rows& rows) const {
    const TagPlacement& tag = placement();
    const lie::Vector6& placed = values.tags[seen_.tag];
    ByMotion out, moved;
    PointJacobian(pose.X_B0S).fill(rows, 0, moved);
    const double s = tag.s + placed[0] / rest_length_;
    if (s == pose.s) {
      const double per_length = shape.piecesPerSection() / rest_length_;
      out.col(0) = per_length * (moved * shape.pieces().col(pose.place.piece));
    } else {  // beyond an end, along x
      out.col(0) = moved.col(0);
    }
    out.template middleCols<2>(1) = rows.by_v * pose.X_B0S.rotation.template rightCols<2>();
    lie::Vector6 phi = lie::Vector6::Zero();
    phi.template tail<3>() = placed.template tail<3>();
    const Eigen::Matrix3d w =
        pose.X_B0T.rotation * lie::SE3::rightJacobian(phi).template bottomRightCorner<3, 3>();
    out.template rightCols<3>() =
        rows.by_v * (lie::skew(pose.X_B0T.translation) * w) + rows.by_w * w;
    return out;
  }

  const Model model_;
  const typename Model::Observation seen_;
  double rest_length_;  // of the section [m]
};

// Readings of captures as terms of the least-squares problem.

struct ReadingTerm {
  std::unique_ptr<ReadingCost> cost;
  std::vector<int> blocks;  ///< indices of its parameter blocks, in the order of its columns
  /// Squared residuals beyond which the reading is an outlier; infinite for twists, whose
  /// covariance is given.
  double limit = std::numeric_limits<double>::infinity();

  bool isRobust() const { return limit < std::numeric_limits<double>::infinity(); }
  /// Part of the robust sum of squares (Cauchy) that a square contributes.
  double loss(double square) const;
  /// Weight of a square from the robust loss, its derivative, in (0, 1].
  double weight(double square) const { return 1 / (1 + square / limit); }
};

/// The terms of one reading.
///
/// @param place  must outlive them.
std::vector<ReadingTerm> termsOf(const Shared& shared, const Place& place, const Reading& reading,
                                 const ParameterBlocks& blocks);

/// State that the readings of a capture share at these values.
///
/// @param kind  of its readings.
CaptureState stateAt(Shared& shared, const Place& place, ReadingKind kind, const Values& values,
                     bool derivatives);

/// The readings that an arm is expected to give at the pressures of a place: those of its captures,
/// each tag once, if it faces the camera.
///
/// @param place  must outlive them. @param state  there, at the current values.
std::vector<ReadingTerm> expectedTerms(const Shared& shared, const Place& place,
                                       const CaptureState& state, const ParameterBlocks& blocks);

/// Adds the weighted J'J of a term to that of all free parameters.
///
/// @param J  (residuals x stride) row major.
void addInformation(const ReadingTerm& term, const ParameterBlocks& blocks, const double* J,
                    double weight, Eigen::MatrixXd& H);

}  // namespace helix_arm::estimation
