#pragma once

#include "batch_vectors.hpp"

#ifdef HELIX_ARM_VECTORS

/// Kernels of the batch for rows: pressures of one sample beside each other, and so its tip.
namespace helix_arm::model::batch {

/// As many rows of three as a vector has lanes are three vectors. Compilers do not find this.
template <int kLanes>
struct RowPermutation;

template <>
struct RowPermutation<2> {
  using Value = Vector<2>::Value;
  using Mask = Vector<2>::Mask;

  static HELIX_ARM_INLINE void split(const Value& a, const Value& b, const Value& c, Value* q) {
    q[0] = __builtin_shuffle(a, b, Mask{0, 3});
    q[1] = __builtin_shuffle(a, c, Mask{1, 2});
    q[2] = __builtin_shuffle(b, c, Mask{0, 3});
  }
  static HELIX_ARM_INLINE void join(const Value* tip, Value* rows) {
    rows[0] = __builtin_shuffle(tip[0], tip[1], Mask{0, 2});
    rows[1] = __builtin_shuffle(tip[2], tip[0], Mask{0, 3});
    rows[2] = __builtin_shuffle(tip[1], tip[2], Mask{1, 3});
  }
};

#ifdef HELIX_ARM_X86
// Each vector has one number of every row in four lanes of three vectors: blends, a permutation.
template <>
struct RowPermutation<4> {
  using Value = Vector<4>::Value;
  using Mask = Vector<4>::Mask;

  static HELIX_ARM_INLINE void blend(const Value& a, const Value& b, const Value& c, Value* out) {
    *out = __builtin_shuffle(__builtin_shuffle(a, b, Mask{0, 5, 2, 3}), c, Mask{0, 1, 6, 3});
  }
  static HELIX_ARM_INLINE void split(const Value& a, const Value& b, const Value& c, Value* q) {
    blend(a, c, b, &q[0]);
    blend(b, a, c, &q[1]);
    blend(c, b, a, &q[2]);
    order(q);
  }
  static HELIX_ARM_INLINE void join(const Value* tip, Value* rows) {
    Value ordered[] = {tip[0], tip[1], tip[2]};
    order(ordered);
    blend(ordered[0], ordered[1], ordered[2], &rows[0]);
    blend(ordered[1], ordered[2], ordered[0], &rows[1]);
    blend(ordered[2], ordered[0], ordered[1], &rows[2]);
  }

 private:
  // Its own inverse.
  static HELIX_ARM_INLINE void order(Value* columns) {
    columns[0] = __builtin_shuffle(columns[0], Mask{0, 3, 2, 1});
    columns[1] = __builtin_shuffle(columns[1], Mask{1, 0, 3, 2});
    columns[2] = __builtin_shuffle(columns[2], Mask{2, 1, 0, 3});
  }
};

template <>
struct RowPermutation<8> {
  using Value = Vector<8>::Value;
  using Mask = Vector<8>::Mask;

  static HELIX_ARM_INLINE void split(const Value& a, const Value& b, const Value& c, Value* q) {
    const Value ab[] = {__builtin_shuffle(a, b, Mask{0, 3, 6, 9, 12, 15, 0, 0}),
                        __builtin_shuffle(a, b, Mask{1, 4, 7, 10, 13, 0, 0, 0}),
                        __builtin_shuffle(a, b, Mask{2, 5, 8, 11, 14, 0, 0, 0})};
    q[0] = __builtin_shuffle(ab[0], c, Mask{0, 1, 2, 3, 4, 5, 10, 13});
    q[1] = __builtin_shuffle(ab[1], c, Mask{0, 1, 2, 3, 4, 8, 11, 14});
    q[2] = __builtin_shuffle(ab[2], c, Mask{0, 1, 2, 3, 4, 9, 12, 15});
  }
  static HELIX_ARM_INLINE void join(const Value* tip, Value* rows) {
    const Value xy[] = {__builtin_shuffle(tip[0], tip[1], Mask{0, 8, 0, 1, 9, 0, 2, 10}),
                        __builtin_shuffle(tip[0], tip[1], Mask{0, 3, 11, 0, 4, 12, 0, 5}),
                        __builtin_shuffle(tip[0], tip[1], Mask{13, 0, 6, 14, 0, 7, 15, 0})};
    rows[0] = __builtin_shuffle(xy[0], tip[2], Mask{0, 1, 8, 3, 4, 9, 6, 7});
    rows[1] = __builtin_shuffle(xy[1], tip[2], Mask{10, 1, 2, 11, 4, 5, 12, 7});
    rows[2] = __builtin_shuffle(xy[2], tip[2], Mask{0, 13, 2, 3, 14, 5, 6, 15});
  }
};
#endif

/// The compiler may not load them again: what is checked is what is computed, whoever writes to the
/// array meanwhile, and permutations take registers.
template <class Value>
HELIX_ARM_INLINE void loadOnce(Value& a, Value& b, Value& c) {
#ifdef HELIX_ARM_X86
  __asm__("" : "+v"(a), "+v"(b), "+v"(c));
#elif defined(__aarch64__)
  __asm__("" : "+w"(a), "+w"(b), "+w"(c));
#endif
}

/// Whether all inputs so far are within the limits, which a NaN is not.
template <int kLanes>
class LimitCheck {
 public:
  using Value = typename Vector<kLanes>::Value;

