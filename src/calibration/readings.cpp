#include "readings.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <type_traits>
#include <utility>
#include <variant>

#include "helix_arm/model/curve.hpp"

namespace helix_arm::estimation {
namespace {

// Entries of an arm's twists that are free if shapes are fitted.
std::vector<int> freeEntries(const ArmCaptures& arm) {
  std::vector<int> entries;
  for (int entry = 0; entry < 6 * arm.arm.sectionCount(); ++entry) {
    const int axis = entry % 6;
    if (!arm.planar || axis < 2 || axis == 5) entries.push_back(entry);
  }
  return entries;
}

// Converts derivatives with respect to mean twists to derivatives with respect to the pieces, whose
// sums are the mean twists.
Eigen::MatrixXd overPieces(const Eigen::MatrixXd& by_twists, const model::Shape& shape) {
  Eigen::MatrixXd out(by_twists.rows(), shape.pieces().size());
  for (int j = 0; j < shape.pieces().cols(); ++j) {
    out.middleCols<6>(6 * j) = by_twists.middleCols<6>(6 * (j / shape.piecesPerSection()));
  }
  return out;
}

// |(w_y, w_z)| of the only section.
class CurvatureCost final : public ReadingCost {
 public:
  CurvatureCost(const Shared& shared, const Place& place, const ParameterBlocks& blocks,
                double measured)
      : ReadingCost(shared, place, 1, blocks), measured_(measured) {}

  bool evaluate(const CaptureState& state, const ParameterBlocks&, Eigen::VectorXd& residual,
                Eigen::MatrixXd* J, Eigen::MatrixXd&) const override {
    const double weight = 1 / shared_.options.curvature_noise;
    const model::Shape& shape = state.shape.shape;
    const lie::Vector6 twist = shape.twists().col(0);
    const double curvature = model::curvatureOf(twist);
    residual.setConstant(1, weight * (curvature - measured_));
    if (J == nullptr) return true;
    Eigen::MatrixXd by_twists = Eigen::MatrixXd::Zero(1, 6);
    // A straight arm has no preferred direction of bending, so its derivative stays zero.
    if (curvature > 0) by_twists.rightCols(2) = weight / curvature * twist.tail<2>().transpose();
    passOn(overPieces(by_twists, shape), state.shape, *J);
    return true;
  }

  double shown(const CaptureState&, const ParameterBlocks&, double square) const override {
    return std::sqrt(square) * shared_.options.curvature_noise;
  }

 private:
  const double measured_;
};

class TwistCost final : public ReadingCost {
 public:
  TwistCost(const Shared& shared, const Place& place, const ParameterBlocks& blocks,
            const TwistReading& reading)
      : ReadingCost(shared, place, static_cast<int>(reading.twists.size()), blocks),
        measured_(reading.twists) {
    limit_ = std::numeric_limits<double>::infinity();
    const Eigen::LLT<Eigen::MatrixXd> factors(reading.covariance);
    whitening_ = factors.matrixL().solve(
        Eigen::MatrixXd::Identity(reading.covariance.rows(), reading.covariance.cols()));
  }

  bool evaluate(const CaptureState& state, const ParameterBlocks&, Eigen::VectorXd& residual,
                Eigen::MatrixXd* J, Eigen::MatrixXd&) const override {
    const model::Shape& shape = state.shape.shape;
    const model::Twists difference = shape.twists() - measured_;
    residual = whitening_ * Eigen::Map<const Eigen::VectorXd>(difference.data(), difference.size());
    if (J == nullptr) return true;
    passOn(overPieces(whitening_, shape), state.shape, *J);
    return true;
  }

