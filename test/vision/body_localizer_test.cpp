#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "procedures/loop_config.hpp"
#include "simulation/bodies.hpp"
#include "support/shipped_scene.hpp"

namespace helix_arm::vision {
namespace {

using estimation::BodyPose;
using Poses = std::vector<BodyPose>;

enum Body { kFrame, kMiddle, kTip };

// The arm of the shipped scene with bodies, moving about 100 times a second; its model is 2 cm off.
class BodyLocalizer : public ::testing::Test {
 protected:
  explicit BodyLocalizer(const std::vector<io::Override>& changes = {})
      : scene_(test::shippedScene("mocap", changes)),
        localizer_(scene_.view(), procedures::localizerConfigOf(scene_)),
        bodies_(scene_.view(), scene_.simulation.bodies) {}

  model::Shape model(double time) const {
    const double a = 1.5e5 + 1e5 * std::sin(2 * time), b = 1.5e5 + 1e5 * std::cos(2 * time);
    return scene_.model.solve(Eigen::Vector3d(a, b, 0.5e5)).shape;
  }
  model::Shape truth(double time) const {
    model::Twists twists = model(time).twists();
    twists.row(5).array() += 0.1;
    twists.row(0).array() *= 1.01;
    return model(time).about(twists);
  }
  double time() const { return 0.01 * static_cast<double>(steps_); }

  using Change = std::function<void(Poses&)>;
  // The next poses, with what happens to them.
  const Observation& see(const Change& change = {}) {
    ++steps_;
    Poses poses = bodies_.see(truth(time()));
    if (change) change(poses);
    return localizer_.locate(poses, model(time()));
  }
  void follow(int steps) {
    for (int k = 0; k < steps; ++k) ASSERT_EQ(see().state, ObservationState::kMeasured);
  }
  double tipError(const Observation& seen) const {
    return (model::tipPose(seen.fit.shape).translation - model::tipPose(truth(time())).translation)
        .norm();
  }
  // The mistake is named, at the start and in motion, and nothing is measured.
  void expectNamed(const Change& change, const std::string& words) {
    for (const int steps : {0, 30}) {
      follow(steps);
      for (int k = 0; k < 20; ++k) {
        const Observation& seen = see(change);
        EXPECT_EQ(seen.state, ObservationState::kNoFit) << steps << ", " << k;
        EXPECT_NE(seen.fault.find(words), std::string::npos) << seen.fault;
      }
    }
    // Once it is gone, the arm is measured at once.
    const Observation& seen = see();
    EXPECT_EQ(seen.state, ObservationState::kMeasured);
    EXPECT_LT(tipError(seen), 0.002);
  }

