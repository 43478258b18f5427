#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/model/actuator.hpp"
#include "helix_arm/model/equilibrium.hpp"

namespace helix_arm::model {

/// Maximum number of cells of a tapered section: parts between two given poses.
inline constexpr int kMostCells = 8;

/// Pose of an actuator at s in [0, 1] of its section.
template <class Group>
Group poseAlong(const ActuatorOf<Group>& actuator, double s);

/// [a, b] of two twists: the derivative of Ad(exp(t a)) b at t = 0.
inline lie::Vector6 bracket(const lie::Vector6& a, const lie::Vector6& b) {
  lie::Vector6 out;
  out.head<3>() = a.tail<3>().cross(b.head<3>()) + a.head<3>().cross(b.tail<3>());
  out.tail<3>() = a.tail<3>().cross(b.tail<3>());
  return out;
}
inline lie::SE2::Tangent bracket(const lie::SE2::Tangent& a, const lie::SE2::Tangent& b) {
  return {b[2] * a.y() - a[2] * b.y(), a[2] * b.x() - b[2] * a.x(), 0.0};
}

/// The points of a Magnus step over h lie this * h off its middle: sqrt(3) / 6.
inline constexpr double kMagnusOffset = 0.28867513459481288;

/// Derivative (dof x n) of sum + [sum, difference] from those of both.
template <class Tangent, class Motion>
Motion magnusSlope(const Tangent& sum, const Tangent& difference, const Motion& by_sum,
                   const Motion& by_difference) {
  Motion out = by_sum;
  for (int i = 0; i < out.cols(); ++i) {
    out.col(i) +=
        bracket(Tangent(by_sum.col(i)), difference) + bracket(sum, Tangent(by_difference.col(i)));
  }
  return out;
}

template <class Group>
class TaperTwist;

/// The equilibrium of a tapered section, whose actuators' poses vary along s. Muscles are clamped
/// at every separator, so without load each s is in balance by itself: g(s) = A(s)+ D(s) l (eq.
/// 17).
///
/// Between two of the given poses (a cell) A+ D and A+ are polynomials of s, fitted once to 1e-9.
/// Immutable.
template <class Group>
class TaperOf {
 public:
  using Tangent = typename Group::Tangent;
  using Matrix = typename Group::Matrix;
  using Map = typename Equilibrium<Group>::Map;
  using Lengths = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxActuators, 1>;

  /// A Magnus step over part of the section, for lengths l: with sum * l = h (g1 + g2) / 2 and
  /// difference * l = sqrt(3) h (g2 - g1) / 12 of its two Gauss points, the motion is
  /// exp(sum l + [sum l, difference l]), an error of order h^5.
  struct Step {
    Map sum, difference;

    Tangent twist(const Lengths& lengths) const {
      const Tangent mean = sum * lengths;
      return mean + bracket(mean, Tangent(difference * lengths));
    }
    /// Its derivative (dof x n) by the lengths.
    Map byLengths(const Lengths& lengths) const {
      const Tangent mean = sum * lengths, change = difference * lengths;
      return magnusSlope(mean, change, sum, difference);
    }
  };

  /// @param actuators  of the section; those with taper have the same number of poses.
  /// @throws std::invalid_argument naming the rule that is broken: as solveEquilibrium(); actuators
  ///     with the same number of poses, each s with stiffness against every motion, and poses that
  ///     change gently enough for the polynomials.
  explicit TaperOf(const std::vector<ActuatorOf<Group>>& actuators);

  /// Parts of the section between the given poses.
  int cells() const { return cells_; }
  /// A(s)+ D(s), and A(s)+, at s in [0, 1].
  Map mapAt(double s) const;
  Matrix complianceAt(double s) const;
  /// Means over the section, with the worst rank and condition.
  const Equilibrium<Group>& mean() const { return mean_; }
  /// The step from s = from to s = to, within one cell.
  Step step(double from, double to) const;

 private:
  friend class TaperTwist<Group>;

  int cells_ = 1, modes_ = 0;
  // Chebyshev coefficients, cell by cell.
  std::vector<Map> map_modes_;
  std::vector<Matrix> compliance_modes_;
  Equilibrium<Group> mean_;
};

/// Twists along a tapered section at given lengths.
template <class Group>
class TaperTwist {
 public:
  using Tangent = typename Group::Tangent;

  /// @param lengths  (n) of its actuators [m].
  TaperTwist(const TaperOf<Group>& taper, const typename TaperOf<Group>::Lengths& lengths);

  /// g(s), s in [0, 1].
  Tangent at(double s) const;
  /// Motion from one s to another, within one cell: a Magnus step, an error of order (to - from)^5.
  Tangent step(double from, double to) const;

 private:
  Tangent atIn(int cell, double s) const;

  int cells_, modes_;
  Eigen::Matrix<double, Group::kDof, Eigen::Dynamic> g_modes_;
};

}  // namespace helix_arm::model