  // Distance of the tips [m].
  double shown(const CaptureState& state, const ParameterBlocks&, double) const override {
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
  TagCost(const Shared& shared, const Place& place, const ParameterBlocks& blocks,
          const Model& model, typename Model::Observation seen)
      : ReadingCost(shared, place, model.residuals(seen), blocks, seen.tag),
        model_(model),
        seen_(std::move(seen)) {
    rest_length_ = shared.arms[place.arm].arm.restLength(placement().section);
  }

  bool evaluate(const CaptureState& state, const ParameterBlocks& values, Eigen::VectorXd& residual,
                Eigen::MatrixXd* J, Eigen::MatrixXd& by_pieces) const override {
    const Pose pose = poseAt(state, values);
    Rows rows;
    if (!model_.evaluate(seen_, pose.X_B0T, state.corners, rows)) return false;
    const int m = residuals();
    residual = rows.residual.head(m);
    if (J == nullptr) return true;
    Eigen::MatrixXd& out = *J;
    const model::Shape::Pieces& pieces = state.shape.shape.pieces();
    by_pieces.setZero(Rows::kCount, pieces.size());
    for (int j = 0; j < pose.place.piece; ++j) state.whole[j].fill(rows, 6 * j, by_pieces);
    const int own = pose.place.piece;
    PointJacobian(state.starts[own], pieces.col(own), pose.place.s).fill(rows, 6 * own, by_pieces);
    passOn(by_pieces, state.shape, out);
    if (const int base = columnOf(ParameterBlock::kBase); base >= 0) {
      ByMotion moved;
      state.base.front().fill(rows, 0, moved);
      out.middleCols<6>(base) = moved.topRows(m);
    }
    if (const int shift = columnOf(ParameterBlock::kBorderShift); shift >= 0) {
      out.col(shift) = rows.by_border_shift.head(m);
    }
    if (const int tag = columnOf(ParameterBlock::kTag); tag >= 0) {
      out.middleCols<6>(tag) = byPlacement(values, state.shape.shape, pose, rows).topRows(m);
    }
    return true;
  }

  double shown(const CaptureState& state, const ParameterBlocks& values,
               double square) const override {
    return model_.shown(seen_, poseAt(state, values).X_B0T, square);
  }

  bool faces(const CaptureState& state, const ParameterBlocks& values) const override {
    if constexpr (Model::kBorderShifts) {
      const lie::SE3 X_CT = model_.X_CB0 * poseAt(state, values).X_B0T;
      return X_CT.translation.z() > 0 &&
             -X_CT.rotation.col(2).dot(X_CT.translation.normalized()) > kFacing;
    }
    return true;
  }

 private:
  struct Pose {
    double s;  // along its section
    PiecePlace place;
    lie::SE3 X_B0S, X_B0T;
  };

  const TagPlacement& placement() const { return shared_.arms[place_.arm].layout.tags[seen_.tag]; }

  Pose poseAt(const CaptureState& state, const ParameterBlocks& values) const {
    const TagPlacement tag =
        columnOf(ParameterBlock::kTag) < 0
            ? placement()
            : movedBy(placement(), values.motionOf(ParameterBlock::kTag, seen_.tag), rest_length_);
    const model::Shape& shape = state.shape.shape;
    Pose pose;
    pose.s = tag.s;
    pose.place = placeOnPieces(tag, shape.piecesPerSection());
    pose.X_B0S = state.starts[pose.place.piece] *
                 lie::SE3::exp(pose.place.s * shape.pieces().col(pose.place.piece));
    pose.X_B0T = pose.X_B0S * tag.X_ST;
    return pose;
  }

  ByMotion byPlacement(const ParameterBlocks& values, const model::Shape& shape, const Pose& pose,
                       const Rows& rows) const {
    const TagPlacement& tag = placement();
    const lie::Vector6 placed = values.motionOf(ParameterBlock::kTag, seen_.tag);
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

}  // namespace

Place placeAt(const Shared& shared, int arm, int capture, const Eigen::VectorXd& pressure) {
  const ArmCaptures& data = shared.arms[arm];
  Place place{arm, capture, data.arm.lengths(pressure), pressure, freeEntries(data), {}, {}, arm};
  for (int i = 0; i < pressure.size(); ++i) {
    place.rest[i] = data.arm.actuator(i).contraction.restLength();
  }
  const bool is_fitted = isFree(shared.options, ParameterBlock::kCurve);
  place.by_curve.setZero(pressure.size(),
                         is_fitted ? shared.arms.front().free_curve->spline.lengths.size() : 0);
  place.rest_by_curve = place.by_curve;
  if (!is_fitted) return place;
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

LinearisedShape shapeAt(Shared& shared, const Place& place, const ParameterBlocks& values,
                        bool derivatives) {
  if (shared.options.free_shapes) {
    model::Twists twists = model::Twists::Zero(6, shared.arms[place.arm].arm.sectionCount());
    twists.reshaped()(place.entries) = values.of(ParameterBlock::kShape, place.capture);
    LinearisedShape shape;
    shape.shape = shared.expected_shapes[place.capture].about(twists);
    return shape;
  }
  // Strokes first, then length scales, as in Contraction::scaledBy().
  const bool has_strokes = isFree(shared.options, ParameterBlock::kStrokeScale);
  const auto curve = values.of(ParameterBlock::kCurve);
  const auto scales = values.of(ParameterBlock::kLengthScale);
  Eigen::VectorXd unscaled = place.lengthsAt(curve), stroke, change;
  if (has_strokes) {
    const Eigen::VectorXd rest = place.restAt(curve);
    stroke = values.of(ParameterBlock::kStrokeScale).array().exp();
    change = stroke.cwiseProduct(unscaled - rest);
    unscaled = rest + change;
  }
  Eigen::VectorXd lengths = unscaled;
  for (int i = 0; i < lengths.size(); ++i) lengths[i] *= shared.scaleOf(scales, i);
  const double* const stiffness = values.of(ParameterBlock::kStiffness).data();
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

ReadingCost::ReadingCost(const Shared& shared, const Place& place, int residuals,
                         const ParameterBlocks& blocks, int tag)
    : shared_(shared),
      place_(place),
      limit_(std::pow(shared.options.robust_scale * std::sqrt(residuals), 2)),
      residuals_(residuals),
      tag_(tag) {
  for (int i = 0; i < kParameterBlockCount; ++i) {
    const auto kind = static_cast<ParameterBlock>(i);
    const bool is_held = kind == ParameterBlock::kTag && tag == shared.held_tag;
    first_[static_cast<std::size_t>(i)] = -1;
    if (!isFree(shared.options, kind) || is_held) continue;
    const int of = kind == ParameterBlock::kTag     ? tag
                   : kind == ParameterBlock::kShape ? place.capture
                                                    : 0;
    first_[static_cast<std::size_t>(i)] = columns_;
    blocks_.push_back(blocks.indexOf(kind, of));
    columns_ += blocks.all()[static_cast<std::size_t>(blocks_.back())].size();
  }
}

void ReadingCost::passOn(const Eigen::MatrixXd& by_pieces, const LinearisedShape& shape,
                         Eigen::MatrixXd& J) const {
  J.resize(residuals_, columns_);
  const auto block = [&](ParameterBlock kind, const Eigen::MatrixXd& derivatives) {
    if (columnOf(kind) < 0) return;
    J.middleCols(columnOf(kind), derivatives.cols()).noalias() =
        by_pieces.topRows(residuals_).lazyProduct(derivatives);
  };
  block(ParameterBlock::kStiffness, shape.by_stiffness);
  block(ParameterBlock::kLengthScale, shape.by_scale);
  block(ParameterBlock::kStrokeScale, shape.by_stroke);
  block(ParameterBlock::kCurve, shape.by_curve);
  if (columnOf(ParameterBlock::kShape) < 0) return;
  // Each piece takes an equal part of a mean twist.
  const int per_section = shape.shape.piecesPerSection();
  for (std::size_t i = 0; i < place_.entries.size(); ++i) {
    auto out = J.col(columnOf(ParameterBlock::kShape) + static_cast<int>(i));
    out.setZero();
    const int first = place_.entries[i] / 6 * per_section;
    for (int j = first; j < first + per_section; ++j) {
      out += by_pieces.col(6 * j + place_.entries[i] % 6).head(residuals_) / per_section;
    }
  }
}

ReadingCosts termsOf(const Shared& shared, const Place& place, const Reading& reading,
                     const ParameterBlocks& blocks) {
  const ArmCaptures& data = shared.arms[place.arm];
  ReadingCosts terms;
  const auto addTags = [&](const auto& model, const auto& observations) {
    using Cost = TagCost<std::decay_t<decltype(model)>>;
    for (const auto& seen : observations) {
      terms.push_back(std::make_unique<Cost>(shared, place, blocks, model, seen));
    }
  };
  if (const auto* curvature = std::get_if<CurvatureReading>(&reading)) {
    terms.push_back(std::make_unique<CurvatureCost>(shared, place, blocks, curvature->curvature));
  } else if (const auto* twists = std::get_if<TwistReading>(&reading)) {
    terms.push_back(std::make_unique<TwistCost>(shared, place, blocks, *twists));
  } else if (const auto* poses = std::get_if<std::vector<PoseObservation>>(&reading)) {
    addTags(PoseModel{shared.expected, data.layout}, *poses);
  } else {
    const CornerModel model{data.X_CB, data.camera.focal() / shared.options.corner_noise,
                            shared.expected};
    addTags(model, std::get<std::vector<CornerObservation>>(reading));
  }
  return terms;
}

CaptureState stateAt(Shared& shared, const Place& place, ReadingKind kind,
                     const ParameterBlocks& values, bool derivatives) {
  CaptureState state;
  state.shape = shapeAt(shared, place, values, derivatives);
  if (!isMet(FitNeed::kTags, kind)) return state;
  const model::Shape& shape = state.shape.shape;
  const lie::Vector6 base = values.motionOf(ParameterBlock::kBase);
  state.corners = shared.arms[place.arm].layout.corners(values.borderShift());
  lie::SE3 X_B0j = lie::SE3::exp(base);
  const int pieces = static_cast<int>(shape.pieces().cols());
  for (int j = 0; j < pieces; ++j) {
    state.starts.push_back(X_B0j);
    if (j + 1 < pieces) X_B0j = shape.beyond(X_B0j, j);
  }
  if (!derivatives) return state;
  if (isFree(shared.options, ParameterBlock::kBase)) state.base.emplace_back(lie::SE3(), base, 1.0);
  for (int j = 0; j + 1 < pieces; ++j) {
    state.whole.emplace_back(state.starts[j], shape.pieces().col(j), 1.0);
  }
  return state;
}

ReadingCosts expectedTerms(const Shared& shared, const Place& place, const CaptureState& state,
                           const ParameterBlocks& blocks) {
  const ArmCaptures& arm = shared.arms[place.arm];
  ReadingCosts terms;
  std::set<int> seen;
  const auto add = [&](const Reading& reading) {
    for (auto& term : termsOf(shared, place, reading, blocks)) {
      if (term->faces(state, blocks)) terms.push_back(std::move(term));
    }
  };
  const auto addNew = [&](auto observations) {
    const auto isKnown = [&seen](const auto& one) { return !seen.insert(one.tag).second; };
    observations.erase(std::remove_if(observations.begin(), observations.end(), isKnown),
                       observations.end());
    add(observations);
  };
  for (const Capture& capture : arm.captures) {
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
  return terms;
}

}  // namespace helix_arm::estimation
