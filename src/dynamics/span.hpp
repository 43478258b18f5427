#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/taper.hpp"
#include "lie/coefficients.hpp"

/// Kinematics of a span of an arm with a twist, and the algebra that its equations of motion take.
///
/// Maps of twists that commute with the adjoint's structure, as Ad, Jr and their products do, are
/// [P Q; 0 P] in space. They are kept so: a product takes 3 products of 3 x 3 in place of 8.
namespace helix_arm::dynamics {

/// [P Q; 0 P].
struct DualMatrix {
  Eigen::Matrix3d P, Q;

  void setZero() {
    P.setZero();
    Q.setZero();
  }
  DualMatrix& operator+=(const DualMatrix& other) {
    P += other.P;
    Q += other.Q;
    return *this;
  }
  DualMatrix operator*(const DualMatrix& other) const {
    return {P * other.P, P * other.Q + Q * other.P};
  }
  lie::Vector6 operator*(const lie::Vector6& twist) const {
    lie::Vector6 out;
    out << P * twist.head<3>() + Q * twist.tail<3>(), P * twist.tail<3>();
    return out;
  }
  lie::Vector6 transposeTimes(const lie::Vector6& wrench) const {
    lie::Vector6 out;
    out << P.transpose() * wrench.head<3>(),
        Q.transpose() * wrench.head<3>() + P.transpose() * wrench.tail<3>();
    return out;
  }
  lie::Matrix6 transposeTimes(const lie::Matrix6& other) const {
    lie::Matrix6 out;
    out.topRows<3>().noalias() = P.transpose() * other.topRows<3>();
    out.bottomRows<3>().noalias() = Q.transpose() * other.topRows<3>();
    out.bottomRows<3>().noalias() += P.transpose() * other.bottomRows<3>();
    return out;
  }
  lie::Matrix6 leftTimes(const lie::Matrix6& other) const {  ///< other * this
    lie::Matrix6 out;
    out.leftCols<3>().noalias() = other.leftCols<3>() * P;
    out.rightCols<3>().noalias() = other.leftCols<3>() * Q;
    out.rightCols<3>().noalias() += other.rightCols<3>() * P;
    return out;
  }
};
inline DualMatrix operator*(double factor, const DualMatrix& matrix) {
  return {factor * matrix.P, factor * matrix.Q};
}

/// The same of a plane, where it is any matrix.
struct PlaneMatrix {
  Eigen::Matrix3d P;

  void setZero() { P.setZero(); }
  PlaneMatrix& operator+=(const PlaneMatrix& other) {
    P += other.P;
    return *this;
  }
  PlaneMatrix operator*(const PlaneMatrix& other) const { return {P * other.P}; }
  Eigen::Vector3d operator*(const Eigen::Vector3d& twist) const { return P * twist; }
  Eigen::Vector3d transposeTimes(const Eigen::Vector3d& wrench) const {
    return P.transpose() * wrench;
  }
  Eigen::Matrix3d transposeTimes(const Eigen::Matrix3d& other) const {
    return P.transpose() * other;
  }
  Eigen::Matrix3d leftTimes(const Eigen::Matrix3d& other) const { return other * P; }
};
inline PlaneMatrix operator*(double factor, const PlaneMatrix& matrix) {
  return {factor * matrix.P};
}

/// ad_g, the map from x to [g, x], and the identity.
inline DualMatrix bracketMatrix(const lie::Vector6& g) {
  return {lie::skew(g.tail<3>()), lie::skew(g.head<3>())};
}
inline DualMatrix identityOf(const lie::SE3&) {
  return {Eigen::Matrix3d::Identity(), Eigen::Matrix3d::Zero()};
}
inline PlaneMatrix bracketMatrix(const lie::SE2::Tangent& g) {
  PlaneMatrix out;
  out.P << 0, -g[2], g[1], g[2], 0, -g[0], 0, 0, 0;
  return out;
}
inline PlaneMatrix identityOf(const lie::SE2&) { return {Eigen::Matrix3d::Identity()}; }

/// Ad(X)^-1 of a twist and of a map.
inline lie::Vector6 back(const lie::SE3& X, const lie::Vector6& twist) {
  const Eigen::Vector3d v = twist.head<3>(), w = twist.tail<3>();
  lie::Vector6 out;
  out << X.rotation.transpose() * (v - X.translation.cross(w)), X.rotation.transpose() * w;
  return out;
}
inline DualMatrix back(const lie::SE3& X, const DualMatrix& map) {
  Eigen::Matrix3d moved = map.Q;
  for (int i = 0; i < 3; ++i) moved.col(i) -= X.translation.cross(map.P.col(i));
  return {X.rotation.transpose() * map.P, X.rotation.transpose() * moved};
}
inline lie::SE2::Tangent back(const lie::SE2& X, const lie::SE2::Tangent& twist) {
  const Eigen::Vector2d p = X.translation,
                        v{twist[0] - p.y() * twist[2], twist[1] + p.x() * twist[2]};
  lie::SE2::Tangent out;
  out << X.rotation.transpose() * v, twist[2];
  return out;
}
inline PlaneMatrix back(const lie::SE2& X, const PlaneMatrix& map) {
  PlaneMatrix out;
  for (int i = 0; i < 3; ++i) out.P.col(i) = back(X, lie::SE2::Tangent(map.P.col(i)));
  return out;
}

/// Ad(X)^-T of a wrench, or of the columns of a matrix of wrenches.
template <int columns>
Eigen::Matrix<double, 6, columns> carried(const lie::SE3& X,
                                          const Eigen::Matrix<double, 6, columns>& wrench) {
  Eigen::Matrix<double, 6, columns> out;
  out.template topRows<3>().noalias() = X.rotation * wrench.template topRows<3>();
  out.template bottomRows<3>().noalias() = X.rotation * wrench.template bottomRows<3>();
  for (int i = 0; i < columns; ++i) {
    out.template block<3, 1>(3, i) += X.translation.cross(out.template block<3, 1>(0, i));
  }
  return out;
}
template <int columns>
Eigen::Matrix<double, 3, columns> carried(const lie::SE2& X,
                                          const Eigen::Matrix<double, 3, columns>& wrench) {
  Eigen::Matrix<double, 3, columns> out = wrench;
  out.template topRows<2>() = X.rotation * wrench.template topRows<2>();
  out.row(2) += X.translation.x() * out.row(1) - X.translation.y() * out.row(0);
  return out;
}

/// A span, which moves from its beginning to its end by exp of a twist.
template <class Group>
struct Span;

/// The coefficients f_n = sum_j (-x)^j / (2j + n)! of the span's angle, for which f_n' = (n f_n+2 -
/// f_n+1) / 2.
struct SpanCoefficients {
  double f1, f2, f3, f4, f5, f6, f7;

