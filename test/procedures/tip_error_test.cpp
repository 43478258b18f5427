// The tip error of a scene, from the tags of captures.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/simulation/rig.hpp"

namespace helix_arm::procedures {
namespace {

const io::Scene& demo() {
  static const io::Scene kScene = io::loadScene(HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml");
  return kScene;
}

// What exact tags of the true arm show, all of them seen; and the distances of its tips from those
// of the model.
struct Seen {
  std::vector<estimation::Capture> captures;
  std::vector<double> distances;
};
Seen seen(const simulation::ArmDeviation& deviation) {
  const simulation::TrueArm truth(demo().model, deviation);
  Seen out;
  for (int k = 0; k < 5; ++k) {
    Eigen::VectorXd pressure = Eigen::VectorXd::Zero(3);
    pressure[k % 3] = 6e4 * (k + 1);
    const model::Shape shape = truth.shape(pressure);
    const std::vector<lie::SE3> tags = estimation::tagPoses(*demo().tags, shape);
    std::vector<estimation::PoseObservation> poses;
    for (int tag = 0; tag < static_cast<int>(tags.size()); ++tag) {
      poses.push_back({tag, tags[static_cast<std::size_t>(tag)]});
    }
    out.captures.push_back({k, pressure, poses});
    out.distances.push_back(
        (model::tipPose(shape).translation - demo().model.solve(pressure).tip.translation).norm());
  }
  std::sort(out.distances.begin(), out.distances.end());
  return out;
}

TEST(TipError, IsTheMedianDistanceOfTheModelsTipFromThatOfTheTags) {
  simulation::ArmDeviation deviation;
  deviation.length_scale = 1.02;
  const Seen data = seen(deviation);
  ASSERT_GT(data.distances[2], 0.004) << "the arms must differ";
  const auto error = medianTipError(demo(), data.captures);
  ASSERT_TRUE(error);
  EXPECT_NEAR(*error, data.distances[2], 0.05 * data.distances[2]);
}

TEST(TipError, VanishesWhereTheModelIsTheArm) {
  const auto error = medianTipError(demo(), seen({}).captures);
  ASSERT_TRUE(error);
  EXPECT_LT(*error, 1e-5);
}

TEST(TipError, LeavesOutWhatShowsNoTagsAndIsEmptyWithoutTags) {
  Seen data = seen({});
  data.captures.push_back({9, Eigen::VectorXd::Zero(3), estimation::CurvatureReading{}});
  data.captures.push_back(
      {10, Eigen::VectorXd::Zero(3), std::vector<estimation::PoseObservation>{}});
  EXPECT_TRUE(medianTipError(demo(), data.captures));
  data.captures.erase(data.captures.begin(), data.captures.begin() + 5);
  EXPECT_FALSE(medianTipError(demo(), data.captures));
  io::Scene blind = demo();
  blind.tags.reset();
  EXPECT_FALSE(medianTipError(blind, seen({}).captures));
}

}  // namespace
}  // namespace helix_arm::procedures
