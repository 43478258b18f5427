#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "helix_arm/localization/arm_view.hpp"

namespace helix_arm::estimation {

/// Pose of a motion-capture body as its system tells it.
struct BodyPose {
  int body;  ///< index in the layout
  lie::SE3
      X_CM;  ///< seen from the frame C of the poses [m]; without rotation noise only a position
};

/// The rotation of a quaternion that was read as (x, y, z, w), but has w first.
Eigen::Matrix3d withScalarFirst(const Eigen::Matrix3d& R);
/// The 24 rotations that permute the axes.
std::vector<Eigen::Matrix3d> axisTurns();

/// Finds the usual mistakes in poses of bodies: names that were swapped, a body that took another's
/// place, one that hangs, a unit, an order of quaternions and a frame that are others than
/// expected.
///
/// A pose far from the expected one is no mistake by itself: a mistake is one that explains most of
/// the distance.
class BodyCheck {
 public:
  /// @param view  of bodies.
  explicit BodyCheck(const ArmView& view) : view_(view), tracks_(view.layout.tags.size()) {}

  /// Mistakes in the poses of one time.
  struct Verdict {
    std::vector<BodyPose> sound;  ///< those that a fit may use
    std::string fault;            ///< mistakes and their remedies; empty: none
    bool all = false;             ///< the mistake concerns all poses
  };

  /// @param expected  the arm's shape, as far as it is known before.
  /// @param model     the model's shape, whose motion tells a body that hangs.
  /// @param near      whether `expected` comes from poses of shortly before.
  Verdict check(const std::vector<BodyPose>& seen, const model::Shape& expected,
                const model::Shape& model, bool near);
  /// Forgets earlier poses.
  void reset() { tracks_.assign(tracks_.size(), {}); }

 private:
  /// When the pose of a body last changed.
  struct Track {
    lie::SE3 pose;
    Eigen::Vector3d model = Eigen::Vector3d::Zero();  ///< where the model had it
    std::vector<BodyPose> others;
    bool known = false;
  };

  bool hangs(const BodyPose& one, const std::vector<BodyPose>& seen,
             const Eigen::Vector3d& model_place);

  const ArmView view_;
  std::vector<Track> tracks_;
};

}  // namespace helix_arm::estimation
