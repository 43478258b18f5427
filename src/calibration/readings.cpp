#include "readings.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
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

// |(w_y, w_z)| of the only section.
class CurvatureCost final : public ReadingCost {
 public:
  CurvatureCost(const Shared& shared, const Place& place, double measured)
      : ReadingCost(shared, place, 1, {}), measured_(measured) {}

  bool evaluate(const CaptureState& state, const Values&, Eigen::VectorXd& residual,
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

  bool evaluate(const CaptureState& state, const Values&, Eigen::VectorXd& residual,
                Eigen::MatrixXd* J, Eigen::MatrixXd&) const override {
    const model::Shape& shape = state.shape.shape;
    const model::Twists difference = shape.twists() - measured_;
    residual = whitening_ * Eigen::Map<const Eigen::VectorXd>(difference.data(), difference.size());
    if (J == nullptr) return true;
    passOn(overPieces(whitening_, shape), state.shape, *J);
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
      : ReadingCost(shared, place, model.residuals(seen), rigOf(takes_tag)),
        model_(model),
        seen_(std::move(seen)) {
    rest_length_ = shared.arms[place.arm].arm.restLength(placement().section);
  }

  int tag() const override { return seen_.tag; }

  bool evaluate(const CaptureState& state, const Values& values, Eigen::VectorXd& residual,
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
    if (columns_.base >= 0) {
      ByMotion moved;
      state.base.front().fill(rows, 0, moved);
      out.middleCols<6>(columns_.base) = moved.topRows(m);
    }
    if constexpr (Model::kBorderShifts) {
      if (columns_.border_shift >= 0) out.col(columns_.border_shift) = rows.by_border_shift;
    }
    if (columns_.tag >= 0) {
      out.middleCols<6>(columns_.tag) =
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

std::vector<int> blocksOf(const ReadingCost& cost, const ParameterBlocks& blocks) {
  std::vector<int> indices;
  for (const ParameterBlock kind : cost.kinds()) {
    int of = 0;
    if (kind == ParameterBlock::kTag) of = cost.tag();
    if (kind == ParameterBlock::kShape) of = cost.place().capture;
    indices.push_back(blocks.indexOf(kind, of));
  }
  return indices;
}

}  // namespace

Place placeAt(const Shared& shared, int arm, int capture, const Eigen::VectorXd& pressure) {
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

LinearisedShape shapeAt(Shared& shared, const Place& place, const Values& values,
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

double ReadingTerm::loss(double square) const {
  return isRobust() ? limit * std::log1p(square / limit) : square;
}

std::vector<ReadingTerm> termsOf(const Shared& shared, const Place& place, const Reading& reading,
                                 const ParameterBlocks& blocks) {
  const ArmCaptures& data = shared.arms[place.arm];
  std::vector<ReadingTerm> terms;
  const auto add = [&](std::unique_ptr<ReadingCost> cost) {
    const double scale = shared.options.robust_scale * std::sqrt(cost->residuals());
    std::vector<int> own = blocksOf(*cost, blocks);
    terms.push_back({std::move(cost), std::move(own), scale * scale});
  };
  const auto addTags = [&](const auto& model, const auto& observations) {
    using Model = std::decay_t<decltype(model)>;
    for (const auto& seen : observations) {
      const bool free = seen.tag != shared.held_tag;
      add(std::make_unique<TagCost<Model>>(shared, place, model, seen, free));
    }
  };
  if (const auto* curvature = std::get_if<CurvatureReading>(&reading)) {
    add(std::make_unique<CurvatureCost>(shared, place, curvature->curvature));
  } else if (const auto* twists = std::get_if<TwistReading>(&reading)) {
    add(std::make_unique<TwistCost>(shared, place, *twists));
    terms.back().limit = std::numeric_limits<double>::infinity();
  } else if (const auto* poses = std::get_if<std::vector<PoseObservation>>(&reading)) {
    addTags(PoseModel{shared.expected, data.layout}, *poses);
  } else {
    const CornerModel model{data.X_CB, data.camera.focal() / shared.options.corner_noise,
                            shared.expected};
    addTags(model, std::get<std::vector<CornerObservation>>(reading));
  }
  return terms;
}

CaptureState stateAt(Shared& shared, const Place& place, ReadingKind kind, const Values& values,
                     bool derivatives) {
  CaptureState state;
  state.shape = shapeAt(shared, place, values, derivatives);
  if (!isMet(FitNeed::kTags, kind)) return state;
  const model::Shape& shape = state.shape.shape;
  const lie::Vector6 base = values.own_blocks.at(ParameterBlock::kBase);
  state.corners =
      shared.arms[place.arm].layout.corners(values.own_blocks.at(ParameterBlock::kBorderShift)[0]);
  lie::SE3 X_B0j = lie::SE3::exp(base);
  const int pieces = static_cast<int>(shape.pieces().cols());
  for (int j = 0; j < pieces; ++j) {
    state.starts.push_back(X_B0j);
    if (j + 1 < pieces) X_B0j = shape.beyond(X_B0j, j);
  }
  if (!derivatives) return state;
  if (shared.selection.has(ParameterBlock::kBase)) state.base.emplace_back(lie::SE3(), base, 1.0);
  for (int j = 0; j + 1 < pieces; ++j) {
    state.whole.emplace_back(state.starts[j], shape.pieces().col(j), 1.0);
  }
  return state;
}

std::vector<ReadingTerm> expectedTerms(const Shared& shared, const Place& place,
                                       const CaptureState& state, const ParameterBlocks& blocks) {
  const ArmCaptures& arm = shared.arms[place.arm];
  std::vector<ReadingTerm> terms;
  std::vector<bool> seen(arm.layout.tags.size(), false);
  const auto add = [&](const Reading& reading) {
    for (ReadingTerm& term : termsOf(shared, place, reading, blocks)) {
      if (const auto* tag = dynamic_cast<const TagCost<CornerModel>*>(term.cost.get())) {
        if (!tag->faces(state, blocks.values())) continue;
      }
      terms.push_back(std::move(term));
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
