#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <vector>

#include "dormand_prince.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/equilibrium.hpp"
#include "helix_arm/model/taper.hpp"

/// Differential equations of frame and moment along a loaded rod: g = g* + C [n; m] in the body
/// frame, X' = X g, m' = m x w + n x v.
namespace helix_arm::statics {

/// A point load; force and moment in the base frame.
struct Pull {
  Eigen::Vector3d offset, force, moment;
};

/// Part of the arm between two shooting nodes. The point loads at its end act on it.
struct Segment {
  int section = 0;
  double begin = 0.0, end = 1.0;  // s along the section
  Eigen::Vector3d force;          // at the end, including all loads beyond [N]
  Eigen::Vector3d weight;         // per unit s [N]
  std::vector<Pull> pulls;        // at the end
  double growth = 0.0;            // exponent of the error growth along the segment

  Eigen::Vector3d forceAt(double s) const { return force + (end - s) * weight; }
};

struct SectionLaw {
  lie::Matrix6 C;  // twist over the section per body wrench; of a tapered one, the mean
  model::Equilibrium<lie::SE3>::Basis null_space;
  std::shared_ptr<const model::TaperOf<lie::SE3>> taper;  // null if the section is not tapered
  double per_K = 0.0;                                     // l / K_eps
};

/// The integrated state: the quaternion (x y z w) and the body moment; then either the position and
/// the integral of the angular strain, or kColumns columns of the flow's derivative.
template <int kColumns>
struct Flow {
  static constexpr int kSize = 7 + (kColumns == 0 ? 6 : 6 * kColumns);
  using State = Eigen::Matrix<double, kSize, 1>;

  const SectionLaw& law;
  const Segment& segment;
  lie::Vector6 unloaded;                               // of a tapered section, the mean
  std::optional<model::TaperTwist<lie::SE3>> profile;  // of a tapered section
  lie::Matrix6 compliance;                             // twist per body wrench, without taper
  double share;                                        // fraction of the load
  double size;                                         // of the arm [m]
  double moment_unit;                                  // [N m]
  double tolerance;

  static Eigen::Matrix3d rotation(const State& y) {
    const double qx = y[0], qy = y[1], qz = y[2], qw = y[3];
    const double f = 2.0 / y.template head<4>().squaredNorm();
    Eigen::Matrix3d R;
    R << 1 - f * (qy * qy + qz * qz), f * (qx * qy - qw * qz), f * (qx * qz + qw * qy),  //
        f * (qx * qy + qw * qz), 1 - f * (qx * qx + qz * qz), f * (qy * qz - qw * qx),   //
        f * (qx * qz - qw * qy), f * (qy * qz + qw * qx), 1 - f * (qx * qx + qy * qy);
    return R;
  }

  lie::Vector6 wrench(double s, const State& y) const {
    lie::Vector6 w;
    w << rotation(y).transpose() * (share * segment.forceAt(s)), y.template segment<3>(4);
    return w;
  }

  State operator()(double s, const State& y) const {
    State dy;
    const Eigen::Matrix3d R = rotation(y);
    const Eigen::Vector3d n = R.transpose() * (share * segment.forceAt(s)),
                          m = y.template segment<3>(4);
    lie::Matrix6 C_here;
    if (profile) C_here = law.per_K * law.taper->complianceAt(s);
    const lie::Matrix6& C = profile ? C_here : compliance;
    const lie::Vector6 g =
        (profile ? profile->at(s) : unloaded) + C.leftCols<3>() * n + C.rightCols<3>() * m;
    const Eigen::Vector3d v = g.head<3>(), w = g.tail<3>();
    const Eigen::Vector3d u = y.template head<3>();
    dy.template head<3>() = 0.5 * (y[3] * w + u.cross(w));
    dy[3] = -0.5 * u.dot(w);
    dy.template segment<3>(4) = m.cross(w) + n.cross(v);
    if constexpr (kColumns == 0) {
      dy.template segment<3>(7) = R * v;
      dy.template segment<3>(10) = w;
    } else {
      using Columns = Eigen::Matrix<double, 6, kColumns>;
      using Half = Eigen::Matrix<double, 3, kColumns>;
      const Eigen::Map<const Columns> d(y.data() + 7);
      Eigen::Map<Columns> dd(dy.data() + 7);
      const Eigen::Matrix3d n_hat = lie::skew(n), w_hat = lie::skew(w);
      const Half dn = n_hat * d.template topRows<3>(), dm = d.template bottomRows<3>();
      const Columns dg = C.leftCols<3>() * dn + C.rightCols<3>() * dm;
      dd.template topRows<3>() = dg.template bottomRows<3>() - w_hat * d.template topRows<3>();
      dd.template bottomRows<3>() = lie::skew(m) * dg.template bottomRows<3>() - w_hat * dm +
                                    n_hat * dg.template topRows<3>() - lie::skew(v) * dn;
    }
    return dy;
  }

  // Squared error of the state, relative to the arm's size and one radian. The derivative is
  // excluded, since it need not be more accurate than the state.
  double squaredError(const State& e) const {
    double sum = 4.0 * e.template head<4>().squaredNorm() +
                 e.template segment<3>(4).squaredNorm() / (moment_unit * moment_unit);
    if constexpr (kColumns == 0) sum += e.template segment<3>(7).squaredNorm() / (size * size);
    return sum;
  }

  // Integrates y from s to end. False if the steps vanish or the numbers overflow.
  bool advance(double s, double end, State& y, double& h) const {
    std::array<State, dormand_prince::kStages> k;
    // Ten times the steps that shapes in equilibrium need.
    const double most_steps =
        200 + 20 * (segment.growth + unloaded.tail<3>().norm() * (segment.end - segment.begin));
    for (int steps = 0; s < end; ++steps) {
      // If the end is almost reached, the rest is one step.
      const bool last = s + h * (1.0 + 1e-10) >= end || end - s <= 1e-14;
      if (steps > most_steps || !(last || s + h > s)) return false;
      const double step = last ? end - s : h;
      k[0] = (*this)(s, y);
      for (int i = 1; i < dormand_prince::kStages; ++i) {
        State sum = dormand_prince::kWeights[i][0] * k[0];
        for (int j = 1; j < i; ++j) {
          if (dormand_prince::kWeights[i][j] != 0) sum += dormand_prince::kWeights[i][j] * k[j];
        }
        k[i] = (*this)(s + dormand_prince::kNodes[i] * step, y + step * sum);
      }
      State next = dormand_prince::kStep[0] * k[0], error5 = dormand_prince::kError5[0] * k[0],
            error3 = dormand_prince::kError3[0] * k[0];
      for (int i = 5; i < dormand_prince::kStages; ++i) {
        next += dormand_prince::kStep[i] * k[i];
        error5 += dormand_prince::kError5[i] * k[i];
        error3 += dormand_prince::kError3[i] * k[i];
      }
      const double square5 = squaredError(error5), square3 = squaredError(error3);
      const double error =
          square5 == 0 ? 0.0 : step * square5 / std::sqrt(square5 + 0.01 * square3) / tolerance;
      const double factor =
          std::isfinite(error) ? std::clamp(0.9 * std::pow(error + 1e-30, -0.125), 0.2, 6.0) : 0.2;
      if (error <= 1.0) {
        y += step * next;
        y.template head<4>().normalize();
        s = last ? end : s + step;
        // A step that was shortened to reach the end does not reduce the step size.
        h = last ? std::max(h, step * factor) : step * factor;
      } else {
        h = step * std::min(factor, 0.9);
      }
    }
    return y.allFinite();
  }
};

}  // namespace helix_arm::statics
