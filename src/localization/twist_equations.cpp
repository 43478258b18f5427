#include "twist_equations.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace helix_arm::estimation {
namespace {

using Parameters = NormalEquations::Matrix;

// Inverse of a positive definite matrix, of which only the lower triangle is read.
Parameters inverseOf(const Eigen::Ref<const Eigen::MatrixXd>& matrix) {
  const Eigen::LLT<Parameters> factors(matrix);
  Parameters out = Parameters::Identity(matrix.rows(), matrix.cols());
  for (int i = 0; i < static_cast<int>(out.cols()); ++i) {
    auto column = out.col(i);
    factors.solveInPlace(column);
  }
  return out;
}

// Minimum degrees of freedom; missing ones are filled with residuals of the expected size.
constexpr double kLeastFreedom = 4.0;
// Lower bound of the estimated variance, relative to the expected one.
constexpr double kLeastVariance = 0.01;

// Marks tags whose mean squares exceed a limit as outliers, and sets the RMS of the others.
// @return the number of the others.
int markOutliers(const FitPoint& at, double limit, TwistFit& fit) {
  double square = 0;
  int fitting = 0;
  for (std::size_t i = 0; i < fit.tags.size(); ++i) {
    TagResidual& tag = fit.tags[i];
    tag.outlier = at.squares[i] > limit * at.counts[i];
    if (tag.outlier) continue;
    square += tag.rms * tag.rms;
    ++fitting;
  }
  fit.rms = fitting > 0 ? std::sqrt(square / fitting) : 0;
  return fitting;
}

// Noise estimated from the residuals.
struct ResidualNoise {
  double variance;  // in expected variances
  double freedom;   // number of residuals in excess of the fitted parameters
};

// Noise of normally distributed errors under a robust loss (Huber, Robust Statistics, 7.6): the
// weighted squares divided by the slopes of the equations, since larger errors have less weight.
// @param data_parameters  how many the tags determine.
ResidualNoise noiseOf(const TwistFit& fit, const FitPoint& at, double data_parameters) {
  // Sums over the residuals.
  double all = 0, weights = 0, weights2 = 0, weighted = 0, slopes = 0, slopes2 = 0;
  for (std::size_t i = 0; i < fit.tags.size(); ++i) {
    const double weight = fit.tags[i].weight;
    const double radial = weight * (2 * weight - 1);  // across it, the slope is the weight
    const double residuals = at.counts[i];
    all += residuals;
    weights += residuals * weight;
    weights2 += residuals * weight * weight;
    weighted += weight * weight * at.squares[i];
    slopes += (residuals - 1) * weight + radial;
    slopes2 += (residuals - 1) * weight * weight + radial * radial;
  }
  // Tags of weight 0 do not count.
  const double count = weights * weights / weights2;
  const double freedom = std::max(0.0, count - data_parameters);
  const double spread = all * slopes2 / (slopes * slopes) - 1;
  const double correction = 1 + data_parameters / all * spread;
  const double square = correction * correction * weighted * count * weights / (slopes * slopes);
  const double expected = std::max(0.0, kLeastFreedom - freedom);
  return {std::max(kLeastVariance, (expected + square) / (expected + freedom)), expected + freedom};
}

// Covariance of a twist fit: errors of the tags, scaled by the residuals, and of the priors.

/// Fraction by which the tags must reduce the model's prior variance of each entry of the twists.
/// Otherwise the estimate would mostly reflect the model.
constexpr double kLeastGain = 0.75;

/// Factor for a covariance whose scale is estimated from only `freedom` residuals, so that the 95 %
/// ellipsoid of a chi-square with `directions` degrees of freedom contains 95 %: Hotelling's factor
/// from the quantile of F (Abramowitz and Stegun, 26.5.22, to 2 %).
double ellipsoidScale(double directions, double freedom) {
  constexpr double kNormal95 = 1.6449;
  constexpr double kLambda = (kNormal95 * kNormal95 - 3) / 6;
  constexpr double kFewest = 2;  // with fewer, the formula is not accurate
  const double per_direction = 1 / (std::max(directions, kFewest) - 1);
  const auto logOfQuantile = [per_direction](double per_freedom) {
    const double h = 2 / (per_direction + per_freedom);
    return 2 * (kNormal95 * std::sqrt(h + kLambda) / h -
                (per_direction - per_freedom) * (kLambda + 5.0 / 6 - 2 / (3 * h)));
  };
  return std::exp(logOfQuantile(1 / (freedom - 1)) - logOfQuantile(0));
}

/// Whether tags with the expected noise determine every entry of the twists. `covariance` is that
/// of the solution with this noise. Larger noise is detected from the residuals.
bool determined(const TwistEquations& equations,
                const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
  for (int entry = 0; entry < 6 * equations.sections(); ++entry) {
    if (equations.held(entry)) continue;
    const double deviation = equations.modelDeviation(entry);
    const double left = covariance(entry, entry) / (deviation * deviation);
    if (!(left < 1 - kLeastGain)) return false;
  }
  return true;
}

/// Fills in what is known of base and border shift after a fit with this covariance of its
/// parameters.
void reportRig(const TwistEquations& equations, const FitPoint& at,
               const Eigen::Ref<const Eigen::MatrixXd>& covariance, TwistFit& result) {
  const int twists = 6 * equations.sections();
  const bool base = equations.options().free_base,
             border_shift = covariance.cols() > twists + 6 * base;
  // Rows of the parameters in the order of the estimate; a step multiplies X_B0B from the right.
  RigEstimate::Matrix by_step = RigEstimate::Matrix::Identity();
  by_step.topLeftCorner<6, 6>() = lie::SE3::rightJacobianInverse(at.base_offset);
  result.rig = equations.rig();
  RigEstimate::Matrix fitted = RigEstimate::Matrix::Zero();
  const int first = base ? 0 : 6, count = (base ? 6 : 0) + (border_shift ? 1 : 0);
  if (count == 0) return;
  fitted.block(first, first, count, count) = covariance.block(twists, twists, count, count);
  const RigEstimate::Matrix moved = by_step * fitted * by_step.transpose();
  if (base) result.rig.mean.head<6>() = at.base_offset;
  if (border_shift) result.rig.mean[6] = at.border_shift;
  for (int i = first; i < first + count; ++i) {
    result.rig.covariance.row(i).setZero();
    result.rig.covariance.col(i).setZero();
  }
  result.rig.covariance.block(first, first, count, count) = moved.block(first, first, count, count);
}

// Tip of the shape seen from B0 after a step of the twists, followed by the base if it is free.
Eigen::Vector3d tipAfter(const lie::SE3& X_B0B, const model::Shape& shape, bool free_base,
                         const Eigen::Ref<const Eigen::VectorXd>& step) {
  const int sections = shape.sectionCount(), per_section = shape.piecesPerSection();
  lie::SE3 X = X_B0B;
  if (free_base) X = X * lie::SE3::exp(lie::Vector6(step.segment<6>(6 * sections)));
  for (int j = 0; j < sections * per_section; ++j) {
    const int k = j / per_section;
    const lie::Vector6 change = step.segment<6>(6 * k) / per_section;
    X = X * lie::SE3::exp(lie::Vector6(shape.pieces().col(j) + change));
    if (shape.links() && (j + 1) % per_section == 0) X = X * (*shape.links())[k];
  }
  return X.translation;
}

}  // namespace

