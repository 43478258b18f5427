#pragma once

#include <string>

namespace helix_arm::io {

/// How one section is drawn; no effect on the model.
struct SectionLook {
  std::string name;
  int separators = 8;              ///< discs along the section, >= 2
  double separator_radius = 0.03;  ///< [m]
  double muscle_radius = 0.008;    ///< [m]
};

}  // namespace helix_arm::io
