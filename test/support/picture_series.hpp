#pragma once

#include "simulation/rig.hpp"
#include "support/sample_view.hpp"

namespace helix_arm::test {

/// The same view through a sensor of `factor` times as many pixels a side.
inline estimation::ArmView enlarged(estimation::ArmView view, double factor) {
  estimation::Camera& camera = view.camera;
  camera.width = static_cast<int>(std::lround(factor * camera.width));
  camera.height = static_cast<int>(std::lround(factor * camera.height));
  camera.fx *= factor;
  camera.fy *= factor;
  camera.cx = factor * (camera.cx + 0.5) - 0.5;
  camera.cy = factor * (camera.cy + 0.5) - 0.5;
  return view;
}

/// A helical arm in brisk motion, 30 pictures a second: what its camera sees, what its true shape
/// is and what shape the model takes it to have.
struct PictureSeries {
  estimation::ArmView view;
  std::vector<cv::Mat> pictures;
  std::vector<model::Twists> truth, model;

  PictureSeries(const estimation::ArmView& arm_view, int count,
                const simulation::SimulatedCameraConfig& config)
      : view(arm_view) {
    const model::Arm arm = ringArm(helicalRing());
    const simulation::TrueArm true_arm(arm, {1.0, 1.1, 1.01});
    simulation::SimulatedCamera camera(view, vision::TagFamily("36h11"), {}, config);
    Eigen::Vector3d pressure;
    for (int i = 0; i < count; ++i) {
      // Each muscle swings over its range at a rate of its own, about once in three seconds.
      for (int k = 0; k < 3; ++k) pressure[k] = 2e5 * (1 + std::sin((0.06 + 0.01 * k) * i + 2 * k));
      truth.push_back(true_arm.twists(pressure));
      model.push_back(arm.twists(pressure));
      pictures.push_back(camera.render(truth.back()).clone());
    }
  }
};

}  // namespace helix_arm::test
