// Distances of an arm's body from zones, the tool and itself: against dense sampling of the
// definitions.
#include <cmath>
#include <memory>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "clearance/random_zones.hpp"
#include "helix_arm/clearance/arm_clearance.hpp"
#include "support/test_size.hpp"

namespace helix_arm::clearance {
namespace {

using Eigen::Vector3d;

// A shape of sections of 0.2 m that turn by up to this angle each.
model::Shape randomShape(test::Random& random, int sections, double most_turn) {
  model::Twists twists(6, sections);
  for (int k = 0; k < sections; ++k) {
    twists.col(k) << random.uniform(0.15, 0.25), random.uniform(-0.02, 0.02),
        random.uniform(-0.02, 0.02), random.uniform(0, most_turn) * random.direction<3>();
  }
  return twists;
}

class DistanceFromZone : public ::testing::TestWithParam<int> {};

TEST_P(DistanceFromZone, IsThatOfDenselySampledPlaces) {
  test::Random random(static_cast<unsigned>(10 + GetParam()));
  const bool mesh = GetParam() == 3;
  int near = 0, touching = 0;
  for (int i = 0; i < test::draws(mesh ? 20 : 60, 400); ++i) {
    const int sections = random.integer(1, 3);
    KeepOut keep_out;
    keep_out.X_WB = test::randomPose(random, 0.1);
    for (int k = 0; k < sections; ++k) keep_out.radii.push_back(random.uniform(0.005, 0.03));
    const int zones = random.integer(1, mesh ? 2 : 6);
    for (int k = 0; k < zones; ++k) {
      keep_out.zones.push_back(test::randomZone(random, 0.15, 0.5, GetParam(), "post"));
      if (random.integer(0, 2) == 0) keep_out.zones.back().from = random.uniform(0, 0.3);
    }
    const model::Shape shape = randomShape(random, sections, 0.9 * basics::kPi / sections);
    const Clearance found = ArmClearance(keep_out).of(shape);
    const double expected = test::denseClearance(keep_out, shape, 4000);
    if (std::isinf(expected)) {  // the arm is shorter than `from`
      EXPECT_TRUE(std::isinf(found.distance));
      continue;
    }
    const double bottom = -*std::max_element(keep_out.radii.begin(), keep_out.radii.end());
    touching += expected < 0;
    near += expected > 0 && expected < 0.1;
    // Inside a zone the curve's place is not asked for.
    if (expected > bottom + 1e-9) {
      EXPECT_NEAR(found.distance, expected, 1e-4) << i;
    }
    EXPECT_EQ(found.distance < 0, expected < 0);
    const Zone& nearest = keep_out.zones[static_cast<std::size_t>(found.zone)];
    EXPECT_LE(test::distanceFrom(nearest, keep_out.X_WB * found.place),
              found.distance + 0.03 + 1e-9);
  }
  EXPECT_GT(near, 3);
  EXPECT_GT(touching, 0);
}
INSTANTIATE_TEST_SUITE_P(OfEachKind, DistanceFromZone, ::testing::Range(0, 5));

// Places on the surface of a box or cylinder, its frame.
std::vector<Vector3d> surfaceOf(const std::variant<Box, Cylinder>& form) {
  std::vector<Vector3d> out;
  constexpr int kSteps = 120;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      const double a = static_cast<double>(i) / kSteps, b = static_cast<double>(j) / kSteps;
      if (const auto* box = std::get_if<Box>(&form)) {
        for (int axis = 0; axis < 6; ++axis) {
          Vector3d u(axis < 3 ? 0.5 : -0.5, a - 0.5, b - 0.5);
          std::rotate(u.data(), u.data() + axis % 3, u.data() + 3);
          out.push_back(u.cwiseProduct(box->size));
        }
      } else {
        const auto& round = std::get<Cylinder>(form);
        const Vector3d on(std::cos(2 * basics::kPi * a), std::sin(2 * basics::kPi * a), 0);
        out.push_back(round.radius * on + (b - 0.5) * round.length * Vector3d::UnitZ());
        for (const double end : {-0.5, 0.5}) {
          out.push_back(b * round.radius * on + end * round.length * Vector3d::UnitZ());
        }
      }
    }
  }
  return out;
}

