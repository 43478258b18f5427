#include "helix_arm/localization/twist_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"
#include "twist_equations.hpp"

namespace helix_arm::estimation {
namespace {

// If the median error exceeds the expected error by more than this factor, the expected error is
// raised in proportion, up to a limit: larger errors are outliers, however many there are.
constexpr double kNoisy = 1.5;
constexpr double kMostNoise = 7.0;
// Minimum degrees of freedom; missing ones are filled with residuals of the expected size.
constexpr double kLeastFreedom = 4.0;
// Lower bound of the estimated variance, relative to the expected one.
constexpr double kLeastVariance = 0.01;

// Marks tags whose squares exceed a limit as outliers, and sets the RMS of the others. The squares
// are of the tags' residuals, in expected variances.
// @return the number of the others.
int markOutliers(const std::vector<double>& squares, double limit, TwistFit& fit) {
  double square = 0;
  int fitting = 0;
  for (std::size_t i = 0; i < fit.tags.size(); ++i) {
    TagResidual& tag = fit.tags[i];
    tag.outlier = squares[i] > limit;
    if (tag.outlier) continue;
    square += tag.rms * tag.rms;
    ++fitting;
  }
  fit.rms = fitting > 0 ? std::sqrt(square / fitting) : 0;
  return fitting;
}

// Factor by which the expected errors of tags must grow; empty if the errors are about as large as
// expected. The factor is limited: tags with much larger errors are wrong, however many they are.
// @param residuals  number per tag. @param errors  workspace.
std::optional<double> noiseScaleOf(const std::vector<double>& squares, double residuals,
                                   std::vector<double>& errors) {
  errors.clear();
  for (const double square : squares) errors.push_back(std::sqrt(square / residuals));
  const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  if (*middle < kNoisy) return std::nullopt;
  return std::min(*middle / kNoisy, kMostNoise);
}

// Noise estimated from the residuals.
struct ResidualNoise {
  double variance;  // in expected variances
  double freedom;   // number of residuals in excess of the fitted parameters
};

// Noise of normally distributed errors under a robust loss (Huber, Robust Statistics, 7.6): the
// weighted squares divided by the slopes of the equations, since larger errors have less weight.
// @param residuals  number per tag. @param data_parameters  how many the tags determine.
ResidualNoise noiseOf(const TwistFit& fit, const std::vector<double>& squares, double residuals,
                      double data_parameters) {
  double weights = 0, weights2 = 0, weighted = 0, slopes = 0, slopes2 = 0;
  for (std::size_t i = 0; i < fit.tags.size(); ++i) {
    const double weight = fit.tags[i].weight;
    const double radial = weight * (2 * weight - 1);  // across it, the slope is the weight
    weights += weight;
    weights2 += weight * weight;
    weighted += weight * weight * squares[i];
    slopes += (residuals - 1) * weight + radial;
    slopes2 += (residuals - 1) * weight * weight + radial * radial;
  }
  const double all = residuals * static_cast<double>(fit.tags.size());
  // Tags of weight 0 do not count.
  const double count = residuals * weights * weights / weights2;
  const double freedom = std::max(0.0, count - data_parameters);
  const double spread = all * slopes2 / (slopes * slopes) - 1;
  const double correction = 1 + data_parameters / all * spread;
  const double square =
      correction * correction * weighted * count * residuals * weights / (slopes * slopes);
  const double expected = std::max(0.0, kLeastFreedom - freedom);
  return {std::max(kLeastVariance, (expected + square) / (expected + freedom)), expected + freedom};
}

// Covariance of a twist fit: errors of the tags, scaled by the residuals, and of the priors.

/// Fraction by which the tags must reduce the model's prior variance of each entry of the twists.
/// Otherwise the estimate would mostly reflect the model.
constexpr double kLeastGain = 0.75;

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
  fitted.block(first, first, count, count) = covariance.block(twists, twists, count, count);
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

// Marquardt's damping, relative to the Hessian's diagonal.
constexpr double kFirstDamping = 1e-6;
constexpr double kLeastDamping = 1e-12;
constexpr double kMaxDamping = 1e8;
constexpr double kDampingFall = 0.1;
constexpr double kDampingRise = 10.0;
// Damping treats a parameter that the tags do not determine as known to a metre or a radian.
constexpr double kLeastInformation = 1.0;
// Converged if the step promises less than this fraction of the expected variance.
constexpr double kConverged = 1e-5;
// A cold search also starts at this angle on each side [rad], with at most kMostColdStarts starts.
constexpr double kColdTurn = 1.5;
constexpr int kMostColdStarts = 48;

constexpr char kCulprit[] = "twist fit";

void require(bool holds, const char* what, double value, const char* rule) {
  basics::requireValue(holds, kCulprit, what, value, rule);
}

}  // namespace

struct TwistFitter::Workspace {
  TwistEquations equations;
  FitPoint at, next;
  std::vector<double> errors;  // of the tags, relative to the expected error
  TwistFit result, best;
  NormalEquations<Eigen::Dynamic> large, large_next;

