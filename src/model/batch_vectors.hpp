#pragma once

#include <cstddef>

#include "batch_kernel.hpp"
#include "batch_series.hpp"
#include "lie/coefficients.hpp"

// The loops are written once, for vectors of any length: the compiler vectorises loops of this
// length only sometimes, and then some instruction sets only.
#if defined(__GNUC__) && !defined(__clang__)
#define HELIX_ARM_VECTORS
#ifdef __x86_64__
#define HELIX_ARM_X86
#endif
#endif

#define HELIX_ARM_INLINE inline __attribute__((always_inline))

/// One step of the batch's kernels, on as many samples as a vector holds.
namespace helix_arm::model::batch {

// `Value` is a vector of kLanes numbers, `Memory` the same at any address, `Mask` one integer per
// number, -1 for true. Each length is written out: where it depends on a parameter, GCC 12 ignores
// `aligned`, and unaligned `Memory` ends the process.
template <int kLanes>
struct Vector;
template <>
struct Vector<1> {
  using Value = double;
  using Memory = double;
};
#ifdef HELIX_ARM_VECTORS
template <>
struct Vector<2> {
  using Value = double __attribute__((vector_size(16)));
  using Memory = double __attribute__((vector_size(16), aligned(8), may_alias));
  using Mask = long long __attribute__((vector_size(16)));
};
#endif
#ifdef HELIX_ARM_X86
template <>
struct Vector<4> {
  using Value = double __attribute__((vector_size(32)));
  using Memory = double __attribute__((vector_size(32), aligned(8), may_alias));
  using Mask = long long __attribute__((vector_size(32)));
};
template <>
struct Vector<8> {
  using Value = double __attribute__((vector_size(64)));
  using Memory = double __attribute__((vector_size(64), aligned(8), may_alias));
  using Mask = long long __attribute__((vector_size(64)));
};
#endif

// Samples from one that is computed to one that is fetched. Processors fetch ahead by themselves,
// but not while they wait for arithmetic, nor across pages.
inline constexpr std::size_t kAhead = 128;

HELIX_ARM_INLINE void fetch(const double* place) { __builtin_prefetch(place); }

// To memory, without reading it into the caches first. C++ has no such operation for all vectors.
template <class Value>
HELIX_ARM_INLINE void stream(const Value& value, double* to) {
#ifdef HELIX_ARM_X86
  if constexpr (sizeof(Value) == 16) {
    __asm__("movntpd %1, %0" : "=m"(*reinterpret_cast<Value*>(to)) : "x"(value));
  } else {
    __asm__("vmovntpd %1, %0" : "=m"(*reinterpret_cast<Value*>(to)) : "v"(value));
  }
#else
  *reinterpret_cast<Value*>(to) = value;
#endif
}
template <bool kStream, class Memory, class Value>
HELIX_ARM_INLINE void store(const Value& value, double* to) {
  if constexpr (kStream) {
    stream(value, to);
  } else {
    *reinterpret_cast<Memory*>(to) = value;
  }
}

// Coefficients of exp about the middle of the series' range (lie::ExpCoefficients): without
// rounding, b theta and c theta^2 are within 1 eps.
inline constexpr double kCentre = lie::kSeriesLimit / 2;
inline constexpr int kDegreeB = 11, kDegreeC = 10;
inline constexpr auto kB = economised<kDegreeB>(2, kCentre);
inline constexpr auto kC = economised<kDegreeC>(3, kCentre);

// An arm's section in vectors.
template <int kLanes, int kCount>
struct SectionVectors {
  using Value = typename Vector<kLanes>::Value;
  Value coefficients[kCount > 0 ? kCount : 1][6], columns[kCount > 0 ? kCount : 1][6], rest[6];

  HELIX_ARM_INLINE SectionVectors(const FlatActuator* actuators, const double* twist) {
    for (int r = 0; r < 6; ++r) rest[r] = Value{} + twist[r];
    for (int i = 0; i < kCount; ++i) {
      for (int k = 0; k < 6; ++k) coefficients[i][k] = Value{} + actuators[i].coefficients[k];
      for (int r = 0; r < 6; ++r) columns[i][r] = Value{} + actuators[i].column[r];
    }
  }