TEST(Clearance, CountsPlatesAndToolAsStraightLinks) {
  test::Random random(2);
  for (int i = 0; i < 100; ++i) {
    auto links = std::make_shared<model::Links>();
    for (int k = 0; k < 2; ++k) links->push_back(test::randomPose(random, 0.1));
    const model::Shape shape(randomShape(random, 2, 1.0).pieces(), 1, links);
    KeepOut keep_out;
    keep_out.radii = {0.02, 0.01};
    keep_out.zones = {test::randomZone(random, 0.1, 0.6, i % 3, "post")};
    const double expected = test::denseClearance(keep_out, shape, 4000);
    if (expected > 0) {
      EXPECT_NEAR(ArmClearance(keep_out).of(shape).distance, expected, 1e-4);
    }
  }
}

TEST(Clearance, OfAToolIsThatOfItsSurface) {
  test::Random random(3);
  for (int i = 0; i < test::draws(20, 200); ++i) {
    KeepOut keep_out;
    keep_out.radii = {1e-3};
    const auto edge = [&] { return random.uniform(0.02, 0.06); };
    keep_out.tool = ToolBody{{}, test::randomPose(random, 0.02)};
    if (i % 2 == 0) {
      keep_out.tool->form = Box{{edge(), edge(), edge()}};
    } else {
      keep_out.tool->form = Cylinder{edge() / 2, edge()};
    }
    const model::Shape shape = randomShape(random, 1, 1.0);
    keep_out.zones = {test::randomZone(random, 0.1, 0.05, i % 5, "post")};
    Zone& zone = keep_out.zones[0];
    const lie::SE3 tip = model::tipPose(shape);
    zone.X_WZ.translation += tip.translation + 0.12 * (tip.rotation.col(0));
    double expected = test::denseClearance(keep_out, shape, 1000);
    for (const Vector3d& place : surfaceOf(keep_out.tool->form)) {
      expected = std::min(expected, test::distanceFrom(zone, tip * (keep_out.tool->X_TB * place)));
    }
    // A surface of places is farther away than what lies between them.
    const double found = ArmClearance(keep_out).of(shape).distance;
    if (expected > 5e-4) {
      EXPECT_LE(found, expected + 1e-4) << i;
      EXPECT_GE(found, expected - 3e-4) << i;
    } else {
      EXPECT_LT(found, 1e-3) << i;
    }
  }
}

// A planar arc of this turn and radius.
model::Shape arc(double turn, double radius) {
  lie::Vector6 twist = lie::Vector6::Zero();
  twist[0] = turn * radius;
  twist[5] = turn;
  return model::Twists(twist);
}

TEST(Clearance, FromItselfIsTheWidthOfABend) {
  KeepOut keep_out;
  keep_out.radii = {0.02};
  const ArmClearance clearance(keep_out);
  EXPECT_TRUE(std::isinf(clearance.of(arc(0.99 * basics::kPi, 0.1)).distance));
  const Clearance half = clearance.of(arc(1.02 * basics::kPi, 0.1));
  EXPECT_EQ(clearance.nameOf(half.zone), kOwnBody);
  EXPECT_NEAR(half.distance, 0.2 * std::sin(0.51 * basics::kPi) - 0.04, 1e-4);
  // Beyond it, the ends of 1.8 half turns approach each other.
  EXPECT_NEAR(clearance.of(arc(1.8 * basics::kPi, 0.1)).distance,
              0.2 * std::sin(0.9 * basics::kPi) - 0.04, 1e-4);
}

// A stick along the tip's x axis, 0.2 m long.
TEST(Clearance, OfTheToolFromTheArmCountsWhereTheArmBendsBackToIt) {
  KeepOut keep_out;
  keep_out.radii = {0.005};
  keep_out.tool = ToolBody{Cylinder{0.005, 0.2}, {}};
  keep_out.tool->X_TB.rotation = Eigen::AngleAxisd(basics::kPi / 2, Vector3d::UnitY()).matrix();
  keep_out.tool->X_TB.translation.x() = 0.1;
  const ArmClearance clearance(keep_out);
  EXPECT_TRUE(std::isinf(clearance.of(arc(0.49 * basics::kPi, 0.3)).distance));
  // Distance of the arm's base from the stick's axis.
  const double turn = 1.4 * basics::kPi;
  const Vector3d along(std::cos(turn), std::sin(turn), 0),
      tip(0.1 * std::sin(turn), 0.1 * (1 - std::cos(turn)), 0);
  const Clearance apart = clearance.of(arc(turn, 0.1));
  EXPECT_NEAR(apart.distance, tip.cross(along).norm() - 0.01, 1e-4);
  EXPECT_EQ(clearance.nameOf(apart.zone), kOwnBody);
  EXPECT_LE(clearance.of(arc(1.9 * basics::kPi, 0.1)).distance, 0.0);
}

}  // namespace
}  // namespace helix_arm::clearance
