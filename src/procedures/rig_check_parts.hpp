#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/procedures/rig_check.hpp"

// The parts of checkRig(). Each adds its findings.

namespace helix_arm::procedures {

/// A number with so many significant digits.
std::string figure(double value, int digits = 3);

/// Where tags are mounted.
void checkTags(const io::Scene& scene, std::vector<Finding>& findings);

/// Contraction curves and the limits on them.
void checkCurves(const io::Scene& scene, std::vector<Finding>& findings);

/// The regulator, as far as its profile tells.
void checkRegulator(const io::Scene& scene, std::vector<Finding>& findings);

/// Intrinsics.
void checkCamera(const io::Scene& scene, std::vector<Finding>& findings);

/// What is seen over the workspace; nothing without camera or tags.
std::optional<VisionFigures> checkVision(const io::Scene& scene, int samples,
                                         std::vector<Finding>& findings);

}  // namespace helix_arm::procedures
