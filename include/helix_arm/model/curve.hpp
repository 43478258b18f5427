#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/shape.hpp"

namespace helix_arm::model {

/// Pose of the base curve at s, seen from the base: X(s) = X_1 .. X_k exp((s - k) g), k = floor(s).
/// Sections of several pieces are evaluated likewise, piece by piece. A link belongs to X_k, so
/// that s = k is the start of section k.
///
/// Each s is evaluated directly, so errors do not accumulate with fine sampling.
/// @param s  in [0, sections]: section k covers [k, k + 1].
/// @throws std::invalid_argument when s is outside.
lie::SE3 poseAt(const Shape& shape, double s);
/// The same at s in [0, 1] of a section: s = 1 is its end, before its link.
lie::SE3 poseAt(const Shape& shape, int section, double s);
inline lie::SE3 poseAt(const Twists& twists, double s) { return poseAt(Shape(twists), s); }

/// A point of a sampled curve.
template <class Group>
struct CurvePoint {
  double s;  ///< in [0, sections]
  Group X;   ///< seen from the base
};

/// Poses as of poseAt() at `count` >= 2 evenly spaced s, including the base and the end of the last
/// section, which is the tip of an arm without links.
/// @throws std::invalid_argument when count < 2.
std::vector<CurvePoint<lie::SE3>> sampleCurve(const Shape& shape, int count);
inline std::vector<CurvePoint<lie::SE3>> sampleCurve(const Twists& twists, int count) {
  return sampleCurve(Shape(twists), count);
}

/// The same to draw an arm: followed by the tip if the arm has links.
std::vector<CurvePoint<lie::SE3>> sampleToTip(const Shape& shape, int count);

/// Pose of the tip, X_1 .. X_n, seen from the base. Twists are those of an arm without links;
/// otherwise, use ArmOf::tipOf().
lie::SE3 tipPose(const Shape& shape);
inline lie::SE3 tipPose(const Twists& twists) { return tipPose(Shape(twists)); }

/// The helix of a section's curve. A straight section has zero turns and an infinite radius; an arc
/// has zero pitch.
struct Helix {
  double radius;  ///< distance of the curve from its axis, |w x v| / |w|^2 [m]
  double pitch;   ///< advance along the axis per turn, signed with the handedness, 2 pi (w.v) /
                  ///< |w|^2 [m]
  double turns;   ///< |w| / 2 pi
};
Helix helixOf(const lie::Vector6& twist);

/// Bending of a section, |(w_y, w_z)| [rad]: the length-scaled curvature of the paper's figures.
double curvatureOf(const lie::Vector6& twist);

/// @throws std::invalid_argument unless count >= 2.
inline void requireCurve(int count) {
  if (count >= 2) return;
  throw std::invalid_argument("a curve of " + std::to_string(count) +
                              " points; expected at least 2");
}

/// s of point i of `count` evenly spaced points along `sections` sections, in [0, sections].
inline double curvePlace(int sections, int i, int count) {
  return static_cast<double>(sections) * i / (count - 1);
}

}  // namespace helix_arm::model
