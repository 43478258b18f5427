#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "fit_noise.hpp"
#include "helix_arm/model/curve.hpp"
#include "twist_equations.hpp"

/// Covariance of a twist fit. It combines the errors of the tags, scaled by the residuals, with
/// those of the priors.
namespace helix_arm::estimation {

/// Fraction by which the tags must reduce the model's prior variance of each entry of the twists.
/// Otherwise the estimate would mostly reflect the model.
inline constexpr double kLeastGain = 0.75;

/// Fraction of a covariance due to one part of it, summed over its directions.
template <class Matrix>
double sumOfShares(const Matrix& part, const Matrix& whole) {
  Matrix quotient = part;
  Eigen::LLT<Matrix>(whole).solveInPlace(quotient);
  return quotient.trace();
}

/// Factor for a covariance whose scale is estimated from only `freedom` residuals, so that the 95 %
/// ellipsoid of a chi-square with `directions` degrees of freedom contains 95 %: Hotelling's factor
/// from the quantile of F (Abramowitz and Stegun, 26.5.22, to 2 %).
double ellipsoidScale(double directions, double freedom);

/// Covariance of the tip's position seen from B0, due to that of the twists followed by the base.
template <class Matrix>
Eigen::Matrix3d tipCovarianceOf(const lie::SE3& X_B0B, const model::Shape& shape, bool free_base,
                                const Matrix& covariance) {
  const int sections = shape.sectionCount(), per_section = shape.piecesPerSection();
  TagRows<3> rows;
  rows.by_v.setIdentity();
  rows.by_w = -lie::skew((X_B0B * model::tipPose(shape)).translation);
  const int size = static_cast<int>(covariance.rows());
  Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, kMaxParameters> J(3, size);
  J.setZero();
  lie::SE3 X_B0j = X_B0B;
  for (int k = 0; k < sections; ++k) {
    Mover mover = Mover::none();
    for (int j = k * per_section; j < (k + 1) * per_section; ++j) {
      mover += Mover(X_B0j, shape.pieces().col(j), 1.0);
      X_B0j = shape.beyond(X_B0j, j);
    }
    mover *= 1.0 / per_section;
    mover.fill(rows, 6 * k, J);
  }
  if (free_base) Mover(X_B0B).fill(rows, 6 * sections, J);
  Eigen::Matrix3d out = Eigen::Matrix3d::Zero();
  for (int column = 0; column < size; ++column) {
    const Eigen::Vector3d moved = J.lazyProduct(covariance.col(column));
    out.noalias() += moved * J.col(column).transpose();
  }
  return out;
}

/// Tip of the shape seen from B0 after a step of the twists, followed by the base if it is free.
template <class Vector>
Eigen::Vector3d tipAfter(const lie::SE3& X_B0B, const model::Shape& shape, bool free_base,
                         const Vector& step) {
  const int sections = shape.sectionCount(), per_section = shape.piecesPerSection();
  lie::SE3 X = X_B0B;
  if (free_base) X = X * lie::SE3::exp(lie::Vector6(step.template segment<6>(6 * sections)));
  for (int j = 0; j < sections * per_section; ++j) {
    const int k = j / per_section;
    const lie::Vector6 change = step.template segment<6>(6 * k) / per_section;
    X = X * lie::SE3::exp(lie::Vector6(shape.pieces().col(j) + change));
    if (shape.links() && (j + 1) % per_section == 0) X = X * (*shape.links())[k];
  }
  return X.translation;
}

/// Second moment of what the tip's path adds to its linear motion, where it bends within the errors
/// of the twists and the base: with the even part q_i of its motion along each principal direction
/// of the covariance, E[(sum q_i z_i^2)(sum q_i z_i^2)'] for independent standard normal z_i.
template <class Matrix>
Eigen::Matrix3d tipCurvatureOf(const lie::SE3& X_B0B, const model::Shape& shape, bool free_base,
                               const Matrix& covariance) {
  const Eigen::SelfAdjointEigenSolver<Matrix> principal(covariance);
  const Eigen::Vector3d tip = (X_B0B * model::tipPose(shape)).translation;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  for (int i = 0; i < static_cast<int>(covariance.cols()); ++i) {
    const auto step =
        (std::sqrt(std::max(0.0, principal.eigenvalues()[i])) * principal.eigenvectors().col(i))
            .eval();
    const Eigen::Vector3d even = 0.5 * (tipAfter(X_B0B, shape, free_base, step) +
                                        tipAfter(X_B0B, shape, free_base, (-step).eval())) -
                                 tip;
    sum += even;
    squares += even * even.transpose();
  }
  return sum * sum.transpose() + 2.0 * squares;
}

/// Whether tags with the expected noise determine every entry of the twists. `covariance` is that
/// of the solution with this noise. Larger noise is detected from the residuals.
template <class Matrix>
bool determined(const TwistEquations& equations, const Matrix& covariance) {
  for (int entry = 0; entry < 6 * equations.sections(); ++entry) {
    if (equations.held(entry)) continue;
    const double deviation = equations.modelDeviation(entry);
    const double left = covariance(entry, entry) / (deviation * deviation);
    if (!(left < 1 - kLeastGain)) return false;
  }
  return true;
}

/// Fills in what is known of base and bleed after a fit with this covariance of its parameters.
template <class Matrix>
void reportRig(const TwistEquations& equations, const FitPoint& at, const Matrix& covariance,
               TwistFit& result) {
  const int twists = 6 * equations.sections();
  const bool base = equations.options().free_base, bleed = covariance.cols() > twists + 6 * base;
  // Rows of the parameters in the order of the estimate; a step multiplies X_B0B from the right.
  RigEstimate::Matrix by_step = RigEstimate::Matrix::Identity();
  by_step.topLeftCorner<6, 6>() = lie::SE3::rightJacobianInverse(at.base_offset);
  result.rig = equations.rig();
  RigEstimate::Matrix fitted = RigEstimate::Matrix::Zero();
  const int first = base ? 0 : 6, count = (base ? 6 : 0) + (bleed ? 1 : 0);
  if (count == 0) return;
  for (int i = 0; i < count; ++i) {
    for (int k = 0; k < count; ++k) {
      fitted(first + i, first + k) = covariance(twists + i, twists + k);
    }
  }
  const RigEstimate::Matrix moved = by_step * fitted * by_step.transpose();
  if (base) result.rig.mean.head<6>() = at.base_offset;
  if (bleed) result.rig.mean[6] = at.bleed;
  for (int i = first; i < first + count; ++i) {
    result.rig.covariance.row(i).setZero();
    result.rig.covariance.col(i).setZero();
  }
  result.rig.covariance.block(first, first, count, count) = moved.block(first, first, count, count);
}

/// Fills in the results that follow from the equations at the end of a search: outliers, RMS,
/// covariances, and the status if the tags do not explain or determine the twists.
///
/// @param at      end of the search. @param system  normal equations there.
/// @param priors  workspace.
template <class Model, int kSize>
void reportStatistics(const Model& model, const TwistEquations& equations, const FitPoint& at,
                      const NormalEquations<kSize>& system, NormalEquations<kSize>& priors,
                      TwistFit& result) {
  using Matrix = typename NormalEquations<kSize>::Matrix;
  const int fitting = markOutliers(at.squares, equations.threshold(model), result);
  const auto size = system.gradient.size();
  priors.gradient.setZero(size);
  priors.hessian.setZero(size, size);
  equations.addPriors<Model>(at, priors);
  Matrix inverse = Matrix::Identity(size, size);
  Eigen::LLT<Matrix>(system.hessian).solveInPlace(inverse);
  // Errors of the tags and of the priors, each propagated to the solution.
  Matrix from_priors, by_priors;
  from_priors.noalias() = inverse.lazyProduct(priors.hessian);
  by_priors.noalias() = from_priors.lazyProduct(inverse);
  const double data_parameters = static_cast<double>(size) - from_priors.trace();
  const ResidualNoise noise = noiseOf(result, at.squares, model.residuals(), data_parameters);
  const Matrix by_tags = noise.variance * (inverse - by_priors);
  const Matrix all = by_tags + by_priors;

  reportRig(equations, at, inverse, result);

  // For the twists alone.
  using Part = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor,
                             NormalEquations<kSize>::kMax, NormalEquations<kSize>::kMax>;
  const int twists = 6 * equations.sections();
  const Part twists_all = all.topLeftCorner(twists, twists);
  const Part twists_by_tags = by_tags.topLeftCorner(twists, twists);
  result.covariance = twists_all;
  if (2 * fitting <= static_cast<int>(result.tags.size())) {
    result.status = FitStatus::kUnexplained;
  } else if (result.status == FitStatus::kConverged && !determined(equations, inverse)) {
    result.status = FitStatus::kUnderdetermined;
  }
  const double scale = ellipsoidScale(sumOfShares(twists_by_tags, twists_all), noise.freedom);
  result.covariance += (scale - 1) * twists_by_tags;
  for (int entry = 0; entry < twists; ++entry) {
    if (!equations.held(entry)) continue;
    result.covariance.row(entry).setZero();
    result.covariance.col(entry).setZero();
  }
  const auto tipOf = [&](const Matrix& covariance) {
    return tipCovarianceOf(at.X_B0B, at.shape, equations.options().free_base, covariance);
  };
  result.tip_covariance = tipOf(all);
  const Eigen::Matrix3d tip_by_tags = tipOf(by_tags);
  const double tip_scale =
      ellipsoidScale(sumOfShares(tip_by_tags, result.tip_covariance), noise.freedom);
  result.tip_covariance += (tip_scale - 1) * tip_by_tags;
  result.tip_covariance += tipCurvatureOf(at.X_B0B, at.shape, equations.options().free_base, all);
}

}  // namespace helix_arm::estimation