void TwistEquations::weighTags() {
  worse_.assign(layout_.tags.size(), 0.0);
  double least = std::numeric_limits<double>::infinity();
  const int base_tag = layout_.baseTag();
  for (std::size_t i = 0; i < worse_.size(); ++i) {
    const lie::Vector6& error = layout_.tags[i].error;
    // Variance of a corner along one axis, in the mean over the axes.
    worse_[i] = (error.head<3>().squaredNorm() +
                 layout_.size * layout_.size / 3 * error.tail<3>().squaredNorm()) /
                3;
    if (static_cast<int>(i) != base_tag) least = std::min(least, worse_[i]);
  }
  for (double& variance : worse_) variance = std::sqrt(std::max(0.0, variance - least));
}

void TwistEquations::know(const RigEstimate& rig) {
  rig_ = rig;
  both_information_ = inverseOf(rig.covariance);
  base_information_.setZero();
  base_information_.topLeftCorner<kBaseParameters, kBaseParameters>() =
      inverseOf(rig.covariance.topLeftCorner<kBaseParameters, kBaseParameters>());
}

double TwistEquations::addPriors(const FitPoint& point, bool fits_border_shift,
                                 Eigen::Ref<Eigen::VectorXd> gradient,
                                 Eigen::Ref<Eigen::MatrixXd> hessian) const {
  double cost = 0;
  for (int entry = 0; entry < 6 * sections_; ++entry) {
    const double precision = 1 / modelDeviation(entry);
    const double residual =
        held(entry) ? 0 : precision * (point.twists.data()[entry] - prior_.data()[entry]);
    cost += residual * residual;
    hessian(entry, entry) += precision * precision;
    gradient[entry] += precision * residual;
  }
  if (options_.free_base) {
    // The prior is of log X_B0B; a step multiplies X_B0B from the right.
    const RigEstimate::Matrix& information =
        fits_border_shift ? both_information_ : base_information_;
    RigEstimate::Vector residual = -rig_.mean;
    residual.head<kBaseParameters>() += point.base_offset;
    residual[kBaseParameters] =
        fits_border_shift ? residual[kBaseParameters] + point.border_shift : 0.0;
    RigEstimate::Matrix rows = RigEstimate::Matrix::Identity();
    rows.topLeftCorner<kBaseParameters, kBaseParameters>() =
        lie::SE3::rightJacobianInverse(point.base_offset);
    const RigEstimate::Vector weighted = information * residual;
    cost += residual.dot(weighted);
    const RigEstimate::Matrix by_base = rows.transpose() * information * rows;
    const RigEstimate::Vector pull = rows.transpose() * weighted;
    const int count = kBaseParameters + (fits_border_shift ? 1 : 0), first = baseColumn();
    for (int i = 0; i < count; ++i) {
      gradient[first + i] += pull[i];
      for (int k = 0; k < count; ++k) hessian(first + i, first + k) += by_base(i, k);
    }
  } else if (fits_border_shift) {
    const int b = borderShiftColumn();
    const double information = 1 / rig_.covariance(kBaseParameters, kBaseParameters);
    const double residual = point.border_shift - rig_.mean[kBaseParameters];
    cost += information * residual * residual;
    hessian(b, b) += information;
    gradient[b] += information * residual;
  }
  return cost;
}

