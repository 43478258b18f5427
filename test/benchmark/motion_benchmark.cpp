// A second of motion of a hanging helical arm of one and two sections, whose pressures change
// within 0.1 s, beside a peer: the classical Runge-Kutta method on the same equations, as other
// simulators take it, at the longest step of 1 / 2^k ms at which it is stable. `real_time_factor`
// is the time moved over the processor's, `error` the RMS of the tip against steps of 0.25 ms, in %
// of the arm's length.
#include <Eigen/Cholesky>
#include <cmath>
#include <vector>

#include <benchmark/benchmark.h>

#include "helix_arm/dynamics/arm_motion.hpp"
#include "support/loaded_arm.hpp"

namespace helix_arm::benchmark {
namespace {

using dynamics::MovingArmOf;
using lie::SE3;

constexpr int kRows = 51;  // in a second

struct Case {
  explicit Case(int sections, double step)
      : arm(test::ringArm(test::helicalRing(), sections)),
        load(test::evenLoad(sections, {9.81, 0, 0}, 0.2, 900)) {
    config.damping = {1e-4, 1e-4, 0.01, 0.02};  // low where steps of the peer depend on it
    config.step = step;
    series.time = {0.0, 0.1, 1.0};
    series.input = Eigen::MatrixXd::Zero(3, arm.actuatorCount());
    for (int row = 1; row < 3; ++row) {
      for (int i = 0; i < arm.actuatorCount(); i += 4) series.input(row, i) = 2e5;
    }
    for (int i = 0; i < kRows; ++i) times.push_back(i / (kRows - 1.0));
  }
  std::vector<Eigen::Vector3d> tips() const {
    std::vector<Eigen::Vector3d> out;
    dynamics::ArmMotion(arm, std::nullopt, load, config)
        .follow(series, dynamics::Start::kRest, times, [&](std::size_t, const SE3& tip) {
          out.push_back(tip.translation);
          return true;
        });
    return out;
  }
  // In % of the length, against steps that are converged.
  double errorOf(const std::vector<Eigen::Vector3d>& found) const {
    Case fine = *this;
    fine.config.step = 2.5e-4;
    const auto converged = fine.tips();
    double sum = 0.0;
    for (std::size_t i = 0; i < found.size(); ++i) sum += (found[i] - converged[i]).squaredNorm();
    return 100 * std::sqrt(sum / static_cast<double>(found.size())) / arm.restLength();
  }

  model::Arm arm;
  statics::Load load;
  dynamics::MotionConfig config;
  dynamics::InputSeries series;
  std::vector<double> times;
};

// The explicit method of order 4.
class Peer {
 public:
  explicit Peer(const Case& given)
      : case_(given),
        moving_(given.arm, given.load, given.config),
        terms_(moving_),
        size_(moving_.coordinates()) {
    dynamics::MotionOf<SE3> rest(moving_);
    rest.startAtRest(given.arm.twists(given.series.input.row(0).transpose()));
    start_.resize(2 * size_);
    start_ << rest.position(), rest.rate();
  }
  std::vector<Eigen::Vector3d> tips() {
    std::vector<Eigen::Vector3d> out;
    Eigen::VectorXd y = start_;
    const double h = case_.config.step;
    const long steps = std::lround(1 / h), every = steps / (kRows - 1);
    for (long i = 0; i <= steps; ++i) {
      if (i % every == 0) out.push_back(moving_.tip(y.head(size_)).translation);
      const double t = i * h;
      const Eigen::VectorXd k1 = slope(t, y), k2 = slope(t + h / 2, y + h / 2 * k1);
      const Eigen::VectorXd k3 = slope(t + h / 2, y + h / 2 * k2), k4 = slope(t + h, y + h * k3);
      y += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    }
    return out;
  }

 private:
  Eigen::VectorXd slope(double t, const Eigen::VectorXd& y) {
    const Eigen::VectorXd q = y.head(size_), v = y.tail(size_);
    const Eigen::VectorXd input = std::min(t / 0.1, 1.0) * case_.series.input.row(1).transpose();
    moving_.evaluate(q, v, terms_);
    moving_.setTwists(case_.arm.twists(input), target_);
    factors_.compute(terms_.mass);
    Eigen::VectorXd dy(2 * size_);
    dy << v,
        factors_.solve(-terms_.force - moving_.stiffness() * (q - target_) - moving_.damping() * v);
    return dy;
  }

  const Case& case_;
  MovingArmOf<SE3> moving_;
  MovingArmOf<SE3>::Terms terms_;
  Eigen::Index size_;
  Eigen::VectorXd start_, target_;
  Eigen::LLT<Eigen::MatrixXd> factors_;
};

void report(::benchmark::State& state, const Case& of, const std::vector<Eigen::Vector3d>& tips) {
  state.counters["real_time_factor"] =
      ::benchmark::Counter(1.0, ::benchmark::Counter::kIsIterationInvariantRate);
  state.counters["error"] = of.errorOf(tips);
}

// Sections, and steps a second.
void midpoint(::benchmark::State& state) {
  const Case given(static_cast<int>(state.range(0)), 1.0 / static_cast<double>(state.range(1)));
  std::vector<Eigen::Vector3d> tips;
  for (auto _ : state) tips = given.tips();
  report(state, given, tips);
}
BENCHMARK(midpoint)
    ->ArgNames({"sections", "steps"})
    ->ArgsProduct({{1, 2}, {100, 200, 400}})
    ->Unit(::benchmark::kMillisecond);

void rungeKutta(::benchmark::State& state) {
  Case given(static_cast<int>(state.range(0)), 1e-3);
  std::vector<Eigen::Vector3d> tips;
  do {  // longer ones are not stable
    tips = Peer(given).tips();
    if (tips.back().allFinite() && given.errorOf(tips) < 1) break;
    given.config.step /= 2;
  } while (given.config.step > 1e-6);
  for (auto _ : state) tips = Peer(given).tips();
  state.counters["step_ms"] = 1e3 * given.config.step;
  report(state, given, tips);
}
BENCHMARK(rungeKutta)->ArgNames({"sections"})->Arg(1)->Arg(2)->Unit(::benchmark::kMillisecond);

}  // namespace
}  // namespace helix_arm::benchmark

BENCHMARK_MAIN();
