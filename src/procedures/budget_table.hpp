#pragma once

#include <string>

#include "helix_arm/tracking/error_budget.hpp"
#include "helix_arm/tracking/onset_hypotheses.hpp"

namespace helix_arm::procedures {

/// A table in mm, for letters of one width; ends in a new line: standard deviations of the parts in
/// their order, predicted and open loop, along x, y, z of the base (< 0: a negative variance) and
/// along the worst direction. After calibration and unexplained their sum, "both together": only
/// that is a covariance.
std::string budgetTable(const estimation::TipErrorBudget& budget);
/// The worst directions in mm, the measured error and what the budget says of it, one in a line:
/// for letters of any width.
std::string budgetText(const estimation::TipErrorBudget& budget);

/// Meaning of ExternalLoad::blind, and the remedy.
inline constexpr char kContactBlind[] =
    "contacts may not be found: the model finds no shape under a force at the tip, or the seen "
    "tags do not determine one; check load and K_eps_n";

/// Why the pictures are doubted while Drift::doubtful, and the remedy.
std::string driftText(const estimation::Drift& drift);

}  // namespace helix_arm::procedures
