#pragma once

#include <vector>

#include "helix_arm/estimation/contraction_fit.hpp"

namespace helix_arm::estimation {

/// The branches that a sample is on, see Branch.
struct Branches {
  bool rising, falling;
};

std::vector<Branches> branchesOf(const std::vector<LengthSample>& samples);

}  // namespace helix_arm::estimation
