#include "shape_motion.hpp"

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <utility>

#include "basics/pi.hpp"
#include "lie/coefficients.hpp"

namespace helix_arm::statics {

Motions velocitiesOf(const lie::SE3& tip, const Motions& motions) {
  Motions out = motions;
  out.topRows<3>() -= lie::skew(tip.translation) * motions.bottomRows<3>();
  return out;
}

ShapeDerivative shapeDerivative(const model::Shape& shape, const std::vector<Motions>& ends) {
  const Eigen::Index columns = ends.front().cols();
  ShapeDerivative out{Motions(), Eigen::MatrixXd::Zero(6 * shape.sectionCount(), columns)};
  lie::SE3 X;
  for (int j = 0; j < shape.pieces().cols(); ++j) {
    const lie::Vector6 g = shape.pieces().col(j);
    const lie::SE3 end = X * lie::SE3::exp(g);
    Motions relative = ends[j];
    if (j > 0) relative -= ends[j - 1];
    out.twists.middleRows<6>(6 * (j / shape.piecesPerSection())) +=
        lie::SE3::rightJacobianInverse(g) * end.inverse().adjoint() * relative;
    X = shape.beyond(X, j);
  }
  out.tip = velocitiesOf(X, ends.back());
  return out;
}

ShapeDerivative constantDerivative(int sections, int columns, double value) {
  return {Motions::Constant(6, columns, value),
          Eigen::MatrixXd::Constant(6 * sections, columns, value)};
}

ShapeResponse withoutDerivative(Solution at, int columns) {
  const int sections = at.shape.sectionCount();
  return {std::move(at),
          constantDerivative(sections, columns, std::numeric_limits<double>::quiet_NaN())};
}

lie::Vector6 twistNear(const lie::SE3& X, const Eigen::Vector3d& near) {
  constexpr double kTurn = 2 * basics::kPi;
  const lie::Vector6 xi = X.log();
  const double angle = xi.tail<3>().norm();
  const double along = angle > 0 ? near.dot(xi.tail<3>()) / angle : 0.0;
  const double turns = std::round((along - angle) / kTurn);
  if (turns == 0) return xi;
  const Eigen::Vector3d w = xi.tail<3>() * ((angle + turns * kTurn) / angle);
  const auto f = lie::expCoefficients(w.squaredNorm());
  const Eigen::Matrix3d V =
      f.a * Eigen::Matrix3d::Identity() + f.b * lie::skew(w) + f.c * (w * w.transpose()).eval();
  lie::Vector6 out;
  out << V.fullPivLu().solve(X.translation), w;
  return out;
}

}  // namespace helix_arm::statics
