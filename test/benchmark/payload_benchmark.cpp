// The force that a place carries, beside what a laboratory writes with a general optimiser: bounded
// least squares of Ceres over the lengths, with derivatives by differences. Both answer the same
// question by the same model; missed_percent is by how much the peer found more.
#include <algorithm>
#include <cmath>
#include <vector>

#include <benchmark/benchmark.h>
#include <ceres/ceres.h>

#include "helix_arm/statics/payload.hpp"
#include "support/loaded_arm.hpp"

namespace helix_arm::benchmark {
namespace {

using Eigen::Vector3d;
using namespace statics;

constexpr int kMuscles = 3, kCases = 20;

const ArmModel& horizontalArm() {
  static const ArmModel model(test::softHelicalArm(), std::nullopt, test::horizontalLoad(),
                              TierSetting{Tier::kLoaded, 5});
  return model;
}

struct Case {
  Vector3d tip, direction;
};
const std::vector<Case>& cases() {
  static const std::vector<Case> all = [] {
    test::Random random(1);
    std::vector<Case> out;
    for (int i = 0; i < kCases; ++i) {
      const Solution at = horizontalArm().solve(test::randomInput(horizontalArm().arm(), random));
      Vector3d direction = random.direction<3>();
      direction.x() = std::abs(direction.x());  // pulls: nothing buckles
      out.push_back({at.tip.translation, direction.normalized()});
    }
    return out;
  }();
  return all;
}

// Free length of a muscle at a fraction of its range, also beyond it, where differences go.
double lengthAt(int i, double fraction) {
  const model::Actuator& muscle = horizontalArm().arm().actuator(i);
  const double rest = muscle.contraction.restLength();
  return rest + fraction * (muscle.contraction.lengthInside(muscle.limits.upper) - rest);
}

// Lengths as fractions of their ranges. @return the cost.
double solveByCeres(ceres::CostFunction* cost, double* fraction) {
  ceres::Problem problem;
  problem.AddResidualBlock(cost, nullptr, fraction);
  for (int i = 0; i < kMuscles; ++i) {
    problem.SetParameterLowerBound(fraction, i, 0.0);
    problem.SetParameterUpperBound(fraction, i, 1.0);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 50;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary.final_cost;
}

struct TipResidual {
  ArmModel model;
  Vector3d tip;

  bool operator()(const double* fraction, double* residual) const {
    const Tip found = model.tipOfLengths(
        Vector3d(lengthAt(0, fraction[0]), lengthAt(1, fraction[1]), lengthAt(2, fraction[2])));
    if (!found.converged()) return false;
    Vector3d::Map(residual) = found.tip.translation - tip;
    return true;
  }
};

// Bisection from the same first bracket, each search from the answer before.
double payloadByCeres(const Case& one, double tolerance) {
  using Cost = ceres::NumericDiffCostFunction<TipResidual, ceres::CENTRAL, 3, kMuscles>;
  double held = 0, beyond = 1;
  std::vector<double> fraction{0.5, 0.5, 0.5};
  const auto holds = [&](double force) {
    Load load = *horizontalArm().load();
    PointLoad point;
    point.force = force * one.direction;
    load.points.push_back(point);
    std::vector<double> trial = fraction;
    auto* const residual = new TipResidual{
        ArmModel(horizontalArm().arm(), std::nullopt, load, TierSetting{Tier::kLoaded, 5}),
        one.tip};
    const double cost = solveByCeres(new Cost(residual), trial.data());
    const bool held_there = std::sqrt(2 * cost) <= tolerance;
    if (held_there) fraction = trial;
    return held_there;
  };
  while (holds(beyond)) {
    held = beyond;
    beyond *= 2;
  }
  while (beyond - held > 1e-3 * beyond) {
    const double middle = 0.5 * (held + beyond);
    (holds(middle) ? held : beyond) = middle;
  }
  return held;
}

void payload(::benchmark::State& state) {
  PayloadSolver solver(horizontalArm());
  std::size_t i = 0;
  double worst = 0;
  for (auto _ : state) {
    const Case& one = cases()[i++ % kCases];
    solver.moveTo(one.tip);
    const double force = solver.along(one.direction).force;
    state.PauseTiming();
    if (i <= kCases) {
      const double peer = payloadByCeres(one, solver.positionTolerance());
      worst = std::max(worst, 100 * (peer - force) / force);
    }
    state.ResumeTiming();
  }
  state.counters["missed_percent"] = worst;
}
BENCHMARK(payload)->Unit(::benchmark::kMillisecond);

// Pushes from the tip towards the base, under which the arm buckles.
void payloadAtBuckling(::benchmark::State& state) {
  PayloadSolver solver(horizontalArm());
  std::size_t i = 0, buckled = 0;
  for (auto _ : state) {
    const Case& one = cases()[i++ % kCases];
    solver.moveTo(one.tip);
    buckled += solver.along(-one.tip).end == PayloadEnd::kUnstable;
  }
  state.counters["buckled_percent"] = 100.0 * buckled / i;
}
BENCHMARK(payloadAtBuckling)->Unit(::benchmark::kMillisecond);

void payloadOfPeer(::benchmark::State& state) {
  const double tolerance = PayloadSolver(horizontalArm()).positionTolerance();
  std::size_t i = 0;
  for (auto _ : state) {
    ::benchmark::DoNotOptimize(payloadByCeres(cases()[i++ % kCases], tolerance));
  }
}
BENCHMARK(payloadOfPeer)->Unit(::benchmark::kMillisecond);

}  // namespace
}  // namespace helix_arm::benchmark
