#include "batch_loops.hpp"

#include <algorithm>

#include "basics/vector_clones.hpp"
#include "lie/coefficients.hpp"

namespace helix_arm::model::batch {
namespace {

// With kAdd, the sum is added to the previous content.
template <int kCount, bool kAdd>
inline __attribute__((always_inline)) void sumActuators(const FlatActuator* actuators,
                                                        const double* const* q, std::size_t count,
                                                        const double* rest,
                                                        Block* __restrict block) {
  for (std::size_t j = 0; j < count; ++j) {
    double twist[6];
    for (int r = 0; r < 6; ++r) twist[r] = kAdd ? block->twist[r][j] : rest[r];
    for (int i = 0; i < kCount; ++i) {
      const double* c = actuators[i].coefficients;
      const double u = q[i][j];
      const double change = ((((c[5] * u + c[4]) * u + c[3]) * u + c[2]) * u + c[1]) * u;
      for (int r = 0; r < 6; ++r) twist[r] += actuators[i].column[r] * change;
    }
    for (int r = 0; r < 6; ++r) block->twist[r][j] = twist[r];
  }
}

template <bool kAdd>
inline __attribute__((always_inline)) void sumGroup(const FlatActuator* actuators, int size,
                                                    const double* const* q, std::size_t count,
                                                    const double* rest, Block* __restrict block) {
  static_assert(kGroup == 4);
  if (size == 4) return sumActuators<4, kAdd>(actuators, q, count, rest, block);
  if (size == 3) return sumActuators<3, kAdd>(actuators, q, count, rest, block);
  if (size == 2) return sumActuators<2, kAdd>(actuators, q, count, rest, block);
  sumActuators<1, kAdd>(actuators, q, count, rest, block);
}

// R p + V v = cos p + a (w x p + v) + w (b (w.p) + c (w.v)) + b (w x v) where the angle is beyond
// the series. Others stay: a factor of 0 or 1 selects them, as branches would not vectorise.
template <bool kFirst>
inline __attribute__((always_inline)) void moveFar(std::size_t count, const Block& block,
                                                   const double* const* from, double* const* to) {
#pragma GCC ivdep
  for (std::size_t j = 0; j < count; ++j) {
    const double vx = block.twist[0][j], vy = block.twist[1][j], vz = block.twist[2][j];
    const double wx = block.twist[3][j], wy = block.twist[4][j], wz = block.twist[5][j];
    // As the kernels decide it, to the last bit.
    const double beyond =
        ((wx * wx - lie::kSeriesLimit / 2) + wy * wy) + wz * wz - lie::kSeriesLimit / 2;
    const double x = (wx * wx + wy * wy) + wz * wz;
    const lie::ExpCoefficients f = lie::detail::expCoefficientsByReduction(std::max(x, 1.0), 0.0);
    double ux = f.b * vx, uy = f.b * vy, uz = f.b * vz;
    double along = f.c * (wx * vx + wy * vy + wz * vz);
    double tx = f.a * vx, ty = f.a * vy, tz = f.a * vz;
    if constexpr (!kFirst) {
      const double px = from[0][j], py = from[1][j], pz = from[2][j];
      ux += f.a * px;
      uy += f.a * py;
      uz += f.a * pz;
      along += f.b * (wx * px + wy * py + wz * pz);
      tx += f.cosine * px;
      ty += f.cosine * py;
      tz += f.cosine * pz;
    }
    const double near = static_cast<double>(beyond <= 0.0), far = 1.0 - near;
    to[0][j] = near * to[0][j] + far * (tx + (wy * uz - wz * uy) + along * wx);
    to[1][j] = near * to[1][j] + far * (ty + (wz * ux - wx * uz) + along * wy);
    to[2][j] = near * to[2][j] + far * (tz + (wx * uy - wy * ux) + along * wz);
  }
}

// With the stride known, the compiler permutes vectors in place of loading numbers one by one.
template <int kStride>
inline __attribute__((always_inline)) void gatherEvery(const double* __restrict from,
                                                       std::size_t count, double* __restrict to) {
  for (std::size_t j = 0; j < count; ++j) to[j] = from[kStride * j];
}

}  // namespace

HELIX_ARM_CLONES
void setTwists(const FlatActuator* actuators, int size, const double* const* q, std::size_t count,
               const double* rest, Block* block) {
  sumGroup<false>(actuators, size, q, count, rest, block);
}

HELIX_ARM_CLONES
void addTwists(const FlatActuator* actuators, int size, const double* const* q, std::size_t count,
               Block* block) {
  sumGroup<true>(actuators, size, q, count, nullptr, block);
}

HELIX_ARM_CLONES
void moveTips(const FlatLink& link, std::size_t count, Columns& tips) {
  for (std::size_t j = 0; j < count; ++j) {
    const double p[3] = {tips[0][j], tips[1][j], tips[2][j]};
    for (int r = 0; r < 3; ++r) {
      tips[r][j] = link.R[r][0] * p[0] + link.R[r][1] * p[1] + link.R[r][2] * p[2] + link.t[r];
    }
  }
}

HELIX_ARM_CLONES
void moveTipsFar(std::size_t count, bool first, const Block& block, const double* const* from,
                 double* const* to) {
  first ? moveFar<true>(count, block, from, to) : moveFar<false>(count, block, from, to);
}

HELIX_ARM_CLONES
void gather(const double* from, std::ptrdiff_t stride, std::size_t count, double* to) {
  if (stride == 1) return gatherEvery<1>(from, count, to);
  if (stride == 2) return gatherEvery<2>(from, count, to);
  if (stride == 3) return gatherEvery<3>(from, count, to);
  if (stride == 4) return gatherEvery<4>(from, count, to);
  for (std::size_t j = 0; j < count; ++j) to[j] = from[stride * static_cast<std::ptrdiff_t>(j)];
}

HELIX_ARM_CLONES
std::int64_t countInside(const double* values, std::size_t count, double lower, double upper) {
  std::int64_t inside = 0;
  for (std::size_t j = 0; j < count; ++j) {
    inside += values[j] >= lower && values[j] <= upper ? 1 : 0;
  }
  return inside;
}

HELIX_ARM_CLONES
void joinRows(const Columns& tips, std::size_t count, double* __restrict rows) {
  for (std::size_t j = 0; j < count; ++j) {
    rows[3 * j] = tips[0][j];
    rows[3 * j + 1] = tips[1][j];
    rows[3 * j + 2] = tips[2][j];
  }
}

}  // namespace helix_arm::model::batch
