#pragma once

#include <cstddef>
#include <cstdint>

#include "batch_kernel.hpp"

/// Loops over a block of samples that are not worth a kernel of their own: the compiler vectorises
/// them. Counts are multiples of kStep unless said otherwise.
namespace helix_arm::model::batch {

using Columns = double[3][kBlock];

/// State of a block of samples between its sections; it stays in the first-level cache.
struct alignas(kLine) Block {
  double inputs[kGroup][kBlock];
  double twist[6][kBlock];
  Columns tips[2];  ///< seen from a section's end and from its base
};

/// twist = rest + sum_i column_i (l_i(q_i) - rest length) for up to kGroup actuators.
void setTwists(const FlatActuator* actuators, int size, const double* const* q, std::size_t count,
               const double* rest, Block* block);
/// The same, added to the twists that are there.
void addTwists(const FlatActuator* actuators, int size, const double* const* q, std::size_t count,
               Block* block);

/// Rigid link between two sections, or beyond the last one.
struct FlatLink {
  double R[3][3];
  double t[3];
};
/// tip = link * tip.
void moveTips(const FlatLink& link, std::size_t count, Columns& tips);

/// tip = exp(twist) tip where the angle is beyond the series; other tips stay.
/// @param first  whether the section's end is the tip.
void moveTipsFar(std::size_t count, bool first, const Block& block, const double* const* from,
                 double* const* to);

/// Every stride-th number; any count.
void gather(const double* from, std::ptrdiff_t stride, std::size_t count, double* to);
/// How many are within [lower, upper], which NaN is not; any count.
std::int64_t countInside(const double* values, std::size_t count, double lower, double upper);
/// Columns to rows of three; any count.
void joinRows(const Columns& tips, std::size_t count, double* rows);

}  // namespace helix_arm::model::batch
