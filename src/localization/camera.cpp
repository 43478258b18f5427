#include "helix_arm/localization/camera.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <string>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::estimation {
namespace {

constexpr int kMaxNewtonSteps = 30;
constexpr double kSettledDirection = 1e-13;  // of a direction; far below a millionth of a pixel

struct Distorted {
  Eigen::Vector2d direction;
  Eigen::Matrix2d jacobian;  // d direction / d (x, y)
};

// OpenCV's rational model: x (1 + k1 r2 + k2 r4 + k3 r6) / (1 + k4 r2 + k5 r4 + k6 r6) and the
// tangential part.
Distorted distort(const std::array<double, 8>& k, double x, double y) {
  const double r2 = x * x + y * y;
  const double numerator = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
  const double denominator = 1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]));
  const double radial = numerator / denominator;
  const double slope =
      (k[0] + r2 * (2 * k[1] + r2 * 3 * k[4]) - radial * (k[5] + r2 * (2 * k[6] + r2 * 3 * k[7]))) /
      denominator;  // d radial / d r2
  const double p1 = k[2], p2 = k[3];
  Distorted out;
  out.direction << x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
      y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y;
  const double cross = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y;
  out.jacobian << radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x, cross, cross,
      radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x;
  return out;
}

// Whether the distortion is still invertible here: it preserves the orientation.
bool unfolded(const Eigen::Matrix2d& jacobian) {
  return jacobian.determinant() > 0 && jacobian.trace() > 0;
}

template <class Value, class Rule>
void require(bool holds, const char* what, const Value& value, const Rule& rule) {
  basics::requireValue(holds, "camera", what, value, rule);
}

}  // namespace

void Camera::validate() const {
  const std::string sides = "1 to " + std::to_string(kMaxSide);
  require(width > 0 && width <= kMaxSide, "the width [px]", width, sides);
  require(height > 0 && height <= kMaxSide, "the height [px]", height, sides);
  const char* const rule = "a finite value > 0: calibrate the camera first";
  require(std::isfinite(fx) && fx > 0, "the focal length fx [px]", fx, rule);
  require(std::isfinite(fy) && fy > 0, "the focal length fy [px]", fy, rule);
  require(std::isfinite(cx), "the principal point cx [px]", cx, "a finite value");
  require(std::isfinite(cy), "the principal point cy [px]", cy, "a finite value");
  for (const double k : distortion) {
    require(std::isfinite(k), "a coefficient of distortion", k, "a finite value");
  }
}

bool Camera::distorts() const {
  return std::any_of(distortion.begin(), distortion.end(), [](double k) { return k != 0; });
}

bool Camera::isCentred() const {
  constexpr double kFarthest = 0.2;
  return std::abs(cx - 0.5 * width) <= kFarthest * width &&
         std::abs(cy - 0.5 * height) <= kFarthest * height;
}

std::optional<Eigen::Vector2d> Camera::project(const Eigen::Vector3d& p_C) const {
  if (!(p_C.z() > 0)) return std::nullopt;
  const double x = p_C.x() / p_C.z(), y = p_C.y() / p_C.z();
  const Distorted distorted = distort(distortion, x, y);
  if (!unfolded(distorted.jacobian)) return std::nullopt;
  return Eigen::Vector2d(fx * distorted.direction.x() + cx, fy * distorted.direction.y() + cy);
}

Eigen::Vector2d Camera::pixelOf(const Eigen::Vector2d& direction) const {
  const Distorted distorted = distort(distortion, direction.x(), direction.y());
  return {fx * distorted.direction.x() + cx, fy * distorted.direction.y() + cy};
}

std::optional<Eigen::Vector2d> Camera::directionOf(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d wanted((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  if (!wanted.allFinite()) return std::nullopt;
  if (!distorts()) return wanted;
  Eigen::Vector2d direction = wanted;
  for (int i = 0; i < kMaxNewtonSteps; ++i) {
    const Distorted distorted = distort(distortion, direction.x(), direction.y());
    if (!unfolded(distorted.jacobian)) return std::nullopt;
    const Eigen::Vector2d error = distorted.direction - wanted;
    if (error.cwiseAbs().maxCoeff() < kSettledDirection) return direction;
    direction -= distorted.jacobian.inverse() * error;
  }
  return std::nullopt;
}

}  // namespace helix_arm::estimation
