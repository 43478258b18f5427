#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::statics {

/// Inputs that move an arm in every way that it can move, for what is judged by samples.
///
/// A section's map from lengths to twists (eq. 17) moves it along as many combinations of its
/// actuators as its rank: the right singular vectors, found of the map times the range of each
/// length. Its twists are farthest out at corners of the limits where a combination of these
/// vectors is largest: sampled are the corners along each vector and against it, of all sections at
/// once and of one section with the others at rest, and of random combinations in every section.
/// The first two samples are the lower and the upper limits; the last `inner` are uniform within
/// them. Seeded: the same arm gives the same samples.
/// @param corners  of random combinations, >= 0.
/// @param inner    inputs within the limits, >= 0.
/// @return inputs (n) each.
std::vector<Eigen::VectorXd> sampleInputs(const model::Arm& arm, int corners, int inner);

}  // namespace helix_arm::statics
