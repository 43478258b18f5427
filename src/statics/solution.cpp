#include "helix_arm/statics/solution.hpp"

namespace helix_arm::statics {

const char* nameOf(SolveStatus status) {
  if (status == SolveStatus::kConverged) return "converged";
  return status == SolveStatus::kNotConverged ? "not_converged" : "unsupported";
}

}  // namespace helix_arm::statics
