#pragma once

#include "helix_arm/io/scene.hpp"

namespace helix_arm::test {

inline std::string shippedPath(const std::string& name) {
  return HELIX_ARM_SOURCE_DIR "/config/scenes/" + name + ".yaml";
}
inline io::Scene shippedScene(const std::string& name,
                              const std::vector<io::Override>& overrides = {}) {
  return io::loadScene(shippedPath(name), overrides);
}
inline io::Scene demo(const std::vector<io::Override>& overrides = {}) {
  return shippedScene("demo", overrides);
}

/// Makes the rig of a demo scene quasi-static, and all its muscles alike: what a law needs that is
/// exact only there.
inline const io::Override kIdealRig{"simulation.arm",
                                    "{K_gamma_scale: 0.6, K_kappa_scale: 1.2, length_scale: 1.01}"};

}  // namespace helix_arm::test
