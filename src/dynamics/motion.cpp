#include "helix_arm/dynamics/motion.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "basics/pi.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::dynamics {
namespace {

// Iterations of a step, and the change of the rate at which they end, relative to it.
constexpr int kMostIterations = 25;
constexpr double kTolerance = 1e-7;
constexpr double kNoMotion = 1e-15;  // energy of a change of rate below which nothing moves [J]
// Largest correction of the balance, of a step's energy.
constexpr double kMostCorrection = 0.1;
// Search for the rest: iterations, step of differences [m, rad], relative change at its end.
constexpr int kMostSearch = 300;
constexpr double kDifference = 1e-6, kFound = 1e-11;

}  // namespace

template <class Group>
MotionOf<Group>::MotionOf(const MovingArmOf<Group>& arm)
    : arm_(arm),
      terms_(arm),
      slope_(arm.coordinates(), arm.coordinates()),
      factors_(arm.coordinates()) {
  for (Eigen::VectorXd* vector :
       {&q_, &v_, &target_, &mid_q_, &mid_v_, &next_q_, &next_v_, &next_target_, &last_v_,
        &momentum_, &change_, &elastic_, &residual_}) {
    vector->setZero(arm.coordinates());
  }
}

template <class Group>
void MotionOf<Group>::begin(const model::TwistsOf<Group>& unloaded) {
  arm_.setTwists(unloaded, target_);
  v_.setZero();
  last_step_ = dissipated_ = carry_ = 0.0;
}

// Takes the place where it is as the start.
template <class Group>
void MotionOf<Group>::settle() {
  now_ = arm_.energies(q_, v_);
  potential_at_start_ = now_.potential;
  work_ = now_.kinetic + elasticEnergy();
}

template <class Group>
void MotionOf<Group>::startStraight(const model::TwistsOf<Group>& unloaded) {
  begin(unloaded);
  model::TwistsOf<Group> twists = unloaded;
  for (int k = 0; k < twists.cols(); ++k) {
    const typename Group::Tangent rest = arm_.arm().restTwist(k);
    twists.col(k).setZero();
    twists(0, k) = arm_.arm().restLength(k);
    if (Group::kRotations > 1) twists(Group::kSpace, k) = rest[Group::kSpace];
  }
  arm_.setTwists(twists, q_);
  settle();
}

template <class Group>
void MotionOf<Group>::startAtRest(const model::TwistsOf<Group>& unloaded) {
  begin(unloaded);
  q_ = target_;
  findRest();
  settle();
}

template <class Group>
void MotionOf<Group>::startAt(const model::TwistsOf<Group>& unloaded, const MotionState& state) {
  basics::require(state.position.size() == q_.size() && state.rate.size() == q_.size() &&
                      state.position.allFinite() && state.rate.allFinite(),
                  "a state has ", state.position.size(), " coordinates and ", state.rate.size(),
                  " rates; expected ", q_.size(), " finite numbers of each");
  begin(unloaded);
  q_ = state.position;
  v_ = state.rate;
  settle();
}

// Forces on the coordinates at rest: elastic ones, weight and dead forces. Leaves the mass matrix
// in terms_.
template <class Group>
Eigen::VectorXd MotionOf<Group>::restForce(const Eigen::VectorXd& q) {
  arm_.evaluate(q, Eigen::VectorXd::Zero(q.size()), terms_);
  return terms_.force + arm_.stiffness() * (q - target_);
}

// Its slope, by central differences.
template <class Group>
Eigen::MatrixXd MotionOf<Group>::restSlope(const Eigen::VectorXd& q) {
  Eigen::MatrixXd slope(q.size(), q.size());
  Eigen::VectorXd moved = q;
  for (Eigen::Index j = 0; j < q.size(); ++j) {
    moved[j] = q[j] + kDifference;
    const Eigen::VectorXd beyond = restForce(moved);
    moved[j] = q[j] - kDifference;
    slope.col(j) = (beyond - restForce(moved)) / (2 * kDifference);
    moved[j] = q[j];
  }
  return slope;
}

// Newton's search for the least potential, with as much of the mass matrix added to the slope as a
// step takes that lowers it.
template <class Group>
void MotionOf<Group>::findRest() {
  Eigen::VectorXd force = restForce(q_);
  const Eigen::MatrixXd mass = terms_.mass;
  double added = arm_.stiffness().diagonal().cwiseQuotient(mass.diagonal()).maxCoeff() * 1e-9;
  const double least = added * 1e-3;
  for (int i = 0; i < kMostSearch; ++i) {
    slope_ = restSlope(q_);
    for (int tries = 0; tries < kMostSearch; ++tries, added *= 4.0) {
      factors_.compute(slope_ + added * mass);
      if (factors_.info() != Eigen::Success) continue;
      change_ = -factors_.solve(force);
      next_q_ = q_ + change_;
      const Eigen::VectorXd next = restForce(next_q_);
      if (!((force + next).dot(change_) <= 0)) continue;
      q_ = next_q_;
      force = next;
      break;
    }
    if (change_.norm() <= kFound * q_.norm()) return;
    added = std::max(0.1 * added, least);
  }
  throw std::runtime_error("no equilibrium was found at the first pressures; start straight");
}

