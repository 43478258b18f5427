#pragma once

#include "helix_arm/io/scene.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "procedures/settle_watch.hpp"
namespace helix_arm::test {

/// What a camera sees of a rig at rest at each of these pressures (steps x actuators) [Pa], as the
/// calibration takes it: the median of a few pictures and of many readings.
/// @param look  called for each picture, returns its tags as
/// std::vector<procedures::TagObservation>.
template <class Look>
std::vector<io::TagCornerCapture> photograph(const io::Scene& scene, simulation::SimulatedRig& rig,
                                             const Eigen::MatrixXd& plan, const Look& look) {
  constexpr int kPictures = 3;                      // at each pressure
  constexpr int kReadings = 100;                    // of the pressures
  constexpr double kSettling = 3.0, kPause = 0.01;  // [s]
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
      samples.push_back({0, pressure, look()});
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

/// The same with what the detector finds in rendered pictures.
inline std::vector<io::TagCornerCapture> photograph(const io::Scene& scene,
                                                    simulation::SimulatedRig& rig,
                                                    const Eigen::MatrixXd& plan) {
  vision::TagDetector detector(scene.vision.detector);
  return photograph(scene, rig, plan, [&] {
    std::vector<procedures::TagObservation> seen;
    for (const vision::TagDetection& tag : detector.detect(rig.render())) {
      if (scene.tags->find(tag.id) >= 0) seen.push_back({tag.id, tag.corners});
    }
    return seen;
  });
}

}  // namespace helix_arm::test
