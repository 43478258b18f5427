#include "helix_arm/localization/camera_placement.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "basics/least_squares.hpp"
#include "helix_arm/model/curve.hpp"
#include "twist_equations.hpp"

namespace helix_arm::estimation {
namespace {

using Matrix8 = Eigen::Matrix<double, 8, 8>;

constexpr int kRows = 8;
// Searches, each with the effects of displacements where the one before ended.
constexpr int kSearches = 3;
// The search ends where a step lowers the cost c by at most 1e-8 (1 + c).
constexpr basics::DescentRules kPlacementDescent{1e-6, 10.0, 1e10, 1e-8, 1e-8, 200};
// Decrease of the cost that a step promises: a fifth of a standard deviation. Below it an estimate
// that converges slowly, along a valley, is good enough.
constexpr double kNegligible = 0.04;
// Prior of the base that says nothing.
constexpr BasePrior kAnyBase{1e4, 1e4};

// Corners of tags whose placements are uncertain: displacements d of variance P are eliminated. The
// least |e + J d|^2 + d' P^-1 d is e' (I + J P J')^-1 e.
struct LooseCorners : CornerModel {
  std::vector<Matrix8> root;  // (tags of the layout) L'^-1 of I + J P J' = L L'

  bool evaluate(const CornerObservation& seen, const lie::SE3& X_B0T, const Corners& plane,
                Rows& rows) const {
    if (!CornerModel::evaluate(seen, X_B0T, plane, rows)) return false;
    const Matrix8 whitening = root[static_cast<std::size_t>(seen.tag)].transpose();
    rows.residual = (whitening * rows.residual).eval();
    rows.by_v = (whitening * rows.by_v).eval();
    rows.by_w = (whitening * rows.by_w).eval();
    rows.by_border_shift = (whitening * rows.by_border_shift).eval();
    return true;
  }
};

// The search for twists, base and border shift, of basics::descend().
class PlacementProblem {
 public:
  PlacementProblem(const model::Arm& arm, const TagLayout& layout, const model::Shape& shape,
                   const std::vector<CornerObservation>& seen, double focal, const lie::SE3& X_CB,
                   const CameraPlacementOptions& options)
      : arm_(arm),
        seen_(seen),
        options_(options),
        equations_(layout, arm.sectionCount(), fitOptions(options)),
        corners_{{X_CB, focal / options.corner_noise, equations_.options()}, {}} {
    model::Twists deviations(6, arm.sectionCount());
    for (int k = 0; k < arm.sectionCount(); ++k) {
      deviations.col(k) << Eigen::Vector3d::Constant(options.shape_prior.translation *
                                                     arm.restLength(k)),
          Eigen::Vector3d::Constant(options.shape_prior.rotation);
    }
    equations_.expect(shape, deviations);
  }

  FitPoint start() const {
    FitPoint point;
    equations_.start(equations_.prior(), point);
    return point;
  }

  // Takes the effects of displacements at an estimate; false with a corner behind the camera.
  bool loosen(const FitPoint& at) {
    const TagLayout& layout = equations_.layout();
    lie::Vector6 variance;
    variance << Eigen::Vector3d::Constant(std::pow(options_.tag_prior.translation, 2)),
        Eigen::Vector3d::Constant(std::pow(options_.tag_prior.rotation, 2));
    corners_.root.assign(layout.tags.size(), Matrix8::Identity());
    for (const CornerObservation& one : seen_) {
      CornerModel::Rows rows;
      if (!rowsOf(one, at, rows)) return false;
      // This tag defines the base.
      if (one.tag == layout.baseTag()) continue;
      const TagPlacement& tag = layout.tags[static_cast<std::size_t>(one.tag)];
      Eigen::Matrix<double, kRows, 6> J;
      J << rows.by_v, rows.by_w;
      J *= at.X_B0B.adjoint() * motionsOf(tag, arm_.restLength(tag.section), at.shape);
      const Matrix8 S = Matrix8::Identity() + J * variance.asDiagonal() * J.transpose();
      corners_.root[static_cast<std::size_t>(one.tag)] =
          S.llt().matrixU().solve(Matrix8::Identity());
    }
    return true;
  }

  double cost(const FitPoint& at) const { return evaluated(at).first.cost; }
  basics::DenseEquations linearise(const FitPoint& at) const {
    const NormalEquations system = evaluated(at).second;
    return {system.hessian.selfadjointView<Eigen::Lower>(), system.gradient};
  }
  FitPoint moved(const FitPoint& from, const Eigen::VectorXd& step) const {
    FitPoint to;
    equations_.move<LooseCorners>(from, step, to);
    return to;
  }

