#include "helix_arm/model/batch.hpp"

#include <algorithm>
#include <array>
#include <cstdint>

#include "helix_arm/lie/coefficients.hpp"

// Debian compiles for baseline x86-64, so the loops below are cloned per instruction set and
// selected at load time. Not under the thread sanitizer, which starts after the selection.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define HELIX_ARM_CLONES __attribute__((target_clones("avx512f", "arch=haswell", "default")))
#else
#define HELIX_ARM_CLONES
#endif

namespace helix_arm::model {
namespace {

// Twists of a block (6 x 8 B each) stay in the first-level cache.
constexpr std::size_t kBlock = kBatchBlock;

struct alignas(64) Block {
  double twist[6][kBlock];
  double tip[3][kBlock];
  double change[3][kBlock];
};

// An actuator in the form that the loops need: its length change as a polynomial of the input, and
// its column of the map.
struct FlatActuator {
  double coefficients[6];  // the first is zero
  double column[6];
};

// Actuators per pass over the inputs; more would not fit the vector registers.
constexpr int kGroup = 3;

// twist = rest + sum_i column_i (l_i(q_i) - rest length) for kCount actuators; with kAdd, the sum
// is added to the previous content.
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
  static_assert(kGroup == 3);
  if (size == 3) return sumActuators<3, kAdd>(actuators, q, count, rest, block);
  if (size == 2) return sumActuators<2, kAdd>(actuators, q, count, rest, block);
  sumActuators<1, kAdd>(actuators, q, count, rest, block);
}

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

// Where tips are read from and written to: the same arrays, except for the section at the base,
// which writes to the caller's.
struct Tips {
  const double* from[3];
  double* to[3];
};

// R p + V v = cos p + a (w x p + v) + w (b (w.p) + c (w.v)) + b (w x v), for sample j; p = 0 where
// the tip begins
template <bool kFirst>
inline __attribute__((always_inline)) void moveTip(const lie::ExpCoefficients& f, std::size_t j,
                                                   const Block& block, const Tips& tips) {
  const double vx = block.twist[0][j], vy = block.twist[1][j], vz = block.twist[2][j];
  const double wx = block.twist[3][j], wy = block.twist[4][j], wz = block.twist[5][j];
  double ux = f.b * vx, uy = f.b * vy, uz = f.b * vz;
  double along = f.c * (wx * vx + wy * vy + wz * vz);
  double x = f.a * vx, y = f.a * vy, z = f.a * vz;
  if constexpr (!kFirst) {
    const double px = tips.from[0][j], py = tips.from[1][j], pz = tips.from[2][j];
    ux += f.a * px;
    uy += f.a * py;
    uz += f.a * pz;
    along += f.b * (wx * px + wy * py + wz * pz);
    x += f.cosine * px;
    y += f.cosine * py;
    z += f.cosine * pz;
  }
  tips.to[0][j] = x + (wy * uz - wz * uy) + along * wx;
  tips.to[1][j] = y + (wz * ux - wx * uz) + along * wy;
  tips.to[2][j] = z + (wx * uy - wy * ux) + along * wz;
}

inline double squaredAngle(std::size_t j, const Block& block) {
  return block.twist[3][j] * block.twist[3][j] + block.twist[4][j] * block.twist[4][j] +
         block.twist[5][j] * block.twist[5][j];
}

// Rigid link between two sections, or beyond the last one.
struct FlatLink {
  double R[3][3];
  double t[3];
};

FlatLink flatten(const lie::SE3& link) {
  FlatLink flat;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) flat.R[r][c] = link.rotation(r, c);
    flat.t[r] = link.translation[r];
  }
  return flat;
}

HELIX_ARM_CLONES
void startTips(const FlatLink& link, std::size_t count, Block* block) {
  for (int r = 0; r < 3; ++r) std::fill_n(block->tip[r], count, link.t[r]);
}

// tip = link * tip.
HELIX_ARM_CLONES
void moveTips(const FlatLink& link, std::size_t count, Block* block) {
  for (std::size_t j = 0; j < count; ++j) {
    const double p[3] = {block->tip[0][j], block->tip[1][j], block->tip[2][j]};
    for (int r = 0; r < 3; ++r) {
      block->tip[r][j] =
          link.R[r][0] * p[0] + link.R[r][1] * p[1] + link.R[r][2] * p[2] + link.t[r];
    }
  }
}

// Number of samples beyond the series; a maximum of doubles would not vectorise.
HELIX_ARM_CLONES
std::int64_t countFar(std::size_t count, const Block& block) {
  std::int64_t far = 0;
  for (std::size_t j = 0; j < count; ++j) far += squaredAngle(j, block) > lie::kSeriesLimit ? 1 : 0;
  return far;
}

// tip = exp(twist) * tip; all samples are within the series.
template <bool kFirst>
inline __attribute__((always_inline)) void moveNear(std::size_t count, const Block& block,
                                                    const Tips& tips) {
#pragma GCC ivdep
  for (std::size_t j = 0; j < count; ++j) {
    moveTip<kFirst>(lie::detail::expCoefficientsBySeries(squaredAngle(j, block)), j, block, tips);
  }
}

