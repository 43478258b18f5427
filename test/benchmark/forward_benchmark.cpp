// One call, inputs to tip pose, beside the peer's forward kinematics of six joints.
#include <vector>

#include <benchmark/benchmark.h>
#include <kdl/chainfksolverpos_recursive.hpp>

#include "benchmark/six_joint_robot.hpp"
#include "helix_arm/model/arm.hpp"
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
BENCHMARK_CAPTURE(forwardOf, tapered, test::taperedArm());
BENCHMARK_CAPTURE(forwardOf, helical_tapered, test::taperedArm(0.26));
BENCHMARK(forwardPlanar);
BENCHMARK(forwardOfPeer);

}  // namespace
}  // namespace helix_arm::benchmark