  // The result at an estimate.
  void describe(const FitPoint& estimate, CameraPlacement& out) const {
    const auto [at, system] = evaluated(estimate);
    NormalEquations priors = system;
    double square = equations_.addPriors<LooseCorners>(at, priors), fitted = 0;
    int tags = 0;
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      const Matrix8& root = corners_.root[static_cast<std::size_t>(seen_[i].tag)];
      CornerModel::Rows rows;
      rowsOf(seen_[i], at, rows);
      // With the displacement that explains most of it.
      const auto left = (root * root.transpose() * rows.residual).eval();
      TagResidual tag = at.residuals[i];
      tag.rms = options_.corner_noise * std::sqrt(left.squaredNorm() / kRows);
      tag.outlier = at.squares[i] > equations_.threshold() * at.counts[i];
      square += tag.weight * at.squares[i];
      out.tags.push_back(tag);
      if (tag.outlier) continue;
      fitted += tag.rms * tag.rms;
      ++tags;
    }
    out.rms = tags > 0 ? std::sqrt(fitted / tags) : 0;
    out.X_CB = corners_.X_CB0 * at.X_B0B;
    out.border_shift = at.border_shift;
    out.shape_deviations = equations_.deviationsOf(at).cwiseAbs().maxCoeff();
    // Every other parameter has a prior, so that it counts on both sides.
    const double freedom = static_cast<double>(kRows * tags) - lie::SE3::kDof;
    const double grown = freedom > 0 ? std::max(1.0, square / freedom) : 1.0;
    const int base = 6 * equations_.sections();
    const Eigen::MatrixXd hessian = linearise(at).hessian;
    const Eigen::MatrixXd inverse =
        hessian.ldlt().solve(Eigen::MatrixXd::Identity(hessian.rows(), hessian.cols()));
    out.covariance = grown * inverse.block<6, 6>(base, base);
    out.covariance = 0.5 * (out.covariance + out.covariance.transpose()).eval();
    if (2 * tags <= static_cast<int>(seen_.size()) && out.status == PlacementStatus::kPlaced) {
      out.status = PlacementStatus::kUnexplained;
    }
  }

 private:
  static TwistFitOptions fitOptions(const CameraPlacementOptions& options) {
    TwistFitOptions fit;
    fit.corner_noise = options.corner_noise;
    fit.free_base = fit.free_border_shift = true;
    fit.base_prior = kAnyBase;
    fit.border_shift_prior = options.border_shift_prior;
    return fit;
  }

  bool rowsOf(const CornerObservation& seen, const FitPoint& at, CornerModel::Rows& rows) const {
    const TagPlacement& tag = equations_.layout().tags[static_cast<std::size_t>(seen.tag)];
    const lie::SE3 X_B0T = at.X_B0B * model::poseAt(at.shape, tag.section, tag.s) * tag.X_ST;
    return corners_.CornerModel::evaluate(seen, X_B0T, equations_.layout().corners(at.border_shift),
                                          rows);
  }

  std::pair<FitPoint, NormalEquations> evaluated(FitPoint at) const {
    NormalEquations system;
    equations_.evaluate(corners_, seen_, -1, at, system);
    return {std::move(at), std::move(system)};
  }

  const model::Arm& arm_;
  const std::vector<CornerObservation>& seen_;
  const CameraPlacementOptions& options_;
  mutable TwistEquations equations_;  // has a workspace
  LooseCorners corners_;
};

}  // namespace

CameraPlacement fitCameraPlacement(const model::Arm& arm, const TagLayout& layout,
                                   const model::Shape& shape,
                                   const std::vector<CornerObservation>& seen, double focal,
                                   const lie::SE3& start, const CameraPlacementOptions& options) {
  CameraPlacement out;
  out.X_CB = start;
  PlacementProblem problem(arm, layout, shape, seen, focal, start, options);
  basics::Descended<FitPoint> found{problem.start()};
  for (int search = 0; search < kSearches; ++search) {
    if (!problem.loosen(found.at)) return out;
    found = basics::descend(problem, std::move(found.at), kPlacementDescent);
  }
  const basics::DenseEquations normal = problem.linearise(found.at);
  const double promised = normal.gradient.dot(normal.hessian.ldlt().solve(normal.gradient));
  if (found.at_rest || promised < kNegligible) out.status = PlacementStatus::kPlaced;
  problem.describe(found.at, out);
  return out;
}

double cornerError(const TagLayout& layout, const model::Shape& shape, const lie::SE3& X_CB,
                   const CornerObservation& seen, double focal) {
  const Corners off = observe(layout, shape, X_CB, seen.tag).direction - seen.direction;
  return focal * off.norm() / std::sqrt(kRows);
}

lie::Matrix6 cameraCovariance(const lie::SE3& X_WB, const lie::SE3& X_CB,
                              const lie::Matrix6& covariance) {
  // X_WC = X_WB X_CB^-1 moves by Ad(X_WB) xi, seen from the world and about its origin; the
  // camera's position moves by v + w x p.
  const Eigen::Vector3d p = (X_WB * X_CB.inverse()).translation;
  lie::Matrix6 J = lie::Matrix6::Identity();
  J.topRightCorner<3, 3>() = -lie::skew(p);
  J = (J * X_WB.adjoint()).eval();
  return J * covariance * J.transpose();
}

}  // namespace helix_arm::estimation
