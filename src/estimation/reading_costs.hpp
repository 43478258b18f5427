#pragma once

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>
#include <vector>

#include <ceres/cost_function.h>

#include "helix_arm/model/curve.hpp"
#include "parameter_blocks.hpp"
#include "reading_place.hpp"
#include "shape_model.hpp"
#include "tag_models.hpp"

/// Cost functions of a calibration's readings: residuals in expected standard deviations, and their
/// derivatives.
namespace helix_arm::estimation {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Index of each parameter block of a cost in Ceres' order.
struct Blocks {
  int stiffness = -1, scale = -1, curve = -1, shape = -1, base = -1, bleed = -1, tag = -1;
};

class ReadingCost : public ceres::CostFunction {
 public:
  // @param rig  the blocks that the cost depends on, besides those of the shape.
  ReadingCost(Shared& shared, Place place, int residuals, const std::set<ParameterBlock>& rig)
      : shared_(shared), place_(std::move(place)), entries_(freeEntries(shared.arms[place_.arm])) {
    set_num_residuals(residuals);
    const auto take = [this](ParameterBlock kind, int size, int& index) {
      if (!shared_.selection.has(kind)) return;
      index = static_cast<int>(kinds_.size());
      kinds_.push_back(kind);
      mutable_parameter_block_sizes()->push_back(size);
    };
    const auto takeOfRig = [&](ParameterBlock kind, int size, int& index) {
      if (rig.count(kind) > 0) take(kind, size, index);
    };
    take(ParameterBlock::kStiffness, static_cast<int>(shared.selection.stiffness.size()),
         blocks_.stiffness);
    take(ParameterBlock::kLengthScale, shared.scales(), blocks_.scale);
    take(ParameterBlock::kCurve, static_cast<int>(place_.by_curve.cols()), blocks_.curve);
    take(ParameterBlock::kShape, static_cast<int>(entries_.size()), blocks_.shape);
    takeOfRig(ParameterBlock::kBase, 6, blocks_.base);
    takeOfRig(ParameterBlock::kBleed, 1, blocks_.bleed);
    takeOfRig(ParameterBlock::kTag, 6, blocks_.tag);
  }

  // Its parameter blocks in Ceres' order.
  const std::vector<ParameterBlock>& kinds() const { return kinds_; }
  const Place& place() const { return place_; }
  virtual int tag() const { return -1; }
  // The error for reports, computed from residuals of this cost.
  virtual double shown(const double* const* parameters, double square) const = 0;

 protected:
  ShapeThere shapeAt(const double* const* p, bool derivatives) const {
    if (blocks_.shape >= 0) {
      ShapeThere shape;
      model::Twists twists = model::Twists::Zero(6, shared_.arms[place_.arm].arm.sectionCount());
      for (std::size_t i = 0; i < entries_.size(); ++i) {
        twists.data()[entries_[i]] = p[blocks_.shape][i];
      }
      shape.shape = shared_.expected_shapes[place_.capture].about(twists);
      return shape;
    }
    const Eigen::VectorXd unscaled =
        place_.lengthsAt(blocks_.curve >= 0 ? p[blocks_.curve] : nullptr);
    Eigen::VectorXd lengths = unscaled;
    const double* scales = blocks_.scale >= 0 ? p[blocks_.scale] : nullptr;
    for (int i = 0; i < lengths.size(); ++i) lengths[i] *= shared_.scaleOf(scales, i);
    const double* stiffness = blocks_.stiffness >= 0 ? p[blocks_.stiffness] : nullptr;
    if (blocks_.curve < 0) {
      return shared_.model.at(place_.arm, lengths, stiffness,
                              scales != nullptr ? shared_.scales() : 0, derivatives);
    }
    // The derivatives with respect to each length give those with respect to scales and curve.
    ShapeThere shape = shared_.model.at(place_.arm, lengths, stiffness,
                                        static_cast<int>(lengths.size()), derivatives);
    if (!derivatives) return shape;
    shape.by_curve = shape.by_scale * unscaled.cwiseInverse().asDiagonal() * place_.by_curve;
    if (scales != nullptr && shared_.scales() == 1) {
      shape.by_scale = shape.by_scale.rowwise().sum().eval();
    }
    return shape;
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
  // parameter blocks.
  void passOn(const Eigen::MatrixXd& by_pieces, const ShapeThere& shape, double** J) const {
    const auto block = [&](int index, const Eigen::MatrixXd& derivatives) {
      if (index < 0 || J[index] == nullptr) return;
      Eigen::Map<RowMajor>(J[index], derivatives.rows(), derivatives.cols()) = derivatives;
    };
    if (blocks_.stiffness >= 0) block(blocks_.stiffness, by_pieces * shape.by_stiffness);
    if (blocks_.scale >= 0) block(blocks_.scale, by_pieces * shape.by_scale);
    if (blocks_.curve >= 0) block(blocks_.curve, by_pieces * shape.by_curve);
    if (blocks_.shape < 0 || J[blocks_.shape] == nullptr) return;
    // Each piece takes an equal part of a mean twist.
    const int per_section = shape.shape.piecesPerSection();
    Eigen::Map<RowMajor> out(J[blocks_.shape], by_pieces.rows(),
                             static_cast<Eigen::Index>(entries_.size()));
    out.setZero();
    for (std::size_t i = 0; i < entries_.size(); ++i) {
      const int first = entries_[i] / 6 * per_section;
      for (int j = first; j < first + per_section; ++j) {
        out.col(i) += by_pieces.col(6 * j + entries_[i] % 6) / per_section;
      }
    }
  }

  Shared& shared_;
  const Place place_;
  const std::vector<int> entries_;  // free entries of the twists, for free shapes
  std::vector<ParameterBlock> kinds_;
  Blocks blocks_;
};

// |(w_y, w_z)| of the only section.
class CurvatureCost final : public ReadingCost {
 public:
  CurvatureCost(Shared& shared, Place place, double measured)
      : ReadingCost(shared, std::move(place), 1, {}), measured_(measured) {}

