#include "batch_kernel.hpp"

#include "batch_rows.hpp"
#include "batch_vectors.hpp"

namespace helix_arm::model::batch {
namespace {

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

template <int kCount, bool kFirst, bool kStream>
HELIX_ARM_WIDE bool moveWide(const Pass& pass, std::size_t count) {
  return moveTips<8, kCount, kFirst, kStream>(pass, count);
}
template <int kCount, bool kFirst, bool kStream>
HELIX_ARM_HALF bool moveHalf(const Pass& pass, std::size_t count) {
  return moveTips<4, kCount, kFirst, kStream>(pass, count);
}
template <bool kColumns, bool kStream>
HELIX_ARM_WIDE RowsFound rowsWide(const FlatActuator* actuators, const double* rest,
                                  const double* const* inputs, std::size_t count, double* tips) {
  return moveRows<8, kColumns, kStream>(actuators, rest, inputs, count, tips);
}
template <bool kColumns, bool kStream>
HELIX_ARM_HALF RowsFound rowsHalf(const FlatActuator* actuators, const double* rest,
                                  const double* const* inputs, std::size_t count, double* tips) {
  return moveRows<4, kColumns, kStream>(actuators, rest, inputs, count, tips);
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

#ifdef HELIX_ARM_VECTORS
template <bool kColumns, bool kStream>
RowsFound rowsBaseline(const FlatActuator* actuators, const double* rest,
                       const double* const* inputs, std::size_t count, double* tips) {
  return moveRows<kBaselineLanes, kColumns, kStream>(actuators, rest, inputs, count, tips);
}
#endif

#define HELIX_ARM_ROW_KERNELS(rows)                                                  \
  {                                                                                  \
    {rows<false, false>, rows<false, true>}, { rows<true, false>, rows<true, true> } \
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
#ifdef HELIX_ARM_VECTORS
  static const Kernels kBaseline{HELIX_ARM_KERNELS(moveBaseline),
                                 HELIX_ARM_ROW_KERNELS(rowsBaseline)};
#else
  static const Kernels kBaseline{HELIX_ARM_KERNELS(moveBaseline), {}};
#endif
#ifdef HELIX_ARM_X86
  static const Kernels kHalf{HELIX_ARM_KERNELS(moveHalf), HELIX_ARM_ROW_KERNELS(rowsHalf)};
  static const Kernels kWide{HELIX_ARM_KERNELS(moveWide), HELIX_ARM_ROW_KERNELS(rowsWide)};
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
