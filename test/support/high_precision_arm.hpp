#pragma once

#include <Eigen/Cholesky>

#include "helix_arm/model/arm.hpp"
#include "support/high_precision.hpp"

/// Arms by their definitions in 80-digit arithmetic.
namespace helix_arm::test {

/// Ad(X)^-1 from its definition, [R' -R' [p]; 0 R'].
inline RealMatrix adjointInverse(const lie::SE3& X) {
  const RealMatrix R = X.rotation.cast<Real>(), p = lie::skew(X.translation).cast<Real>();
  RealMatrix Ad = RealMatrix::Zero(6, 6);
  Ad.topLeftCorner(3, 3) = Ad.bottomRightCorner(3, 3) = R.transpose();
  Ad.topRightCorner(3, 3) = -R.transpose() * p;
  return Ad;
}

/// A+ D with A and D summed as eq. 15-17 print them. Where A is singular its null space N is known
/// beforehand, and A+ = (A + N N')^-1 - N N'.
inline RealMatrix mapByDefinition(const std::vector<model::ActuatorElement<lie::SE3>>& elements,
                                  const RealMatrix& N) {
  const int n = static_cast<int>(elements.size());
  RealMatrix A = N * N.transpose(), D = RealMatrix::Zero(6, n);
  for (int i = 0; i < n; ++i) {
    const RealMatrix Ad_oi = adjointInverse(elements[i].X_O),
                     K = elements[i].K.asDiagonal().toDenseMatrix().cast<Real>();
    A += Ad_oi.transpose() * K * Ad_oi;
    D.col(i) = Ad_oi.transpose() * K.col(0);
  }
  return A.llt().solve(D) - N * (N.transpose() * D);
}

/// l(q) - l(0) of the polynomial that the curve is stored as.
inline Real changeByDefinition(const model::Contraction& contraction, double q) {
  const auto& pieces = contraction.pieces();
  std::size_t j = 0;
  while (j + 1 < pieces.size() && q >= pieces[j + 1].start) ++j;
  const Real u = (Real(q) - Real(pieces[j].start)) * Real(pieces[j].inverse_scale);
  Real sum = 0;
  for (int k = 5; k >= 0; --k) sum = sum * u + Real(pieces[j].coefficients[k]);
  return sum;
}

/// Twists (6 x sections) of an arm at inputs q, every section with the null space N.
inline RealMatrix twistsByDefinition(const model::Arm& arm, const Eigen::VectorXd& q,
                                     const RealMatrix& N) {
  RealMatrix out(6, arm.sectionCount());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    std::vector<model::ActuatorElement<lie::SE3>> elements;
    RealMatrix lengths(arm.firstActuator(k + 1) - arm.firstActuator(k), 1);
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      const model::Actuator& actuator = arm.actuator(i);
      elements.push_back({actuator.X_O, actuator.stiffness.diagonal<lie::SE3>()});
      lengths(i - arm.firstActuator(k), 0) =
          Real(actuator.contraction.restLength()) + changeByDefinition(actuator.contraction, q[i]);
    }
    out.col(k) = mapByDefinition(elements, N) * lengths;
  }
  return out;
}

/// Homogeneous matrix of the pose at s in [0, sections] of a curve of constant twists.
inline RealMatrix poseByDefinition(const RealMatrix& twists, double s) {
  RealMatrix X = RealMatrix::Identity(4, 4);
  for (int k = 0; k < twists.cols() && k < s; ++k) {
    const RealMatrix xi = twists.col(k) * Real(s < k + 1 ? s - k : 1.0);
    RealMatrix M = RealMatrix::Zero(4, 4);
    M(0, 1) = -xi(5);
    M(1, 0) = xi(5);
    M(0, 2) = xi(4);
    M(2, 0) = -xi(4);
    M(1, 2) = -xi(3);
    M(2, 1) = xi(3);
    M.topRightCorner(3, 1) = xi.topRows(3);
    X = (X * expOfMatrix(M)).eval();
  }
  return X;
}

}  // namespace helix_arm::test
