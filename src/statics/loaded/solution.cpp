#include "helix_arm/statics/solution.hpp"

namespace helix_arm::statics {

const char* nameOf(SolveStatus status) {
  switch (status) {
    case SolveStatus::kConverged:
      return "converged";
    case SolveStatus::kNotConverged:
      return "not_converged";
    case SolveStatus::kSnapped:
      return "snapped";
    case SolveStatus::kUnsupported:
      return "unsupported";
  }
  return "";
}

}  // namespace helix_arm::statics