  const io::Scene scene_;
  ArmLocalizer localizer_;
  simulation::SimulatedBodies bodies_;
  int steps_ = 0;
};

TEST_F(BodyLocalizer, MeasuresTheTipToTheNoiseOfItsBody) {
  double squares = 0;
  constexpr int kSteps = 200;
  for (int k = 0; k < kSteps; ++k) {
    const Observation& seen = see();
    ASSERT_EQ(seen.state, ObservationState::kMeasured);
    EXPECT_TRUE(seen.fault.empty()) << seen.fault;
    EXPECT_EQ(seen.fit.outliers(), 0);
    squares += tipError(seen) * tipError(seen);
    // Standardised errors of the twists.
    const Eigen::VectorXd error = (seen.fit.twists - truth(time()).twists()).reshaped();
    EXPECT_LT(error.dot(seen.fit.covariance.ldlt().solve(error)), 60);
  }
  EXPECT_LT(std::sqrt(squares / kSteps), 0.0004);  // 0.2 mm each axis, and 0.2 degrees at 3 cm
}

TEST_F(BodyLocalizer, NamesSwappedBodies) {
  expectNamed([](Poses& poses) { std::swap(poses[kMiddle].X_CM, poses[kTip].X_CM); },
              "the bodies middle and tip are swapped");
}

TEST_F(BodyLocalizer, NamesMillimetres) {
  expectNamed(
      [](Poses& poses) {
        for (BodyPose& one : poses) one.X_CM.translation *= 1e3;
      },
      "millimetres");
}

TEST_F(BodyLocalizer, NamesQuaternionsWithTheirScalarFirst) {
  expectNamed(
      [](Poses& poses) {
        for (BodyPose& one : poses) {
          const Eigen::Quaterniond q(one.X_CM.rotation);
          one.X_CM.rotation = Eigen::Quaterniond(q.z(), q.w(), q.x(), q.y()).toRotationMatrix();
        }
      },
      "w, x, y, z");
}

TEST_F(BodyLocalizer, NamesAFrameWithItsYAxisUp) {
  const lie::SE3 turn{Eigen::AngleAxisd(-M_PI / 2, Eigen::Vector3d::UnitX()).toRotationMatrix(),
                      Eigen::Vector3d::Zero()};
  expectNamed(
      [&turn](Poses& poses) {
        for (BodyPose& one : poses) one.X_CM = turn * one.X_CM;
      },
      "turned by 90 degrees about (-1.0, 0.0, 0.0)");
}

TEST_F(BodyLocalizer, SaysThatBaseOrFrameHaveMoved) {
  follow(50);
  ASSERT_FALSE(see().moved);
  std::optional<estimation::BaseMove> moved;
  for (int k = 0; k < 100 && !moved; ++k) {
    moved = see([](Poses& poses) {
              for (BodyPose& one : poses) one.X_CM.translation.y() += 0.012;
            }).moved;
  }
  ASSERT_TRUE(moved);
  EXPECT_NEAR(moved->xi.head<3>().norm(), 0.012, 0.003);
}

class WithoutRotations : public BodyLocalizer {
 protected:
  WithoutRotations() : BodyLocalizer({{"bodies.2.noise", "{rotation_deg: 0}"}}) {}
};

TEST_F(WithoutRotations, APositionCountsWithThreeNumbers) {
  for (int k = 0; k < 20; ++k) {
    // Whatever is told of its rotation has no effect.
    const Observation& seen = see([](Poses& poses) {
      poses[kTip].X_CM.rotation = Eigen::AngleAxisd(2, Eigen::Vector3d::UnitY()).toRotationMatrix();
    });
    ASSERT_EQ(seen.state, ObservationState::kMeasured);
    EXPECT_LT(tipError(seen), 0.002);
  }
}

class WithoutFrame : public BodyLocalizer {
 protected:
  WithoutFrame() : BodyLocalizer({{"motion_capture", "{}"}}) {}
};

TEST_F(WithoutFrame, NothingIsMeasured) { EXPECT_EQ(see().state, ObservationState::kNoFit); }

TEST_F(BodyLocalizer, ABodyThatTakesAnothersPlaceIsNamedAndNotUsed) {
  follow(20);
  for (int k = 0; k < 20; ++k) {
    const Observation& seen = see([](Poses& poses) { poses[kMiddle].X_CM = poses[kTip].X_CM; });
    EXPECT_NE(seen.fault.find("body middle is where tip is"), std::string::npos) << seen.fault;
    ASSERT_EQ(seen.state, ObservationState::kMeasured);
    EXPECT_EQ(seen.fit.tags.size(), 2U);
    EXPECT_LT(tipError(seen), 0.002);
  }
}

TEST_F(BodyLocalizer, ABodyThatHangsIsNamedAndNotUsed) {
  follow(20);
  const BodyPose hung = bodies_.see(truth(time()))[kTip];
  const Eigen::Vector3d before = hung.X_CM.translation;
  bool named = false;
  double moved_unnamed = 0;
  for (int k = 0; k < 60; ++k) {
    const Observation& seen = see([&hung](Poses& poses) { poses[kTip] = hung; });
    const double moved = (bodies_.see(truth(time()))[kTip].X_CM.translation - before).norm();
    named = seen.fault.find("body tip hangs") != std::string::npos;
    if (!named) moved_unnamed = std::max(moved_unnamed, moved);
  }
  EXPECT_TRUE(named);
  EXPECT_LT(moved_unnamed, 0.015);
}

TEST_F(BodyLocalizer, LostBodiesLeaveTheOthersToMeasure) {
  follow(20);
  const auto lose = [this](Body lost) -> const Observation& {
    return see([lost](Poses& poses) { poses.erase(poses.begin() + lost); });
  };
  EXPECT_EQ(lose(kMiddle).state, ObservationState::kMeasured);
  EXPECT_EQ(see([](Poses& poses) { poses.clear(); }).state, ObservationState::kNoTags);
  const Observation& seen = see([](Poses& poses) { poses.resize(1); });
  EXPECT_EQ(seen.state, ObservationState::kTooFewTags) << nameOf(seen.state);
  EXPECT_EQ(see().state, ObservationState::kMeasured);
}

}  // namespace
}  // namespace helix_arm::vision
