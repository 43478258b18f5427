#pragma once

#include <stdexcept>
#include <string>

namespace helix_arm::test {

/// A spatial scene with every key of the schema, one subject a line: faults are checked by line.
inline const std::string kSpatialScene = R"(name: rig
contractions:
  muscle:
    quintic:
      coefficients_m: [0.4, -0.1, 0, 0, 0, 0]
      reference_pressure_kpa: 400
      max_pressure_kpa: 400
  bellows:
    table: {pressure_kpa: [0, 50, 100], length_m: [0.1, 0.12, 0.13]}
  cable:
    tendon: {length_m: 0.3, spool_radius_m: 0.01, max_angle_rad: 10}
arm:
  geometry: spatial
  base: {position_m: [0.1, 0.2, 1], rpy_deg: [10, 90, 20]}
  stiffness: {K_gamma: 10, K_tau_m2: 0, K_kappa_m2: 1.0e-4}
  sections:
    - name: lower
      ring: {count: 3, radius_m: 0.03, tilt_deg: 10, length_scale: 1, contraction: muscle, max_pressure_kpa: 300}
      separators: 5
      separator_radius_m: 0.04
      muscle_radius_m: 0.01
    - name: upper
      stiffness: {K_gamma: 20, K_tau_m2: 1.0e-5, K_kappa_m2: 2.0e-4}
      actuators:
        - {name: left, position_m: [0, 0.02, 0], rpy_deg: [0, 0, 5], contraction: bellows}
        - {position_m: [0, -0.02, 0], contraction: bellows, min_pressure_kpa: 10, max_pressure_kpa: 90}
        - name: top
          position_m: [0, 0.01, 0.03]
          tilt_deg: 12
          contraction: bellows
          stiffness: {K_gamma: 30, K_tau_m2: 2.0e-5, K_kappa_m2: 3.0e-4}
regulator:
  simulated: {time_constant_s: 0.2, supply_kpa: 450, noise_kpa: 2, seed: 7}
safety: {commander_timeout_s: 0.8, target_timeout_s: 2, reading_timeout_s: 0.4, slew_kpa_s: 200, trip_margin_kpa: 20, spike_time_s: 0.2, min_supply_kpa: 300, follow: {tolerance_kpa: 50, time_s: 1.5, time_constant_s: 0.3}, leak_drop_kpa: 15, fault_action: hold, hold_time_s: 5, vented_below_kpa: 12, vent_time_s: 4}
tags:
  family: 25h9
  size_m: 0.02
  groups:
    - section: upper
      actuator: top
      ids: [3, 1]
      s: [0.25, 1]
      position_m: [0.01, -0.02, 0.04]
      rpy_deg: [15, 25, 35]
    - {ids: [0], s: [0.5]}
camera:
  size_px: [640, 480]
  focal_px: [600, 610]
  centre_px: [320.5, 239.5]
  distortion: [0.1, -0.2, 0.001, -0.002, 0.05]
  position_m: [1, 0.5, 0.8]
  rpy_deg: [5, 12, 170]
  webcam: {device: /dev/video2, fourcc: YUYV, fps: 15, focus: 20, exposure: 300}
vision:
  quad_decimate: 1.5
  quad_sigma_px: 0.8
  threads: 2
  refine_edges: false
  max_hamming: 0
  tracking: regions
  min_tags: 3
  corner_noise_px: 0.4
  tag_position_noise_m: 0.025
  tag_rotation_noise_deg: 5
  robust_scale: 4
  base_prior: {translation_m: 0.003, rotation_deg: 0.9}
  bleed_prior_m: 0.0004
simulation:
  arm: {K_gamma_scale: 0.8, K_kappa_scale: 1.2, length_scale: 1.02, K_eps_scale: 0.9}
  camera: {blur_px: 0.5, noise_gray_levels: 3, exposure: 1.1, bleed_m: 0.0003, jpeg_quality: 80, clutter: 4, occluders: 2, seed: 9}
  mounts: {camera_translation_m: 0.02, camera_rotation_deg: 2, tag_translation_m: 0.003, tag_rotation_deg: 4, seed: 5}
)";

/// The same under a load; load begins at line 72.
inline const std::string kLoadedScene = [] {
  std::string text = kSpatialScene;
  const std::string stiffness = "K_kappa_m2: 1.0e-4}";
  text.replace(text.find(stiffness), stiffness.size(), "K_kappa_m2: 1.0e-4, K_eps_n: 900}");
  return text + R"(load:
  gravity_m_s2: [0.1, 0.2, -9.7]
  mass_kg: 0.3
  tip: {mass_kg: 0.05, position_m: [0.02, 0, 0.01], force_n: [0.1, 0.2, 0.3], moment_nm: [0.01, 0, -0.02]}
  points:
    - {section: upper, s: 0.5, mass_kg: 0.02, position_m: [0, 0.03, 0], force_n: [0.4, 0, 0], moment_nm: [0, 0.03, 0]}
    - {s: 0.25, force_n: [0, 0.5, 0]}
tier: loaded
order: 3
dynamics: {damping_s: {stretch: 0.01, bend: 0.02}, inertia_radius_m: 0.025, order: 1, step_s: 0.002}
)";
}();

/// The least a planar scene can say.
inline const std::string kPlanarScene = R"(name: flat
contractions:
  muscle:
    table: {pressure_kpa: [0, 400], length_m: [0.4, 0.3]}
arm:
  geometry: planar
  stiffness: {K_gamma: 10, K_tau_m2: 0, K_kappa_m2: 1.0e-4}
  sections:
    - name: only
      ring: {count: 2, radius_m: 0.03, contraction: muscle}
)";

/// The text with its first `from` replaced.
inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  if (at == std::string::npos) throw std::invalid_argument("the scene has no " + from);
  return text.replace(at, from.size(), to);
}

}  // namespace helix_arm::test
