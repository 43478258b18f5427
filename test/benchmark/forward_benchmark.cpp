// One call, inputs to tip pose, beside the peer's forward kinematics of six joints.
#include <utility>
#include <vector>

#include <benchmark/benchmark.h>
#include <kdl/chainfksolverpos_recursive.hpp>

#include "benchmark/six_joint_robot.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "support/paper_arm.hpp"
#include "support/tapered_arm.hpp"

namespace helix_arm::benchmark {
namespace {

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

void forwardPlanar(::benchmark::State& state) {
  const model::Contraction muscle = test::fig3Muscle();
  model::PlanarSection section;
  for (const double y : {0.0381, -0.0381}) {
    section.actuators.push_back({"muscle",
                                 {Eigen::Matrix2d::Identity(), {0, y}},
                                 {10, 0, 1.38e-4},
                                 muscle,
                                 muscle.inputRange()});
  }
  const model::PlanarArm arm({section});
  test::Random random(1);
  std::vector<Eigen::VectorXd> inputs;
  for (std::size_t i = 0; i < kInputs; ++i) {
    inputs.push_back(Eigen::Vector2d(random.uniform(0, test::kMaxPressure),
                                     random.uniform(0, test::kMaxPressure)));
  }
  std::size_t i = 0;
  for (auto _ : state) {
    lie::SE2 tip = arm.tip(inputs[i++ % kInputs]);
    ::benchmark::DoNotOptimize(tip);
  }
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
BENCHMARK_CAPTURE(forwardOf, helical_tapered, test::taperedArm(0.26));
BENCHMARK(forwardPlanar);
BENCHMARK(forwardOfPeer);

}  // namespace
}  // namespace helix_arm::benchmark
