#pragma once

#include <cstdint>

namespace helix_arm::basics {

/// A number in [0, 1) from 64 random bits. The result is the same on every machine, unlike that of
/// the standard library's distributions.
inline double fractionOf(std::uint64_t bits) { return static_cast<double>(bits >> 11) * 0x1p-53; }

}  // namespace helix_arm::basics
