#include "helix_arm/estimation/twist_fit.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"
#include "twist_equations.hpp"

namespace helix_arm::estimation {
namespace {

// Marquardt's damping, relative to the Hessian's diagonal.
constexpr double kFirstDamping = 1e-6;
constexpr double kLeastDamping = 1e-12;
constexpr double kMaxDamping = 1e8;
constexpr double kDampingFall = 0.1;
constexpr double kDampingRise = 10.0;
// Damping takes a parameter that the tags say nothing of as known to a metre or a radian.
constexpr double kLeastInformation = 1.0;
// Steps that promise less than this part of an expected variance are not worth taking.
constexpr double kConverged = 1e-5;
// The tags must take this share of the model's prior variance from each entry of the twists, or
// what they are said to measure would be the model.
constexpr double kLeastGain = 0.75;
// Errors whose median is this many of the expected ones raise what is expected of them, in
// proportion and up to a limit: tags that are off by more are wrong, however many they are.
constexpr double kNoisy = 1.5;
constexpr double kMostNoise = 7.0;
// Where fewer residuals than this are left over, ones as large as expected make up for them.
constexpr double kLeastFreedom = 4.0;
// No readings are taken for better than this share of their expected errors' variance.
constexpr double kLeastVariance = 0.01;
// A cold search also starts this far to each side [rad], but at no more places than these.
constexpr double kColdTurn = 1.5;
constexpr int kMostColdStarts = 48;

void require(bool holds, const char* what, double value, const char* rule) {
  basics::requireValue(holds, "twist fit", what, value, rule);
}

// What the residuals say of the noise: its variance, in expected ones, and from how many residuals
// beyond those that the parameters take.
struct ResidualNoise {
  double variance, freedom;
};

// Share of a part of a covariance in the whole, summed over its directions.
template <class Matrix>
double sumOfShares(const Matrix& part, const Matrix& whole) {
  Matrix quotient = part;
  Eigen::LLT<Matrix>(whole).solveInPlace(quotient);
  return quotient.trace();
}

// By how much a covariance whose scale is known from `freedom` residuals only must grow, so that
// the ellipsoid of 95 % of a chi-square of as many directions does hold 95 %: Hotelling's factor by
// the quantile of F (Abramowitz and Stegun, 26.5.22, to 2 %).
double ellipsoidScale(double directions, double freedom) {
  constexpr double kNormal95 = 1.6449;
  constexpr double kLambda = (kNormal95 * kNormal95 - 3) / 6;
  constexpr double kFewest = 2;  // with less the formula is no longer good
  const double per_direction = 1 / (std::max(directions, kFewest) - 1);
  const auto logOfQuantile = [per_direction](double per_freedom) {
    const double h = 2 / (per_direction + per_freedom);
    return 2 * (kNormal95 * std::sqrt(h + kLambda) / h -
                (per_direction - per_freedom) * (kLambda + 5.0 / 6 - 2 / (3 * h)));
  };
  return std::exp(logOfQuantile(1 / (freedom - 1)) - logOfQuantile(0));
}

// Covariance of the tip's position seen from B0, from that of the twists and, behind them, the
// base.
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
      X_B0j = X_B0j * lie::SE3::exp(shape.pieces().col(j));
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

}  // namespace

struct TwistFitter::Workspace {
  TwistEquations equations;
  FitPoint at, next;
  std::vector<double> errors;  // of the tags, in expected ones
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

  // Levenberg and Marquardt from `at`; leaves out one of the tags seen, or none (-1).
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
    reportStatistics(model, system, trial);
  }

  void report() {
    result.twists = at.twists;
    result.shape = at.shape;
    result.X_B0B = at.X_B0B;
    result.bleed = at.bleed;
    result.cost = at.cost;
    result.tags = at.residuals;
  }

  // Tags that do not fit, and the RMS of the others; returns how many those are.
  int reportTags(double limit) {
    double square = 0;
    int fitting = 0;
    for (std::size_t i = 0; i < result.tags.size(); ++i) {
      TagResidual& tag = result.tags[i];
      tag.outlier = at.squares[i] > limit;
      if (tag.outlier) continue;
      square += tag.rms * tag.rms;
      ++fitting;
    }
    result.rms = fitting > 0 ? std::sqrt(square / fitting) : 0;
    return fitting;
  }

