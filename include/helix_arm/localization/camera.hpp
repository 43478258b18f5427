#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

namespace helix_arm::estimation {

/// A pinhole camera with the lens distortion of OpenCV and sensor_msgs/CameraInfo (plumb_bob and
/// rational_polynomial).
///
/// Frame C: z forward, x right and y down in the image. Pixel (0, 0) is the centre of the top-left
/// pixel, as in OpenCV.
struct Camera {
  /// Largest width and height of images that are searched for tags [px].
  static constexpr int kMaxSide = 32767;

  int width = 0, height = 0;              ///< [px]
  double fx = 0, fy = 0;                  ///< focal lengths [px]
  double cx = 0, cy = 0;                  ///< principal point [px]
  std::array<double, 8> distortion = {};  ///< k1 k2 p1 p2 k3 k4 k5 k6

  /// @throws std::invalid_argument naming the value and its rule: sizes 1 to kMaxSide, focal
  /// lengths > 0, everything finite.
  void validate() const;

  bool distorts() const;

  /// Whether the principal point is within a fifth of the picture's sides of its centre. Lenses are
  /// mounted better than that; a calibration of another size of picture is farther off.
  bool isCentred() const;

  /// Mean focal length, which converts directions to pixels [px].
  double focal() const { return 0.5 * (fx + fy); }

  /// Pixel of a point seen from C [m]; empty if the point is behind the camera, or so far off its
  /// axis that the distortion is not invertible.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& p_C) const;

  /// Pixel of a direction (x/z, y/z), without the checks of project().
  Eigen::Vector2d pixelOf(const Eigen::Vector2d& direction) const;

  /// The direction (x/z, y/z) that is seen at a pixel; empty if the distortion cannot be inverted
  /// there. pixelOf() maps it back to the pixel within 1e-9 px.
  std::optional<Eigen::Vector2d> directionOf(const Eigen::Vector2d& pixel) const;

  bool contains(const Eigen::Vector2d& pixel) const {
    return pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() <= width - 1 && pixel.y() <= height - 1;
  }
};

}  // namespace helix_arm::estimation