HELIX_ARM_CLONES
void moveTipsNear(std::size_t count, bool first, const Block& block, const Tips& tips) {
  first ? moveNear<true>(count, block, tips) : moveNear<false>(count, block, tips);
}

// The same if some samples are beyond the series: both forms are computed and selected by a factor
// of 0 or 1, since a branch would not vectorise.
template <bool kFirst>
inline __attribute__((always_inline)) void moveFar(std::size_t count, const Block& block,
                                                   const Tips& tips) {
#pragma GCC ivdep
  for (std::size_t j = 0; j < count; ++j) {
    const double x = squaredAngle(j, block);
    const lie::ExpCoefficients near =
        lie::detail::expCoefficientsBySeries(std::min(x, lie::kSeriesLimit));
    const lie::ExpCoefficients far = lie::detail::expCoefficientsByReduction(x, 0.0);
    const double n = static_cast<double>(x <= lie::kSeriesLimit), f = 1.0 - n;
    moveTip<kFirst>({n * near.a + f * far.a, n * near.b + f * far.b, n * near.c + f * far.c,
                     n * near.cosine + f * far.cosine},
                    j, block, tips);
  }
}

HELIX_ARM_CLONES
void moveTipsFar(std::size_t count, bool first, const Block& block, const Tips& tips) {
  first ? moveFar<true>(count, block, tips) : moveFar<false>(count, block, tips);
}

FlatActuator flatten(const Contraction& contraction, const double* column) {
  FlatActuator flat{};
  std::copy_n(column, 6, flat.column);
  if (contraction.pieces().size() == 1) {
    // Curves of one piece start at zero, so only the scale is folded in.
    const Contraction::Piece& piece = contraction.pieces().front();
    double power = 1.0;
    for (int k = 0; k < 6; ++k, power *= piece.inverse_scale)
      flat.coefficients[k] = piece.coefficients[k] * power;
  } else {
    flat.coefficients[1] = 1.0;  // the change itself, evaluated before
  }
  return flat;
}

// Products of exponentials are not vectorised.
void batchTapered(const Arm& arm, const double* const* inputs, std::size_t count, double* x,
                  double* y, double* z) {
  Eigen::VectorXd q(arm.actuatorCount());
  for (std::size_t j = 0; j < count; ++j) {
    for (int i = 0; i < q.size(); ++i) q[i] = inputs[i][j];
    const Eigen::Vector3d tip = arm.tipInside(q).translation;
    x[j] = tip.x();
    y[j] = tip.y();
    z[j] = tip.z();
  }
}

}  // namespace

void batchTips(const Arm& arm, const double* const* inputs, std::size_t count, double* x, double* y,
               double* z) {
  if (arm.tapered()) return batchTapered(arm, inputs, count, x, y, z);
  std::array<FlatActuator, kMaxSections * kMaxActuators> flat;
  for (int k = 0; k < arm.sectionCount(); ++k) {
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      flat[i] = flatten(arm.actuator(i).contraction,
                        arm.equilibrium(k).map.col(i - arm.firstActuator(k)).data());
    }
  }
  std::array<FlatLink, kMaxSections> links;
  const bool linked = arm.links() != nullptr;
  for (int k = 0; linked && k < arm.sectionCount(); ++k) links[k] = flatten(arm.link(k));
  Block block;
  for (std::size_t first = 0; first < count; first += kBlock) {
    const std::size_t size = std::min(kBlock, count - first);
    for (int k = arm.sectionCount() - 1; k >= 0; --k) {
      const int begin = arm.firstActuator(k), end = arm.firstActuator(k + 1);
      for (int i = begin; i < end; i += kGroup) {
        const int members = std::min(kGroup, end - i);
        const double* q[kGroup];
        for (int m = 0; m < members; ++m) {
          q[m] = inputs[i + m] + first;
          const Contraction& contraction = arm.actuator(i + m).contraction;
          if (contraction.pieces().size() == 1) continue;
          for (std::size_t j = 0; j < size; ++j)
            block.change[m][j] = contraction.changeInside(q[m][j]);
          q[m] = block.change[m];
        }
        if (i == begin) {
          setTwists(&flat[i], members, q, size, arm.restTwist(k).data(), &block);
        } else {
          addTwists(&flat[i], members, q, size, &block);
        }
      }
      const bool at_end = k == arm.sectionCount() - 1, at_base = k == 0;
      if (linked && at_end) startTips(links[k], size, &block);
      if (linked && !at_end) moveTips(links[k], size, &block);
      const Tips tips = {{block.tip[0], block.tip[1], block.tip[2]},
                         {at_base ? x + first : block.tip[0], at_base ? y + first : block.tip[1],
                          at_base ? z + first : block.tip[2]}};
      (countFar(size, block) == 0 ? moveTipsNear : moveTipsFar)(size, at_end && !linked, block,
                                                                tips);
    }
  }
}

const char* batchInstructionSet() {
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
  if (__builtin_cpu_supports("avx512f")) return "avx512f";
  if (__builtin_cpu_supports("avx2")) return "avx2";
  return "sse2";
#else
  return "portable";
#endif
}

}  // namespace helix_arm::model
