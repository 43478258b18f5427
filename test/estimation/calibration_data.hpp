// Captures of simulated arms, and what a calibration of them says.
#pragma once

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "helix_arm/calibration/calibration.hpp"
#include "helix_arm/model/curve.hpp"
#include "support/sample_rig.hpp"

namespace helix_arm::estimation {

using test::Random;
using Pressures = std::vector<Eigen::VectorXd>;

inline const Parameter& parameter(const Calibration& calibration, const std::string& name) {
  const auto& all = calibration.parameters;
  const auto found = std::find_if(all.begin(), all.end(),
                                  [&name](const Parameter& one) { return one.name == name; });
  if (found == all.end()) throw std::out_of_range("no parameter " + name);
  return *found;
}

inline bool warns(const Calibration& found, const std::string& words) {
  return std::any_of(found.warnings.begin(), found.warnings.end(),
                     [&words](const auto& one) { return one.find(words) != std::string::npos; });
}

/// Of captures that can be calibrated.
inline Calibration calibrated(const std::vector<ArmCaptures>& data,
                              const CalibrationOptions& options = {},
                              const std::string& what = "") {
  const Calibration found = calibrate(data, options);
  if (found.status != CalibrationStatus::kCalibrated) {
    throw std::runtime_error(what + ": " + nameOf(found.status) + ", " + found.reason);
  }
  return found;
}

/// A rig that differs from what is known of it in its stiffness alone.
inline test::RigTruth rigOf(const model::Arm& truth, const TagLayout& layout = {}) {
  ArmView view;
  view.layout = layout;
  return {truth, 1.0, {}, view, 0.0, {}};
}

inline ArmCaptures dataOf(const model::Arm& known, const TagLayout& layout = {}) {
  return {"arm", known, false, layout, {}, {}, {}};
}

inline Pressures randomPressures(const model::Arm& arm, int count, Random& random) {
  Pressures out;
  for (int i = 0; i < count; ++i) out.push_back(test::randomInput(arm, random));
  return out;
}

/// Curvatures to `noise` [rad].
inline ArmCaptures curvatures(const model::Arm& known, const test::RigTruth& truth, double noise,
                              Random& random) {
  ArmCaptures data = dataOf(known);
  for (const Eigen::VectorXd& pressure : test::twelvePressures(known)) {
    const double exact = model::curvatureOf(test::shapeOf(truth, pressure).col(0));
    test::addCapture(data, pressure, CurvatureReading{std::abs(exact + noise * random.normal())});
  }
  return data;
}

inline ArmCaptures curvatures(const model::Arm& known, const model::Arm& truth, double noise,
                              Random& random) {
  return curvatures(known, rigOf(truth), noise, random);
}

/// Twists that are said to be off by `deviation` and are off by `noise` [m], [rad].
inline ArmCaptures twists(const model::Arm& known, const test::RigTruth& truth,
                          const Pressures& pressures, double deviation, double noise,
                          Random& random) {
  ArmCaptures data = dataOf(known);
  const int entries = 6 * known.sectionCount();
  const Eigen::MatrixXd covariance =
      deviation * deviation * Eigen::MatrixXd::Identity(entries, entries);
  for (const Eigen::VectorXd& pressure : pressures) {
    model::Twists seen = test::shapeOf(truth, pressure);
    for (double& entry : seen.reshaped()) entry += noise * random.normal();
    test::addCapture(data, pressure, TwistReading{seen, covariance});
  }
  return data;
}
/// Exact ones at the twelve pressures.
inline ArmCaptures twists(const model::Arm& known, const model::Arm& truth, double deviation) {
  Random unused(0);
  return twists(known, rigOf(truth), test::twelvePressures(known), deviation, 0.0, unused);
}

/// Tags of a shape as an instrument sees them, to `noise` [m] in every coordinate.
inline std::vector<PoseObservation> posesOf(const TagLayout& layout, const model::Shape& shape,
                                            const lie::SE3& X_B0B, double noise, Random& random) {
  std::vector<PoseObservation> seen;
  for (const lie::SE3& X_BT : tagPoses(layout, shape)) {
    seen.push_back({static_cast<int>(seen.size()), X_B0B * X_BT});
    for (double& x : seen.back().X_BT.translation) x += noise * random.normal();
  }
  return seen;
}

/// @param known_layout  where the tags are thought to be.
inline ArmCaptures poses(const model::Arm& known, const TagLayout& known_layout,
                         const test::RigTruth& truth, const Pressures& pressures, double noise,
                         Random& random) {
  ArmCaptures data = dataOf(known, known_layout);
  for (const Eigen::VectorXd& pressure : pressures) {
    test::addCapture(
        data, pressure,
        posesOf(truth.view.layout, test::shapeOf(truth, pressure), truth.X_B0B, noise, random));
  }
  return data;
}

/// @param view  what is known.
inline ArmCaptures corners(const model::Arm& known, const ArmView& view,
                           const test::RigTruth& truth, const Pressures& pressures, double noise,
                           Random& random) {
  ArmCaptures data{"rig", known, false, view.layout, view.X_CB, view.camera, {}};
  for (const Eigen::VectorXd& pressure : pressures) {
    test::addCapture(data, pressure, test::observe(truth, pressure, noise, random));
  }
  return data;
}

}  // namespace helix_arm::estimation