  Workspace(TagLayout tags, int section_count, const TwistFitOptions& fit_options)
      : equations(std::move(tags), section_count, fit_options) {
    const std::size_t count = layout().tags.size();
    errors.reserve(count);
    for (FitPoint* point : {&at, &next}) {
      point->residuals.reserve(count);
      point->squares.reserve(count);
    }
    for (TwistFit* fit : {&result, &best}) {
      fit->tags.reserve(count);
      fit->covariance.setZero(6 * sections(), 6 * sections());
    }
  }

  const TagLayout& layout() const { return equations.layout(); }
  int sections() const { return equations.sections(); }
  const TwistFitOptions& options() const { return equations.options(); }

  // Levenberg-Marquardt from `at`; leaves out one visible tag, or none (-1).
  template <class Model, int kSize>
  void search(const Model& model, const std::vector<typename Model::Observation>& seen, int skipped,
              NormalEquations<kSize>& system, NormalEquations<kSize>& trial) {
    result.status = FitStatus::kUnderdetermined;
    result.iterations = 0;
    result.rms = result.cost = 0;
    result.tags.clear();
    const int used = static_cast<int>(seen.size()) - (skipped >= 0 ? 1 : 0);
    if (used * model.residuals() < 6 * sections()) return;
    equations.evaluate(model, seen, skipped, at, system);
    result.status = FitStatus::kNotConverged;
    if (!std::isfinite(at.cost)) return;

    Eigen::LLT<typename NormalEquations<kSize>::Matrix> factors;
    typename NormalEquations<kSize>::Vector step;
    double damping = kFirstDamping;
    while (result.iterations < options().max_iterations && damping < kMaxDamping) {
      ++result.iterations;
      typename NormalEquations<kSize>::Matrix damped = system.hessian;
      damped.diagonal() += damping * system.hessian.diagonal().cwiseMax(kLeastInformation);
      factors.compute(damped);
      step = -factors.solve(system.gradient);
      const double promised = -step.dot(system.gradient);
      if (promised < kConverged) {
        result.status = FitStatus::kConverged;
        break;
      }
      equations.move<Model>(at, step, next);
      equations.evaluate(model, seen, skipped, next, trial);
      if (next.cost < at.cost) {
        std::swap(at, next);
        std::swap(system, trial);
        damping = std::max(damping * kDampingFall, kLeastDamping);
      } else {
        damping = std::max(damping * kDampingRise, kFirstDamping);
      }
    }
    report();
    reportStatistics(model, equations, at, system, trial, result);
  }

  void report() {
    result.twists = at.twists;
    result.shape = at.shape;
    result.X_B0B = at.X_B0B;
    result.bleed = at.bleed;
    result.cost = at.cost;
    result.tags = at.residuals;
  }

  template <class Model>
  void run(const Model& model, const std::vector<typename Model::Observation>& seen, int skipped) {
    switch (equations.parameters<Model>()) {
      case 6:
        return runOf<6>(model, seen, skipped);
      case 7:
        return runOf<7>(model, seen, skipped);
      case 12:
        return runOf<12>(model, seen, skipped);
      case 13:
        return runOf<13>(model, seen, skipped);
      default:
        return search(model, seen, skipped, large, large_next);
    }
  }
  template <int kSize, class Model>
  void runOf(const Model& model, const std::vector<typename Model::Observation>& seen,
             int skipped) {
    NormalEquations<kSize> system, trial;
    search(model, seen, skipped, system, trial);
  }

