#include "helix_arm/localization/twist_fit.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"
#include "twist_equations.hpp"

namespace helix_arm::estimation {
namespace {

// If the median error exceeds the expected error by more than this factor, the expected error is
// raised in proportion, up to a limit: larger errors are outliers, however many there are.
constexpr double kNoisy = 1.5;
constexpr double kMostNoise = 7.0;

// Factor by which the expected errors of tags must grow; empty if the errors are about as large as
// expected. The factor is limited: tags with much larger errors are wrong, however many they are.
// @param errors  workspace.
std::optional<double> noiseScaleOf(const FitPoint& at, std::vector<double>& errors) {
  errors.clear();
  for (std::size_t i = 0; i < at.squares.size(); ++i) {
    errors.push_back(std::sqrt(at.squares[i] / at.counts[i]));
  }
  const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  if (*middle < kNoisy) return std::nullopt;
  return std::min(*middle / kNoisy, kMostNoise);
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
constexpr int kMostIterations = 50;

}  // namespace

struct TwistFitter::Workspace {
  TwistEquations equations;
  FitPoint at, next;
  std::vector<double> errors;  // of the tags, relative to the expected error
  TwistFit result, best;
  NormalEquations system, trial;

  Workspace(TagLayout tags, int section_count, const TwistFitOptions& fit_options)
      : equations(std::move(tags), section_count, fit_options) {
    result.covariance.setZero(6 * sections(), 6 * sections());
  }

  const TagLayout& layout() const { return equations.layout(); }
  int sections() const { return equations.sections(); }
  const TwistFitOptions& options() const { return equations.options(); }

  // Levenberg-Marquardt from `at`; leaves out one visible tag, or none (-1).
  template <class Model>
  void run(const Model& model, const std::vector<typename Model::Observation>& seen, int skipped) {
    result.status = FitStatus::kUnderdetermined;
    result.iterations = 0;
    result.rms = result.cost = 0;
    result.tags.clear();
    int numbers = 0;
    for (int i = 0; i < static_cast<int>(seen.size()); ++i) {
      if (i != skipped) numbers += model.residuals(seen[static_cast<std::size_t>(i)]);
    }
    if (numbers < 6 * sections()) return;
    equations.evaluate(model, seen, skipped, at, system);
    result.status = FitStatus::kNotConverged;
    if (!std::isfinite(at.cost)) return;

    Eigen::LLT<NormalEquations::Matrix> factors;
    NormalEquations::Vector step;
    double damping = kFirstDamping;
    while (result.iterations < kMostIterations && damping < kMaxDamping) {
      ++result.iterations;
      NormalEquations::Matrix damped = system.hessian;
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
    result.twists = at.twists;
    result.shape = at.shape;
    result.X_B0B = at.X_B0B;
    result.border_shift = at.border_shift;
    result.cost = at.cost;
    result.tags = at.residuals;
    trial.gradient.setZero(system.gradient.size());
    trial.hessian.setZero(system.gradient.size(), system.gradient.size());
    equations.addPriors<Model>(at, trial);
    reportStatistics(equations, at, system.hessian, trial.hessian, result);
  }

  // If most tags have larger errors than expected, raises the expected error.
  template <class Model>
  void adaptToNoise(const Model& model, const std::vector<typename Model::Observation>& seen) {
    if (at.squares.size() != seen.size() || seen.empty()) return;
    const std::optional<double> scale = noiseScaleOf(at, errors);
    if (!scale) return;
    equations.setNoiseScale(*scale);
    run(model, seen, -1);
  }

  template <class Model>
  const TwistFit& fit(const Model& model, const std::vector<typename Model::Observation>& seen,
                      const model::Shape& start, const model::Shape& of_model) {
    equations.expect(of_model);
    equations.start(start.twists(), at);
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
    equations.expect(of_model);
    equations.start(equations.prior(), at);
    run(model, seen, -1);
    best = result;
    int starts_left = kMostColdStarts;
    const auto refine = [&](const model::Twists& from, int skipped) {
      if (--starts_left < 0) return;
      equations.start(from, at);
      run(model, seen, skipped);
      if (skipped >= 0) {
        if (result.status == FitStatus::kNotConverged || result.tags.empty()) return;
        equations.start(result.twists, at);
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
      equations.start(best.twists, at);
      at.X_B0B = best.X_B0B;
      at.base_offset = at.X_B0B.log();
      at.border_shift = best.border_shift;
      run(model, seen, -1);
      adaptToNoise(model, seen);
    }
    return result;
  }
};

TwistFitter::TwistFitter(TagLayout layout, int sections, const TwistFitOptions& options)
    : work_(std::make_unique<Workspace>(std::move(layout), sections, options)) {}
TwistFitter::~TwistFitter() = default;
TwistFitter::TwistFitter(TwistFitter&&) noexcept = default;
TwistFitter& TwistFitter::operator=(TwistFitter&&) noexcept = default;

const TagLayout& TwistFitter::layout() const { return work_->layout(); }
const TwistFitOptions& TwistFitter::options() const { return work_->options(); }

void TwistFitter::know(const RigEstimate& rig) {
  const bool finite = rig.mean.allFinite() && rig.covariance.allFinite();
  basics::require(
      finite && (Eigen::LDLT<RigEstimate::Matrix>(rig.covariance).vectorD().array() > 0).all(),
      "twist fit: what is known of base and bleed is no estimate; expected finite numbers and a "
      "covariance "
      "that is positive definite");
  work_->equations.know(rig);
}

const TwistFit& TwistFitter::fit(const std::vector<CornerObservation>& seen, const lie::SE3& X_CB,
                                 double focal, const model::Shape& start,
                                 const model::Shape& model) {
  return work_->fit(CornerModel{X_CB, focal / work_->options().corner_noise, work_->options()},
                    seen, start, model);
}

const TwistFit& TwistFitter::fit(const std::vector<PoseObservation>& seen,
                                 const model::Shape& start, const model::Shape& model) {
  return work_->fit(PoseModel{work_->options(), work_->layout()}, seen, start, model);
}

const TwistFit& TwistFitter::fitCold(const std::vector<CornerObservation>& seen,
                                     const lie::SE3& X_CB, double focal,
                                     const model::Shape& model) {
  return work_->fitCold(CornerModel{X_CB, focal / work_->options().corner_noise, work_->options()},
                        seen, model);
}

const TwistFit& TwistFitter::fitCold(const std::vector<PoseObservation>& seen,
                                     const model::Shape& model) {
  return work_->fitCold(PoseModel{work_->options(), work_->layout()}, seen, model);
}

RigEstimate::RigEstimate(const TwistFitOptions& options) {
  Vector deviation;
  deviation << Eigen::Vector3d::Constant(options.base_prior.translation),
      Eigen::Vector3d::Constant(options.base_prior.rotation), options.border_shift_prior;
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

}  // namespace helix_arm::estimation
