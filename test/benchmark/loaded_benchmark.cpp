// Tip of a loaded arm by every tier, beside a peer: what laboratories write to shoot at a Cosserat
// rod. 45 cases hanging and 45 horizontal, of the helical arm of 50.8 mm at the shear stiffness
// where loads bend it most and at that of its scene. Each call takes inputs to a tip; `error` is
// the largest of the 45 tips' errors against the exact tier at its finest tolerance, in % of the
// arm's length. The peer errs more than order 5 in 20 steps, and less in 100.
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <vector>

#include <benchmark/benchmark.h>

#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "support/loaded_arm.hpp"

namespace helix_arm::benchmark {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using lie::Vector6;
using test::Posture;

// RK4 on position, quaternion, force and moment; Newton's method on the force and moment at the
// base with a Jacobian by forward differences.
class PeerShooting {
 public:
  PeerShooting(const model::Arm& arm, const statics::Load& load, int steps)
      : compliance_(arm.freeLength(0) / load.K_eps[0] * arm.equilibrium(0).compliance),
        weight_(load.mass[0] * load.gravity),
        size_(arm.freeLength(0)),
        steps_(steps) {
    // Forces of 1 N and the moments that they make: one unit for all unknowns.
    unit_ << Vector3d::Ones(), Vector3d::Constant(size_);
  }

  // False where Newton's method does not come to rest.
  bool tip(const Vector6& unloaded, Vector3d& tip) const {
    constexpr int kMaxIterations = 30;
    constexpr double kTolerance = 1e-8, kDifference = 1e-6;
    Vector6 wrench;  // at the base: the first guess is a force that carries the weight
    wrench << weight_, Vector3d::Zero();
    for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
      const Vector6 miss = shoot(unloaded, wrench, tip);
      if (miss.norm() < kTolerance) return true;
      Eigen::Matrix<double, 6, 6> J;
      for (int i = 0; i < 6; ++i) {
        Vector6 moved = wrench;
        moved[i] += kDifference * unit_[i];
        Vector3d ignored;
        J.col(i) = (shoot(unloaded, moved, ignored) - miss) / kDifference;
      }
      wrench -= unit_.cwiseProduct(J.partialPivLu().solve(miss));
    }
    return false;
  }

 private:
  using State = Eigen::Matrix<double, 13, 1>;  // position, quaternion (x y z w), force, moment

  State slope(const Vector6& unloaded, const State& y) const {
    const Quaterniond q(y[6], y[3], y[4], y[5]);
    const Eigen::Matrix3d R = q.toRotationMatrix();
    const Vector3d force = y.segment<3>(7), moment = y.tail<3>();
    Vector6 wrench;
    wrench << R.transpose() * force, R.transpose() * moment;
    const Vector6 g = unloaded + compliance_ * wrench;
    const Vector3d v = R * g.head<3>();
    State dy;
    dy << v, 0.5 * (q * Quaterniond(0, g[3], g[4], g[5])).coeffs(), -weight_, force.cross(v);
    return dy;
  }

  // Force and moment left over at the tip, in their units.
  Vector6 shoot(const Vector6& unloaded, const Vector6& wrench, Vector3d& tip) const {
    State y;
    y << Vector3d::Zero(), 0, 0, 0, 1, wrench;
    const double h = 1.0 / steps_;
    for (int i = 0; i < steps_; ++i) {
      const State k1 = slope(unloaded, y);
      const State k2 = slope(unloaded, y + 0.5 * h * k1);
      const State k3 = slope(unloaded, y + 0.5 * h * k2);
      const State k4 = slope(unloaded, y + h * k3);
      y += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
      y.segment<4>(3).normalize();
    }
    tip = y.head<3>();
    return y.tail<6>().cwiseQuotient(unit_);
  }

  lie::Matrix6 compliance_;
  Vector3d weight_;
  double size_;  // [m]
  int steps_;
  Vector6 unit_;
};