  // twist = rest + sum_i column_i (l_i(q_i) - rest length); in the order of sumActuators().
  HELIX_ARM_INLINE void twist(const Value* q, Value* out) const {
    Value change[kCount];
#pragma GCC unroll 4
    for (int i = 0; i < kCount; ++i) change[i] = coefficients[i][5] * q[i] + coefficients[i][4];
#pragma GCC unroll 4
    for (int k = 3; k > 0; --k) {
#pragma GCC unroll 4
      for (int i = 0; i < kCount; ++i) change[i] = change[i] * q[i] + coefficients[i][k];
    }
#pragma GCC unroll 4
    for (int i = 0; i < kCount; ++i) change[i] *= q[i];
#pragma GCC unroll 6
    for (int r = 0; r < 6; ++r) out[r] = rest[r] + columns[0][r] * change[0];
#pragma GCC unroll 4
    for (int i = 1; i < kCount; ++i) {
#pragma GCC unroll 6
      for (int r = 0; r < 6; ++r) out[r] += columns[i][r] * change[i];
    }
  }
};

// b and c at t = theta^2 - kCentre. Even and odd powers apart: half the latency of Horner's rule
// for one product more.
template <class Value>
HELIX_ARM_INLINE void coefficientsAt(const Value& t, Value* b, Value* c) {
  static_assert(kDegreeB == 11 && kDegreeC == 10);
  const Value t2 = t * t;
  Value b_odd = Value{} + kB[11], b_even = Value{} + kB[10];
  Value c_even = Value{} + kC[10], c_odd = Value{} + kC[9];
#pragma GCC unroll 8
  for (int k = 8; k >= 0; k -= 2) {
    b_odd = b_odd * t2 + kB[k + 1];
    b_even = b_even * t2 + kB[k];
    c_even = c_even * t2 + kC[k];
    if (k > 0) c_odd = c_odd * t2 + kC[k - 1];
  }
  *b = b_odd * t + b_even;
  *c = c_odd * t + c_even;
}

// R p + V v = p + v + w x (a p + b v + w x (b p + c v)); p = 0 where the section's end is the tip.
// @param farthest  the largest theta^2 - kCentre so far; a NaN is not counted.
template <bool kFirst, class Value>
HELIX_ARM_INLINE void moveTip(const Value* twist, Value* tip, Value* farthest) {
  const Value *v = twist, *w = twist + 3;
  const Value t = ((w[0] * w[0] - kCentre) + w[1] * w[1]) + w[2] * w[2];
  *farthest = t > *farthest ? t : *farthest;
  Value b, c;
  coefficientsAt(t, &b, &c);
  Value inner[3], outer[3], sum[3];
  if constexpr (kFirst) {
#pragma GCC unroll 3
    for (int r = 0; r < 3; ++r) {
      inner[r] = c * v[r];
      outer[r] = b * v[r];
      sum[r] = v[r];
    }
  } else {
    const Value a = 1.0 - (t + kCentre) * c;
#pragma GCC unroll 3
    for (int r = 0; r < 3; ++r) {
      inner[r] = b * tip[r] + c * v[r];
      outer[r] = a * tip[r] + b * v[r];
      sum[r] = tip[r] + v[r];
    }
  }
  outer[0] = (outer[0] + w[1] * inner[2]) - w[2] * inner[1];
  outer[1] = (outer[1] + w[2] * inner[0]) - w[0] * inner[2];
  outer[2] = (outer[2] + w[0] * inner[1]) - w[1] * inner[0];
  tip[0] = (sum[0] + w[1] * outer[2]) - w[2] * outer[1];
  tip[1] = (sum[1] + w[2] * outer[0]) - w[0] * outer[2];
  tip[2] = (sum[2] + w[0] * outer[1]) - w[1] * outer[0];
}

template <int kLanes>
HELIX_ARM_INLINE bool isNear(const typename Vector<kLanes>::Value& farthest) {
  double lanes[kLanes];
  *reinterpret_cast<typename Vector<kLanes>::Memory*>(lanes) = farthest;
  bool near = true;
  for (const double lane : lanes) near &= lane <= kCentre;
  return near;
}

}  // namespace helix_arm::model::batch
