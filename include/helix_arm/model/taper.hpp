#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"
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

/// A Magnus step of values g(s), h long: h g, h^2 g' and h^3 g'' / 2 at its middle.
template <class Value>
struct MagnusTerms {
  Value value, slope, curvature;
};

/// Magnus terms of the quadratic with the moments of g from s = from to s = to, which three Gauss
/// points integrate in each cell: where g changes its slope between two cells, a step keeps its
/// order.
/// @param cells  in s = 0 to 1. @param zero  of g's shape. @param at  g(s).
template <class Value, class At>
MagnusTerms<Value> magnusTerms(double from, double to, int cells, const Value& zero, const At& at) {
  constexpr double kGauss = 0.38729833462074169;  // sqrt(15) / 10
  const double h = to - from, middle = 0.5 * (from + to);
  MagnusTerms<Value> out{zero, zero, zero};
  for (int cell = 0; cell < cells; ++cell) {
    const double begin = std::max(from, static_cast<double>(cell) / cells);
    const double end = std::min(to, (cell + 1.0) / cells);
    for (int i = -1; begin < end && i <= 1; ++i) {
      const double s = 0.5 * (begin + end) + i * kGauss * (end - begin);
      const double x = (s - middle) / h, even = 15 * x * x - 1.25;
      const Value g = (i == 0 ? 4.0 / 9 : 5.0 / 18) * (end - begin) * at(s);
      out.value += (1 - even) * g;
      out.slope += 12 * x * g;
      out.curvature += 12 * even * g;
    }
  }
  return out;
}

/// The step's twist: X' = X g moves by its exponential, with an error of order h^7 (Blanes, Casas,
/// Oteo and Ros, Physics Reports 470, 2009, section 5.5, for Y' = A Y).
template <class Tangent>
Tangent magnusTwist(const MagnusTerms<Tangent>& g) {
  const Tangent first = bracket(g.slope, g.value);
  const Tangent second = bracket(g.value, Tangent(2 * g.curvature + first)) / 60;
  return g.value + g.curvature / 12 +
         bracket(Tangent(20 * g.value + g.curvature - first), Tangent(g.slope + second)) / 240;
}

/// Its derivative (dof x n) from those of the terms.
template <class Tangent, class Motion>
Motion magnusSlope(const MagnusTerms<Tangent>& g, const MagnusTerms<Motion>& by) {
  const Tangent first = bracket(g.slope, g.value), inner = 2 * g.curvature + first;
  const Tangent left = 20 * g.value + g.curvature - first,
                right = g.slope + bracket(g.value, inner) / 60;
  Motion out = by.value + by.curvature / 12;
  for (int i = 0; i < out.cols(); ++i) {
    const Tangent value = by.value.col(i), slope = by.slope.col(i), curvature = by.curvature.col(i);
    const Tangent by_first = bracket(slope, g.value) + bracket(g.slope, value);
    const Tangent by_left = 20 * value + curvature - by_first;
    const Tangent by_right =
        slope + (bracket(value, inner) + bracket(g.value, Tangent(2 * curvature + by_first))) / 60;
    out.col(i) += (bracket(by_left, right) + bracket(left, by_right)) / 240;
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

  /// A Magnus step over part of the section: maps of the lengths l.
  struct Step : MagnusTerms<Map> {
    MagnusTerms<Tangent> of(const Lengths& lengths) const {
      return {this->value * lengths, this->slope * lengths, this->curvature * lengths};
    }
    Tangent twist(const Lengths& lengths) const { return magnusTwist(of(lengths)); }
    /// Its derivative (dof x n) by the lengths.
    Map byLengths(const Lengths& lengths) const {
      return magnusSlope<Tangent, Map>(of(lengths), *this);
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
  /// The step from s = from to s = to.
  Step step(double from, double to) const;

 private:
  friend class TaperTwist<Group>;

  // Fits this many modes per cell. @return the largest error, relative to the entries of one unit.
  double fit(const std::vector<ActuatorOf<Group>>& actuators, int modes);

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
  /// Motion from one s to another: a Magnus step, an error of order (to - from)^7.
  Tangent step(double from, double to) const;
  int cells() const { return cells_; }

 private:
  int cells_, modes_;
  Eigen::Matrix<double, Group::kDof, Eigen::Dynamic> g_modes_;
};

}  // namespace helix_arm::model
