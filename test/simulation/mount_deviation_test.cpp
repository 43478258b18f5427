#include <cmath>
#include <limits>
#include <stdexcept>

#include <gtest/gtest.h>

#include "helix_arm/simulation/rig.hpp"
#include "support/refusal.hpp"
#include "support/sample_view.hpp"

namespace helix_arm::test {
namespace {

using simulation::deviate;
using simulation::MountDeviation;

// Of two sections with 16 tags each.
class Mounts : public testing::Test {
 protected:
  const model::Arm arm_ = ringArm(helicalRing(), 2);
  const estimation::ArmView view_ = sampleView(0.8, 2, 16);
};

void expectSame(const lie::SE3& a, const lie::SE3& b) {
  EXPECT_EQ(a.rotation, b.rotation);
  EXPECT_EQ(a.translation, b.translation);
}

TEST_F(Mounts, WithoutDeviationAllIsWhereTheSceneSays) {
  const estimation::ArmView view = deviate(view_, arm_, {});
  expectSame(view.X_CB, view_.X_CB);
  for (std::size_t i = 0; i < view.layout.tags.size(); ++i) {
    EXPECT_EQ(view.layout.tags[i].s, view_.layout.tags[i].s);
    expectSame(view.layout.tags[i].X_ST, view_.layout.tags[i].X_ST);
  }
}

TEST_F(Mounts, TheTagNearestToTheBaseKeepsItsPose) {
  const estimation::ArmView view = deviate(view_, arm_, {0.01, 0.1, 0.01, 0.1, 3});
  const int base = view_.layout.baseTag();
  for (int i = 0; i < static_cast<int>(view.layout.tags.size()); ++i) {
    const auto &before = view_.layout.tags[i], &after = view.layout.tags[i];
    EXPECT_EQ(after.id, before.id);
    EXPECT_EQ(after.section, before.section);
    EXPECT_EQ((after.X_ST.rotation - before.X_ST.rotation).norm() < 1e-6, i == base) << i;
  }
  EXPECT_NO_THROW(view.validate());
}

// 5 standard errors of each mean and each deviation.
TEST_F(Mounts, TheNoiseIsNormalOfTheDeviationsAskedFor) {
  const MountDeviation deviation{0.004, 0.02, 0.001, 0.05, 1};
  lie::Vector6 camera_sum = lie::Vector6::Zero(), camera_squares = camera_sum;
  lie::Vector6 tag_sum = camera_sum, tag_squares = camera_sum;
  constexpr int kRigs = 1000;
  int tags = 0;
  for (int seed = 0; seed < kRigs; ++seed) {
    MountDeviation seeded = deviation;
    seeded.seed = static_cast<std::uint32_t>(seed);
    const estimation::ArmView view = deviate(view_, arm_, seeded);
    const lie::Vector6 camera = (view_.X_CB.inverse() * view.X_CB).log();
    camera_sum += camera;
    camera_squares += camera.cwiseAbs2();
    for (std::size_t i = 0; i < view.layout.tags.size(); ++i) {
      if (static_cast<int>(i) == view_.layout.baseTag()) continue;
      const auto &before = view_.layout.tags[i], &after = view.layout.tags[i];
      const double length = arm_.restLength(before.section);
      lie::SE3 turn;
      turn.rotation = before.X_ST.rotation.transpose() * after.X_ST.rotation;
      lie::Vector6 moved = turn.log();
      moved.head<3>() = after.X_ST.translation - before.X_ST.translation;
      moved[0] += (after.s - before.s) * length;
      tag_sum += moved;
      tag_squares += moved.cwiseAbs2();
      ++tags;
    }
  }
  for (int i = 0; i < 6; ++i) {
    const double camera = i < 3 ? 0.004 : 0.02, tag = i < 3 ? 0.001 : 0.05;
    EXPECT_NEAR(camera_sum[i] / kRigs, 0, 5 * camera / std::sqrt(kRigs)) << i;
    EXPECT_NEAR(std::sqrt(camera_squares[i] / kRigs), camera, 5 * camera / std::sqrt(2 * kRigs));
    EXPECT_NEAR(tag_sum[i] / tags, 0, 5 * tag / std::sqrt(tags)) << i;
    EXPECT_NEAR(std::sqrt(tag_squares[i] / tags), tag, 5 * tag / std::sqrt(2 * tags)) << i;
  }
}

TEST_F(Mounts, TheSeedDecides) {
  const MountDeviation first{0.01, 0.1, 0.01, 0.1, 3}, other{0.01, 0.1, 0.01, 0.1, 4};
  const estimation::ArmView a = deviate(view_, arm_, first), b = deviate(view_, arm_, first),
                            c = deviate(view_, arm_, other);
  expectSame(a.X_CB, b.X_CB);
  expectSame(a.layout.tags[5].X_ST, b.layout.tags[5].X_ST);
  EXPECT_NE(a.X_CB.translation, c.X_CB.translation);
  EXPECT_NE(a.layout.tags[5].X_ST.translation, c.layout.tags[5].X_ST.translation);
  // A camera that stands elsewhere moves no tag.
  const estimation::ArmView d = deviate(view_, arm_, {0, 0, 0.01, 0.1, 3});
  expectSame(d.layout.tags[5].X_ST, a.layout.tags[5].X_ST);
  expectSame(deviate(view_.layout, arm_, first).tags[5].X_ST, a.layout.tags[5].X_ST);
}

TEST_F(Mounts, InvalidDeviationsAreRefused) {
  for (const double wrong : {-1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    for (const MountDeviation& deviation :
         {MountDeviation{wrong, 0, 0, 0}, MountDeviation{0, wrong, 0, 0},
          MountDeviation{0, 0, wrong, 0}, MountDeviation{0, 0, 0, wrong}}) {
      EXPECT_THROW(deviation.validate(), std::invalid_argument);
      EXPECT_THROW(deviate(view_, arm_, deviation), std::invalid_argument);
    }
  }
  EXPECT_EQ(refusal([] {
              MountDeviation{0, 0, -0.5, 0}.validate();
            }),
            "true mounts: the deviation of the tags' places [m] is -0.5; expected a finite value "
            ">= 0");
  EXPECT_THROW(deviate(view_, ringArm(helicalRing()), {}), std::invalid_argument);
}

}  // namespace
}  // namespace helix_arm::test
