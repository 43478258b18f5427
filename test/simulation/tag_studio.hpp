#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "helix_arm/simulation/camera.hpp"
#include "support/random.hpp"

namespace helix_arm::test {

constexpr double kTagSize = 0.031;  // [m]

inline estimation::Camera plainCamera() { return {640, 480, 800, 790, 322.3, 237.8, {}}; }

/// One whose straight lines bend by tens of pixels.
inline estimation::Camera distortingCamera() {
  estimation::Camera camera = plainCamera();
  camera.distortion = {-0.35, 0.12, 0.004, -0.003, 0.02, 0.05, 0.01, 0.0};
  return camera;
}

/// Without blur and noise.
inline simulation::SimulatedCameraConfig sharpConfig() {
  simulation::SimulatedCameraConfig config;
  config.blur = 0;
  config.noise = 0;
  return config;
}

/// The tag's face to the camera: x right, y up in the picture.
inline Eigen::Matrix3d facingCamera() { return Eigen::Vector3d(1, -1, -1).asDiagonal(); }

/// A tag somewhere before the camera, turned off its line of sight by up to 60 degrees.
inline lie::SE3 randomTagPose(Random& random, double nearest, double farthest) {
  const double z = random.uniform(nearest, farthest);
  const Eigen::Vector3d tilt = random.uniform(0, 1.0) * random.direction<3>();
  const Eigen::AngleAxisd turn(tilt.norm(), tilt.normalized());
  const Eigen::AngleAxisd roll(random.uniform(0, 6.28), Eigen::Vector3d::UnitZ());
  return {turn * (facingCamera() * roll.toRotationMatrix()),
          {random.uniform(-0.22, 0.22) * z, random.uniform(-0.15, 0.15) * z, z}};
}

/// Tags with these poses X_CT, ids from 0, and an arm that is out of sight: beside the camera.
inline estimation::ArmView studio(const estimation::Camera& camera,
                                  const std::vector<lie::SE3>& poses) {
  estimation::ArmView view{camera, {}, {kTagSize, {}}, 1};
  for (const lie::SE3& X_CT : poses) {
    view.layout.tags.push_back({static_cast<int>(view.layout.tags.size()), 0, 0.0, X_CT});
  }
  return view;
}
inline model::Twists studioTwists() { return model::Twists::Identity(6, 1) * 0.4; }

inline cv::Mat photograph(const estimation::ArmView& view,
                          const simulation::SimulatedCameraConfig& config) {
  simulation::SimulatedCamera camera(view, vision::TagFamily("36h11"), {}, config);
  return camera.render(studioTwists()).clone();
}

}  // namespace helix_arm::test
