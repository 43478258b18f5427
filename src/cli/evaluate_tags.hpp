#pragma once

#include "command.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/scene.hpp"

namespace helix_arm::cli {

/// Compares the model's tags and tip with measured tag poses, and prints it.
/// @return the exit code.
/// @throws as fitCaptures() does, and io::DocumentError with every pressure outside the limits.
int evaluateTags(const io::Scene& scene, const io::DataSet& data, Format format);

}  // namespace helix_arm::cli
