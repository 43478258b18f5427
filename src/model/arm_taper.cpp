// Tapered sections of ArmOf.
#include <algorithm>
#include <random>
#include <stdexcept>
#include <string>

#include "helix_arm/basics/fraction.hpp"
#include "helix_arm/model/arm.hpp"

namespace helix_arm::model {
namespace {

// Of the choice of the Magnus steps.
constexpr int kStepSamples = 64;
constexpr double kTipError = 1e-5;    // of the arm's length
constexpr double kCurveError = 2e-4;  // the same, of points within a piece

// How far a piece of constant twist is from the curve between its ends, about: v changes by `slope`
// over it, and so does the curvature.
template <class Tangent>
double errorWithin(const MagnusTerms<Tangent>& g) {
  constexpr int kSpace = Tangent::RowsAtCompileTime == 6 ? 3 : 2;
  return g.slope.template head<kSpace>().norm() / 8 +
         bracket(g.value, g.slope).template head<kSpace>().norm() / 125;
}

}  // namespace

template <class Group>
void ArmOf<Group>::setSteps(int steps) {
  steps_ = steps;
  for (int k = 0; k < sectionCount(); ++k) {
    section_steps_[k].clear();
    for (int j = 0; tapers_[k] && j < steps; ++j) {
      section_steps_[k].push_back(
          tapers_[k]->step(static_cast<double>(j) / steps, (j + 1.0) / steps));
    }
    if (!tapers_[k]) continue;
    Eigen::VectorXd rest_length(first_[k + 1] - first_[k]);
    for (int i = 0; i < rest_length.size(); ++i) {
      rest_length[i] = actuators_[first_[k] + i].contraction.restLength();
    }
    rest_twists_[k].setZero();
    for (const auto& step : section_steps_[k]) rest_twists_[k] += step.twist(rest_length);
  }
}

// Doubles the steps until that no longer moves the tip, and pieces follow the curve.
template <class Group>
void ArmOf<Group>::chooseSteps() {
  std::mt19937_64 generator(20240229);
  std::vector<Eigen::VectorXd> samples;
  for (int sample = 0; sample < kStepSamples; ++sample) {
    Eigen::VectorXd fraction(actuatorCount());
    for (double& one : fraction) one = basics::fractionOf(generator());
    // Every other one is a corner of the limits, where twists are largest.
    if (sample % 2 == 0) fraction = fraction.array().round().matrix();
    samples.push_back(inputAt(fraction));
  }
  const auto tipsWith = [&](int steps) {
    setSteps(steps);
    std::vector<Eigen::Matrix<double, Group::kSpace, 1>> tips;
    for (const Eigen::VectorXd& q : samples) tips.push_back(tipInside(q).translation);
    return tips;
  };
  const int most = kMaxPieces / sectionCount();
  for (int steps = 1;; steps = std::min(2 * steps, most)) {
    const auto finer = tipsWith(2 * steps), tips = tipsWith(steps);
    double moved = 0.0, within = 0.0;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      moved = std::max(moved, (finer[i] - tips[i]).norm());
      for (int k = 0; k < sectionCount(); ++k) {
        const auto lengths = lengthsOf(samples[i], k);
        for (const auto& step : section_steps_[k]) {
          within = std::max(within, errorWithin(step.of(lengths)));
        }
      }
    }
    if (moved < kTipError * restLength() && within < kCurveError * restLength()) return;
    if (steps == most) {
      throw std::invalid_argument("its taper needs more than " + std::to_string(most) +
                                  " Magnus steps per section, " + std::to_string(kMaxPieces) +
                                  " in all; expected a gentler taper, or fewer sections");
    }
  }
}

template <class Group>
typename Group::Tangent ArmOf<Group>::taperedTwist(const typename TaperOf<Group>::Lengths& lengths,
                                                   int k) const noexcept {
  typename Group::Tangent sum = Group::Tangent::Zero();
  for (const auto& step : section_steps_[k]) sum += step.twist(lengths);
  return sum;
}

template <class Group>
typename TaperOf<Group>::Lengths ArmOf<Group>::lengthsOf(const InputRef& q, int k) const noexcept {
  typename TaperOf<Group>::Lengths out(first_[k + 1] - first_[k]);
  for (int i = 0; i < out.size(); ++i) {
    out[i] = actuators_[first_[k] + i].contraction.lengthInside(q[first_[k] + i]);
  }
  return out;
}

template <class Group>
UnloadedOf<Group> ArmOf<Group>::unloaded(const InputRef& q) const {
  if (!tapered()) return twists(q);
  return {twists(q), lengths(q)};
}

template <class Group>
UnloadedOf<Group> ArmOf<Group>::unloadedOfLengths(const InputRef& lengths) const {
  if (!tapered()) return twistsOfLengths(lengths);
  return {twistsOfLengths(lengths), lengths};
}

template <class Group>
PiecesOf<Group> ArmOf<Group>::pieces(const UnloadedOf<Group>& unloaded) const {
  if (!tapered()) return unloaded.twists;
  PiecesOf<Group> out(Group::kDof, sectionCount() * steps_);
  for (int k = 0; k < sectionCount(); ++k) {
    auto own = out.middleCols(k * steps_, steps_);
    if (!tapers_[k]) {
      own.colwise() = unloaded.twists.col(k) / steps_;
      continue;
    }
    const typename TaperOf<Group>::Lengths lengths =
        unloaded.lengths.segment(first_[k], first_[k + 1] - first_[k]);
    for (int j = 0; j < steps_; ++j) own.col(j) = section_steps_[k][j].twist(lengths);
  }
  return out;
}

template <class Group>
typename Equilibrium<Group>::Map ArmOf<Group>::pieceByLengths(
    int k, int j, const UnloadedOf<Group>& unloaded) const {
  if (!tapers_[k]) return equilibria_[k].map / piecesPerSection();
  return section_steps_[k][j].byLengths(
      unloaded.lengths.segment(first_[k], first_[k + 1] - first_[k]));
}

template void PlanarArm::setSteps(int);
template void PlanarArm::chooseSteps();
template TaperOf<lie::SE2>::Lengths PlanarArm::lengthsOf(const InputRef&, int) const noexcept;
template lie::SE2::Tangent PlanarArm::taperedTwist(const TaperOf<lie::SE2>::Lengths&,
                                                   int) const noexcept;
template UnloadedOf<lie::SE2> PlanarArm::unloaded(const InputRef&) const;
template UnloadedOf<lie::SE2> PlanarArm::unloadedOfLengths(const InputRef&) const;
template PiecesOf<lie::SE2> PlanarArm::pieces(const UnloadedOf<lie::SE2>&) const;
template Equilibrium<lie::SE2>::Map PlanarArm::pieceByLengths(int, int,
                                                              const UnloadedOf<lie::SE2>&) const;
template void Arm::setSteps(int);
template void Arm::chooseSteps();
template TaperOf<lie::SE3>::Lengths Arm::lengthsOf(const InputRef&, int) const noexcept;
template lie::SE3::Tangent Arm::taperedTwist(const TaperOf<lie::SE3>::Lengths&, int) const noexcept;
template UnloadedOf<lie::SE3> Arm::unloaded(const InputRef&) const;
template UnloadedOf<lie::SE3> Arm::unloadedOfLengths(const InputRef&) const;
template PiecesOf<lie::SE3> Arm::pieces(const UnloadedOf<lie::SE3>&) const;
template Equilibrium<lie::SE3>::Map Arm::pieceByLengths(int, int,
                                                        const UnloadedOf<lie::SE3>&) const;

}  // namespace helix_arm::model
