#pragma once

#include "helix_arm/statics/loaded.hpp"

namespace helix_arm::statics {

/// Maximum number of elements: parts of an arm between section ends and point loads.
inline constexpr int kMaxElements = model::kMaxSections + kMaxInnerPoints;
/// Maximum number of unknowns of the loaded tier in a group with kDof dimensions.
template <int kDof>
inline constexpr int kMaxRates = kDof*(kMostOrder + 1) * kMaxElements;

/// Number of Gauss points of the reference solution for checks.
inline constexpr int kFineNodes = 16;
template <int kDof>
inline constexpr int kMaxFineRates = kDof* kFineNodes* kMaxElements;

}  // namespace helix_arm::statics
