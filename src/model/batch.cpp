#include "helix_arm/model/batch.hpp"

#include <algorithm>

#include "helix_arm/lie/coefficients.hpp"

// Debian's binaries are baseline x86-64: the loops below exist once for each instruction set, and the loader picks.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define HELIX_ARM_CLONES __attribute__((target_clones("avx512f", "arch=haswell", "default")))
#else
#define HELIX_ARM_CLONES
#endif

namespace helix_arm::model {
namespace {

// Samples that go through all stages together: their twists (6 x 8 B each) stay in the first-level cache.
constexpr std::size_t kBlock = 128;

struct alignas(64) Block {
  double twist[6][kBlock];
  double tip[3][kBlock];
  double length[kBlock];
};

// twist += column * l(q), l a polynomial in (q - start) * inverse_scale.
HELIX_ARM_CLONES
void addActuator(const double* __restrict q, std::size_t count, const Contraction::Piece& piece,
                 const double* column, Block* __restrict block) {
  const double start = piece.start, scale = piece.inverse_scale;
  const double c0 = piece.coefficients[0], c1 = piece.coefficients[1], c2 = piece.coefficients[2];
  const double c3 = piece.coefficients[3], c4 = piece.coefficients[4], c5 = piece.coefficients[5];
  const double m0 = column[0], m1 = column[1], m2 = column[2], m3 = column[3], m4 = column[4], m5 = column[5];
  for (std::size_t j = 0; j < count; ++j) {
    const double u = (q[j] - start) * scale;
    const double length = ((((c5 * u + c4) * u + c3) * u + c2) * u + c1) * u + c0;
    block->twist[0][j] += m0 * length;
    block->twist[1][j] += m1 * length;
    block->twist[2][j] += m2 * length;
    block->twist[3][j] += m3 * length;
    block->twist[4][j] += m4 * length;
    block->twist[5][j] += m5 * length;
  }
}

// R p + V v = cos p + a (w x p + v) + w (b (w.p) + c (w.v)) + b (w x v), for sample j
inline void moveTip(const lie::ExpCoefficients& f, std::size_t j, Block* __restrict block) {
  const double vx = block->twist[0][j], vy = block->twist[1][j], vz = block->twist[2][j];
  const double wx = block->twist[3][j], wy = block->twist[4][j], wz = block->twist[5][j];
  const double px = block->tip[0][j], py = block->tip[1][j], pz = block->tip[2][j];
  const double ux = f.a * px + f.b * vx, uy = f.a * py + f.b * vy, uz = f.a * pz + f.b * vz;
  const double along = f.b * (wx * px + wy * py + wz * pz) + f.c * (wx * vx + wy * vy + wz * vz);
  block->tip[0][j] = f.cosine * px + f.a * vx + (wy * uz - wz * uy) + along * wx;
  block->tip[1][j] = f.cosine * py + f.a * vy + (wz * ux - wx * uz) + along * wy;
  block->tip[2][j] = f.cosine * pz + f.a * vz + (wx * uy - wy * ux) + along * wz;
}

inline double squaredAngle(std::size_t j, const Block& block) {
  return block.twist[3][j] * block.twist[3][j] + block.twist[4][j] * block.twist[4][j] +
         block.twist[5][j] * block.twist[5][j];
}

HELIX_ARM_CLONES
double largestSquaredAngle(std::size_t count, const Block& block) {
  double largest = 0.0;
  for (std::size_t j = 0; j < count; ++j) largest = std::max(largest, squaredAngle(j, block));
  return largest;
}

// tip = exp(twist) * tip, all samples within the series.
HELIX_ARM_CLONES
void moveTipsBySeries(std::size_t count, Block* __restrict block) {
  for (std::size_t j = 0; j < count; ++j) {
    moveTip(lie::detail::expCoefficientsBySeries(squaredAngle(j, *block)), j, block);
  }
}

// The same where some are beyond: both ways are computed and a factor of 0 or 1 takes one, as a branch would not vectorise.
HELIX_ARM_CLONES
void moveTipsByEither(std::size_t count, Block* __restrict block) {
  for (std::size_t j = 0; j < count; ++j) {
    const double x = squaredAngle(j, *block);
    const lie::ExpCoefficients near = lie::detail::expCoefficientsBySeries(std::min(x, lie::kSeriesLimit));
    const lie::ExpCoefficients far = lie::detail::expCoefficientsByReduction(x, 0.0);
    const double n = static_cast<double>(x <= lie::kSeriesLimit), f = 1.0 - n;
    moveTip({n * near.a + f * far.a, n * near.b + f * far.b, n * near.c + f * far.c, n * near.cosine + f * far.cosine},
            j, block);
  }
}

// A curve of several pieces is looked up one sample at a time; the identity then takes its lengths on.
void addTableActuator(const Contraction& contraction, const double* q, std::size_t count, const double* column,
                      Block* block) {
  for (std::size_t j = 0; j < count; ++j) block->length[j] = contraction.lengthInside(q[j]);
  addActuator(block->length, count, {0.0, 1.0, {0, 1, 0, 0, 0, 0}}, column, block);
}

}  // namespace

void batchTips(const Arm& arm, const double* const* inputs, std::size_t count, double* x, double* y, double* z) {
  Block block;
  for (std::size_t first = 0; first < count; first += kBlock) {
    const std::size_t size = std::min(kBlock, count - first);
    for (double* coordinate : block.tip) std::fill_n(coordinate, size, 0.0);
    for (int k = arm.sectionCount() - 1; k >= 0; --k) {
      for (double* component : block.twist) std::fill_n(component, size, 0.0);
      for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
        const Contraction& contraction = arm.actuator(i).contraction;
        const double* column = arm.equilibrium(k).map.col(i - arm.firstActuator(k)).data();
        if (contraction.pieces().size() == 1) {
          addActuator(inputs[i] + first, size, contraction.pieces().front(), column, &block);
        } else {
          addTableActuator(contraction, inputs[i] + first, size, column, &block);
        }
      }
      if (largestSquaredAngle(size, block) <= lie::kSeriesLimit) {
        moveTipsBySeries(size, &block);
      } else {
        moveTipsByEither(size, &block);
      }
    }
    std::copy_n(block.tip[0], size, x + first);
    std::copy_n(block.tip[1], size, y + first);
    std::copy_n(block.tip[2], size, z + first);
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
