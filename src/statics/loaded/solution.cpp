#include "helix_arm/statics/solution.hpp"

#include <array>

namespace helix_arm::statics {

const char* nameOf(SolveStatus status) {
  static constexpr std::array<const char*, 4> kNames = {"converged", "not_converged", "snapped",
                                                        "unsupported"};
  return kNames[static_cast<std::size_t>(status)];
}

}  // namespace helix_arm::statics
