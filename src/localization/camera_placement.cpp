#include "helix_arm/localization/camera_placement.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "basics/least_squares.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"

namespace helix_arm::estimation {
namespace {

using Vector8 = Eigen::Matrix<double, 8, 1>;

constexpr char kCulprit[] = "camera placement";
constexpr int kRows = 8;
constexpr std::size_t kLeastTags = 2;
// Half the step of differences: large against rounding, small against everything that bends.
constexpr double kPlacementStep = 1e-6;  // [m, rad]
// The search ends where a step lowers the cost c by at most 1e-8 (1 + c).
constexpr basics::DescentRules kPlacementDescent{1e-6, 10.0, 1e10, 1e-8, 1e-8, 0};
// Decrease of the cost that a step promises: a fifth of a standard deviation. Below it an estimate
// that converges slowly, along a valley, is good enough.
constexpr double kNegligible = 0.04;

// As movedBy(), but along the tangent also within the section: movedBy() has a kink at its ends,
// which keeps the search from converging. At rest both agree to second order.
lie::SE3 displaced(const lie::SE3& X_ST, const lie::Vector6& moved) {
  lie::Vector6 turn = lie::Vector6::Zero();
  turn.tail<3>() = moved.tail<3>();
  return {X_ST.rotation * lie::SE3::exp(turn).rotation, X_ST.translation + moved.head<3>()};
}

// An estimate of everything that is fitted.
struct PlacementEstimate {
  lie::SE3 X_CB;
  double bleed = 0;
  model::Twists twists;             // (6 x sections)
  std::vector<lie::Vector6> moved;  // (seen tags)
};

// Parameters: pose of the base (6), bleed, twists (6 x sections), displacements (6 x seen tags).
class Problem {
 public:
  Problem(const model::Arm& arm, const TagLayout& layout, const model::Shape& shape,
          const std::vector<CornerObservation>& seen, double focal,
          const CameraPlacementOptions& options)
      : arm_(arm),
        layout_(layout),
        shape_(shape),
        seen_(seen),
        scale_(focal / options.corner_noise),
        options_(options),
        base_tag_(layout.baseTag()) {
    per_tag_.head<3>().setConstant(options.tag_prior.translation);
    per_tag_.tail<3>().setConstant(options.tag_prior.rotation);
  }

  int size() const { return firstMoved() + 6 * static_cast<int>(seen_.size()); }

  PlacementEstimate start(const lie::SE3& X_CB) const {
    return {X_CB, 0.0, shape_.twists(),
            std::vector<lie::Vector6>(seen_.size(), lie::Vector6::Zero())};
  }

  PlacementEstimate moved(const PlacementEstimate& from, const Eigen::VectorXd& step) const {
    PlacementEstimate to = from;
    to.X_CB = from.X_CB * lie::SE3::exp(step.head<6>());
    to.bleed += step[kBleed];
    for (int k = 0; k < to.twists.cols(); ++k) to.twists.col(k) += step.segment<6>(kTwists + 6 * k);
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      to.moved[i] += step.segment<6>(firstMoved() + 6 * static_cast<int>(i));
    }
    return to;
  }

  // Errors of the corners in expected standard deviations; empty if one is behind the camera.
  std::optional<Vector8> corners(std::size_t i, const lie::SE3& X_CB, double bleed,
                                 const model::Shape& shape, const lie::Vector6& moved) const {
    const TagPlacement& tag = layout_.tags[static_cast<std::size_t>(seen_[i].tag)];
    const lie::SE3 X_CT =
        X_CB * model::poseAt(shape, tag.section, tag.s) * displaced(tag.X_ST, moved);
    const Corners plane = layout_.corners(bleed);
    Vector8 out;
    for (int c = 0; c < 4; ++c) {
      const Eigen::Vector3d p_C = X_CT * Eigen::Vector3d(plane(0, c), plane(1, c), 0.0);
      if (!(p_C.z() > 0)) return std::nullopt;
      out.segment<2>(2 * c) = scale_ * (p_C.head<2>() / p_C.z() - seen_[i].direction.col(c));
    }
    return out;
  }

