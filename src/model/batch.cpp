#include "helix_arm/model/batch.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "basics/vector_clones.hpp"
#include "batch_series.hpp"
#include "lie/coefficients.hpp"

#define HELIX_ARM_INLINE inline __attribute__((always_inline))
// A loop over a block, which the compiler vectorises.
#define HELIX_ARM_LOOP HELIX_ARM_CLONES __attribute__((noinline))

namespace helix_arm::model {
namespace {

// Samples per block, whose columns stay in the first-level cache. A last block is filled up, so
// that every tip is computed in the same way.
constexpr std::size_t kBlock = 64;
// Most actuators per pass over the twists.
constexpr int kGroup = 4;

using Column = double[kBlock];
struct alignas(64) Block {
  Column inputs[kGroup];
  Column twist[6];
  Column tips[2][3];  // seen from a section's end and from its base
  Column origin[3];   // zero: the tip, seen from itself
  Column out[3];
};

// An actuator for the loops: its length change as a polynomial of the input, its map's column.
struct FlatActuator {
  double coefficients[6];  // the first is zero
  double column[6];
};

FlatActuator flatten(const Contraction& contraction, const double* column) {
  FlatActuator flat{};
  std::copy_n(column, 6, flat.column);
  const auto& pieces = contraction.pieces();
  if (pieces.size() > 1) {
    flat.coefficients[1] = 1.0;  // the change itself, evaluated before
    return flat;
  }
  // Curves of one piece start at zero, so only the scale is folded in.
  double power = 1.0;
  for (int k = 0; k < 6; ++k, power *= pieces.front().inverse_scale)
    flat.coefficients[k] = pieces.front().coefficients[k] * power;
  return flat;
}

// twist = rest + sum_i column_i (l_i(q_i) - rest length), or with kAdd, twist += the sum.
template <int kCount, bool kAdd>
HELIX_ARM_INLINE void sumActuators(const FlatActuator* actuators, const double* const* q,
                                   const double* rest, Column* __restrict twist) {
  for (std::size_t j = 0; j < kBlock; ++j) {
    double sum[6];
    for (int r = 0; r < 6; ++r) sum[r] = kAdd ? twist[r][j] : rest[r];
    for (int i = 0; i < kCount; ++i) {
      const double* const c = actuators[i].coefficients;
      const double u = q[i][j];
      const double change = ((((c[5] * u + c[4]) * u + c[3]) * u + c[2]) * u + c[1]) * u;
      for (int r = 0; r < 6; ++r) sum[r] += actuators[i].column[r] * change;
    }
    for (int r = 0; r < 6; ++r) twist[r][j] = sum[r];
  }
}

// @param rest  null: the sum is added.
template <int kCount>
HELIX_ARM_INLINE void sumGroup(const FlatActuator* actuators, const double* const* q,
                               const double* rest, Column* twist) {
  return rest != nullptr ? sumActuators<kCount, false>(actuators, q, rest, twist)
                         : sumActuators<kCount, true>(actuators, q, rest, twist);
}

HELIX_ARM_LOOP void setTwists(const FlatActuator* actuators, int count, const double* const* q,
                              const double* rest, Column* twist) {
  static_assert(kGroup == 4);
  if (count == 4) return sumGroup<4>(actuators, q, rest, twist);
  if (count == 3) return sumGroup<3>(actuators, q, rest, twist);
  if (count == 2) return sumGroup<2>(actuators, q, rest, twist);
  sumGroup<1>(actuators, q, rest, twist);
}

// Coefficients of exp about the middle of the series' range (lie::ExpCoefficients): without
// rounding, b theta and c theta^2 are within 1 eps.
constexpr double kCentre = lie::kSeriesLimit / 2;
constexpr auto kB = batch::economised<11>(2, kCentre);
constexpr auto kC = batch::economised<10>(3, kCentre);

// sum_k coefficients[k] t^k. Even and odd powers apart: half the latency of Horner's rule.
template <std::size_t kSize>
HELIX_ARM_INLINE double polynomial(const std::array<double, kSize>& coefficients, double t) {
  constexpr std::size_t kEven = (kSize - 1) / 2 * 2, kOdd = kSize / 2 * 2 - 1;
  const double t2 = t * t;
  double even = coefficients[kEven], odd = coefficients[kOdd];
  for (std::size_t k = kEven; k > 0; k -= 2) even = even * t2 + coefficients[k - 2];
  for (std::size_t k = kOdd; k > 1; k -= 2) odd = odd * t2 + coefficients[k - 2];
  return odd * t + even;
}

// R p + V v = p + v + w x (a p + b v + w x (b p + c v)); p = 0 where the section's end is the tip.
template <bool kFirst>
HELIX_ARM_INLINE void moveNear(const Column* twist, const Column* from, double* const* to) {
#pragma GCC ivdep
  for (std::size_t j = 0; j < kBlock; ++j) {
    const double v[] = {twist[0][j], twist[1][j], twist[2][j]};
    const double w[] = {twist[3][j], twist[4][j], twist[5][j]};
    const double x = (w[0] * w[0] + w[1] * w[1]) + w[2] * w[2];
    const double b = polynomial(kB, x - kCentre), c = polynomial(kC, x - kCentre);
    const double a = 1.0 - x * c;
    double inner[3], outer[3], sum[3];
    for (int r = 0; r < 3; ++r) {
      inner[r] = kFirst ? c * v[r] : b * from[r][j] + c * v[r];
      outer[r] = kFirst ? b * v[r] : a * from[r][j] + b * v[r];
      sum[r] = kFirst ? v[r] : from[r][j] + v[r];
    }
    outer[0] = (outer[0] + w[1] * inner[2]) - w[2] * inner[1];
    outer[1] = (outer[1] + w[2] * inner[0]) - w[0] * inner[2];
    outer[2] = (outer[2] + w[0] * inner[1]) - w[1] * inner[0];
    to[0][j] = (sum[0] + w[1] * outer[2]) - w[2] * outer[1];
    to[1][j] = (sum[1] + w[2] * outer[0]) - w[0] * outer[2];
    to[2][j] = (sum[2] + w[0] * outer[1]) - w[1] * outer[0];
  }
}

HELIX_ARM_LOOP void moveTips(const Column* twist, bool first, const Column* from,
                             double* const* to) {
  first ? moveNear<true>(twist, from, to) : moveNear<false>(twist, from, to);
}

// How many angles are beyond the series, whose tips mean nothing.
HELIX_ARM_LOOP std::int64_t countFar(const Column* twist) {
  std::int64_t far = 0;
  for (std::size_t j = 0; j < kBlock; ++j) {
    const double w[] = {twist[3][j], twist[4][j], twist[5][j]};
    far += (w[0] * w[0] + w[1] * w[1]) + w[2] * w[2] > lie::kSeriesLimit ? 1 : 0;
  }
  return far;
}

// R p + V v = cos p + a (w x p + v) + w (b (w.p) + c (w.v)) + b (w x v) where the angle is beyond
// the series. Others stay: a factor of 0 or 1 selects them, as branches would not vectorise.
HELIX_ARM_LOOP void moveTipsFar(const Column* twist, const Column* from, double* const* to) {
#pragma GCC ivdep
  for (std::size_t j = 0; j < kBlock; ++j) {
    const double v[] = {twist[0][j], twist[1][j], twist[2][j]};
    const double w[] = {twist[3][j], twist[4][j], twist[5][j]};
    const double p[] = {from[0][j], from[1][j], from[2][j]};
    const double x = (w[0] * w[0] + w[1] * w[1]) + w[2] * w[2];
    const lie::ExpCoefficients f = lie::detail::expCoefficientsByReduction(std::max(x, 1.0), 0.0);
    const double along = f.b * (w[0] * p[0] + w[1] * p[1] + w[2] * p[2]) +
                         f.c * (w[0] * v[0] + w[1] * v[1] + w[2] * v[2]);
    double u[3];
    for (int r = 0; r < 3; ++r) u[r] = f.b * v[r] + f.a * p[r];
    const double turned[] = {w[1] * u[2] - w[2] * u[1], w[2] * u[0] - w[0] * u[2],
                             w[0] * u[1] - w[1] * u[0]};
    const double far = static_cast<double>(x > lie::kSeriesLimit), near = 1.0 - far;
    for (int r = 0; r < 3; ++r) {
      const double moved = (f.a * v[r] + f.cosine * p[r]) + turned[r] + along * w[r];
      to[r][j] = near * to[r][j] + far * moved;
    }
  }
}

// to = link * from, which may be the same.
HELIX_ARM_LOOP void moveThrough(const lie::SE3& link, const Column* from, Column* to) {
  const lie::SE3 X = link;  // what is written may not alias it
#pragma GCC ivdep
  for (std::size_t j = 0; j < kBlock; ++j) {
    const double p[] = {from[0][j], from[1][j], from[2][j]};
    for (int r = 0; r < 3; ++r) {
      to[r][j] = X.rotation(r, 0) * p[0] + X.rotation(r, 1) * p[1] + X.rotation(r, 2) * p[2] +
                 X.translation[r];
    }
  }
}

// With the stride known, the compiler permutes vectors in place of loading numbers one by one.
template <int kStride>
HELIX_ARM_INLINE std::int64_t gatherEvery(const double* __restrict from, std::ptrdiff_t stride,
                                          const Range& limits, double* __restrict to) {
  const double lower = limits.lower, upper = limits.upper;
  std::int64_t inside = 0;
  for (std::size_t j = 0; j < kBlock; ++j) {
    to[j] = from[(kStride > 0 ? kStride : stride) * static_cast<std::ptrdiff_t>(j)];
  }
  // The copy is checked, not the array, which others may write to meanwhile.
  for (std::size_t j = 0; j < kBlock; ++j) inside += to[j] >= lower && to[j] <= upper ? 1 : 0;
  return inside;
}

// Every stride-th number. @return how many are within the limits, which NaN is not.
HELIX_ARM_LOOP std::int64_t gather(const double* from, std::ptrdiff_t stride, const Range& limits,
                                   double* to) {
  if (stride == 1) return gatherEvery<1>(from, stride, limits, to);
  if (stride == 3) return gatherEvery<3>(from, stride, limits, to);
  return gatherEvery<0>(from, stride, limits, to);
}

HELIX_ARM_LOOP void joinRows(const Column* __restrict tip, double* __restrict rows) {
  for (std::size_t j = 0; j < kBlock; ++j) {
    for (int r = 0; r < 3; ++r) rows[3 * j + r] = tip[r][j];
  }
}

// Processors fetch ahead by themselves, but not while they wait for arithmetic, nor across pages.
void fetch(const double* column) {
  for (std::size_t j = 0; j < kBlock; j += 8) __builtin_prefetch(column + j);
}

}  // namespace

struct TipBatch::Plan {
  const Arm& arm;
  std::vector<FlatActuator> actuators;

