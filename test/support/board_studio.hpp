#pragma once

#include <Eigen/Geometry>

#include "helix_arm/simulation/camera.hpp"
#include "helix_arm/vision/camera_calibration.hpp"
#include "support/random.hpp"

namespace helix_arm::test {

/// A webcam of 1280 x 720 with the distortion that such have.
inline estimation::Camera boardCamera() {
  return {1280, 720, 931.5, 929.8, 644.2, 357.6, {0.08, -0.17, 0.0008, -0.0006, 0.06, 0, 0, 0}};
}

/// Board frame: origin in its centre, x right, y up, z to the reader.
/// @param u, v  where its centre appears, as parts of the picture.
/// @param tilt  rotation vector of the board from facing the camera [rad].
inline lie::SE3 boardPose(const estimation::Camera& camera, double u, double v, double distance,
                          const Eigen::Vector3d& tilt) {
  const Eigen::Matrix3d facing = Eigen::Vector3d(1, -1, -1).asDiagonal();
  const Eigen::AngleAxisd turn(
      tilt.norm(), tilt.norm() > 0 ? Eigen::Vector3d(tilt.normalized()) : Eigen::Vector3d(1, 0, 0));
  return {turn * facing,
          {distance * (u * camera.width - camera.cx) / camera.fx,
           distance * (v * camera.height - camera.cy) / camera.fy, distance}};
}

/// Poses as a person would hold the board: near, all over the picture, tilted to each side.
inline std::vector<lie::SE3> boardPoses(const estimation::Camera& camera, int count,
                                        Random& random) {
  std::vector<lie::SE3> poses;
  for (int i = 0; i < count; ++i) {
    const double u = (0.2 + 0.6 * (i % 3) / 2.0) + random.uniform(-0.05, 0.05);
    const double v = (0.25 + 0.5 * ((i / 3) % 3) / 2.0) + random.uniform(-0.05, 0.05);
    Eigen::Vector3d tilt = random.uniform(0.25, 0.75) * random.direction<3>();
    tilt.z() *= 0.3;
    poses.push_back(boardPose(camera, u, v, random.uniform(0.24, 0.4), tilt));
  }
  return poses;
}

/// A picture of a board, of either kind.
template <class Board>
cv::Mat boardPicture(const estimation::Camera& camera, const Board& board, const lie::SE3& X_CP,
                     const simulation::SimulatedCameraConfig& config = {}) {
  return simulation::boardCamera(camera, board, X_CP, config)
      .render(simulation::kArmOutOfView)
      .clone();
}

/// What a detector would find, each coordinate off by normal noise [px].
inline vision::BoardObservation boardCorners(const estimation::Camera& camera,
                                             const vision::TagBoard& board, const lie::SE3& X_CP,
                                             double noise, Random& random) {
  vision::BoardObservation observation{"", {}};
  for (int id = board.first_id; id < board.first_id + board.count(); ++id) {
    const estimation::Corners plane = board.corners(id);
    std::vector<vision::BoardCorner> tag;
    for (int c = 0; c < 4; ++c) {
      const auto pixel = camera.project(X_CP * Eigen::Vector3d(plane(0, c), plane(1, c), 0));
      if (!pixel || !camera.contains(*pixel)) break;
      tag.push_back({4 * (id - board.first_id) + c, plane.col(c),
                     *pixel + noise * Eigen::Vector2d(random.normal(), random.normal())});
    }
    if (tag.size() == 4)
      observation.corners.insert(observation.corners.end(), tag.begin(), tag.end());
  }
  return observation;
}

}  // namespace helix_arm::test