  // Cost of one tag before the loss: its corners and its displacement.
  std::optional<double> tagCost(std::size_t i, const PlacementEstimate& at,
                                const model::Shape& shape) const {
    const auto error = corners(i, at.X_CB, at.bleed, shape, at.moved[i]);
    if (!error) return std::nullopt;
    return error->squaredNorm() + at.moved[i].cwiseQuotient(per_tag_).squaredNorm();
  }

  double priorCost(const PlacementEstimate& at) const {
    double cost = std::pow(at.bleed / options_.bleed_prior, 2);
    for (int k = 0; k < at.twists.cols(); ++k) cost += twistDeviations(at, k).squaredNorm();
    return cost;
  }

  lie::Vector6 twistDeviations(const PlacementEstimate& at, int k) const {
    return (at.twists.col(k) - shape_.twists().col(k)).cwiseQuotient(twistPrior(k));
  }

  // Cauchy loss; infinite if a corner is behind the camera.
  double cost(const PlacementEstimate& at) const {
    const model::Shape shape = shape_.about(at.twists);
    double sum = priorCost(at);
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      const auto square = tagCost(i, at, shape);
      if (!square) return std::numeric_limits<double>::infinity();
      sum += limit2() * std::log1p(*square / limit2());
    }
    return sum;
  }

  double weight(double square) const { return 1 / (1 + square / limit2()); }
  bool isOutlier(double square) const { return square > limit2(); }

  // Of half the cost, with the weights of this estimate. Every corner must be in front.
  basics::DenseEquations linearise(const PlacementEstimate& at) const {
    const int n = size(), twists = 6 * static_cast<int>(at.twists.cols());
    basics::DenseEquations out{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n)};
    addPrior(kBleed, at.bleed / options_.bleed_prior, options_.bleed_prior, out);
    for (int k = 0; k < at.twists.cols(); ++k) {
      const lie::Vector6 off = twistDeviations(at, k), prior = twistPrior(k);
      for (int j = 0; j < 6; ++j) addPrior(kTwists + 6 * k + j, off[j], prior[j], out);
    }
    const model::Shape shape = shape_.about(at.twists);
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      const int own = firstMoved() + 6 * static_cast<int>(i);
      const Vector8 error = *corners(i, at.X_CB, at.bleed, shape, at.moved[i]);
      const double w = weight(*tagCost(i, at, shape));
      const Eigen::MatrixXd common = byCommon(i, at);
      const Eigen::Matrix<double, kRows, 6> alone = byMoved(i, at, shape);
      const int m = kTwists + twists;
      out.hessian.topLeftCorner(m, m) += w * common.transpose() * common;
      out.hessian.block(0, own, m, 6) += w * common.transpose() * alone;
      out.hessian.block(own, 0, 6, m) += w * alone.transpose() * common;
      out.hessian.block(own, own, 6, 6) += w * alone.transpose() * alone;
      out.gradient.head(m) += w * common.transpose() * error;
      out.gradient.segment<6>(own) += w * alone.transpose() * error;
      for (int j = 0; j < 6; ++j) {
        const double prior = per_tag_[j] / std::sqrt(w);
        addPrior(own + j, at.moved[i][j] / prior, prior, out);
      }
    }
    return out;
  }

 private:
  static constexpr int kBleed = 6, kTwists = 7;

  int firstMoved() const { return kTwists + 6 * shape_.sectionCount(); }
  double limit2() const { return kRows * options_.robust_scale * options_.robust_scale; }

  lie::Vector6 twistPrior(int k) const {
    lie::Vector6 prior;
    prior.head<3>().setConstant(options_.shape_prior.translation * arm_.restLength(k));
    prior.tail<3>().setConstant(options_.shape_prior.rotation);
    return prior;
  }

  static void addPrior(int entry, double off, double prior, basics::DenseEquations& out) {
    out.hessian(entry, entry) += 1 / (prior * prior);
    out.gradient[entry] += off / prior;
  }

  Vector8 difference(std::size_t i, const PlacementEstimate& low,
                     const PlacementEstimate& high) const {
    const auto at = [&](const PlacementEstimate& one) {
      return corners(i, one.X_CB, one.bleed, shape_.about(one.twists), one.moved[i]);
    };
    const auto from = at(low), to = at(high);
    return from && to ? Vector8((*to - *from) / (2 * kPlacementStep)) : Vector8(Vector8::Zero());
  }

  // By pose, bleed and twists.
  Eigen::MatrixXd byCommon(std::size_t i, const PlacementEstimate& at) const {
    Eigen::MatrixXd J(kRows, kTwists + 6 * at.twists.cols());
    for (Eigen::Index j = 0; j < J.cols(); ++j) {
      Eigen::VectorXd step = Eigen::VectorXd::Zero(size());
      step[j] = kPlacementStep;
      J.col(j) = difference(i, moved(at, -step), moved(at, step));
    }
    return J;
  }

  // Zero for the tag that defines the base.
  Eigen::Matrix<double, kRows, 6> byMoved(std::size_t i, const PlacementEstimate& at,
                                          const model::Shape& shape) const {
    Eigen::Matrix<double, kRows, 6> J = Eigen::Matrix<double, kRows, 6>::Zero();
    if (seen_[i].tag == base_tag_) return J;
    for (int j = 0; j < 6; ++j) {
      const lie::Vector6 step = kPlacementStep * lie::Vector6::Unit(j);
      const auto from = corners(i, at.X_CB, at.bleed, shape, at.moved[i] - step);
      const auto to = corners(i, at.X_CB, at.bleed, shape, at.moved[i] + step);
      if (from && to) J.col(j) = (*to - *from) / (2 * kPlacementStep);
    }
    return J;
  }

  const model::Arm& arm_;
  const TagLayout& layout_;
  const model::Shape& shape_;
  const std::vector<CornerObservation>& seen_;
  const double scale_;
  const CameraPlacementOptions& options_;
  const int base_tag_;
  lie::Vector6 per_tag_;
};