  explicit Plan(const Arm& of) : arm(of) {
    for (int k = 0; k < arm.sectionCount(); ++k) {
      const int begin = arm.firstActuator(k);
      for (int i = begin; i < arm.firstActuator(k + 1); ++i) {
        actuators.push_back(
            flatten(arm.actuator(i).contraction, arm.equilibrium(k).map.col(i - begin).data()));
      }
    }
  }

  // The twists of a section. @param inputsOf  as of tips().
  template <class InputsOf>
  void setTwists(int k, const InputsOf& inputsOf, Block* block) const {
    const int begin = arm.firstActuator(k), end = arm.firstActuator(k + 1);
    for (int first = begin; first < end; first += kGroup) {
      const int members = std::min(kGroup, end - first);
      const double* q[kGroup];
      for (int m = 0; m < members; ++m) {
        double* const buffer = block->inputs[m];
        q[m] = inputsOf(first + m, buffer);
        const Contraction& contraction = arm.actuator(first + m).contraction;
        if (contraction.pieces().size() == 1) continue;
        for (std::size_t j = 0; j < kBlock; ++j) buffer[j] = contraction.changeInside(q[m][j]);
        q[m] = buffer;
      }
      model::setTwists(&actuators[static_cast<std::size_t>(first)], members, q,
                       first == begin ? arm.restTwist(k).data() : nullptr, block->twist);
    }
  }

