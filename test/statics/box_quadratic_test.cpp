#include "statics/inverse/box_quadratic.hpp"

#include <gtest/gtest.h>

#include "support/random.hpp"

namespace helix_arm::statics {
namespace {

TEST(BoxQuadratic, MeetsTheOptimalityConditions) {
  test::Random random(81);
  int at_bounds = 0, free = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    const int n = random.integer(1, 12);
    BoxQuadratic problem(n);
    Eigen::MatrixXd J(random.integer(1, 8), n);
    for (int i = 0; i < J.size(); ++i) J(i) = random.uniform(-1, 1);
    problem.H = J.transpose() * J + 1e-3 * Eigen::MatrixXd::Identity(n, n);
    for (int i = 0; i < n; ++i) {
      problem.g[i] = random.uniform(-1, 1);
      problem.lower[i] = random.uniform(0, 1) < 0.2 ? 0 : -random.logUniform(1e-3, 10);
      problem.upper[i] = random.uniform(0, 1) < 0.2 ? 0 : random.logUniform(1e-3, 10);
    }
    const Eigen::VectorXd x = problem.solve();
    const Eigen::VectorXd gradient = problem.H * x + problem.g;
    for (int i = 0; i < n; ++i) {
      EXPECT_GE(x[i], problem.lower[i]);
      EXPECT_LE(x[i], problem.upper[i]);
      const bool at_lower = x[i] <= problem.lower[i], at_upper = x[i] >= problem.upper[i];
      at_lower || at_upper ? ++at_bounds : ++free;
      // Zero inside, pushing outwards at a bound.
      EXPECT_TRUE(at_lower || gradient[i] < 1e-8) << "n " << n << " trial " << trial;
      EXPECT_TRUE(at_upper || gradient[i] > -1e-8) << "n " << n << " trial " << trial;
    }
  }
  EXPECT_GT(at_bounds, 1000);
  EXPECT_GT(free, 1000);
}

}  // namespace
}  // namespace helix_arm::statics
