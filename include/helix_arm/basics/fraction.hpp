#pragma once

#include <cstdint>

namespace helix_arm::basics {

/// A number in [0, 1) of 64 random bits: the same on every machine, which no distribution of the
/// standard library is.
inline double fractionOf(std::uint64_t bits) { return static_cast<double>(bits >> 11) * 0x1p-53; }

}  // namespace helix_arm::basics
