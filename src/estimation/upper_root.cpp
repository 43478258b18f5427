#include "upper_root.hpp"

#include <algorithm>
#include <cmath>

#include "helix_arm/basics/vector_clones.hpp"

namespace helix_arm::estimation {
namespace {

// Rows per pass over the rest of a matrix: each of its entries is then read and written once for
// several products.
constexpr int kRowsAtOnce = 8;

// to[j] -= sum_k factor[k] rows[k][j]
inline __attribute__((always_inline)) void subtractRows(const double* rows, std::ptrdiff_t stride,
                                                        const double* factor, int size,
                                                        double* __restrict to) {
  const double *const a = rows, *const b = a + stride, *const c = b + stride, *const d = c + stride;
  const double *const e = d + stride, *const f = e + stride, *const g = f + stride,
                      *const h = g + stride;
  for (int j = 0; j < size; ++j) {
    to[j] -= (factor[0] * a[j] + factor[1] * b[j] + factor[2] * c[j] + factor[3] * d[j]) +
             (factor[4] * e[j] + factor[5] * f[j] + factor[6] * g[j] + factor[7] * h[j]);
  }
}

inline __attribute__((always_inline)) void subtractRow(const double* row, double factor, int size,
                                                       double* __restrict to) {
  for (int j = 0; j < size; ++j) to[j] -= factor * row[j];
}

HELIX_ARM_CLONES bool factorRows(double* S, int n) {
  for (int first = 0; first < n; first += kRowsAtOnce) {
    const int end = std::min(first + kRowsAtOnce, n);
    for (int k = first; k < end; ++k) {
      double* const row = S + static_cast<std::ptrdiff_t>(k) * n;
      for (int i = first; i < k; ++i) {
        const double* const above = S + static_cast<std::ptrdiff_t>(i) * n;
        subtractRow(above + k, above[k], n - k, row + k);
      }
      if (!(row[k] > 0)) return false;
      const double scale = 1 / std::sqrt(row[k]);
      for (int j = k; j < n; ++j) row[j] *= scale;
    }
    if (end - first < kRowsAtOnce) break;
    const double* const done = S + static_cast<std::ptrdiff_t>(first) * n;
    for (int i = end; i < n; ++i) {
      double factor[kRowsAtOnce];
      for (int k = 0; k < kRowsAtOnce; ++k) factor[k] = done[k * n + i];
      subtractRows(done + i, n, factor, n - i, S + static_cast<std::ptrdiff_t>(i) * n + i);
    }
  }
  return true;
}

// From the last row on: (U C)_ij = 0 for j > i and 1 / U_ii for j = i.
HELIX_ARM_CLONES void invertRows(const double* U, double* C, int n) {
  for (int i = n - 1; i >= 0; --i) {
    const double* const u = U + static_cast<std::ptrdiff_t>(i) * n;
    double* const c = C + static_cast<std::ptrdiff_t>(i) * n;
    std::fill(c + i, c + n, 0.0);
    int k = i + 1;
    for (; k + kRowsAtOnce <= n; k += kRowsAtOnce) {
      subtractRows(C + static_cast<std::ptrdiff_t>(k) * n + i + 1, n, u + k, n - i - 1, c + i + 1);
    }
    for (; k < n; ++k) {
      subtractRow(C + static_cast<std::ptrdiff_t>(k) * n + i + 1, u[k], n - i - 1, c + i + 1);
    }
    const double scale = 1 / u[i];
    double diagonal = scale;
    for (int j = i + 1; j < n; ++j) {
      c[j] *= scale;
      C[static_cast<std::ptrdiff_t>(j) * n + i] = c[j];
      diagonal -= u[j] * c[j];
    }
    c[i] = diagonal * scale;
  }
}

// As many as kRowPadding, in as few registers as the processor needs.
typedef double Chunk __attribute__((vector_size(8 * kRowPadding), aligned(8), may_alias));

HELIX_ARM_CLONES void squarePaddedRows(const double* W, int rows, int stride, int count,
                                       double weight, double* square) {
  for (int first = 0; first < stride; first += kRowPadding) {
    const int end = std::min(count, first + kRowPadding);
    for (int i = 0; i < end; ++i) {
      Chunk sum = {};
      for (int r = 0; r < rows; ++r) {
        const double* const row = W + r * stride;
        sum += row[i] * *reinterpret_cast<const Chunk*>(row + first);
      }
      *reinterpret_cast<Chunk*>(square + i * stride + first) = weight * sum;
    }
  }
}

HELIX_ARM_CLONES void divideRows(const double* U, int n, double* X, int stride) {
  for (int first = 0; first < stride; first += kRowPadding) {
    for (int i = 0; i < n; ++i) {
      Chunk& row = *reinterpret_cast<Chunk*>(X + i * stride + first);
      Chunk rest = row;
      for (int k = 0; k < i; ++k) {
        rest -= U[k * n + i] * *reinterpret_cast<const Chunk*>(X + k * stride + first);
      }
      row = rest * (1 / U[i * n + i]);
    }
  }
}

}  // namespace

bool factorUpper(RowMajor& S) { return factorRows(S.data(), static_cast<int>(S.rows())); }

void solveUpper(const RowMajor& U, Eigen::VectorXd& x) {
  divideByTransposed(U, x);
  const Eigen::Index n = U.rows();
  for (Eigen::Index i = n; i-- > 0;) {
    x[i] = (x[i] - U.row(i).tail(n - i - 1).dot(x.tail(n - i - 1))) / U(i, i);
  }
}

void divideByTransposed(const RowMajor& U, RowMajor& X) {
  divideRows(U.data(), static_cast<int>(U.rows()), X.data(), static_cast<int>(X.cols()));
}

void divideByTransposed(const RowMajor& U, Eigen::VectorXd& x) {
  const Eigen::Index n = U.rows();
  for (Eigen::Index i = 0; i < n; ++i) {
    x[i] /= U(i, i);
    x.tail(n - i - 1) -= x[i] * U.row(i).tail(n - i - 1).transpose();
  }
}

RowMajor inverseOfUpper(const RowMajor& U) {
  RowMajor C(U.rows(), U.cols());
  invertRows(U.data(), C.data(), static_cast<int>(U.rows()));
  return C;
}

void squareRows(const double* W, int rows, int stride, int count, double weight, double* square) {
  squarePaddedRows(W, rows, stride, count, weight, square);
}

void subtractSquare(const RowMajor& W, const std::vector<int>& at, std::vector<double>& square,
                    RowMajor& S) {
  const int count = static_cast<int>(at.size()), stride = static_cast<int>(W.cols());
  square.resize(static_cast<std::size_t>(count * stride));
  squareRows(W.data(), static_cast<int>(W.rows()), stride, count, 1, square.data());
  for (int i = 0; i < count; ++i) {
    double* const out = &S(at[i], 0);
    const double* const row = &square[static_cast<std::size_t>(i * stride)];
    for (int j = i; j < count; ++j) out[at[j]] -= row[j];
  }
}

}  // namespace helix_arm::estimation
