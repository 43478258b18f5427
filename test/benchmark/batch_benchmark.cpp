// A million inputs to tips, beside the roofs of this machine: its fused multiply-adds and its
// memory.
#include <algorithm>
#include <cstdlib>
#include <memory>
#include <thread>
#include <vector>

#include <benchmark/benchmark.h>
#include <sys/mman.h>

#include "basics/vector_clones.hpp"
#include "helix_arm/model/batch.hpp"
#include "support/paper_arm.hpp"

#ifdef __x86_64__
#include <emmintrin.h>
#endif

namespace helix_arm::benchmark {
namespace {

constexpr std::size_t kSamples = 1000000;
// Multiplications and additions of one sample with three muscles, counted in batch.cpp: lengths 27,
// twist 36, angle 6, coefficients 43, tip 30. All but 10 of them are in fused pairs.
constexpr double kFlopsPerSample = 142;
constexpr int kAccumulators = 128;

// Numbers in pages of 2 MB where the system has them, as NumPy allocates large arrays.
class LargeArray {
 public:
  explicit LargeArray(std::size_t count, double value = 0.0)
      : numbers_(static_cast<double*>(std::aligned_alloc(kPage, bytes(count)))) {
    madvise(numbers_.get(), bytes(count), MADV_HUGEPAGE);
    std::fill_n(numbers_.get(), count, value);
  }
  double* data() const { return numbers_.get(); }

 private:
  static constexpr std::size_t kPage = std::size_t{1} << 21;
  static std::size_t bytes(std::size_t count) {
    return (count * sizeof(double) + kPage - 1) / kPage * kPage;
  }
  struct Free {
    void operator()(double* numbers) const { std::free(numbers); }
  };
  std::unique_ptr<double, Free> numbers_;
};

struct Arrays {
  LargeArray q[3] = {LargeArray(kSamples), LargeArray(kSamples), LargeArray(kSamples)};
  LargeArray tips[3] = {LargeArray(kSamples), LargeArray(kSamples), LargeArray(kSamples)};

  Arrays() {
    test::Random random(3);
    for (const LargeArray& axis : q) {
      for (std::size_t i = 0; i < kSamples; ++i)
        axis.data()[i] = random.uniform(0, test::kMaxPressure);
    }
  }
  // Tips of samples [first, end).
  void batch(const model::TipBatch& batch, std::size_t first, std::size_t end) const {
    const double* inputs[] = {q[0].data() + first, q[1].data() + first, q[2].data() + first};
    batch.columns(inputs, end - first, tips[0].data() + first, tips[1].data() + first,
                  tips[2].data() + first);
  }
};

void batch(::benchmark::State& state, const test::Ring& ring) {
  const model::Arm arm = test::ringArm(ring);
  const model::TipBatch batch(arm);
  const Arrays arrays;
  for (auto _ : state) {
    arrays.batch(batch, 0, kSamples);
    ::benchmark::ClobberMemory();
  }
}

void batchRows(::benchmark::State& state, const test::Ring& ring) {
  const model::Arm arm = test::ringArm(ring);
  const model::TipBatch batch(arm);
  const LargeArray inputs(3 * kSamples), tips(3 * kSamples);
  test::Random random(3);
  for (std::size_t i = 0; i < 3 * kSamples; ++i)
    inputs.data()[i] = random.uniform(0, test::kMaxPressure);
  for (auto _ : state) {
    ::benchmark::DoNotOptimize(
        batch.rows({inputs.data(), 3 * sizeof(double), sizeof(double)}, kSamples, tips.data()));
  }
}

// In so many threads, each with its part of the samples.
void batchThreads(::benchmark::State& state) {
  const model::Arm arm = test::ringArm(test::helicalRing());
  const model::TipBatch batch(arm);
  const Arrays arrays;
  const auto threads = static_cast<std::size_t>(state.range(0));
  const auto part = [&](std::size_t i) {
    arrays.batch(batch, kSamples * i / threads, kSamples * (i + 1) / threads);
  };
  for (auto _ : state) {
    std::vector<std::thread> others;
    for (std::size_t i = 1; i < threads; ++i) others.emplace_back(part, i);
    part(0);
    for (std::thread& other : others) other.join();
  }
}

// The same six arrays and next to no arithmetic, fetched ahead; written through the caches.
HELIX_ARM_CLONES __attribute__((noinline)) void readAndWrite(
    const double* __restrict a, const double* __restrict b, const double* __restrict c,
    double* __restrict x, double* __restrict y, double* __restrict z) {
  constexpr std::size_t kLine = 8, kAhead = 16 * kLine;
  for (std::size_t j = 0; j < kSamples; j += kLine) {
    for (const double* place : {a, b, c}) __builtin_prefetch(place + j + kAhead);
    for (const double* place : {x, y, z}) __builtin_prefetch(place + j + kAhead, 1);
    for (std::size_t i = j; i < j + kLine; ++i) {
      x[i] = a[i] + b[i];
      y[i] = b[i] + c[i];
      z[i] = c[i] + a[i];
    }
  }
}

// The same, written past the caches: a line is not read before it is written.
void readAndStream(const double* a, const double* b, const double* c, double* x, double* y,
                   double* z) {
#ifdef __x86_64__
  for (std::size_t i = 0; i < kSamples; i += 2) {
    const __m128d p = _mm_load_pd(a + i), q = _mm_load_pd(b + i), r = _mm_load_pd(c + i);
    _mm_stream_pd(x + i, _mm_add_pd(p, q));
    _mm_stream_pd(y + i, _mm_add_pd(q, r));
    _mm_stream_pd(z + i, _mm_add_pd(r, p));
  }
  _mm_sfence();
#else
  readAndWrite(a, b, c, x, y, z);
#endif
}

using Copy = void (*)(const double*, const double*, const double*, double*, double*, double*);
void bandwidthRoof(::benchmark::State& state, Copy copy) {
  const Arrays arrays;
  for (auto _ : state) {
    copy(arrays.q[0].data(), arrays.q[1].data(), arrays.q[2].data(), arrays.tips[0].data(),
         arrays.tips[1].data(), arrays.tips[2].data());
    ::benchmark::ClobberMemory();
  }
}

HELIX_ARM_CLONES __attribute__((noinline)) void multiplyAdd(double* accumulators, long steps) {
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
BENCHMARK_CAPTURE(batchRows, helical, test::helicalRing())->Unit(::benchmark::kMillisecond);
BENCHMARK(batchThreads)
    ->Unit(::benchmark::kMillisecond)
    ->UseRealTime()
    ->DenseRange(1, static_cast<int>(std::max(1u, std::thread::hardware_concurrency())));
BENCHMARK_CAPTURE(bandwidthRoof, cached, readAndWrite)->Unit(::benchmark::kMillisecond);
BENCHMARK_CAPTURE(bandwidthRoof, streamed, readAndStream)->Unit(::benchmark::kMillisecond);
BENCHMARK(fmaRoof)->Unit(::benchmark::kMillisecond);

}  // namespace
}  // namespace helix_arm::benchmark
