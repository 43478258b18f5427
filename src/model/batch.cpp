#include "helix_arm/model/batch.hpp"

#include <algorithm>
#include <cstdint>
#include <vector>

#include "batch_loops.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::model {
namespace {

using batch::Block;
using batch::Columns;
using batch::FlatActuator;
using batch::FlatLink;
using batch::kBlock;
using batch::kGroup;
using batch::kStep;
using batch::Pass;

// A batch whose tips do not stay in a core's caches.
constexpr std::size_t kLargeBatch = 100'000;
// Samples from one look at their angles to the next, of an arm that needs no block.
constexpr std::size_t kSpan = 16 * kBlock;

FlatLink flatten(const lie::SE3& link) {
  FlatLink flat;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) flat.R[r][c] = link.rotation(r, c);
    flat.t[r] = link.translation[r];
  }
  return flat;
}

FlatActuator flatten(const Actuator& actuator, const double* column) {
  FlatActuator flat{};
  std::copy_n(column, 6, flat.column);
  flat.limits = actuator.limits;
  const auto& pieces = actuator.contraction.pieces();
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

// Inputs of a block, one actuator after the other, or via `buffer` if they lie otherwise in memory.
class ColumnInputs {
 public:
  ColumnInputs(const double* const* columns, std::size_t first)
      : columns_(columns), first_(first) {}
  const double* column(int actuator, const Range&, std::size_t count, double* buffer) {
    const double* const from = columns_[actuator] + first_;
    if (count % kStep == 0) return from;
    std::fill(std::copy_n(from, count, buffer), buffer + kBlock, from[0]);
    return buffer;
  }

 private:
  const double* const* columns_;
  std::size_t first_;
};

// Copied, so that what is checked is what is computed, whoever writes to the array meanwhile.
class RowInputs {
 public:
  RowInputs(const InputArray& array, std::size_t first) : array_(array), first_(first) {}
  bool inside() const { return inside_; }
  const double* column(int actuator, const Range& limits, std::size_t count, double* buffer) {
    constexpr auto kNumber = static_cast<std::ptrdiff_t>(sizeof(double));
    if (array_.row_stride % kNumber == 0) {
      batch::gather(array_.place(first_, actuator), array_.row_stride / kNumber, count, buffer);
    } else {
      for (std::size_t j = 0; j < count; ++j) buffer[j] = array_.at(first_ + j, actuator);
    }
    inside_ &= batch::countInside(buffer, count, limits.lower, limits.upper) ==
               static_cast<std::int64_t>(count);
    if (count % kStep != 0) std::fill(buffer + count, buffer + kBlock, limits.lower);
    return buffer;
  }

 private:
  InputArray array_;
  std::size_t first_;
  bool inside_ = true;
};

// Calls kernel(first, size) for spans of whole steps, and inBlocks(first, end) for those where it
// says that not all angles are near, and for the rest. @param head  samples before the streamed.
template <class InBlocks, class Kernel>
void inSpans(std::size_t count, std::size_t head, bool streamed, const InBlocks& inBlocks,
             const Kernel& kernel) {
  const std::size_t begin = streamed ? head : 0, end = begin + (count - begin) / kStep * kStep;
  inBlocks(0, begin);
  for (std::size_t first = begin; first < end; first += kSpan) {
    const std::size_t size = std::min(kSpan, end - first);
    if (!kernel(first, size)) inBlocks(first, first + size);
  }
  if (streamed) batch::finishStreams();
  inBlocks(end, count);
}

bool isLine(const double* place) {
  return reinterpret_cast<std::uintptr_t>(place) % batch::kLine == 0;
}
// Samples of this many numbers before the first one that begins at a line of the caches.
std::size_t beforeLine(const double* place, std::size_t numbers) {
  std::size_t out = 0;
  while (out < kStep && !isLine(place + numbers * out)) ++out;
  return out;
}

}  // namespace

struct TipBatch::Plan {
  const Arm& arm;
  const batch::Kernels& kernels;
  std::vector<FlatActuator> actuators;
  std::vector<FlatLink> links;  // empty if there are none
  // One section of actuators whose lengths are polynomials: nothing is kept between two passes.
  bool direct = false;

