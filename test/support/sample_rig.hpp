#pragma once

#include <map>

#include "helix_arm/calibration/calibration.hpp"
#include "support/sample_view.hpp"

namespace helix_arm::test {

/// What a calibration should find: a true arm and rig that are not what they are thought to be.
struct RigTruth {
  model::Arm arm;                            ///< true
  double length_scale;                       ///< of its free lengths over those that are known
  lie::SE3 X_B0B;                            ///< true base seen from where it is thought to be
  estimation::ArmView view;                  ///< true; its layout has the true placements
  double border_shift;                       ///< [m]
  std::map<std::string, double> parameters;  ///< by the names that a calibration gives them
};

/// How far a rig is from what is known of it: standard deviations.
struct RigErrors {
  double K_kappa = 0, K_gamma = 0, length_scale = 0;  ///< of logs
  double base_translation = 0, base_rotation = 0;     ///< [m], [rad]
  double tag_translation = 0, tag_rotation = 0;       ///< [m], [rad]
  double border_shift = 0;                            ///< [m]
  double K_tau = 0;                                   ///< of its log
};

/// Everything of a rig is fitted, to readings without noise; priors hardly hold anything.
inline estimation::CalibrationOptions everythingFromExactReadings(double corner_noise) {
  estimation::CalibrationOptions options;
  options.fit.insert({estimation::FitParameter::kBase, estimation::FitParameter::kTags,
                      estimation::FitParameter::kBorderShift});
  options.fit.insert(estimation::FitParameter::kLengthScale);
  options.stiffness_prior = 10;
  options.length_scale_prior = 1;
  options.tag_prior = {0.1, 1};
  options.border_shift_prior = 0.1;
  options.corner_noise = corner_noise;
  options.corner_floor = 0;
  options.held_out = false;
  return options;
}

inline RigTruth drawRig(const model::Arm& known, const estimation::ArmView& view,
                        const RigErrors& errors, Random& random) {
  model::Stiffness stiffness = known.actuator(0).stiffness;
  stiffness.kappa *= std::exp(errors.K_kappa * random.normal());
  stiffness.gamma *= std::exp(errors.K_gamma * random.normal());
  if (errors.K_tau > 0) stiffness.tau *= std::exp(errors.K_tau * random.normal());
  RigTruth truth{known.withStiffness(stiffness),
                 std::exp(errors.length_scale * random.normal()),
                 {},
                 view,
                 errors.border_shift * random.normal(),
                 {}};
  auto& parameters = truth.parameters;
  parameters["K_kappa"] = stiffness.kappa;
  parameters["K_gamma"] = stiffness.gamma;
  parameters["K_tau"] = stiffness.tau;
  parameters["length_scale"] = truth.length_scale;
  parameters["bleed"] = truth.border_shift;
  const char* const base_names[] = {"x", "y", "z", "rx", "ry", "rz"};
  const char* const tag_names[] = {"along", "y", "z", "rx", "ry", "rz"};
  lie::Vector6 base;
  for (int i = 0; i < 6; ++i) {
    base[i] = (i < 3 ? errors.base_translation : errors.base_rotation) * random.normal();
    parameters[std::string("base_") + base_names[i]] = base[i];
  }
  truth.X_B0B = lie::SE3::exp(base);
  truth.view.X_CB = view.X_CB * truth.X_B0B;
  // The first tag is the base tag: it is where it should be.
  for (std::size_t t = 1; t < truth.view.layout.tags.size(); ++t) {
    estimation::TagPlacement& tag = truth.view.layout.tags[t];
    lie::Vector6 moved;
    for (int i = 0; i < 6; ++i) {
      moved[i] = (i < 3 ? errors.tag_translation : errors.tag_rotation) * random.normal();
      parameters["tag_" + std::to_string(tag.id) + "_" + tag_names[i]] = moved[i];
    }
    tag = estimation::movedBy(tag, moved, known.restLength(tag.section));
  }
  return truth;
}

/// The true shape at these pressures.
inline model::Twists shapeOf(const RigTruth& truth, const Eigen::VectorXd& pressure) {
  return truth.arm.twistsOfLengths(truth.length_scale * truth.arm.lengths(pressure));
}

/// What the camera sees of the rig at these pressures, to `noise` [px].
inline std::vector<estimation::CornerObservation> observe(const RigTruth& truth,
                                                          const Eigen::VectorXd& pressure,
                                                          double noise, Random& random) {
  estimation::ArmView shrunk = truth.view;
  shrunk.layout.size -= 2 * truth.border_shift;
  return observe(truth.view, estimation::visibleTags(shrunk, shapeOf(truth, pressure), 0.3), noise,
                 random);
}

/// Adds a capture, numbered on.
inline void addCapture(estimation::ArmCaptures& data, const Eigen::VectorXd& pressure,
                       estimation::Reading reading) {
  estimation::Capture capture;
  capture.number = static_cast<int>(data.captures.size()) + 1;
  capture.pressure = pressure;
  capture.reading = std::move(reading);
  data.captures.push_back(std::move(capture));
}

/// The paper's twelve levels, level j in actuator j mod n.
inline std::vector<Eigen::VectorXd> twelvePressures(const model::Arm& arm) {
  constexpr double kLevels[] = {0, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60};
  std::vector<Eigen::VectorXd> out;
  for (int j = 0; j < 12; ++j) {
    out.push_back(Eigen::VectorXd::Zero(arm.actuatorCount()));
    out.back()[j % arm.actuatorCount()] = kLevels[j] / 60 * kMaxPressure;
  }
  return out;
}

}  // namespace helix_arm::test