  // Of errors of normal distribution under a loss that weighs them (Huber, Robust Statistics, 7.6):
  // the squares that count over the slopes of the equations, by which larger errors count less.
  ResidualNoise noiseOf(double residuals, double data_parameters) const {
    double weights = 0, weights2 = 0, squares = 0, slopes = 0, slopes2 = 0;
    for (std::size_t i = 0; i < result.tags.size(); ++i) {
      const double weight = result.tags[i].weight;
      const double radial = weight * (2 * weight - 1);  // across it the slope is the weight
      weights += weight;
      weights2 += weight * weight;
      squares += weight * weight * at.squares[i];
      slopes += (residuals - 1) * weight + radial;
      slopes2 += (residuals - 1) * weight * weight + radial * radial;
    }
    const double all = residuals * static_cast<double>(result.tags.size());
    // Tags without weight are none.
    const double count = residuals * weights * weights / weights2;
    const double freedom = std::max(0.0, count - data_parameters);
    const double spread = all * slopes2 / (slopes * slopes) - 1;
    const double correction = 1 + data_parameters / all * spread;
    const double square =
        correction * correction * squares * count * residuals * weights / (slopes * slopes);
    const double expected = std::max(0.0, kLeastFreedom - freedom);
    return {std::max(kLeastVariance, (expected + square) / (expected + freedom)),
            expected + freedom};
  }

  template <class Model, int kSize>
  void reportStatistics(const Model& model, const NormalEquations<kSize>& system,
                        NormalEquations<kSize>& priors) {
    using Matrix = typename NormalEquations<kSize>::Matrix;
    const int fitting = reportTags(equations.threshold(model));
    const auto size = system.gradient.size();
    priors.gradient.setZero(size);
    priors.hessian.setZero(size, size);
    equations.addPriors<Model>(at, priors);
    Matrix inverse = Matrix::Identity(size, size);
    Eigen::LLT<Matrix>(system.hessian).solveInPlace(inverse);
    // Errors of the tags and of the priors, by how much each moves the answer.
    Matrix from_priors, by_priors;
    from_priors.noalias() = inverse.lazyProduct(priors.hessian);
    by_priors.noalias() = from_priors.lazyProduct(inverse);
    const double data_parameters = static_cast<double>(size) - from_priors.trace();
    const ResidualNoise noise = noiseOf(model.residuals(), data_parameters);
    const Matrix by_tags = noise.variance * (inverse - by_priors);
    const Matrix all = by_tags + by_priors;

    // Of the twists alone.
    using Part = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor,
                               NormalEquations<kSize>::kMax, NormalEquations<kSize>::kMax>;
    const int twists = 6 * sections();
    const Part twists_all = all.topLeftCorner(twists, twists);
    const Part twists_by_tags = by_tags.topLeftCorner(twists, twists);
    result.covariance = twists_all;
    if (2 * fitting <= static_cast<int>(result.tags.size())) {
      result.status = FitStatus::kUnexplained;
    } else if (result.status == FitStatus::kConverged && !determined(inverse)) {
      result.status = FitStatus::kUnderdetermined;
    }
    const double scale = ellipsoidScale(sumOfShares(twists_by_tags, twists_all), noise.freedom);
    result.covariance += (scale - 1) * twists_by_tags;
    for (int entry = 0; entry < twists; ++entry) {
      if (!equations.held(entry)) continue;
      result.covariance.row(entry).setZero();
      result.covariance.col(entry).setZero();
    }
    const auto tipOf = [this](const Matrix& covariance) {
      return tipCovarianceOf(at.X_B0B, at.shape, options().free_base, covariance);
    };
    result.tip_covariance = tipOf(all);
    const Eigen::Matrix3d tip_by_tags = tipOf(by_tags);
    const double tip_scale =
        ellipsoidScale(sumOfShares(tip_by_tags, result.tip_covariance), noise.freedom);
    result.tip_covariance += (tip_scale - 1) * tip_by_tags;
  }

