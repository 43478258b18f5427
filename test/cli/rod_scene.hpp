#pragma once

#include <string>

namespace helix_arm::test {

/// An arm of three muscles that is a straight rod of 0.3 m at 0 kPa, with six tags 50 mm from its
/// axis: 1, 2 and 3 on its y side, 4, 5 and 6 on its z side.
inline const std::string kRodScene = R"(name: rod
contractions:
  linear: {table: {pressure_kpa: [0, 100], length_m: [0.3, 0.2]}}
arm:
  geometry: spatial
  stiffness: {K_gamma: 10, K_tau_m2: 0, K_kappa_m2: 1.0e-4}
  sections: [{name: arm, ring: {count: 3, radius_m: 0.03, contraction: linear}}]
tags:
  size_m: 0.03
  groups:
    - {ids: [1, 2, 3], s: [0.25, 0.5, 1], position_m: [0, 0.05, 0]}
    - {ids: [4, 5, 6], s: [0.25, 0.5, 1], position_m: [0, 0, 0.05]}
)";

/// A planar arm of two muscles that is a straight rod of 0.4 m at 0 kPa.
inline const std::string kFlatScene = R"(name: flat
contractions:
  linear: {table: {pressure_kpa: [0, 100], length_m: [0.4, 0.3]}}
arm:
  geometry: planar
  stiffness: {K_gamma: 10, K_tau_m2: 0, K_kappa_m2: 1.0e-4}
  sections: [{name: arm, ring: {count: 2, radius_m: 0.03, contraction: linear}}]
)";

/// Header of a data set of its tag poses.
inline const std::string kTagPoseHeader = "capture,pressure_1_kpa,tag,x_m,y_m,z_m,qx,qy,qz,qw\n";

}  // namespace helix_arm::test
