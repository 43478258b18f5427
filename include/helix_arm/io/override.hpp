#pragma once

#include <string>

namespace helix_arm::io {

/// An override of one key, as in `--set regulator.simulated.noise_kpa=1`; list entries by number
/// (`arm.sections.0.name`).
struct Override {
  std::string key;    ///< dotted path; a key that the schema does not know is a fault
  std::string value;  ///< YAML text
};

}  // namespace helix_arm::io
