#pragma once

#include "helix_arm/statics/loaded.hpp"

namespace helix_arm::statics {

/// The most parts of an arm between joints and points that pull.
inline constexpr int kMaxElements = model::kMaxSections + kMaxInnerPoints;
/// The most unknowns of the loaded tier in a group of so many dimensions.
template <int kDof>
inline constexpr int kMaxRates = kDof*(kMostOrder + 1) * kMaxElements;

/// Gauss points of the solution that others are compared with.
inline constexpr int kFineNodes = 16;
template <int kDof>
inline constexpr int kMaxFineRates = kDof* kFineNodes* kMaxElements;

}  // namespace helix_arm::statics