// The result at an estimate.
void describe(const Problem& problem, const PlacementEstimate& at, const TagLayout& layout,
              const model::Shape& model, const std::vector<CornerObservation>& seen,
              const CameraPlacementOptions& options, CameraPlacement& out) {
  const model::Shape shape = model.about(at.twists);
  double square = problem.priorCost(at), fitted = 0;
  int tags = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const double cost = problem.tagCost(i, at, shape).value_or(0);
    const Vector8 error =
        problem.corners(i, at.X_CB, at.bleed, shape, at.moved[i]).value_or(Vector8::Zero());
    const double rms = options.corner_noise * std::sqrt(error.squaredNorm() / kRows);
    const bool outlier = problem.isOutlier(cost);
    out.tags.push_back({seen[i].tag, rms, problem.weight(cost), outlier});
    square += problem.weight(cost) * cost;
    if (outlier) continue;
    fitted += rms * rms;
    ++tags;
  }
  out.rms = tags > 0 ? std::sqrt(fitted / tags) : 0;
  out.X_CB = at.X_CB;
  out.bleed = at.bleed;
  out.twists = at.twists;
  for (int k = 0; k < at.twists.cols(); ++k) {
    out.shape_deviations =
        std::max(out.shape_deviations, problem.twistDeviations(at, k).cwiseAbs().maxCoeff());
  }
  // Every other parameter has a prior, so that it counts on both sides.
  const double freedom = static_cast<double>(kRows * tags) - lie::SE3::kDof;
  const double grown = freedom > 0 ? std::max(1.0, square / freedom) : 1.0;
  const basics::DenseEquations normal = problem.linearise(at);
  const Eigen::MatrixXd six = Eigen::MatrixXd::Identity(normal.hessian.rows(), lie::SE3::kDof);
  out.covariance = grown * normal.hessian.ldlt().solve(six).topRows<6>();
  out.covariance = 0.5 * (out.covariance + out.covariance.transpose()).eval();
  const bool most = 2 * tags > static_cast<int>(layout.tags.empty() ? 0 : seen.size());
  if (!most && out.status == PlacementStatus::kPlaced) out.status = PlacementStatus::kUnexplained;
}

}  // namespace