  void startFrom(const model::Twists& twists) { equations.start(twists, at); }

  void checkShape(const model::Shape& shape, const char* what) const {
    require(shape.sectionCount() == sections(), what, static_cast<double>(shape.sectionCount()),
            "as many as there are sections");
    require(shape.pieces().allFinite(), what, std::nan(""), "finite ones");
  }

  void expect(const model::Shape& model) {
    checkShape(model, "the number of the model's twists");
    equations.expect(model);
  }

  template <class Observation>
  void checkSeen(const std::vector<Observation>& seen) const {
    std::uint64_t before = 0;  // one bit per tag; kMaxTags of them
    for (const Observation& observation : seen) {
      const int tag = observation.tag;
      require(tag >= 0 && tag < static_cast<int>(layout().tags.size()), "the index of a tag", tag,
              "one of the layout");
      const std::uint64_t bit = std::uint64_t{1} << tag;
      require((before & bit) == 0, "a tag that is seen twice", layout().tags[tag].id,
              "each at most once");
      before |= bit;
      require(isFinite(observation), "a tag whose pose is not finite", layout().tags[tag].id,
              "finite numbers");
    }
  }

  // If most tags have larger errors than expected, raises the expected error.
  template <class Model>
  void adaptToNoise(const Model& model, const std::vector<typename Model::Observation>& seen) {
    if (at.squares.size() != seen.size() || seen.empty()) return;
    const std::optional<double> scale = noiseScaleOf(at.squares, model.residuals(), errors);
    if (!scale) return;
    equations.setNoiseScale(*scale);
    run(model, seen, -1);
  }

  template <class Model>
  const TwistFit& fit(const Model& model, const std::vector<typename Model::Observation>& seen,
                      const model::Shape& start, const model::Shape& of_model) {
    checkSeen(seen);
    checkShape(start, "the number of twists to start from");
    expect(of_model);
    startFrom(start.twists());
    run(model, seen, -1);
    adaptToNoise(model, seen);
    return result;
  }

  void keepBetter() {
    const auto ended = [](const TwistFit& fit) {
      return fit.status == FitStatus::kConverged || fit.status == FitStatus::kUnexplained;
    };
    if (ended(result) && (!ended(best) || result.cost < best.cost)) std::swap(best, result);
  }