  // The tips of a block. @param inputsOf  the inputs of an actuator, where they are or via a
  // buffer. @param size  samples that count; the others fill the block up.
  template <class InputsOf>
  void tips(const InputsOf& inputsOf, std::size_t size, Block* block, double* const* out) const {
    if (!arm.isLinear()) return tipsOneByOne(inputsOf, size, block, out);
    const Column* from = block->origin;
    int present = 0;  // of block->tips
    for (int k = arm.sectionCount() - 1; k >= 0; --k) {
      if (arm.links() != nullptr) {
        moveThrough(arm.link(k), from, block->tips[present]);
        from = block->tips[present];
      }
      setTwists(k, inputsOf, block);
      present = 1 - present;
      Column* const next = block->tips[present];
      double* const columns[] = {next[0], next[1], next[2]};
      double* const* const to = k == 0 ? out : columns;
      moveTips(block->twist, from == block->origin, from, to);
      if (countFar(block->twist) > 0) moveTipsFar(block->twist, from, to);
      from = next;
    }
  }

  // Products of exponentials, and maps that depend on the inputs, are not vectorised.
  template <class InputsOf>
  void tipsOneByOne(const InputsOf& inputsOf, std::size_t size, Block* block,
                    double* const* out) const {
    Eigen::MatrixXd q(arm.actuatorCount(), size);
    for (int i = 0; i < q.rows(); ++i) {
      const double* const inputs = inputsOf(i, block->inputs[0]);
      for (std::size_t j = 0; j < size; ++j) q(i, j) = inputs[j];
    }
    for (std::size_t j = 0; j < size; ++j) {
      const Eigen::Vector3d tip = arm.tipInside(q.col(j)).translation;
      for (int r = 0; r < 3; ++r) out[r][j] = tip[r];
    }
  }
};

TipBatch::TipBatch(const Arm& arm) : plan_(std::make_unique<const Plan>(arm)) {}

TipBatch::~TipBatch() = default;

void TipBatch::columns(const double* const* inputs, std::size_t count, double* x, double* y,
                       double* z) const {
  Block block{};
  for (std::size_t first = 0; first < count; first += kBlock) {
    const std::size_t size = std::min(kBlock, count - first);
    const auto inputsOf = [&](int actuator, double* buffer) -> const double* {
      const double* const from = inputs[actuator] + first;
      fetch(from + 2 * kBlock);
      if (size == kBlock) return from;
      std::fill(std::copy_n(from, size, buffer), buffer + kBlock, from[0]);
      return buffer;
    };
    double* const out[] = {x + first, y + first, z + first};
    if (size == kBlock) {
      for (const double* column : out) fetch(column + 2 * kBlock);
      plan_->tips(inputsOf, size, &block, out);
    } else {
      double* const padded[] = {block.out[0], block.out[1], block.out[2]};
      plan_->tips(inputsOf, size, &block, padded);
      for (int r = 0; r < 3; ++r) std::copy_n(padded[r], size, out[r]);
    }
  }
}

bool TipBatch::rows(const InputArray& inputs, std::size_t count, double* tips) const {
  bool inside = true;
  Block block{};
  Column padded;
  double* const out[] = {block.out[0], block.out[1], block.out[2]};
  for (std::size_t first = 0; first < count; first += kBlock) {
    const std::size_t size = std::min(kBlock, count - first);
    const auto inputsOf = [&](int actuator, double* buffer) -> const double* {
      constexpr auto kNumber = static_cast<std::ptrdiff_t>(sizeof(double));
      fetch(inputs.place(first + 2 * kBlock, 0) + static_cast<std::size_t>(actuator) * kBlock);
      const Range& limits = plan_->arm.actuator(actuator).limits;
      const double* from = inputs.place(first, actuator);
      std::ptrdiff_t stride = inputs.row_stride / kNumber;
      if (size < kBlock || inputs.row_stride % kNumber != 0) {
        for (std::size_t j = 0; j < size; ++j) padded[j] = inputs.at(first + j, actuator);
        std::fill(padded + size, padded + kBlock, padded[0]);
        from = padded;
        stride = 1;
      }
      inside &= gather(from, stride, limits, buffer) == kBlock;
      return buffer;
    };
    plan_->tips(inputsOf, size, &block, out);
    double* const to = tips + 3 * first;
    for (int r = 0; r < 3; ++r) fetch(to + (6 + r) * kBlock);
    if (size == kBlock) {
      joinRows(block.out, to);
    } else {
      for (std::size_t j = 0; j < 3 * size; ++j) to[j] = block.out[j % 3][j / 3];
    }
  }
  return inside;
}

}  // namespace helix_arm::model