void CameraPlacementOptions::validate() const {
  basics::requirePositive(kCulprit,
                          {{"the corner noise [px]", corner_noise},
                           {"the prior of the tags' positions [m]", tag_prior.translation},
                           {"the prior of the tags' rotations [rad]", tag_prior.rotation},
                           {"the prior of the twists' v", shape_prior.translation},
                           {"the prior of the twists' w [rad]", shape_prior.rotation},
                           {"the prior of the bleed [m]", bleed_prior},
                           {"the robust threshold", robust_scale}});
  basics::requireValue(max_iterations > 0, kCulprit, "the number of iterations", max_iterations,
                       "a value > 0");
}

int CameraPlacement::outliers() const {
  return static_cast<int>(
      std::count_if(tags.begin(), tags.end(), [](const TagResidual& tag) { return tag.outlier; }));
}

CameraPlacement fitCameraPlacement(const model::Arm& arm, const TagLayout& layout,
                                   const model::Shape& shape,
                                   const std::vector<CornerObservation>& seen, double focal,
                                   const lie::SE3& start, const CameraPlacementOptions& options) {
  options.validate();
  layout.validate(arm.sectionCount());
  basics::requirePositive(kCulprit, "the focal length [px]", focal);
  basics::requireValue(shape.sectionCount() == arm.sectionCount(), kCulprit,
                       "the number of sections of the shape", shape.sectionCount(),
                       "that of the arm");
  for (const CornerObservation& one : seen) {
    basics::requireValue(one.tag >= 0 && one.tag < static_cast<int>(layout.tags.size()), kCulprit,
                         "the index of a tag", one.tag, "one of the layout");
    basics::require(one.direction.allFinite(), kCulprit, ": a direction of tag ",
                    layout.tags[static_cast<std::size_t>(one.tag)].id,
                    " is not finite; expected finite directions");
  }
  CameraPlacement out;
  out.X_CB = start;
  out.twists = shape.twists();
  if (seen.size() < kLeastTags) return out;
  const Problem problem(arm, layout, shape, seen, focal, options);
  basics::DescentRules rules = kPlacementDescent;
  rules.max_iterations = options.max_iterations;
  const auto found = basics::descend(problem, problem.start(start), rules);
  out.status = PlacementStatus::kNotConverged;
  if (!std::isfinite(found.cost)) return out;
  out.iterations = found.iterations;
  const PlacementEstimate& at = found.at;
  if (found.at_rest) out.status = PlacementStatus::kPlaced;
  if (out.status != PlacementStatus::kPlaced) {
    const basics::DenseEquations normal = problem.linearise(at);
    const double promised = normal.gradient.dot(normal.hessian.ldlt().solve(normal.gradient));
    if (promised < kNegligible) out.status = PlacementStatus::kPlaced;
  }
  describe(problem, at, layout, shape, seen, options, out);
  return out;
}

double cornerError(const TagLayout& layout, const model::Shape& shape, const lie::SE3& X_CB,
                   const CornerObservation& seen, double focal) {
  const TagPlacement& tag = layout.tags[static_cast<std::size_t>(seen.tag)];
  const lie::SE3 X_CT = X_CB * model::poseAt(shape, tag.section, tag.s) * tag.X_ST;
  const Corners plane = layout.corners();
  double square = 0;
  for (int c = 0; c < 4; ++c) {
    const Eigen::Vector3d p_C = X_CT * Eigen::Vector3d(plane(0, c), plane(1, c), 0.0);
    if (!(p_C.z() > 0)) return std::numeric_limits<double>::infinity();
    square += (p_C.head<2>() / p_C.z() - seen.direction.col(c)).squaredNorm();
  }
  return focal * std::sqrt(square / kRows);
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