void reportStatistics(const TwistEquations& equations, const FitPoint& at,
                      const Eigen::Ref<const Eigen::MatrixXd>& hessian,
                      const Eigen::Ref<const Eigen::MatrixXd>& priors, TwistFit& result) {
  const int fitting = markOutliers(at, equations.threshold(), result);
  const Parameters inverse = inverseOf(hessian);
  // Errors of the tags and of the priors, each propagated to the solution.
  const Parameters from_priors = inverse.lazyProduct(priors);
  const Parameters by_priors = from_priors.lazyProduct(inverse);
  const double data_parameters = static_cast<double>(hessian.cols()) - from_priors.trace();
  const ResidualNoise noise = noiseOf(result, at, data_parameters);
  const Parameters by_tags = noise.variance * (inverse - by_priors);
  const Parameters all = by_tags + by_priors;

  reportRig(equations, at, inverse, result);

  // For the twists alone. A part of a covariance is a share of it in each direction, which the
  // trace of its product with the inverse adds up.
  const int twists = 6 * equations.sections();
  const Parameters twists_all = all.topLeftCorner(twists, twists);
  const Parameters twists_by_tags = by_tags.topLeftCorner(twists, twists);
  result.covariance = twists_all;
  if (2 * fitting <= static_cast<int>(result.tags.size())) {
    result.status = FitStatus::kUnexplained;
  } else if (result.status == FitStatus::kConverged && !determined(equations, inverse)) {
    result.status = FitStatus::kUnderdetermined;
  }
  const double scale =
      ellipsoidScale(inverseOf(twists_all).cwiseProduct(twists_by_tags).sum(), noise.freedom);
  result.covariance += (scale - 1) * twists_by_tags;
  for (int entry = 0; entry < twists; ++entry) {
    if (!equations.held(entry)) continue;
    result.covariance.row(entry).setZero();
    result.covariance.col(entry).setZero();
  }
  const auto tipOf = [&](const Parameters& covariance) {
    return tipCovarianceOf(at.X_B0B, at.shape, equations.options().free_base, covariance);
  };
  result.tip_covariance = tipOf(all);
  const Eigen::Matrix3d tip_by_tags = tipOf(by_tags);
  const double tip_scale = ellipsoidScale(
      result.tip_covariance.inverse().cwiseProduct(tip_by_tags).sum(), noise.freedom);
  result.tip_covariance += (tip_scale - 1) * tip_by_tags;
  result.tip_covariance += tipCurvatureOf(at.X_B0B, at.shape, equations.options().free_base, all);
}