  Plan(const Arm& of, const batch::Kernels& with) : arm(of), kernels(with) {
    direct = arm.sectionCount() == 1 && arm.links() == nullptr && arm.actuatorCount() <= kGroup;
    for (int k = 0; k < arm.sectionCount(); ++k) {
      const int begin = arm.firstActuator(k);
      for (int i = begin; i < arm.firstActuator(k + 1); ++i) {
        const double* const column = arm.equilibrium(k).map.col(i - begin).data();
        actuators.push_back(flatten(arm.actuator(i), column));
        direct = direct && isPolynomial(i);
      }
      if (arm.links() != nullptr) links.push_back(flatten(arm.link(k)));
    }
  }

  bool isPolynomial(int actuator) const {
    return arm.actuator(actuator).contraction.pieces().size() == 1;
  }

  template <class Inputs>
  void setChanges(Inputs& inputs, int begin, int members, std::size_t count, Block* block,
                  const double** out) const {
    for (int m = 0; m < members; ++m) {
      const int i = begin + m;
      double* const buffer = block->inputs[m];
      out[m] = inputs.column(i, actuators[i].limits, count, buffer);
      if (isPolynomial(i)) continue;
      const Contraction& contraction = arm.actuator(i).contraction;
      for (std::size_t j = 0; j < count; ++j) buffer[j] = contraction.changeInside(out[m][j]);
      std::fill(buffer + count, buffer + kBlock, 0.0);
      out[m] = buffer;
    }
  }

  // The twists of a section.
  template <class Inputs>
  void setTwistsOf(int k, Inputs& inputs, std::size_t count, Block* block) const {
    const int begin = arm.firstActuator(k), end = arm.firstActuator(k + 1);
    const std::size_t whole = (count + kStep - 1) / kStep * kStep;
    for (int i = begin; i < end; i += kGroup) {
      const int members = std::min(kGroup, end - i);
      const double* q[kGroup];
      setChanges(inputs, i, members, count, block, q);
      if (i == begin) {
        batch::setTwists(&actuators[i], members, q, whole, arm.restTwist(k).data(), block);
      } else {
        batch::addTwists(&actuators[i], members, q, whole, block);
      }
    }
  }

  // `out` takes whole steps.
  template <class Inputs>
  void block(Inputs& inputs, std::size_t count, Block* block, double* const* out) const {
    const std::size_t whole = (count + kStep - 1) / kStep * kStep;
    int present = 0;  // of block->tips
    for (int k = arm.sectionCount() - 1; k >= 0; --k) {
      const bool at_end = k == arm.sectionCount() - 1;
      if (!links.empty()) {
        if (at_end) {
          for (int r = 0; r < 3; ++r) std::fill_n(block->tips[present][r], whole, links[k].t[r]);
        } else {
          batch::moveTips(links[k], whole, block->tips[present]);
        }
      }
      Pass pass{};
      pass.rest = arm.restTwist(k).data();
      for (int r = 0; r < 3; ++r) {
        pass.from[r] = block->tips[present][r];
        pass.to[r] = k == 0 ? out[r] : block->tips[1 - present][r];
      }
      const int begin = arm.firstActuator(k), size = arm.firstActuator(k + 1) - begin;
      const bool first = at_end && links.empty(), few = size <= kGroup;
      if (few) {
        pass.actuators = &actuators[begin];
        setChanges(inputs, begin, size, count, block, pass.inputs);
      } else {
        setTwistsOf(k, inputs, count, block);
        for (int r = 0; r < 6; ++r) pass.twists[r] = block->twist[r];
      }
      if (!kernels.section[few ? size : 0][first ? 1 : 0](pass, whole)) {
        if (few) batch::setTwists(pass.actuators, size, pass.inputs, whole, pass.rest, block);
        batch::moveTipsFar(whole, first, *block, pass.from, pass.to);
      }
      present = 1 - present;
    }
  }

  // Products of exponentials, and maps that depend on the inputs, are not vectorised.
  template <class Input, class Output>
  void oneByOne(std::size_t count, const Input& input, const Output& output) const {
    Eigen::VectorXd q(arm.actuatorCount());
    for (std::size_t j = 0; j < count; ++j) {
      for (int i = 0; i < q.size(); ++i) q[i] = input(j, i);
      output(j, arm.tipInside(q).translation);
    }
  }
};

TipBatch::TipBatch(const Arm& arm, InstructionSet set) {
  basics::require(set <= widestInstructionSet(), "batch: this machine has no ", nameOf(set),
                  "; its widest vectors are of ", nameOf(widestInstructionSet()));
  plan_ = std::make_unique<const Plan>(arm, batch::kernelsOf(set));
}