  bool Evaluate(const double* const* p, double* residual, double** J) const override {
    const double weight = shared_.inverse_noise / shared_.options.curvature_noise;
    const ShapeThere shape = shapeAt(p, J != nullptr);
    if (!shape.found) return false;
    const lie::Vector6 twist = shape.shape.twists().col(0);
    const double curvature = model::curvatureOf(twist);
    residual[0] = weight * (curvature - measured_);
    if (J == nullptr) return true;
    Eigen::MatrixXd by_twists = Eigen::MatrixXd::Zero(1, 6);
    // A straight arm has no preferred direction of bending, so its derivative stays zero.
    if (curvature > 0) by_twists.rightCols(2) = weight / curvature * twist.tail<2>().transpose();
    passOn(overPieces(by_twists, shape.shape), shape, J);
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
      : ReadingCost(shared, std::move(place), static_cast<int>(reading.twists.size()), {}),
        measured_(reading.twists) {
    const Eigen::LLT<Eigen::MatrixXd> factors(reading.covariance);
    whitening_ = factors.matrixL().solve(
        Eigen::MatrixXd::Identity(reading.covariance.rows(), reading.covariance.cols()));
  }

  bool Evaluate(const double* const* p, double* residual, double** J) const override {
    const ShapeThere shape = shapeAt(p, J != nullptr);
    if (!shape.found) return false;
    const model::Twists difference = shape.shape.twists() - measured_;
    Eigen::Map<Eigen::VectorXd>(residual, num_residuals()) =
        shared_.inverse_noise * whitening_ *
        Eigen::Map<const Eigen::VectorXd>(difference.data(), difference.size());
    if (J != nullptr) {
      passOn(overPieces(shared_.inverse_noise * whitening_, shape.shape), shape, J);
    }
    return true;
  }

  // Distance of the tips [m].
  double shown(const double* const* p, double) const override {
    const model::Shape shape = shapeAt(p, false).shape;
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

 public:
  TagCost(Shared& shared, Place place, const Model& model, typename Model::Observation seen,
          bool takes_tag)
      : ReadingCost(shared, std::move(place), model.residuals(), rigOf(takes_tag)),
        model_(model),
        seen_(std::move(seen)) {
    const model::Arm& arm = shared.arms[place_.arm].arm;
    const TagPlacement& tag = placement();
    rest_length_ = arm.restLength(tag.section);
  }

  int tag() const override { return seen_.tag; }

  bool Evaluate(const double* const* p, double* residual, double** J) const override {
    const ShapeThere shape = shapeAt(p, J != nullptr);
    if (!shape.found) return false;
    const Pose pose = poseAt(p, shape.shape);
    typename Model::Rows rows;
    if (!model_.evaluate(seen_, pose.X_B0T, corners(p), rows)) return false;
    const int m = num_residuals();
    rows.residual *= shared_.inverse_noise;
    Eigen::Map<Eigen::VectorXd>(residual, m) = rows.residual.head(m);
    if (J == nullptr) return true;
    rows.by_v *= shared_.inverse_noise;
    rows.by_w *= shared_.inverse_noise;
    if (Model::kBleeds) rows.by_bleed *= shared_.inverse_noise;

    const model::Shape::Pieces& pieces = shape.shape.pieces();
    Eigen::MatrixXd by_pieces = Eigen::MatrixXd::Zero(Model::Rows::kCount, pieces.size());
    for (int j = 0; j <= pose.place.piece; ++j) {
      const double reach = j < pose.place.piece ? 1.0 : pose.place.s;
      Mover(pose.starts[j], pieces.col(j), reach).fill(rows, 6 * j, by_pieces);
    }
    passOn(by_pieces.topRows(m), shape, J);
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
          byPlacement(p, shape.shape, pose, rows).topRows(m);
    }
    return true;
  }

  double shown(const double* const* p, double square) const override {
    const double expected = square / (shared_.inverse_noise * shared_.inverse_noise);
    return model_.shown(seen_, poseAt(p, shapeAt(p, false).shape).X_B0T, expected);
  }

  // Whether the tag faces the camera.
  bool faces(const double* const* p) const {
    if constexpr (Model::kBleeds) {
      const lie::SE3 X_CT = model_.X_CB0 * poseAt(p, shapeAt(p, false).shape).X_B0T;
      return X_CT.translation.z() > 0 &&
             -X_CT.rotation.col(2).dot(X_CT.translation.normalized()) > kFacing;
    }
    return true;
  }

 private:
  static std::set<ParameterBlock> rigOf(bool takes_tag) {
    std::set<ParameterBlock> rig{ParameterBlock::kBase};
    if (Model::kBleeds) rig.insert(ParameterBlock::kBleed);
    if (takes_tag) rig.insert(ParameterBlock::kTag);
    return rig;
  }

  struct Pose {
    double s;  // along its section
    PiecePlace place;
    std::vector<lie::SE3> starts;  // X_B0j of the pieces up to the tag's
    lie::SE3 X_B0S, X_B0T;
  };

  const TagPlacement& placement() const { return shared_.arms[place_.arm].layout.tags[seen_.tag]; }

  Corners corners(const double* const* p) const {
    return shared_.arms[place_.arm].layout.corners(blocks_.bleed >= 0 ? p[blocks_.bleed][0] : 0.0);
  }

  Pose poseAt(const double* const* p, const model::Shape& shape) const {
    TagPlacement tag = placement();
    if (blocks_.tag >= 0) {
      tag = movedBy(tag, Eigen::Map<const lie::Vector6>(p[blocks_.tag]), rest_length_);
    }
    Pose pose;
    pose.s = tag.s;
    pose.place = placeOnPieces(tag, shape.piecesPerSection());
    lie::SE3 X_B0j;
    if (blocks_.base >= 0) {
      X_B0j = lie::SE3::exp(Eigen::Map<const lie::Vector6>(p[blocks_.base]));
    }
    for (int j = 0; j <= pose.place.piece; ++j) {
      pose.starts.push_back(X_B0j);
      if (j < pose.place.piece) X_B0j = shape.beyond(X_B0j, j);
    }
    pose.X_B0S = X_B0j * lie::SE3::exp(pose.place.s * shape.pieces().col(pose.place.piece));
    pose.X_B0T = pose.X_B0S * tag.X_ST;
    return pose;
  }

  Eigen::MatrixXd byPlacement(const double* const* p, const model::Shape& shape, const Pose& pose,
                              const typename Model::Rows& rows) const {
    const TagPlacement& tag = placement();
    const Eigen::Vector3d turned(p[blocks_.tag][3], p[blocks_.tag][4], p[blocks_.tag][5]);
    Eigen::MatrixXd out(Model::Rows::kCount, 6);
    Eigen::MatrixXd moved(Model::Rows::kCount, 6);
    Mover(pose.X_B0S).fill(rows, 0, moved);
    const double s = tag.s + p[blocks_.tag][0] / rest_length_;
    if (s == pose.s) {
      const double per_length = shape.piecesPerSection() / rest_length_;
      out.col(0) = per_length * (moved * shape.pieces().col(pose.place.piece));
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

}  // namespace helix_arm::estimation