Eigen::Matrix3d tipCovarianceOf(const lie::SE3& X_B0B, const model::Shape& shape, bool free_base,
                                const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
  const int sections = shape.sectionCount(), per_section = shape.piecesPerSection();
  TagRows<3> rows;
  rows.by_v.setIdentity();
  rows.by_w = -lie::skew((X_B0B * model::tipPose(shape)).translation);
  const int size = static_cast<int>(covariance.rows());
  Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, kMaxParameters> J(3, size);
  J.setZero();
  lie::SE3 X_B0j = X_B0B;
  for (int k = 0; k < sections; ++k) {
    PointJacobian jacobian;
    for (int j = k * per_section; j < (k + 1) * per_section; ++j) {
      jacobian += PointJacobian(X_B0j, shape.pieces().col(j), 1.0);
      X_B0j = shape.beyond(X_B0j, j);
    }
    jacobian *= 1.0 / per_section;
    jacobian.fill(rows, 6 * k, J);
  }
  if (free_base) PointJacobian(X_B0B).fill(rows, 6 * sections, J);
  Eigen::Matrix3d out = Eigen::Matrix3d::Zero();
  for (int column = 0; column < size; ++column) {
    const Eigen::Vector3d moved = J.lazyProduct(covariance.col(column));
    out.noalias() += moved * J.col(column).transpose();
  }
  return out;
}

Eigen::Matrix3d tipCurvatureOf(const lie::SE3& X_B0B, const model::Shape& shape, bool free_base,
                               const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
  const Eigen::SelfAdjointEigenSolver<NormalEquations::Matrix> principal(covariance);
  const Eigen::Vector3d tip = (X_B0B * model::tipPose(shape)).translation;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  for (int i = 0; i < static_cast<int>(covariance.cols()); ++i) {
    const NormalEquations::Vector step =
        std::sqrt(std::max(0.0, principal.eigenvalues()[i])) * principal.eigenvectors().col(i);
    const NormalEquations::Vector back = -step;  // a Ref of an expression would be on the heap
    const Eigen::Vector3d even =
        0.5 * (tipAfter(X_B0B, shape, free_base, step) + tipAfter(X_B0B, shape, free_base, back)) -
        tip;
    sum += even;
    squares += even * even.transpose();
  }
  return sum * sum.transpose() + 2.0 * squares;
}

Eigen::Matrix3d tipCovariance(const model::Shape& shape, const Eigen::MatrixXd& covariance) {
  return tipCovarianceOf({}, shape, false, covariance);
}

}  // namespace helix_arm::estimation
