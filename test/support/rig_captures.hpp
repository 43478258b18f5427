#pragma once

#include "helix_arm/io/scene.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "helix_arm/procedures/settle_watch.hpp"
namespace helix_arm::test {

/// What the detector sees of a rig with a camera at rest at each of these pressures (steps x
/// actuators) [Pa], as the calibration takes it: the median of a few pictures and of many readings.
inline std::vector<io::TagCornerCapture> photograph(const io::Scene& scene,
                                                    simulation::SimulatedRig& rig,
                                                    const Eigen::MatrixXd& plan) {
  constexpr int kPictures = 3;                      // at each pressure
  constexpr int kReadings = 100;                    // of the pressures
  constexpr double kSettling = 3.0, kPause = 0.01;  // [s]
  vision::TagDetector detector(scene.vision.detector);
  std::vector<io::TagCornerCapture> captures;
  for (int step = 0; step < plan.rows(); ++step) {
    rig.command(plan.row(step).transpose());
    rig.step(kSettling);
    std::vector<procedures::Sample> samples;
    for (int picture = 0; picture < kPictures; ++picture) {
      Eigen::VectorXd pressure = Eigen::VectorXd::Zero(plan.cols());
      for (int i = 0; i < kReadings; ++i) {
        pressure += rig.measure() / kReadings;
        rig.step(kPause);
      }
      procedures::Sample sample{0, pressure, {}};
      for (const vision::TagDetection& tag : detector.detect(rig.render())) {
        if (scene.tags->find(tag.id) >= 0) sample.tags.push_back({tag.id, tag.corners});
      }
      samples.push_back(std::move(sample));
    }
    const procedures::Sample median = procedures::medianOf(samples);
    io::TagCornerCapture capture{step + 1, scene.arm.clamped(median.pressure), {}};
    for (const procedures::TagObservation& tag : median.tags) {
      capture.tags.push_back({tag.id, tag.corners, 0});
    }
    captures.push_back(std::move(capture));
  }
  return captures;
}

}  // namespace helix_arm::test
