// A million inputs to tips, beside the roofs of this machine: its fused multiply-adds and its
// memory.
#include <vector>

#include <benchmark/benchmark.h>

#include "helix_arm/model/batch.hpp"
#include "support/paper_arm.hpp"

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define HELIX_ARM_CLONES \
  __attribute__((target_clones("avx512f", "arch=haswell", "default"), noinline))
#else
#define HELIX_ARM_CLONES
#endif

namespace helix_arm::benchmark {
namespace {

constexpr std::size_t kSamples = 1000000;
// Multiplications and additions of one sample with three muscles, counted in batch.cpp: lengths 27,
// twist 63 - 27, coefficients 68, the angle twice 11, tip 30.
constexpr double kFlopsPerSample = 172;
constexpr int kAccumulators = 128;

void batch(::benchmark::State& state, const test::Ring& ring) {
  const model::Arm arm = test::ringArm(ring);
  test::Random random(3);
  std::vector<double> q[3], x(kSamples), y(kSamples), z(kSamples);
  for (auto& axis : q) {
    for (std::size_t i = 0; i < kSamples; ++i)
      axis.push_back(random.uniform(0, test::kMaxPressure));
  }
  const double* inputs[] = {q[0].data(), q[1].data(), q[2].data()};
  for (auto _ : state) {
    model::batchTips(arm, inputs, kSamples, x.data(), y.data(), z.data());
    ::benchmark::ClobberMemory();
  }
  state.SetLabel(model::batchInstructionSet());
}

HELIX_ARM_CLONES
void readAndWrite(const double* __restrict a, const double* __restrict b,
                  const double* __restrict c, double* __restrict x, double* __restrict y,
                  double* __restrict z) {
  for (std::size_t i = 0; i < kSamples; ++i) {
    x[i] = a[i] + b[i];
    y[i] = b[i] + c[i];
    z[i] = c[i] + a[i];
  }
}

// The same six arrays and next to no arithmetic.
void bandwidthRoof(::benchmark::State& state) {
  std::vector<double> arrays[6];
  for (auto& array : arrays) array.assign(kSamples, 1.0);
  for (auto _ : state) {
    readAndWrite(arrays[0].data(), arrays[1].data(), arrays[2].data(), arrays[3].data(),
                 arrays[4].data(), arrays[5].data());
    ::benchmark::ClobberMemory();
  }
}

HELIX_ARM_CLONES
void multiplyAdd(double* accumulators, long steps) {
  double local[kAccumulators];
  for (int i = 0; i < kAccumulators; ++i) local[i] = accumulators[i];
  for (long step = 0; step < steps; ++step) {
    for (double& value : local) value = value * 0.999 + 0.001;
  }
  for (int i = 0; i < kAccumulators; ++i) accumulators[i] = local[i];
}

// As many multiplications and additions, all of them fused, in registers.
void fmaRoof(::benchmark::State& state) {
  double accumulators[kAccumulators] = {};
  const long steps = static_cast<long>(kSamples * kFlopsPerSample / (2 * kAccumulators));
  for (auto _ : state) {
    multiplyAdd(accumulators, steps);
    ::benchmark::DoNotOptimize(accumulators);
  }
}

BENCHMARK_CAPTURE(batch, straight, test::straightRing())->Unit(::benchmark::kMillisecond);
BENCHMARK_CAPTURE(batch, helical, test::helicalRing())->Unit(::benchmark::kMillisecond);
BENCHMARK(bandwidthRoof)->Unit(::benchmark::kMillisecond);
BENCHMARK(fmaRoof)->Unit(::benchmark::kMillisecond);

}  // namespace
}  // namespace helix_arm::benchmark
