// Distance of a shape from six zones, beside dense sampling of the curve at the same error, and
// FCL's distances of capsules along the curve. Both answer within 0.1 mm.
#include <algorithm>
#include <cmath>
#include <vector>

#include <benchmark/benchmark.h>
#include <fcl/geometry/shape/box.h>
#include <fcl/geometry/shape/capsule.h>
#include <fcl/geometry/shape/cylinder.h>
#include <fcl/narrowphase/distance.h>

#include "clearance/random_zones.hpp"

namespace helix_arm::benchmark {
namespace {

using namespace clearance;

constexpr int kShapes = 200, kZones = 6, kPlaces = 150, kCapsules = 16;
constexpr double kRadius = 0.02;

struct Case {
  model::Shape shape;
  KeepOut keep_out;
  ArmClearance clearance;
};
const std::vector<Case>& cases() {
  static const std::vector<Case> all = [] {
    test::Random random(1);
    std::vector<Case> out;
    while (out.size() < kShapes) {
      model::Twists twists(6, 2);
      for (int k = 0; k < 2; ++k) {
        twists.col(k) << random.uniform(0.15, 0.2), 0, 0,
            random.uniform(0, 1.5) * random.direction<3>();
      }
      KeepOut keep_out;
      keep_out.radii = {kRadius, kRadius};
      for (int i = 0; i < kZones; ++i) {
        keep_out.zones.push_back(test::randomZone(random, 0.15, 0.5, i % 2, "zone"));
      }
      if (test::denseClearance(keep_out, twists, 100) < 0.001) continue;
      out.push_back({twists, keep_out, ArmClearance(keep_out)});
    }
    return out;
  }();
  return all;
}

void distance(::benchmark::State& state) {
  std::size_t i = 0;
  for (auto _ : state) {
    const Case& one = cases()[i++ % kShapes];
    ::benchmark::DoNotOptimize(one.clearance.of(one.shape));
  }
}
BENCHMARK(distance)->Unit(::benchmark::kMicrosecond);

void distanceOfPeer(::benchmark::State& state) {
  std::size_t i = 0;
  double worst = 0;
  for (auto _ : state) {
    const Case& one = cases()[i++ % kShapes];
    const double found = test::denseClearance(one.keep_out, one.shape, kPlaces);
    state.PauseTiming();
    worst = std::max(worst, std::abs(found - one.clearance.of(one.shape).distance));
    state.ResumeTiming();
  }
  state.counters["differ_mm"] = 1e3 * worst;
}
BENCHMARK(distanceOfPeer)->Unit(::benchmark::kMicrosecond);

// The usual way with FCL: every capsule against every zone.
double capsuleClearance(const Case& one) {
  double least = 1e9;
  const auto curve = model::sampleCurve(one.shape, 2 * kCapsules + 1);
  for (std::size_t k = 0; k + 1 < curve.size(); ++k) {
    const Eigen::Vector3d a = curve[k].X.translation, b = curve[k + 1].X.translation;
    const fcl::Capsuled capsule(kRadius, (b - a).norm());
    Eigen::Isometry3d at(Eigen::Translation3d((a + b) / 2));
    at.linear() =
        Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), b - a).toRotationMatrix();
    for (const Zone& zone : one.keep_out.zones) {
      Eigen::Isometry3d there(Eigen::Translation3d(zone.X_WZ.translation));
      there.linear() = zone.X_WZ.rotation;
      fcl::DistanceResultd result;
      const fcl::DistanceRequestd request;
      if (const auto* box = std::get_if<Box>(&zone.form)) {
        const fcl::Boxd solid(box->size);
        least = std::min(least, fcl::distance(&capsule, at, &solid, there, request, result));
      } else {
        const auto& round = std::get<Cylinder>(zone.form);
        const fcl::Cylinderd solid(round.radius, round.length);
        least = std::min(least, fcl::distance(&capsule, at, &solid, there, request, result));
      }
    }
  }
  return least;
}

void capsulesOfPeer(::benchmark::State& state) {
  std::size_t i = 0;
  for (auto _ : state) ::benchmark::DoNotOptimize(capsuleClearance(cases()[i++ % kShapes]));
}
BENCHMARK(capsulesOfPeer)->Unit(::benchmark::kMicrosecond);

}  // namespace
}  // namespace helix_arm::benchmark
