// The linear map against the pseudo-inverse in 80 digits, over the extremes an arm may be built
// with.
#include "helix_arm/model/equilibrium.hpp"

#include <Eigen/Cholesky>
#include <cstdio>

#include <gtest/gtest.h>

#include "support/high_precision.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::model {
namespace {

using test::Real;
using test::RealMatrix;

// Ad(X)^-1 from its definition, [R' -R' [p]; 0 R'].
RealMatrix adjointInverse(const lie::SE3& X) {
  const RealMatrix R = X.rotation.cast<Real>(), p = lie::skew(X.translation).cast<Real>();
  RealMatrix Ad = RealMatrix::Zero(6, 6);
  Ad.topLeftCorner(3, 3) = Ad.bottomRightCorner(3, 3) = R.transpose();
  Ad.topRightCorner(3, 3) = -R.transpose() * p;
  return Ad;
}

// A+ D with A and D summed as eq. 15-17 print them. Where A is singular its null space N is known
// beforehand, and A+ = (A + N N')^-1 - N N'.
RealMatrix mapByDefinition(const std::vector<ActuatorElement<lie::SE3>>& elements,
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

struct Case {
  std::string name;
  std::vector<ActuatorElement<lie::SE3>> elements;
  int free_twist = -1;  // the entry of the twist that nothing resists
  int rank() const { return free_twist < 0 ? 6 : 5; }
  RealMatrix nullSpace() const {
    if (free_twist < 0) return RealMatrix::Zero(6, 0);
    return lie::Vector6::Unit(free_twist).cast<Real>();
  }
};

std::vector<ActuatorElement<lie::SE3>> ring(int count, double radius, double tilt,
                                            const lie::SE3::Tangent& K) {
  std::vector<ActuatorElement<lie::SE3>> elements;
  for (int i = 0; i < count; ++i) elements.push_back({test::ringPose(i, count, radius, tilt), K});
  return elements;
}

lie::SE3::Tangent stiffness(double gamma, double tau, double kappa) {
  return Stiffness{gamma, tau, kappa}.diagonal<lie::SE3>();
}

// Two muscles in the x-y plane, without a turn of their frames: every zero of theirs is exact.
std::vector<ActuatorElement<lie::SE3>> flatPair(double offset, const lie::SE3::Tangent& K) {
  return {{{Eigen::Matrix3d::Identity(), {0, offset, 0}}, K},
          {{Eigen::Matrix3d::Identity(), {0, -offset, 0}}, K}};
}

std::vector<Case> cases() {
  const double tilt = 15 * test::kPi / 180;
  std::vector<Case> all;
  for (const double radius : {5e-5, 1e-4, 0.0254, 1.0}) {
    for (const double gamma : {1.0, 1e2, 1e6, 1e12}) {
      for (const double kappa : {1e-12, 9.8e-5, 1e2}) {
        for (const double angle : {0.0, tilt}) {
          char name[120];
          std::snprintf(name, sizeof name, "ring of 3, r %g m, tilt %.2g, K_gamma %g, K_kappa %g",
                        radius, angle, gamma, kappa);
          all.push_back({name, ring(3, radius, angle, stiffness(gamma, 0, kappa))});
        }
      }
    }
  }
  for (const int count : {4, 6, 24})
    all.push_back(
        {"ring of " + std::to_string(count), ring(count, 0.03, tilt, stiffness(100, 1e-5, 1e-4))});
  all.push_back({"planar pair", flatPair(0.0381, stiffness(10, 0, 1.38e-4))});
  const lie::SE3 centred;
  all.push_back({"one centred muscle, K_tau = 0", {{centred, stiffness(10, 0, 1e-4)}}, 3});
  all.push_back({"one centred muscle, K_tau > 0", {{centred, stiffness(10, 1e-5, 1e-4)}}});
  for (const double offset : {1e-20, 1e-17, 1e-12, 1e-6}) {
    const lie::SE3 almost{Eigen::Matrix3d::Identity(), {0, offset, 0}};
    all.push_back(
        {"one muscle " + std::to_string(offset) + " m off", {{almost, stiffness(10, 1e-5, 1e-4)}}});
  }
  all.push_back({"planar pair, K_kappa = 0", flatPair(0.0381, stiffness(10, 0, 0)), 4});
  lie::SE3::Tangent printed;
  printed << 1, 10, 10, 0, 0, 1.38e-4;  // the paper's own K, with one entry of bending
  all.push_back({"planar pair, K as printed", flatPair(0.0381, printed), 4});
  return all;
}

// Relative error of the rows from `first` on, or of nothing where they are zero.
double blockError(const RealMatrix& map, const RealMatrix& reference, int first) {
  const RealMatrix block = reference.middleRows(first, 3);
  if (block.norm() < Real(1e-12) * reference.norm()) return 0.0;
  return test::relativeEps(map.middleRows(first, 3), block) * test::kEps;
}

TEST(Equilibrium, MatchesThePseudoInverseIn80Digits) {
  double worst_v = 0, worst_w = 0;
  std::string worst_name;
  int arms = 0;
  for (const Case& c : cases()) {
    const Equilibrium<lie::SE3> result = solveEquilibrium(c.elements);
    EXPECT_EQ(result.rank, c.rank()) << c.name;
    EXPECT_EQ(result.null_space.cols(), 6 - c.rank()) << c.name;
    EXPECT_GE(result.condition, 1.0) << c.name;
    const RealMatrix map = result.map.cast<Real>();
    const RealMatrix reference = mapByDefinition(c.elements, c.nullSpace());
    const double v = blockError(map, reference, 0), w = blockError(map, reference, 3);
    EXPECT_LE(v, 1e-14) << c.name;
    // Muscles too stiff to bend over so short a lever: what little bending is left loses digits.
    const double lever = c.elements.front().X_O.translation.norm();
    const bool rigid = c.elements.front().K[5] > 1e8 * lever * lever;
    EXPECT_LE(w, rigid ? 1e-11 : 1e-14) << c.name;
    if (std::max(v, w) > std::max(worst_v, worst_w)) worst_name = c.name;
    worst_v = std::max(worst_v, v);
    worst_w = std::max(worst_w, w);
    ++arms;
  }
  std::printf("%d arms, worst relative error of v %.2g, of w %.2g (%s)\n", arms, worst_v, worst_w,
              worst_name.c_str());
}

TEST(Equilibrium, ReproducesTheHelicalArmOfErratum3) {
  // z-curvature at 60 psi in muscle 1 for three shear stiffnesses.
  const Contraction muscle = test::fig3Muscle();
  const Eigen::Vector3d l(muscle.length(test::kMaxPressure), muscle.length(0), muscle.length(0));
  for (const auto& [gamma, expected] :
       {std::pair{10.0, 1.455}, std::pair{100.0, 0.502}, std::pair{1000.0, 0.066}}) {
    const lie::Vector6 g =
        solveEquilibrium(ring(3, 0.0254, 15 * test::kPi / 180, stiffness(gamma, 0, 9.8e-5))).map *
        l;
    EXPECT_NEAR(g[5], expected, 1e-3) << gamma;
  }
}

}  // namespace
}  // namespace helix_arm::model