TipBatch::~TipBatch() = default;

void TipBatch::columns(const double* const* inputs, std::size_t count, double* x, double* y,
                       double* z, std::size_t total) const {
  const Plan& plan = *plan_;
  if (!plan.arm.isLinear()) {
    return plan.oneByOne(
        count, [&](std::size_t j, int i) { return inputs[i][j]; },
        [&](std::size_t j, const Eigen::Vector3d& tip) {
          x[j] = tip.x();
          y[j] = tip.y();
          z[j] = tip.z();
        });
  }
  const auto inBlocks = [&](std::size_t begin, std::size_t end) {
    Block block;
    for (std::size_t first = begin; first < end; first += kBlock) {
      const std::size_t size = std::min(kBlock, end - first);
      ColumnInputs columns(inputs, first);
      double* const out[] = {x + first, y + first, z + first};
      if (size % kStep == 0) {
        plan.block(columns, size, &block, out);
      } else {
        alignas(batch::kLine) Columns last;
        double* const padded[] = {last[0], last[1], last[2]};
        plan.block(columns, size, &block, padded);
        for (int r = 0; r < 3; ++r) std::copy_n(last[r], size, out[r]);
      }
    }
  };
  if (!plan.direct) return inBlocks(0, count);
  const std::size_t head = std::min(count, beforeLine(x, 1));
  const bool streamed = std::max(count, total) >= kLargeBatch && isLine(x + head) &&
                        isLine(y + head) && isLine(z + head);
  const int n = plan.arm.actuatorCount();
  const batch::Kernel kernel = streamed ? plan.kernels.streamed[n] : plan.kernels.section[n][1];
  inSpans(count, head, streamed, inBlocks, [&](std::size_t first, std::size_t size) {
    Pass pass{};
    pass.actuators = plan.actuators.data();
    pass.rest = plan.arm.restTwist(0).data();
    for (int i = 0; i < n; ++i) pass.inputs[i] = inputs[i] + first;
    pass.to[0] = x + first, pass.to[1] = y + first, pass.to[2] = z + first;
    return kernel(pass, size);
  });
}

bool TipBatch::rows(const InputArray& inputs, std::size_t count, double* tips,
                    std::size_t total) const {
  const Plan& plan = *plan_;
  bool inside = true;
  if (!plan.arm.isLinear()) {
    plan.oneByOne(
        count,
        [&](std::size_t j, int i) {
          const double input = inputs.at(j, i);
          inside &= plan.actuators[i].limits.contains(input);
          return input;
        },
        [&](std::size_t j, const Eigen::Vector3d& tip) {
          Eigen::Vector3d::Map(tips + 3 * j) = tip;
        });
    return inside;
  }
  const auto inBlocks = [&](std::size_t begin, std::size_t end) {
    Block block;
    alignas(batch::kLine) Columns out;
    double* const columns[] = {out[0], out[1], out[2]};
    for (std::size_t first = begin; first < end; first += kBlock) {
      const std::size_t size = std::min(kBlock, end - first);
      RowInputs rows(inputs, first);
      plan.block(rows, size, &block, columns);
      batch::joinRows(out, size, tips + 3 * first);
      inside &= rows.inside();
    }
  };
  constexpr auto kNumber = static_cast<std::ptrdiff_t>(sizeof(double));
  const bool by_columns = inputs.row_stride == kNumber;
  const bool dense =
      by_columns || (inputs.column_stride == kNumber && inputs.row_stride == 3 * kNumber);
  const std::size_t head = std::min(count, beforeLine(tips, 3));
  const bool streamed = std::max(count, total) >= kLargeBatch && isLine(tips + 3 * head);
  const batch::RowKernel kernel = plan.kernels.rows[by_columns ? 1 : 0][streamed ? 1 : 0];
  if (!plan.direct || plan.arm.actuatorCount() != 3 || !dense || kernel == nullptr) {
    inBlocks(0, count);
    return inside;
  }
  inSpans(count, head, streamed, inBlocks, [&](std::size_t first, std::size_t size) {
    const double* const from[] = {inputs.place(first, 0), inputs.place(first, 1),
                                  inputs.place(first, 2)};
    const batch::RowsFound found =
        kernel(plan.actuators.data(), plan.arm.restTwist(0).data(), from, size, tips + 3 * first);
    inside &= found.inside;
    return found.near;
  });
  return inside;
}

}  // namespace helix_arm::model