  template <class Model>
  const TwistFit& fitCold(const Model& model, const std::vector<typename Model::Observation>& seen,
                          const model::Shape& of_model) {
    checkSeen(seen);
    expect(of_model);
    startFrom(equations.prior());
    run(model, seen, -1);
    best = result;
    int starts_left = kMostColdStarts;
    const auto refine = [&](const model::Twists& from, int skipped) {
      if (--starts_left < 0) return;
      startFrom(from);
      run(model, seen, skipped);
      if (skipped >= 0) {
        if (result.status == FitStatus::kNotConverged || result.tags.empty()) return;
        startFrom(result.twists);
        run(model, seen, -1);
      }
      keepBetter();
    };
    for (int k = 0; k < sections(); ++k) {
      for (int axis = 3; axis < 6; ++axis) {
        for (const double turn : {-kColdTurn, kColdTurn}) {
          model::Twists from = equations.prior();
          from(axis, k) += turn;
          if (!equations.held(axis)) refine(from, -1);
        }
      }
    }
    for (int i = 0; i < static_cast<int>(seen.size()); ++i) refine(equations.prior(), i);
    // Repeats the best one, so that the workspace holds its result.
    if (!best.tags.empty()) {
      startFrom(best.twists);
      at.X_B0B = best.X_B0B;
      at.base_offset = at.X_B0B.log();
      at.bleed = best.bleed;
      run(model, seen, -1);
      adaptToNoise(model, seen);
    }
    return result;
  }
};

TwistFitter::TwistFitter(TagLayout layout, int sections, const TwistFitOptions& options) {
  require(sections >= 1 && sections <= model::kMaxSections, "the number of sections", sections,
          "1 to 16");
  layout.validate(sections);
  options.validate();
  work_ = std::make_unique<Workspace>(std::move(layout), sections, options);
}
TwistFitter::~TwistFitter() = default;
TwistFitter::TwistFitter(TwistFitter&&) noexcept = default;
TwistFitter& TwistFitter::operator=(TwistFitter&&) noexcept = default;

const TagLayout& TwistFitter::layout() const { return work_->layout(); }
const TwistFitOptions& TwistFitter::options() const { return work_->options(); }

void TwistFitter::know(const RigEstimate& rig) {
  const bool finite = rig.mean.allFinite() && rig.covariance.allFinite();
  basics::require(
      finite && Eigen::LLT<RigEstimate::Matrix>(rig.covariance).info() == Eigen::Success, kCulprit,
      ": what is known of base and bleed is no estimate; expected finite numbers and a covariance "
      "that is positive definite");
  work_->equations.know(rig);
}

const TwistFit& TwistFitter::fit(const std::vector<CornerObservation>& seen, const lie::SE3& X_CB,
                                 double focal, const model::Shape& start,
                                 const model::Shape& model) {
  basics::requirePositive(kCulprit, "the focal length [px]", focal);
  return work_->fit(CornerModel{X_CB, focal / work_->options().corner_noise, work_->options()},
                    seen, start, model);
}

const TwistFit& TwistFitter::fit(const std::vector<PoseObservation>& seen,
                                 const model::Shape& start, const model::Shape& model) {
  return work_->fit(PoseModel{work_->options()}, seen, start, model);
}

const TwistFit& TwistFitter::fitCold(const std::vector<CornerObservation>& seen,
                                     const lie::SE3& X_CB, double focal,
                                     const model::Shape& model) {
  basics::requirePositive(kCulprit, "the focal length [px]", focal);
  return work_->fitCold(CornerModel{X_CB, focal / work_->options().corner_noise, work_->options()},
                        seen, model);
}

const TwistFit& TwistFitter::fitCold(const std::vector<PoseObservation>& seen,
                                     const model::Shape& model) {
  return work_->fitCold(PoseModel{work_->options()}, seen, model);
}

void TwistFitOptions::validate() const {
  basics::requirePositive(kCulprit, {{"the noise of corners [px]", corner_noise},
                                     {"the noise of tag positions [m]", position_noise}});
  basics::requireNotNegative(kCulprit, "the noise of tag rotations [rad]", rotation_noise);
  basics::requirePositive(kCulprit,
                          {{"the robust scale", robust_scale},
                           {"the model's prior of v [m]", model_prior.translation},
                           {"the model's prior of w [rad]", model_prior.rotation},
                           {"the prior of the base's position [m]", base_prior.translation},
                           {"the prior of the base's rotation [rad]", base_prior.rotation},
                           {"the prior of the bleed [m]", bleed_prior}});
  require(max_iterations >= 1, "the number of iterations", max_iterations, "at least 1");
}

RigEstimate::RigEstimate(const TwistFitOptions& options) {
  Vector deviation;
  deviation << Eigen::Vector3d::Constant(options.base_prior.translation),
      Eigen::Vector3d::Constant(options.base_prior.rotation), options.bleed_prior;
  covariance = deviation.cwiseAbs2().asDiagonal();
}

const char* nameOf(FitStatus status) {
  static constexpr std::array<const char*, 4> kNames = {"converged", "not_converged",
                                                        "underdetermined", "unexplained"};
  return kNames[static_cast<std::size_t>(status)];
}

int TwistFit::outliers() const {
  return static_cast<int>(
      std::count_if(tags.begin(), tags.end(), [](const TagResidual& tag) { return tag.outlier; }));
}

Eigen::Matrix3d tipCovariance(const model::Shape& shape, const Eigen::MatrixXd& covariance) {
  return tipCovarianceOf({}, shape, false, covariance);
}

}  // namespace helix_arm::estimation
