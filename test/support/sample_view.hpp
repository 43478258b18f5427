#pragma once

#include "helix_arm/localization/arm_view.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "support/paper_arm.hpp"
namespace helix_arm::test {

/// A webcam of 1280 x 720 with the distortion that such have.
inline estimation::Camera sampleCamera() {
  return {1280, 720, 930.0, 928.0, 642.3, 358.9, {0.08, -0.17, 0.0007, -0.0012, 0.06, 0, 0, 0}};
}

/// Tags of 31 mm on stand-offs around the arm: `rows` along each section, one of `sides` in turn.
inline estimation::TagLayout sampleLayout(int sections = 1, int rows = 32, int sides = 4) {
  estimation::TagLayout layout;
  layout.size = 0.031;
  for (int k = 0; k < sections; ++k) {
    for (int i = 0; i < rows; ++i) {
      const double angle = 2 * kPi * (i % sides) / sides;
      // The z axis of T turned outward, the x axis along the arm.
      const Eigen::Matrix3d R =
          Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitX()).toRotationMatrix();
      const int id = static_cast<int>(layout.tags.size());
      layout.tags.push_back({id, k, (i + 1.0) / rows, {R, 0.045 * R.col(2)}});
    }
  }
  return layout;
}

/// The camera `distance` in front of the middle of an arm that points down in the picture.
inline estimation::ArmView sampleView(double distance = 0.8, int sections = 1, int rows = 32,
                                      int sides = 4) {
  estimation::ArmView view;
  view.camera = sampleCamera();
  view.layout = sampleLayout(sections, rows, sides);
  view.sections = sections;
  view.X_CB.rotation << 0, 1, 0, 1, 0, 0, 0, 0, -1;
  view.X_CB.translation << 0.0, -0.2 * sections, distance;
  return view;
}

/// What a camera sees of some tags, each coordinate of a corner off by normal noise.
inline std::vector<estimation::CornerObservation> observe(
    const estimation::ArmView& view, const std::vector<estimation::TagImage>& images, double noise,
    Random& random) {
  std::vector<estimation::CornerObservation> seen;
  for (const estimation::TagImage& image : images) {
    estimation::CornerObservation observation{image.tag, {}};
    for (int c = 0; c < 4; ++c) {
      const Eigen::Vector2d pixel =
          image.corners.col(c) + noise * Eigen::Vector2d(random.normal(), random.normal());
      observation.direction.col(c) = view.camera.directionOf(pixel).value();
    }
    seen.push_back(observation);
  }
  return seen;
}

/// `count` of the tags, spread over those there are.
template <class T>
std::vector<T> spread(const std::vector<T>& all, int count) {
  std::vector<T> out;
  for (int i = 0; i < count; ++i) {
    out.push_back(all[static_cast<std::size_t>(std::lround((i + 0.5) * all.size() / count - 0.5))]);
  }
  return out;
}

}  // namespace helix_arm::test
