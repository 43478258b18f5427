#include "columns.hpp"

#ifdef __x86_64__
#include <immintrin.h>
#endif

// As in batch.cpp of the model: cloned per instruction set and selected at load time.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define HELIX_ARM_CLONES __attribute__((target_clones("avx512f", "arch=haswell", "default")))
#else
#define HELIX_ARM_CLONES
#endif

namespace helix_arm::python {
namespace {

#ifdef __x86_64__
#define HELIX_ARM_WIDE __attribute__((target("avx512f")))

// Eight rows of three are three vectors. The compiler does not find these permutations by itself.
using Numbers = double __attribute__((vector_size(64)));
using InMemory = double __attribute__((vector_size(64), aligned(8), may_alias));
using Places = long long __attribute__((vector_size(64)));
constexpr std::size_t kWide = 8;

// @return the number of rows that were split.
HELIX_ARM_WIDE std::size_t splitThree(const double* rows, std::size_t count,
                                      double* const* columns) {
  std::size_t j = 0;
  for (; j + kWide <= count; j += kWide) {
    const auto* const from = reinterpret_cast<const InMemory*>(rows + 3 * j);
    const Numbers a = from[0], b = from[1], c = from[2];
    const Numbers x = __builtin_shuffle(a, b, Places{0, 3, 6, 9, 12, 15, 0, 0});
    const Numbers y = __builtin_shuffle(a, b, Places{1, 4, 7, 10, 13, 0, 0, 0});
    const Numbers z = __builtin_shuffle(a, b, Places{2, 5, 8, 11, 14, 0, 0, 0});
    *reinterpret_cast<InMemory*>(columns[0] + j) =
        __builtin_shuffle(x, c, Places{0, 1, 2, 3, 4, 5, 10, 13});
    *reinterpret_cast<InMemory*>(columns[1] + j) =
        __builtin_shuffle(y, c, Places{0, 1, 2, 3, 4, 8, 11, 14});
    *reinterpret_cast<InMemory*>(columns[2] + j) =
        __builtin_shuffle(z, c, Places{0, 1, 2, 3, 4, 9, 12, 15});
  }
  return j;
}

// @param past_caches  whether the rows are not read into the caches first: their address is then a
//     multiple of a vector's size. @return the number of rows that were joined.
HELIX_ARM_WIDE std::size_t joinThree(const double* x, const double* y, const double* z,
                                     std::size_t count, bool past_caches, double* rows) {
  std::size_t j = 0;
  for (; j + kWide <= count; j += kWide) {
    const Numbers a = *reinterpret_cast<const InMemory*>(x + j);
    const Numbers b = *reinterpret_cast<const InMemory*>(y + j);
    const Numbers c = *reinterpret_cast<const InMemory*>(z + j);
    double* const to = rows + 3 * j;
    const Numbers ab[] = {__builtin_shuffle(a, b, Places{0, 8, 0, 1, 9, 0, 2, 10}),
                          __builtin_shuffle(a, b, Places{0, 3, 11, 0, 4, 12, 0, 5}),
                          __builtin_shuffle(a, b, Places{13, 0, 6, 14, 0, 7, 15, 0})};
    const Numbers abc[] = {__builtin_shuffle(ab[0], c, Places{0, 1, 8, 3, 4, 9, 6, 7}),
                           __builtin_shuffle(ab[1], c, Places{10, 1, 2, 11, 4, 5, 12, 7}),
                           __builtin_shuffle(ab[2], c, Places{0, 13, 2, 3, 14, 5, 6, 15})};
    for (std::size_t i = 0; i < 3; ++i) {
      if (past_caches) {
        _mm512_stream_pd(to + kWide * i, abc[i]);
      } else {
        *reinterpret_cast<InMemory*>(to + kWide * i) = abc[i];
      }
    }
  }
  return j;
}

bool isWide() {
  static const bool wide = __builtin_cpu_supports("avx512f") != 0;
  return wide;
}
#else
std::size_t splitThree(const double*, std::size_t, double* const*) { return 0; }
std::size_t joinThree(const double*, const double*, const double*, std::size_t, bool, double*) {
  return 0;
}
bool isWide() { return false; }
#endif

// With n known, the compiler permutes vectors in place of loading numbers one by one.
template <int kColumns>
inline __attribute__((always_inline)) void split(const double* __restrict rows, std::size_t count,
                                                 double* const* columns) {
  if constexpr (kColumns == 2) {
    double* __restrict a = columns[0];
    double* __restrict b = columns[1];
    for (std::size_t j = 0; j < count; ++j) {
      a[j] = rows[2 * j];
      b[j] = rows[2 * j + 1];
    }
  } else {
    static_assert(kColumns == 4);
    double* __restrict a = columns[0];
    double* __restrict b = columns[1];
    double* __restrict c = columns[2];
    double* __restrict d = columns[3];
    for (std::size_t j = 0; j < count; ++j) {
      a[j] = rows[4 * j];
      b[j] = rows[4 * j + 1];
      c[j] = rows[4 * j + 2];
      d[j] = rows[4 * j + 3];
    }
  }
}

}  // namespace

void splitRows(const double* rows, std::size_t n, std::size_t count, double* const* columns) {
  if (n == 2) return split<2>(rows, count, columns);
  if (n == 4) return split<4>(rows, count, columns);
  std::size_t done = 0;
  if (n == 3 && isWide()) done = splitThree(rows, count, columns);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = done; j < count; ++j) columns[i][j] = rows[n * j + i];
  }
}

void joinRows(const double* x, const double* y, const double* z, std::size_t count,
              bool past_caches, double* rows) {
  const auto joinFew = [&](std::size_t first, std::size_t end) {
    for (std::size_t j = first; j < end; ++j) {
      rows[3 * j] = x[j];
      rows[3 * j + 1] = y[j];
      rows[3 * j + 2] = z[j];
    }
  };
  std::size_t done = 0;
  if (isWide()) {
    const auto isVector = [&](std::size_t j) {
      return reinterpret_cast<std::uintptr_t>(rows + 3 * j) % 64 == 0;
    };
    if (past_caches) {
      while (done < count && !isVector(done)) ++done;
      joinFew(0, done);
    }
    done += joinThree(x + done, y + done, z + done, count - done, past_caches, rows + 3 * done);
  }
  joinFew(done, count);
}

void finishRows() {
#ifdef __x86_64__
  _mm_sfence();
#endif
}

HELIX_ARM_CLONES
std::int64_t countOutside(const double* values, std::size_t count, double lower, double upper) {
  std::int64_t inside = 0;
  for (std::size_t j = 0; j < count; ++j) {
    inside += values[j] >= lower && values[j] <= upper ? 1 : 0;
  }
  return static_cast<std::int64_t>(count) - inside;
}

}  // namespace helix_arm::python
