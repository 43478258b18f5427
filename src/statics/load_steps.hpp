#pragma once

#include <vector>

#include "multiple_shooting.hpp"

namespace helix_arm::statics {

/// The equilibrium at the largest fraction of the load that was reached.
struct Reached {
  std::vector<Node> nodes;
  double share = 0.0;
  double residual = 0.0;  ///< as Balance::residual
  int iterations = 0;     ///< Newton iterations, summed over all load steps
  int load_steps = 0;
  bool snapped = false;  ///< the branch ended at a smaller load
};

/// Applies the load in steps, as long as Newton's method stays on the branch that grows from the
/// unloaded shape. Where the branch ends, the result is whichever shape damped steps find under the
/// full load.
Reached stepLoad(const MultipleShooting& shooting, const ExactOptions& options);

}  // namespace helix_arm::statics
