#pragma once

#include "helix_arm/statics/arm_model.hpp"
#include "support/loaded_arm.hpp"

namespace helix_arm::estimation {

inline statics::ArmModel helicalModel() {
  return statics::ArmModel(test::ringArm(test::helicalRing()));
}
inline statics::ArmModel loadedModel() {
  return {test::softHelicalArm(), std::nullopt, test::weight(test::Posture::kHanging, 0.2, 900.0),
          statics::TierSetting{statics::Tier::kLoaded, 5}};
}

}  // namespace helix_arm::estimation
