#include "helix_arm/localization/rig_memory.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "basics/pi.hpp"
#include "basics/text.hpp"

namespace helix_arm::estimation {
namespace {

using Matrix = RigEstimate::Matrix;

// A shape is a new one if an entry of its twists differs by this much.
constexpr double kMoved = 0.005;  // [m]
constexpr double kTurned = 0.05;  // [rad]
constexpr int kMostFailures = 30;
// Part of what is known that remains after each later picture: a camera that was pushed is followed
// within some hundred different shapes, while one load, carried for some of them, changes little.
constexpr double kKept = 0.995;

// Constants of BaseWatch: deviations of a move, fits that change its verdict, prior of fits.
constexpr double kMovedBeyond = 5.0;
constexpr int kWatchPatience = 3;
// Fits of the usual base: fewest that count, and most. Part of P0 + Q by which it may change.
constexpr int kLeastFits = 10, kUsualFits = 100;
constexpr double kChanges = 0.25;
constexpr BasePrior kAnywhere = {0.5, 1.0};

TwistFitOptions unknownBase(TwistFitOptions options) {
  options.free_base = true;
  options.base_prior = kAnywhere;
  return options;
}

Matrix inverseOf(const Matrix& covariance) {
  return Eigen::LLT<Matrix>(covariance).solve(Matrix::Identity());
}

}  // namespace

RigMemory::RigMemory(const TwistFitOptions& options, const Matrix& by_placements)
    : options_(options),
      by_placements_(by_placements),
      estimate_(options),
      teaches_(options.free_base || options.free_border_shift),
      held_(!teaches_) {}

TwistFitOptions RigMemory::heldOptions(TwistFitOptions options) {
  options.base_prior.translation *= kSurest;
  options.base_prior.rotation *= kSurest;
  options.border_shift_prior *= kSurest;
  return options;
}

Matrix RigMemory::heldErrors(const TwistFitOptions& options, const Matrix& by_placements) {
  const Matrix prior = RigEstimate(options).covariance;
  const Matrix whole = prior + by_placements;
  return RigEstimate(heldOptions(options)).covariance + prior -
         prior * Eigen::LLT<Matrix>(whole).solve(prior);
}

bool RigMemory::isNew(const model::Twists& twists) const {
  if (!taught_ || taught_->cols() != twists.cols()) return true;
  const model::Twists moved = (twists - *taught_).cwiseAbs();
  return moved.topRows<3>().maxCoeff() > kMoved || moved.bottomRows<3>().maxCoeff() > kTurned;
}

void RigMemory::learn(const TwistFit& fit) {
  if (fit.status != FitStatus::kConverged) {
    failures_ += fit.status == FitStatus::kUnexplained ? 1 : 0;
    if (failures_ >= kMostFailures) reset();
    return;
  }
  failures_ = 0;
  if (!teaches_ || !isNew(fit.twists)) return;
  taught_ = fit.twists;
  if (held_) {
    information_ *= kKept;
    weighted_ *= kKept;
  }
  // Information of the picture beyond what the fit knew.
  const Matrix known = inverseOf(estimate_.covariance), after = inverseOf(fit.rig.covariance);
  information_ += after - known;
  weighted_ += after * fit.rig.mean - known * estimate_.mean;
  conclude();
}

void RigMemory::conclude() {
  const RigEstimate prior(options_), narrow(heldOptions(options_));
  const Matrix certain = inverseOf(prior.covariance);
  // Covariance of z as a measurement of base and border shift: (information^-1 + Q)^-1.
  const Matrix damping = Matrix::Identity() + information_ * by_placements_;
  const Eigen::PartialPivLU<Matrix> damped(damping);
  const Matrix measured = damped.solve(information_);
  estimate_.mean = (certain + measured).partialPivLu().solve(damped.solve(weighted_));
  estimate_.covariance = inverseOf(certain + information_);
  const auto surer = [&](int first, int count) {
    return (estimate_.covariance.diagonal().segment(first, count).array() <=
            narrow.covariance.diagonal().segment(first, count).array())
        .all();
  };
  held_ |= (!options_.free_base || surer(0, 6)) && (!options_.free_border_shift || surer(6, 1));
  if (held_) estimate_.covariance = narrow.covariance;
}

void RigMemory::reset() { *this = RigMemory(options_, by_placements_); }

std::string BaseMove::message() const {
  return basics::format(
      "the %s or the arm's base %s %.0f mm and %.1f deg%s (%.0f standard deviations): fix "
      "both, then %s",
      of_bodies ? "frame of the poses" : "camera", since_before ? "has moved by" : "is",
      1e3 * xi.head<3>().norm(), xi.tail<3>().norm() * 180 / basics::kPi,
      since_before ? "" : " from where the scene says", deviations,
      of_bodies ? "calibrate anew with --fit base"
                : "place the camera anew with helix_arm camera place");
}

BaseWatch::BaseWatch(TagLayout layout, int sections, const TwistFitOptions& options,
                     const Matrix& by_placements)
    : fitter_(std::move(layout), sections, unknownBase(options)),
      known_((RigEstimate(options).covariance + by_placements).topLeftCorner<6, 6>()) {}

void BaseWatch::see(const std::vector<CornerObservation>& seen, const lie::SE3& X_CB, double focal,
                    const model::Shape& start, const model::Shape& model) {
  if (isDue()) judge(fitter_.fit(seen, X_CB, focal, start, model));
}

void BaseWatch::see(const std::vector<PoseObservation>& seen, const model::Shape& start,
                    const model::Shape& model) {
  if (isDue()) judge(fitter_.fit(seen, start, model));
}

void BaseWatch::judge(const TwistFit& fit) {
  if (fit.status != FitStatus::kConverged) return;
  const BaseMove now = moveOf(fit.rig);
  const bool moved = now.deviations > kMovedBeyond;
  if (!moved) {
    fits_ = std::min(fits_ + 1, kUsualFits);
    usual_ += (fit.rig.mean.head<6>() - usual_) / fits_;
  }
  contradictions_ = moved == move_.has_value() ? 0 : contradictions_ + 1;
  if (contradictions_ >= kWatchPatience || (moved && move_)) {
    move_ = moved ? std::optional<BaseMove>(now) : std::nullopt;
    contradictions_ = 0;
  }
}

BaseMove BaseWatch::moveOf(const RigEstimate& rig) const {
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  const lie::Vector6 x = rig.mean.head<6>();
  const Matrix6 noise = rig.covariance.topLeftCorner<6, 6>();
  const auto distance = [&noise](const lie::Vector6& from, const Matrix6& known) {
    return std::sqrt(from.dot(Eigen::LLT<Matrix6>(known + noise).solve(from)));
  };
  const bool bodies = fitter_.layout().hasBodies();
  const BaseMove of_scene = {x, distance(x, known_), false, bodies};
  if (fits_ < kLeastFits) return of_scene;
  const BaseMove since = {x - usual_, distance(x - usual_, kChanges * known_), true, bodies};
  return since.deviations > of_scene.deviations ? since : of_scene;
}

void BaseWatch::reset() {
  pictures_ = fits_ = contradictions_ = 0;
  move_.reset();
}

}  // namespace helix_arm::estimation