  HELIX_ARM_INLINE void add(const Value& q, const Value& lower, const Value& upper) {
    inside_ = (q >= lower) & (q <= upper) & inside_;
  }
  HELIX_ARM_INLINE bool inside() const {
    long long all = -1;
    for (int lane = 0; lane < kLanes; ++lane) all &= inside_[lane];
    return all != 0;
  }

 private:
  using Mask = typename Vector<kLanes>::Mask;
  Mask inside_ = Mask{} - 1;
};

#ifdef HELIX_ARM_X86
// The compiler takes masks of this length apart before it inlines them where the machine has them.
template <>
class LimitCheck<8> {
 public:
  using Value = Vector<8>::Value;

  HELIX_ARM_INLINE void add(const Value& q, const Value& lower, const Value& upper) {
    __asm__("vcmplepd %2, %1, %0 %{%0%}" : "+Yk"(inside_) : "v"(lower), "v"(q));
    __asm__("vcmplepd %2, %1, %0 %{%0%}" : "+Yk"(inside_) : "v"(q), "vm"(upper));
  }
  HELIX_ARM_INLINE bool inside() const { return inside_ == kAll; }

 private:
  static constexpr unsigned short kAll = 0xff;
  unsigned short inside_ = kAll;
};
#endif

/// A RowKernel.
template <int kLanes, bool kColumns, bool kStream>
HELIX_ARM_INLINE RowsFound moveRows(const FlatActuator* actuators, const double* rest,
                                    const double* const* inputs, std::size_t count, double* tips) {
  using Value = typename Vector<kLanes>::Value;
  using Memory = typename Vector<kLanes>::Memory;
  constexpr std::size_t kLineNumbers = kLine / sizeof(double);
  const SectionVectors<kLanes, 3> section(actuators, rest);
  const double* const columns[] = {inputs[0], inputs[kColumns ? 1 : 0], inputs[kColumns ? 2 : 0]};
  Value lower[3], upper[3], farthest{};
  for (int i = 0; i < 3; ++i) {
    lower[i] = Value{} + actuators[i].limits.lower;
    upper[i] = Value{} + actuators[i].limits.upper;
  }
  LimitCheck<kLanes> check;
#pragma GCC unroll 1
  for (std::size_t j = 0; j < count; j += kLanes) {
    if (j % kStep == 0) {
#pragma GCC unroll 3
      for (std::size_t i = 0; i < 3; ++i) {
        fetch(kColumns ? columns[i] + j + kAhead
                       : columns[0] + 3 * (j + kAhead) + i * kLineNumbers);
        if (!kStream) fetch(tips + 3 * (j + kAhead) + i * kLineNumbers);
      }
    }
    Value q[3];
    if constexpr (kColumns) {
#pragma GCC unroll 3
      for (int i = 0; i < 3; ++i) q[i] = *reinterpret_cast<const Memory*>(columns[i] + j);
      loadOnce(q[0], q[1], q[2]);
    } else {
      const auto* const from = reinterpret_cast<const Memory*>(columns[0] + 3 * j);
      Value a = from[0], b = from[1], c = from[2];
      loadOnce(a, b, c);
      RowPermutation<kLanes>::split(a, b, c, q);
    }
#pragma GCC unroll 3
    for (int i = 0; i < 3; ++i) check.add(q[i], lower[i], upper[i]);
    Value twist[6], tip[3], rows[3];
    section.twist(q, twist);
    moveTip<true>(twist, tip, &farthest);
    RowPermutation<kLanes>::join(tip, rows);
#pragma GCC unroll 3
    for (int r = 0; r < 3; ++r) store<kStream, Memory>(rows[r], tips + 3 * j + kLanes * r);
  }
  return {check.inside(), isNear<kLanes>(farthest)};
}

}  // namespace helix_arm::model::batch

#endif
