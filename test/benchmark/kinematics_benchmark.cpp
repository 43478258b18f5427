// One call, inputs to tip pose, beside the peer's forward kinematics of six joints.
#include <algorithm>
#include <utility>
#include <vector>

#include <benchmark/benchmark.h>
#include <kdl/chain.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainiksolverpos_lma.hpp>
#include <kdl/chainiksolverpos_nr_jl.hpp>
#include <kdl/chainiksolvervel_pinv.hpp>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "support/paper_arm.hpp"
#include "support/tapered_arm.hpp"

namespace helix_arm::benchmark {
namespace {

// A six-joint industrial arm (the PUMA 560's Denavit-Hartenberg table): what the peer library's
// solvers are made for.
KDL::Chain sixJointRobot() {
  constexpr double kQuarterTurn = 1.5707963267948966;
  const KDL::Joint joint(KDL::Joint::RotZ);
  KDL::Chain chain;
  chain.addSegment(KDL::Segment(joint, KDL::Frame::DH(0.0, kQuarterTurn, 0.0, 0.0)));
  chain.addSegment(KDL::Segment(joint, KDL::Frame::DH(0.4318, 0.0, 0.0, 0.0)));
  chain.addSegment(KDL::Segment(joint, KDL::Frame::DH(0.0203, -kQuarterTurn, 0.15005, 0.0)));
  chain.addSegment(KDL::Segment(joint, KDL::Frame::DH(0.0, kQuarterTurn, 0.4318, 0.0)));
  chain.addSegment(KDL::Segment(joint, KDL::Frame::DH(0.0, -kQuarterTurn, 0.0, 0.0)));
  chain.addSegment(KDL::Segment(joint, KDL::Frame::DH(0.0, 0.0, 0.0563, 0.0)));
  return chain;
}

constexpr std::size_t kInputs = 1024;  // different ones, so that no branch is learned by heart

void forwardOf(::benchmark::State& state, const model::Arm& arm) {
  test::Random random(1);
  std::vector<Eigen::VectorXd> inputs;
  for (std::size_t i = 0; i < kInputs; ++i) inputs.push_back(test::randomInput(arm, random));
  std::size_t i = 0;
  for (auto _ : state) {
    lie::SE3 tip = arm.tip(inputs[i++ % kInputs]);
    ::benchmark::DoNotOptimize(tip);
  }
}

// The same with lag and two plays on each muscle: pressures that ramp between random ones, at times
// that are not evenly spaced.
void forwardWithResponse(::benchmark::State& state) {
  const model::Arm plain = test::ringArm(test::helicalRing());
  std::vector<model::Section> sections(1);
  for (int k = 0; k < plain.actuatorCount(); ++k) {
    sections[0].actuators.push_back(plain.actuator(k));
    sections[0].actuators.back().response = {0.5, 1.0, 2, {{{2e4, 0.3}, {6e4, 0.4}}}};
  }
  const model::Arm arm(std::move(sections));
  model::ArmResponse response(arm);
  test::Random random(1);
  std::vector<Eigen::VectorXd> inputs;
  std::vector<double> steps;
  constexpr std::size_t kRamp = 64;
  Eigen::VectorXd from = test::randomInput(arm, random), to = from;
  for (std::size_t i = 0; i < kInputs; ++i) {
    if (i % kRamp == 0) {
      from = to;
      to = test::randomInput(arm, random);
    }
    const double part = static_cast<double>(i % kRamp) / kRamp;
    inputs.emplace_back(from + part * (to - from));
    steps.push_back(random.uniform(0.005, 0.015));
  }
  std::size_t i = 0;
  double time = 0;
  for (auto _ : state) {
    time += steps[i % kInputs];
    response.follow(time, inputs[i++ % kInputs]);
    lie::SE3 tip = arm.tip(response.effective());
    ::benchmark::DoNotOptimize(tip);
  }
}

void forward(::benchmark::State& state, const test::Ring& ring) {
  forwardOf(state, test::ringArm(ring));
}

void forwardOfPeer(::benchmark::State& state) {
  const KDL::Chain chain = sixJointRobot();  // the solver keeps a reference
  KDL::ChainFkSolverPos_recursive solver(chain);
  test::Random random(1);
  std::vector<KDL::JntArray> inputs(kInputs, KDL::JntArray(6));
  for (auto& joints : inputs) {
    for (unsigned k = 0; k < 6; ++k) joints(k) = random.uniform(-2, 2);
  }
  KDL::Frame tip;
  std::size_t i = 0;
  for (auto _ : state) {
    solver.JntToCart(inputs[i++ % kInputs], tip);
    ::benchmark::DoNotOptimize(tip);
  }
}

BENCHMARK_CAPTURE(forward, straight, test::straightRing());
BENCHMARK_CAPTURE(forward, helical, test::helicalRing());
BENCHMARK(forwardWithResponse);
BENCHMARK_CAPTURE(forwardOf, tapered, test::taperedArm());
BENCHMARK(forwardOfPeer);

// Warm inverse along a path: every target starts from the answer to the one before it, and is met
// within 1e-6 m.
//
// Both sides walk at random in their inputs, each step moving its tip by about a hundredth of its
// reach.

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