// The residual of a step's equations at mid_v_, along with the energies at its end.
template <class Group>
void MotionOf<Group>::residualAt(double dt) noexcept {
  mid_q_ = q_ + 0.5 * dt * mid_v_;
  next_q_ = q_ + dt * mid_v_;
  next_v_ = 2.0 * mid_v_ - v_;
  arm_.evaluate(mid_q_, mid_v_, terms_);
  next_ = arm_.energies(next_q_, next_v_);
  change_ = mid_q_ - 0.5 * (target_ + next_target_);
  elastic_.noalias() = arm_.stiffness() * change_;
  residual_ = terms_.force + elastic_;
  residual_.noalias() += arm_.damping() * mid_v_;
  change_ = 2.0 / dt * (mid_v_ - v_);
  residual_.noalias() += terms_.mass * change_;
  momentum_.noalias() = terms_.mass * mid_v_;
  // The energy that the masses gain, less that of the forces of the midpoint; 0 at order 3 of dt.
  const double gained = next_.kinetic + next_.potential - now_.kinetic - now_.potential - carry_;
  const double given =
      dt * (change_.dot(momentum_) + mid_v_.dot(terms_.force) + terms_.moment_power);
  const double moved = mid_v_.dot(momentum_);
  if (moved < kNoMotion) return;
  const double correction =
      std::min(std::max((gained - given) / moved, -kMostCorrection), kMostCorrection);
  residual_ += correction / dt * momentum_;
}

template <class Group>
bool MotionOf<Group>::solve(double dt) noexcept {
  mid_v_ = v_;
  if (last_step_ > 0) mid_v_ += 0.5 * dt / last_step_ * (v_ - last_v_);
  for (int i = 0; i < kMostIterations; ++i) {
    residualAt(dt);
    if (i == 0) {
      slope_ = 2.0 / dt * terms_.mass + 0.5 * dt * arm_.stiffness() + arm_.damping();
      factors_.compute(slope_);
      if (factors_.info() != Eigen::Success) return false;
    }
    change_ = residual_;
    factors_.solveInPlace(change_);
    mid_v_ -= change_;
    const double energy = 0.5 * dt * change_.dot(residual_);  // of the change
    if (!std::isfinite(energy)) return false;
    if (energy <= kTolerance * kTolerance * mid_v_.dot(momentum_) + kNoMotion) return true;
  }
  return false;
}

template <class Group>
bool MotionOf<Group>::step(double dt, const model::TwistsOf<Group>& unloaded) noexcept {
  arm_.setTwists(unloaded, next_target_);
  if (!solve(dt)) return false;
  next_q_ = q_ + dt * mid_v_;
  next_v_ = 2.0 * mid_v_ - v_;
  change_ = 0.5 * (q_ + next_q_ - target_ - next_target_);
  elastic_.noalias() = arm_.stiffness() * change_;
  work_ += dt * terms_.moment_power - (next_target_ - target_).dot(elastic_);
  momentum_.noalias() = arm_.damping() * mid_v_;
  dissipated_ += dt * mid_v_.dot(momentum_);
  last_v_ = v_;
  last_step_ = dt;
  q_.swap(next_q_);
  v_.swap(next_v_);
  target_.swap(next_target_);
  now_ = arm_.energies(q_, v_);
  const Energy balance = energy();
  carry_ =
      balance.work - balance.dissipated - balance.kinetic - balance.elastic - balance.potential;
  return true;
}

template <class Group>
double MotionOf<Group>::elasticEnergy() const noexcept {
  constexpr int kDof = Group::kDof;
  double sum = 0.0;
  for (Eigen::Index at = 0; at < q_.size(); at += kDof) {  // the stiffness has blocks alone
    const typename Group::Tangent strain =
        q_.template segment<kDof>(at) - target_.template segment<kDof>(at);
    sum += 0.5 * strain.dot(arm_.stiffness().template block<kDof, kDof>(at, at) * strain);
  }
  return sum;
}

template <class Group>
Energy MotionOf<Group>::energy() const {
  return {now_.kinetic, elasticEnergy(), now_.potential - potential_at_start_, dissipated_, work_};
}

template <class Group>
LinearMotion MotionOf<Group>::linearised() {
  LinearMotion out{q_, {}, arm_.damping(), restSlope(q_), {}, lie::inSpace(tip()), {}};
  restForce(q_);
  out.mass = terms_.mass;
  out.tip_by.resize(3, q_.size());
  Eigen::VectorXd moved = q_;
  const auto tipAt = [&](Eigen::Index j, double by) {
    moved[j] = q_[j] + by;
    return lie::inSpace(arm_.tip(moved)).translation;
  };
  for (Eigen::Index j = 0; j < q_.size(); ++j) {
    out.tip_by.col(j) = (tipAt(j, kDifference) - tipAt(j, -kDifference)) / (2 * kDifference);
    moved[j] = q_[j];
  }
  return out;
}

std::vector<Vibration> vibrationsOf(const LinearMotion& motion) {
  const Eigen::Index n = motion.mass.rows();
  const Eigen::LLT<Eigen::MatrixXd> mass(motion.mass);
  Eigen::MatrixXd rates = Eigen::MatrixXd::Zero(2 * n, 2 * n);
  rates.topRightCorner(n, n).setIdentity();
  rates.bottomLeftCorner(n, n) = -mass.solve(motion.stiffness);
  rates.bottomRightCorner(n, n) = -mass.solve(motion.damping);
  const Eigen::VectorXcd roots = Eigen::EigenSolver<Eigen::MatrixXd>(rates, false).eigenvalues();
  std::vector<Vibration> out;
  for (const std::complex<double>& root : roots) {
    if (root.imag() <= 0) continue;  // the other of a pair, or no vibration
    out.push_back({std::abs(root) / (2 * basics::kPi), -root.real() / std::abs(root)});
  }
  std::sort(out.begin(), out.end(),
            [](const auto& one, const auto& other) { return one.frequency < other.frequency; });
  return out;
}

template class MotionOf<lie::SE3>;
template class MotionOf<lie::SE2>;

}  // namespace helix_arm::dynamics