  /// @param x  squared angle.
  explicit SpanCoefficients(double x) {
    if (x <= lie::kSeriesLimit) {
      f6 = lie::detail::factorialSeries<6, 12>(x);
      f7 = lie::detail::factorialSeries<7, 12>(x);
      f5 = 1.0 / 120 - x * f7;
      f4 = 1.0 / 24 - x * f6;
      f3 = 1.0 / 6 - x * f5;
      f2 = 0.5 - x * f4;
      f1 = 1.0 - x * f3;
      return;
    }
    const lie::JacobianCoefficients far = lie::jacobianCoefficients(x);
    f1 = far.a, f2 = far.b, f3 = far.c, f4 = far.d, f5 = far.e;
    f6 = (1.0 / 24 - f4) / x;
    f7 = (1.0 / 120 - f5) / x;
  }
};

template <>
struct Span<lie::SE3> {
  lie::SE3 X;         ///< its end, seen from its beginning
  DualMatrix Jr;      ///< right Jacobian of exp at the twist
  lie::Vector6 own;   ///< Jr times the twist's rate
  lie::Vector6 bias;  ///< the derivative of Jr along the rate, times the rate

  /// @param with_matrix  whether Jr and bias are wanted.
  Span(const lie::Vector6& twist, const lie::Vector6& rate, bool with_matrix) {
    const Eigen::Vector3d v = twist.head<3>(), w = twist.tail<3>();
    const double x = w.squaredNorm(), wv = w.dot(v);
    const SpanCoefficients f(x);
    const double by2 = f.f4 - 0.5 * f.f3, by3 = 1.5 * f.f5 - 0.5 * f.f4;  // f2', f3'
    const Eigen::Matrix3d ww = w * w.transpose(), W = lie::skew(w);
    X.rotation = f.f2 * ww + f.f1 * W;
    X.rotation.diagonal().array() += 1.0 - f.f2 * x;
    X.translation = f.f1 * v + f.f3 * wv * w + f.f2 * w.cross(v);
    // A twist is the dual vector w + e v, e^2 = 0, and a function of its square f + 2 e w.v f'.
    const auto scaled = [](double real, double dual, const lie::Vector6& xi) {
      lie::Vector6 out;
      out << real * xi.head<3>() + dual * xi.tail<3>(), real * xi.tail<3>();
      return out;
    };
    const lie::Vector6 once = model::bracket(twist, rate), twice = model::bracket(twist, once);
    own = rate - scaled(f.f2, 2 * wv * by2, once) + scaled(f.f3, 2 * wv * by3, twice);
    if (!with_matrix) return;
    const double f4_by = 2 * f.f6 - 0.5 * f.f5, f5_by = 2.5 * f.f7 - 0.5 * f.f6;
    const double by22 = f4_by - 0.5 * by3, by33 = 1.5 * f5_by - 0.5 * f4_by;
    const Eigen::Vector3d v_rate = rate.head<3>(), w_rate = rate.tail<3>();
    bias = scaled(f.f3, 2 * wv * by3, model::bracket(rate, once)) +
           scaled(2 * w.dot(w_rate), 2 * (v.dot(w_rate) + w.dot(v_rate)),
                  scaled(by3, 2 * wv * by33, twice) - scaled(by2, 2 * wv * by22, once));
    Jr.P = f.f3 * ww - f.f2 * W;
    Jr.P.diagonal().array() += 1.0 - f.f3 * x;
    Jr.Q = f.f3 * (w * v.transpose() + v * w.transpose()) - f.f2 * lie::skew(v) +
           2 * wv * (by3 * ww - by2 * W);
    Jr.Q.diagonal().array() -= 2 * wv * (f.f3 + by3 * x);
  }
};

/// In a plane, that of space without what leaves it.
template <>
struct Span<lie::SE2> {
  lie::SE2 X;
  PlaneMatrix Jr;
  lie::SE2::Tangent own, bias;

  Span(const lie::SE2::Tangent& twist, const lie::SE2::Tangent& rate, bool with_matrix) {
    const Span<lie::SE3> span(lie::embed(twist), lie::embed(rate), with_matrix);
    X = {span.X.rotation.topLeftCorner<2, 2>(), span.X.translation.head<2>()};
    own = lie::project(span.own);
    if (!with_matrix) return;
    bias = lie::project(span.bias);
    Jr.P.setZero();
    Jr.P.topLeftCorner<2, 2>() = span.Jr.P.topLeftCorner<2, 2>();
    Jr.P.topRightCorner<2, 1>() = span.Jr.Q.topRightCorner<2, 1>();
    Jr.P(2, 2) = 1.0;
  }
};

}  // namespace helix_arm::dynamics
