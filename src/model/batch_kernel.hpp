#pragma once

#include <cstddef>

#include "helix_arm/model/batch.hpp"

/// Inner loops of TipBatch, for each instruction set.
namespace helix_arm::model::batch {

/// Samples per block: its twists and tips stay in the first-level cache.
inline constexpr std::size_t kBlock = 256;
/// Every kernel takes multiples of so many samples, so that all are computed in the same way.
inline constexpr std::size_t kStep = 8;
/// Most actuators per pass over the inputs.
inline constexpr int kGroup = 4;

/// An actuator for the loops: its length change as a polynomial of the input, its map's column.
struct FlatActuator {
  double coefficients[6];  // the first is zero
  double column[6];
  Range limits;
};

/// One section of many samples.
struct Pass {
  const FlatActuator* actuators;  ///< those of the section
  const double* rest;             ///< its twist at their rest lengths
  const double* inputs[kGroup];
  const double* twists[6];  ///< in place of actuators and inputs
  const double* from[3];    ///< tips, seen from the section's end; not where it is the tip
  double* to[3];            ///< tips, seen from its base; may not be where they come from
};
/// tip = exp(twist) tip. @return whether all angles are within lie::kSeriesLimit; otherwise the
/// tips beyond mean nothing.
using Kernel = bool (*)(const Pass& pass, std::size_t count);

struct RowsFound {
  bool inside;  ///< whether all inputs are within the limits
  bool near;    ///< whether all angles are within lie::kSeriesLimit
};
/// An arm of one section with three actuators, to rows.
/// @param inputs  (3) columns, or (1) rows.
using RowKernel = RowsFound (*)(const FlatActuator* actuators, const double* rest,
                                const double* const* inputs, std::size_t count, double* tips);

struct Kernels {
  /// By the number of actuators, 0 where twists are given; and whether the section ends at the tip.
  Kernel section[kGroup + 1][2];
  /// By the number of actuators; the section's end is the tip. Tips are written to memory past the
  /// caches; their addresses are multiples of kLine.
  Kernel streamed[kGroup + 1];
  /// Whether inputs are columns, and tips are written past the caches; null where there are none.
  RowKernel rows[2][2];
};
const Kernels& kernelsOf(InstructionSet set);

inline constexpr std::size_t kLine = 64;  ///< of the caches [bytes]
/// Before another thread may read what was written past the caches.
void finishStreams();

}  // namespace helix_arm::model::batch
