// Warm inverse along a path: every target starts from the answer to the one before it, and is met
// within 1e-6 m.
//
// Both sides walk at random in their inputs, each step moving its tip by about a hundredth of its
// reach.
#include <algorithm>
#include <stdexcept>
#include <vector>

#include <benchmark/benchmark.h>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainiksolverpos_lma.hpp>
#include <kdl/chainiksolverpos_nr_jl.hpp>
#include <kdl/chainiksolvervel_pinv.hpp>

#include "benchmark/six_joint_robot.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::benchmark {
namespace {

constexpr int kTargets = 1000;
constexpr double kTolerance = 1e-6;  // [m], and [rad] where the peer asks for one number

void inverse(::benchmark::State& state, const test::Ring& ring) {
  const model::Arm arm = test::ringArm(ring);
  statics::InverseOptions options;
  options.position_tolerance = kTolerance;
  statics::InverseSolver solver(arm, options);
  test::Random random(2);
  Eigen::VectorXd q = arm.inputAt(0.5);
  std::vector<Eigen::Vector3d> targets;
  for (int i = 0; i < kTargets; ++i) {
    for (int k = 0; k < q.size(); ++k) {
      q[k] = std::clamp(q[k] + random.uniform(-5e3, 5e3), 1e4, 4e5);
    }
    targets.push_back(arm.tip(q).translation);
  }
  Eigen::VectorXd command = arm.inputAt(0.5);
  double path = 0.0;
  std::size_t i = 0;
  for (auto _ : state) {
    if (i == kTargets) {
      i = 0;
      command = arm.inputAt(0.5);
    }
    const statics::InverseResult& result = solver.toPosition(targets[i++], command);
    if (result.status != statics::InverseStatus::kReached)
      state.SkipWithError("a target was not reached");
    command = result.input;
  }
  for (int k = 1; k < kTargets; ++k) path += (targets[k] - targets[k - 1]).norm();
  state.counters["step_mm"] = 1e3 * path / (kTargets - 1);
}

template <class Solver>
void inverseOfPeer(::benchmark::State& state, Solver& solver) {
  const KDL::Chain chain = sixJointRobot();  // the solvers keep references
  KDL::ChainFkSolverPos_recursive forward(chain);
  test::Random random(2);
  KDL::JntArray start(6);
  for (unsigned k = 0; k < 6; ++k) start(k) = 0.3 + 0.2 * k;  // away from its singular poses
  KDL::JntArray q = start;
  std::vector<KDL::Frame> targets(kTargets);
  for (auto& target : targets) {
    for (unsigned k = 0; k < 6; ++k) {
      q(k) = std::clamp(q(k) + random.uniform(-0.02, 0.02), start(k) - 0.3, start(k) + 0.3);
    }
    forward.JntToCart(q, target);
  }
  KDL::JntArray command = start, answer(6);
  double path = 0.0;
  std::size_t i = 0;
  for (auto _ : state) {
    if (i == kTargets) {
      i = 0;
      command = start;
    }
    if (solver.CartToJnt(command, targets[i++], answer) < 0)
      state.SkipWithError("a target was not reached");
    command = answer;
  }
  for (int k = 1; k < kTargets; ++k) path += (targets[k].p - targets[k - 1].p).Norm();
  state.counters["step_mm"] = 1e3 * path / (kTargets - 1);
}

void inverseOfPeerLma(::benchmark::State& state) {
  const KDL::Chain chain = sixJointRobot();
  KDL::ChainIkSolverPos_LMA solver(chain, kTolerance);
  inverseOfPeer(state, solver);
}

void inverseOfPeerNrJl(::benchmark::State& state) {
  const KDL::Chain chain = sixJointRobot();
  KDL::ChainFkSolverPos_recursive forward(chain);
  KDL::ChainIkSolverVel_pinv velocity(chain);
  KDL::JntArray lower(6), upper(6);
  for (unsigned k = 0; k < 6; ++k) {
    lower(k) = -6;
    upper(k) = 6;
  }
  KDL::ChainIkSolverPos_NR_JL solver(chain, lower, upper, forward, velocity, 100, kTolerance);
  inverseOfPeer(state, solver);
}

BENCHMARK_CAPTURE(inverse, straight, test::straightRing());
BENCHMARK_CAPTURE(inverse, helical, test::helicalRing());
BENCHMARK(inverseOfPeerLma);
BENCHMARK(inverseOfPeerNrJl);

}  // namespace
}  // namespace helix_arm::benchmark
