#include "batch_kernel.hpp"

#include "batch_series.hpp"
#include "helix_arm/lie/coefficients.hpp"

// The loops are written once, for vectors of any length: the compiler vectorises loops of this
// length only sometimes, and then some instruction sets only.
#if defined(__GNUC__) && !defined(__clang__)
#define HELIX_ARM_VECTORS
#ifdef __x86_64__
#define HELIX_ARM_X86
#endif
#endif

#define HELIX_ARM_INLINE inline __attribute__((always_inline))

namespace helix_arm::model::batch {
namespace {

// `Value` is a vector of kLanes numbers, `Memory` the same at any address, `Mask` one integer per
// number, -1 for true.
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
};
#endif
#ifdef HELIX_ARM_X86
template <>
struct Vector<4> {
  using Value = double __attribute__((vector_size(32)));
  using Memory = double __attribute__((vector_size(32), aligned(8), may_alias));
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
constexpr std::size_t kAhead = 128;

HELIX_ARM_INLINE void fetch(const double* place) { __builtin_prefetch(place); }

// To memory without reading it into the caches first. There is no such operation for vectors of any
// length in C++.
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
constexpr double kCentre = lie::kSeriesLimit / 2;
constexpr int kDegreeB = 11, kDegreeC = 10;
constexpr auto kB = economised<kDegreeB>(2, kCentre);
constexpr auto kC = economised<kDegreeC>(3, kCentre);

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

template <int kLanes, int kCount, bool kFirst, bool kStream>
HELIX_ARM_INLINE bool moveTips(const Pass& given, std::size_t count) {
  using Value = typename Vector<kLanes>::Value;
  using Memory = typename Vector<kLanes>::Memory;
  const Pass pass = given;  // what is written may not alias it
  const SectionVectors<kLanes, kCount> section(pass.actuators, pass.rest);
  Value farthest{};
#pragma GCC unroll 1
  for (std::size_t j = 0; j < count; j += kLanes) {
    if (j % kStep == 0) {
#pragma GCC unroll 4
      for (int i = 0; i < kCount; ++i) fetch(pass.inputs[i] + j + kAhead);
#pragma GCC unroll 3
      for (int r = 0; r < 3 && !kStream; ++r) fetch(pass.to[r] + j + kAhead);
    }
    Value twist[6], tip[3];
    if constexpr (kCount > 0) {
      Value q[kCount];
#pragma GCC unroll 4
      for (int i = 0; i < kCount; ++i) q[i] = *reinterpret_cast<const Memory*>(pass.inputs[i] + j);
      section.twist(q, twist);
    } else {
#pragma GCC unroll 6
      for (int r = 0; r < 6; ++r) twist[r] = *reinterpret_cast<const Memory*>(pass.twists[r] + j);
    }
    if constexpr (!kFirst) {
#pragma GCC unroll 3
      for (int r = 0; r < 3; ++r) tip[r] = *reinterpret_cast<const Memory*>(pass.from[r] + j);
    }
    moveTip<kFirst>(twist, tip, &farthest);
#pragma GCC unroll 3
    for (int r = 0; r < 3; ++r) store<kStream, Memory>(tip[r], pass.to[r] + j);
  }
  return isNear<kLanes>(farthest);
}

#ifdef HELIX_ARM_X86
#define HELIX_ARM_WIDE __attribute__((target("avx512f")))
#define HELIX_ARM_HALF __attribute__((target("avx2,fma")))

// Eight rows of three are three vectors. The compiler does not find these permutations by itself.
template <bool kColumns, bool kStream>
HELIX_ARM_WIDE RowsFound moveRows(const FlatActuator* actuators, const double* rest,
                                  const double* const* inputs, std::size_t count, double* tips) {
  using Value = Vector<8>::Value;
  using Memory = Vector<8>::Memory;
  using Mask = Vector<8>::Mask;
  const SectionVectors<8, 3> section(actuators, rest);
  const double* const columns[] = {inputs[0], inputs[kColumns ? 1 : 0], inputs[kColumns ? 2 : 0]};
  Value lower[3], upper[3];
  for (int i = 0; i < 3; ++i) {
    lower[i] = Value{} + actuators[i].limits.lower;
    upper[i] = Value{} + actuators[i].limits.upper;
  }
  Value farthest{};
  Mask inside = Mask{} - 1;
#pragma GCC unroll 1
  for (std::size_t j = 0; j < count; j += kStep) {
    constexpr std::size_t kLineNumbers = kLine / sizeof(double);
    Value q[3];
    if constexpr (kColumns) {
#pragma GCC unroll 3
      for (int i = 0; i < 3; ++i) {
        fetch(columns[i] + j + kAhead);
        q[i] = *reinterpret_cast<const Memory*>(columns[i] + j);
      }
    } else {
#pragma GCC unroll 3
      for (std::size_t i = 0; i < 3; ++i) fetch(columns[0] + 3 * (j + kAhead) + i * kLineNumbers);
      const auto* const from = reinterpret_cast<const Memory*>(columns[0] + 3 * j);
      Value a = from[0], b = from[1], c = from[2];
      __asm__("" : "+v"(a), "+v"(b), "+v"(c));  // so that each is loaded once
      const Value ab[] = {__builtin_shuffle(a, b, Mask{0, 3, 6, 9, 12, 15, 0, 0}),
                          __builtin_shuffle(a, b, Mask{1, 4, 7, 10, 13, 0, 0, 0}),
                          __builtin_shuffle(a, b, Mask{2, 5, 8, 11, 14, 0, 0, 0})};
      q[0] = __builtin_shuffle(ab[0], c, Mask{0, 1, 2, 3, 4, 5, 10, 13});
      q[1] = __builtin_shuffle(ab[1], c, Mask{0, 1, 2, 3, 4, 8, 11, 14});
      q[2] = __builtin_shuffle(ab[2], c, Mask{0, 1, 2, 3, 4, 9, 12, 15});
    }
    if constexpr (!kStream) {
#pragma GCC unroll 3
      for (std::size_t i = 0; i < 3; ++i) fetch(tips + 3 * (j + kAhead) + i * kLineNumbers);
    }
    inside = (q[0] >= lower[0]) & (q[0] <= upper[0]) & (q[1] >= lower[1]) & (q[1] <= upper[1]) &
             (q[2] >= lower[2]) & (q[2] <= upper[2]) & inside;
    Value twist[6], tip[3];
    section.twist(q, twist);
    moveTip<true>(twist, tip, &farthest);
    const Value xy[] = {__builtin_shuffle(tip[0], tip[1], Mask{0, 8, 0, 1, 9, 0, 2, 10}),
                        __builtin_shuffle(tip[0], tip[1], Mask{0, 3, 11, 0, 4, 12, 0, 5}),
                        __builtin_shuffle(tip[0], tip[1], Mask{13, 0, 6, 14, 0, 7, 15, 0})};
    store<kStream, Memory>(__builtin_shuffle(xy[0], tip[2], Mask{0, 1, 8, 3, 4, 9, 6, 7}),
                           tips + 3 * j);
    store<kStream, Memory>(__builtin_shuffle(xy[1], tip[2], Mask{10, 1, 2, 11, 4, 5, 12, 7}),
                           tips + 3 * j + 8);
    store<kStream, Memory>(__builtin_shuffle(xy[2], tip[2], Mask{0, 13, 2, 3, 14, 5, 6, 15}),
                           tips + 3 * j + 16);
  }
  long long all = -1;
  for (int lane = 0; lane < 8; ++lane) all &= inside[lane];
  return {all != 0, isNear<8>(farthest)};
}

template <int kCount, bool kFirst, bool kStream>
HELIX_ARM_WIDE bool moveWide(const Pass& pass, std::size_t count) {
  return moveTips<8, kCount, kFirst, kStream>(pass, count);
}
template <int kCount, bool kFirst, bool kStream>
HELIX_ARM_HALF bool moveHalf(const Pass& pass, std::size_t count) {
  return moveTips<4, kCount, kFirst, kStream>(pass, count);
}
#endif

#ifdef HELIX_ARM_VECTORS
constexpr int kBaselineLanes = 2;
#else
constexpr int kBaselineLanes = 1;
#endif
template <int kCount, bool kFirst, bool kStream>
bool moveBaseline(const Pass& pass, std::size_t count) {
  return moveTips<kBaselineLanes, kCount, kFirst, kStream>(pass, count);
}

#define HELIX_ARM_KERNELS(move)                                                                 \
  {{move<0, false, false>, move<0, true, false>},                                               \
   {move<1, false, false>, move<1, true, false>},                                               \
   {move<2, false, false>, move<2, true, false>},                                               \
   {move<3, false, false>, move<3, true, false>},                                               \
   {move<4, false, false>, move<4, true, false>}},                                              \
  {                                                                                             \
    nullptr, move<1, true, true>, move<2, true, true>, move<3, true, true>, move<4, true, true> \
  }

}  // namespace

const Kernels& kernelsOf(InstructionSet set) {
  static_assert(kGroup == 4);
  static const Kernels kBaseline{HELIX_ARM_KERNELS(moveBaseline), {}};
#ifdef HELIX_ARM_X86
  static const Kernels kHalf{HELIX_ARM_KERNELS(moveHalf), {}};
  static const Kernels kWide{HELIX_ARM_KERNELS(moveWide),
                             {{moveRows<false, false>, moveRows<false, true>},
                              {moveRows<true, false>, moveRows<true, true>}}};
  if (set == InstructionSet::kAvx512) return kWide;
  if (set == InstructionSet::kAvx2) return kHalf;
#endif
  static_cast<void>(set);
  return kBaseline;
}

void finishStreams() {
#ifdef HELIX_ARM_X86
  __builtin_ia32_sfence();
#endif
}

}  // namespace helix_arm::model::batch

namespace helix_arm::model {

InstructionSet widestInstructionSet() {
#ifdef HELIX_ARM_X86
  static const InstructionSet widest =
      __builtin_cpu_supports("avx512f")                                 ? InstructionSet::kAvx512
      : __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") ? InstructionSet::kAvx2
                                                                        : InstructionSet::kBaseline;
  return widest;
#else
  return InstructionSet::kBaseline;
#endif
}

const char* nameOf(InstructionSet set) {
  if (set == InstructionSet::kAvx512) return "avx512f";
  if (set == InstructionSet::kAvx2) return "avx2";
#ifdef __x86_64__
  return "sse2";
#else
  return "portable";
#endif
}

}  // namespace helix_arm::model
