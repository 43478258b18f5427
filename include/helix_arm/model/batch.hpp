#pragma once

#include <cstddef>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::model {

/// Number of inputs per block of batchTips. The last bits of a tip depend on its place in its block
/// and on whether another tip of the block turns by more than 4.5 rad.
inline constexpr std::size_t kBatchBlock = 256;

/// Tip positions of many inputs at once, for point clouds and maps. Structure of arrays, one
/// thread, the widest vector unit of the machine (chosen at run time).
///
/// Agrees with Arm::tip to 8 eps of the arm's length where no section turns by more than 4.5 rad.
/// Beyond that, the rounding of the twist grows with the angle (24 eps at 7.5 rad). Contractions
/// from a table run at scalar speed.
/// @param inputs  (actuatorCount) pointers to `count` inputs each, inside the limits [Pa or rad];
///     not checked.
/// @param x,y,z   `count` tip coordinates each, base frame [m].
void batchTips(const Arm& arm, const double* const* inputs, std::size_t count, double* x, double* y,
               double* z);

/// The instruction set that batchTips uses on this machine: "avx512f", "avx2", "sse2" or
/// "portable".
const char* batchInstructionSet();

}  // namespace helix_arm::model