// Solves the cases in turn and returns the largest error. A solver computes a tip from inputs and
// returns whether it converged.
template <class Make>
void solveCases(::benchmark::State& state, const model::Arm& arm, Posture posture,
                const Make& solverOf) {
  const std::vector<test::LoadedCase> cases = test::loadedCases(posture);
  using Solver = decltype(solverOf(cases.front().load));
  std::vector<Solver> solvers;
  statics::ExactOptions finest;
  finest.tolerance = 1e-13;
  double error = 0.0;
  for (const test::LoadedCase& loaded : cases) {
    solvers.push_back(solverOf(loaded.load));
    const statics::Solution truth =
        statics::ExactArm(arm, loaded.load, finest).solve(arm.twists(loaded.input));
    Vector3d tip;
    if (!truth.converged() || !solvers.back()(loaded.input, tip)) {
      state.SkipWithError("a case was not solved");
      return;
    }
    error = std::max(error, (tip - truth.tip.translation).norm() / arm.restLength(0));
  }
  std::size_t i = 0;
  for (auto _ : state) {
    Vector3d tip;
    solvers[i](cases[i].input, tip);
    ::benchmark::DoNotOptimize(tip);
    i = (i + 1) % cases.size();
  }
  state.counters["error"] = 100 * error;
}

void linear(::benchmark::State& state, const model::Arm& arm, Posture posture) {
  solveCases(state, arm, posture, [&arm](const statics::Load&) {
    return [&arm](const Eigen::VectorXd& q, Vector3d& tip) {
      tip = arm.tip(q).translation;
      return true;
    };
  });
}

void loaded(::benchmark::State& state, const model::Arm& arm, Posture posture) {
  const int order = static_cast<int>(state.range(0));
  solveCases(state, arm, posture, [&arm, order](const statics::Load& load) {
    return [&arm, solver = statics::LoadedArm(arm, load, order)](const Eigen::VectorXd& q,
                                                                 Vector3d& tip) {
      const statics::Tip found = solver.tip(arm.twists(q));
      tip = found.tip.translation;
      return found.status == statics::SolveStatus::kConverged;
    };
  });
}

void exact(::benchmark::State& state, const model::Arm& arm, Posture posture) {
  solveCases(state, arm, posture, [&arm](const statics::Load& load) {
    return [&arm, solver = statics::ExactArm(arm, load)](const Eigen::VectorXd& q, Vector3d& tip) {
      const statics::Solution found = solver.solve(arm.twists(q));
      tip = found.tip.translation;
      return found.converged();
    };
  });
}

void loadedOfPeer(::benchmark::State& state, const model::Arm& arm, Posture posture) {
  const int steps = static_cast<int>(state.range(0));
  solveCases(state, arm, posture, [&arm, steps](const statics::Load& load) {
    return
        [&arm, solver = PeerShooting(arm, load, steps)](const Eigen::VectorXd& q, Vector3d& tip) {
          return solver.tip(arm.twists(q).col(0), tip);
        };
  });
}

model::Arm sceneArm() { return test::ringArm(test::helicalRing()); }

#define HELIX_ARM_ALL_TIERS(name, arm, posture)                                  \
  BENCHMARK_CAPTURE(linear, name, arm, posture);                                 \
  BENCHMARK_CAPTURE(loaded, name, arm, posture)                                  \
      ->DenseRange(statics::kLeastOrder, statics::kMostOrder)                    \
      ->Unit(::benchmark::kMicrosecond);                                         \
  BENCHMARK_CAPTURE(exact, name, arm, posture)->Unit(::benchmark::kMicrosecond); \
  BENCHMARK_CAPTURE(loadedOfPeer, name, arm, posture)                            \
      ->Arg(20)                                                                  \
      ->Arg(100)                                                                 \
      ->Unit(::benchmark::kMicrosecond)

HELIX_ARM_ALL_TIERS(soft_hanging, test::softHelicalArm(), Posture::kHanging);
HELIX_ARM_ALL_TIERS(soft_horizontal, test::softHelicalArm(), Posture::kHorizontal);
HELIX_ARM_ALL_TIERS(scene_hanging, sceneArm(), Posture::kHanging);
HELIX_ARM_ALL_TIERS(scene_horizontal, sceneArm(), Posture::kHorizontal);

}  // namespace
}  // namespace helix_arm::benchmark
