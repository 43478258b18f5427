#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::statics {

/// Sample inputs that exercise every motion of an arm, for checks that rely on samples.
///
/// A section's map from lengths to twists (eq. 17) moves it along as many combinations of its
/// actuators as the rank of the map. They are the right singular vectors of the map multiplied by
/// the range of each length. The twists are largest at corners of the limits where a combination of
/// these vectors is largest. The samples are the corners along and against each vector (for all
/// sections at once, and for one section with the others at rest), and the corners along random
/// combinations in every section. The first two samples are the lower and the upper limits; the
/// last `inner` are uniform within the limits. The generator is seeded: the same arm gives the same
/// samples.
/// @param corners  number of random combinations, >= 0.
/// @param inner    number of uniform samples within the limits, >= 0.
/// @return inputs (n) of each sample.
std::vector<Eigen::VectorXd> sampleInputs(const model::Arm& arm, int corners, int inner);

}  // namespace helix_arm::statics
