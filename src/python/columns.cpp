#include "columns.hpp"

// As in batch.cpp of the model: cloned per instruction set and selected at load time.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define HELIX_ARM_CLONES __attribute__((target_clones("avx512f", "arch=haswell", "default")))
#else
#define HELIX_ARM_CLONES
#endif

namespace helix_arm::python {
namespace {

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
  } else if constexpr (kColumns == 3) {
    double* __restrict a = columns[0];
    double* __restrict b = columns[1];
    double* __restrict c = columns[2];
    for (std::size_t j = 0; j < count; ++j) {
      a[j] = rows[3 * j];
      b[j] = rows[3 * j + 1];
      c[j] = rows[3 * j + 2];
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

HELIX_ARM_CLONES
void splitRows(const double* rows, std::size_t n, std::size_t count, double* const* columns) {
  if (n == 2) return split<2>(rows, count, columns);
  if (n == 3) return split<3>(rows, count, columns);
  if (n == 4) return split<4>(rows, count, columns);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < count; ++j) columns[i][j] = rows[n * j + i];
  }
}

HELIX_ARM_CLONES
void joinRows(const double* __restrict x, const double* __restrict y, const double* __restrict z,
              std::size_t count, double* __restrict rows) {
  for (std::size_t j = 0; j < count; ++j) {
    rows[3 * j] = x[j];
    rows[3 * j + 1] = y[j];
    rows[3 * j + 2] = z[j];
  }
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