  // Whether the tags, if they are as good as expected, say something about every entry of the
  // twists: `covariance` is that of the answer then. Tags that are worse are for residuals to tell.
  template <class Matrix>
  bool determined(const Matrix& covariance) const {
    for (int entry = 0; entry < 6 * sections(); ++entry) {
      if (equations.held(entry)) continue;
      const double deviation = equations.modelDeviation(entry);
      const double left = covariance(entry, entry) / (deviation * deviation);
      if (!(left < 1 - kLeastGain)) return false;
    }
    return true;
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
    std::uint64_t before = 0;  // a bit a tag; kMaxTags of them
    for (const Observation& observation : seen) {
      const int tag = observation.tag;
      require(tag >= 0 && tag < static_cast<int>(layout().tags.size()), "the index of a tag", tag,
              "one of the layout");
      const std::uint64_t bit = std::uint64_t{1} << tag;
      require((before & bit) == 0, "a tag that is seen twice", layout().tags[tag].id,
              "each at most once");
      before |= bit;
      require(isFinite(observation), "a tag whose place is not finite", layout().tags[tag].id,
              "finite numbers");
    }
  }

  // Where most tags are farther off than expected, takes that for what is to be expected.
  template <class Model>
  void adaptToNoise(const Model& model, const std::vector<typename Model::Observation>& seen) {
    if (at.squares.size() != seen.size() || seen.empty()) return;
    errors.clear();
    for (const double square : at.squares) errors.push_back(std::sqrt(square / model.residuals()));
    const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
    std::nth_element(errors.begin(), middle, errors.end());
    if (*middle < kNoisy) return;
    equations.setNoiseScale(std::min(*middle / kNoisy, kMostNoise));
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
    // The best once more, so that the work space is where it ended.
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

const TwistFit& TwistFitter::fit(const std::vector<CornerObservation>& seen, const lie::SE3& X_CB,
                                 double focal, const model::Shape& start,
                                 const model::Shape& model) {
  require(std::isfinite(focal) && focal > 0, "the focal length [px]", focal, "a finite value > 0");
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
  require(std::isfinite(focal) && focal > 0, "the focal length [px]", focal, "a finite value > 0");
  return work_->fitCold(CornerModel{X_CB, focal / work_->options().corner_noise, work_->options()},
                        seen, model);
}

const TwistFit& TwistFitter::fitCold(const std::vector<PoseObservation>& seen,
                                     const model::Shape& model) {
  return work_->fitCold(PoseModel{work_->options()}, seen, model);
}

void TwistFitOptions::validate() const {
  const auto positive = [](const char* what, double value) {
    require(std::isfinite(value) && value > 0, what, value, "a finite value > 0");
  };
  positive("the noise of corners [px]", corner_noise);
  positive("the noise of tag positions [m]", position_noise);
  require(std::isfinite(rotation_noise) && rotation_noise >= 0, "the noise of tag rotations [rad]",
          rotation_noise, "a finite value >= 0");
  positive("the robust scale", robust_scale);
  positive("the model's prior of v [m]", model_prior.translation);
  positive("the model's prior of w [rad]", model_prior.rotation);
  positive("the prior of the base's place [m]", base_prior.translation);
  positive("the prior of the base's rotation [rad]", base_prior.rotation);
  positive("the prior of the bleed [m]", bleed_prior);
  require(max_iterations >= 1, "the number of iterations", max_iterations, "at least 1");
}

const char* nameOf(FitStatus status) {
  switch (status) {
    case FitStatus::kConverged:
      return "converged";
    case FitStatus::kNotConverged:
      return "not_converged";
    case FitStatus::kUnderdetermined:
      return "underdetermined";
    case FitStatus::kUnexplained:
      return "unexplained";
  }
  return "";
}

int TwistFit::outliers() const {
  return static_cast<int>(
      std::count_if(tags.begin(), tags.end(), [](const TagResidual& tag) { return tag.outlier; }));
}

Eigen::Matrix3d tipCovariance(const model::Shape& shape, const Eigen::MatrixXd& covariance) {
  return tipCovarianceOf({}, shape, false, covariance);
}

}  // namespace helix_arm::estimation
