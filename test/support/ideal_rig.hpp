#pragma once

#include "helix_arm/io/scene.hpp"

namespace helix_arm::test {

/// Makes the rig of a demo scene quasi-static, and all its muscles alike: what a law needs that is
/// exact only there.
inline const io::Override kIdealRig{"simulation.arm",
                                    "{K_gamma_scale: 0.6, K_kappa_scale: 1.2, length_scale: 1.01}"};

}  // namespace helix_arm::test
