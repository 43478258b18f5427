#include "helix_arm/localization/tag_layout.hpp"

#include <algorithm>
#include <utility>

#include <gtest/gtest.h>

#include "helix_arm/localization/camera.hpp"
#include "support/random.hpp"
#include "support/sample_view.hpp"

namespace helix_arm::estimation {
namespace {

// A tag rides on the piece that it sits on: its section's pieces before it, and its share of that.
TEST(TagLayout, TagsRideOnTheirCurveOrOnThePiecesOfALoadedArm) {
  const TagLayout layout = test::sampleLayout(2);
  for (const int per_section : {1, 3}) {
    model::Shape::Pieces pieces(6, 2 * per_section);
    for (int j = 0; j < pieces.cols(); ++j) {
      for (int i = 0; i < 6; ++i) pieces(i, j) = i == 0 ? 0.14 : 0.1 * i - 0.07 * j;
    }
    const std::vector<lie::SE3> poses = per_section == 1
                                            ? tagPoses(layout, model::Twists(pieces))
                                            : tagPoses(layout, model::Shape(pieces, per_section));
    ASSERT_EQ(poses.size(), layout.tags.size());
    bool last_of_section = false;
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const TagPlacement& tag = layout.tags[i];
      double along = per_section * (tag.section + tag.s);
      lie::SE3 X;
      for (int j = 0; along > 0; ++j, along -= 1) {
        X = X * lie::SE3::exp(std::min(along, 1.0) * pieces.col(j));
      }
      X = X * tag.X_ST;
      EXPECT_LT((poses[i].translation - X.translation).norm(), 1e-14);
      EXPECT_LT((poses[i].rotation - X.rotation).norm(), 1e-14);
      const PiecePlace place = placeOnPieces(tag, per_section);
      EXPECT_GE(place.piece, tag.section * per_section);
      EXPECT_LT(place.piece, (tag.section + 1) * per_section);
      EXPECT_NEAR(place.piece + place.s, per_section * (tag.section + tag.s), 1e-14);
      EXPECT_TRUE(place.s >= 0 && place.s <= 1);
      last_of_section |= tag.s == 1;
    }
    EXPECT_TRUE(last_of_section);
  }
}

TEST(TagLayout, BleedShrinksTheBorder) {
  TagLayout layout;
  layout.size = 0.03;
  const Corners corners = layout.corners(0.001);
  EXPECT_NEAR(corners(0, 1) - corners(0, 0), 0.028, 1e-15);
  EXPECT_NEAR(corners(1, 2) - corners(1, 1), 0.028, 1e-15);
  // Left below, right below, right above, left above.
  EXPECT_TRUE(corners(0, 0) < 0 && corners(1, 0) < 0 && corners(0, 2) > 0 && corners(1, 2) > 0);
}

TEST(TagLayout, ATagThatIsMovedTurnsAboutItsCentre) {
  const double length = 0.4;
  model::Twists rest = model::Twists::Zero(6, 1);
  rest(0, 0) = length;
  const TagLayout layout = test::sampleLayout(1, 8);
  // Inside, and beyond either end.
  for (const auto& [tag, along] : {std::pair{3, 0.006}, {7, 0.006}, {0, -0.07}}) {
    const lie::SE3 before = tagPoses(layout, rest)[tag];
    lie::Vector6 moved;
    moved << along, -0.002, 0.004, 0.1, -0.2, 0.05;
    TagLayout after = layout;
    after.tags[tag] = movedBy(layout.tags[tag], moved, length);
    EXPECT_NO_THROW(after.validate(1));
    const lie::SE3 pose = tagPoses(after, rest)[tag];
    EXPECT_LT((pose.translation - before.translation - moved.head<3>()).norm(), 1e-15);
    lie::Vector6 turn = lie::Vector6::Zero();
    turn.tail<3>() = moved.tail<3>();
    EXPECT_LT((pose.rotation - before.rotation * lie::SE3::exp(turn).rotation).norm(), 1e-15);
  }
  EXPECT_EQ(movedBy(layout.tags[3], lie::Vector6::Unit(0) * 0.01, length).s, 0.5 + 0.01 / length);
}

TEST(TagImage, VisibleTagsFaceTheCameraAndLieInThePicture) {
  const ArmView view = test::sampleView();
  const model::Arm arm = test::ringArm(test::helicalRing());
  const model::Twists twists = arm.twists(arm.inputAt(0.3));
  const std::vector<lie::SE3> poses = tagPoses(view.layout, twists);
  const std::vector<TagImage> observations = visibleTags(view, twists, 0.2);
  std::vector<bool> visible(poses.size(), false);
  for (const TagImage& observation : observations) visible[observation.tag] = true;
  int hidden = 0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const lie::SE3 X_CT = view.X_CB * poses[i];
    const double cosine = -X_CT.rotation.col(2).dot(X_CT.translation.normalized());
    EXPECT_EQ(visible[i], cosine >= 0.2) << "tag " << i;  // all of this arm is in the picture
    hidden += visible[i] ? 0 : 1;
  }
  EXPECT_GT(observations.size(), 8u);
  EXPECT_GT(hidden, 8);
  // As it is read: the corners go around against the clock where y points up, with it where it
  // points down.
  for (const TagImage& observation : observations) {
    const Eigen::Vector2d a = observation.corners.col(1) - observation.corners.col(0);
    const Eigen::Vector2d b = observation.corners.col(2) - observation.corners.col(1);
    EXPECT_LT(a.x() * b.y() - a.y() * b.x(), 0);
  }
}

TEST(Camera, ProjectsByTheDefinitionOfOpenCV) {
  // x'' = x' radial + 2 p1 x'y' + p2 (r2 + 2 x'^2), and so on, written out for one point.
  const Camera camera{
      640, 480, 500, 510, 320, 240, {0.1, -0.05, 0.002, -0.003, 0.01, 0.02, 0.03, 0.004}};
  const double x = 0.2, y = -0.1, r2 = 0.05;
  const double radial = (1 + 0.1 * r2 - 0.05 * r2 * r2 + 0.01 * r2 * r2 * r2) /
                        (1 + 0.02 * r2 + 0.03 * r2 * r2 + 0.004 * r2 * r2 * r2);
  const double u = x * radial + 2 * 0.002 * x * y - 0.003 * (r2 + 2 * x * x);
  const double v = y * radial + 0.002 * (r2 + 2 * y * y) + 2 * -0.003 * x * y;
  const auto pixel = camera.project({2 * x, 2 * y, 2});
  ASSERT_TRUE(pixel);
  EXPECT_NEAR(pixel->x(), 500 * u + 320, 1e-10);
  EXPECT_NEAR(pixel->y(), 510 * v + 240, 1e-10);
}

TEST(Camera, DirectionAndPixelUndoEachOther) {
  test::Random random(3);
  const Camera camera = test::sampleCamera();
  double worst = 0;
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector2d pixel(random.uniform(0, camera.width - 1),
                                random.uniform(0, camera.height - 1));
    const auto direction = camera.directionOf(pixel);
    ASSERT_TRUE(direction) << pixel.transpose();
    worst = std::max(worst, (camera.pixelOf(*direction) - pixel).norm());
  }
  EXPECT_LT(worst, 1e-9);
}

TEST(Camera, SeesNothingBehindItself) {
  const Camera camera = test::sampleCamera();
  EXPECT_FALSE(camera.project({0.1, 0.1, -1}));
  EXPECT_FALSE(camera.project({0.1, 0.1, 0}));
}

TEST(Camera, SeesNothingWhereTheDistortionFoldsBack) {
  // radial = 1 - r2 turns back at r2 = 1/3.
  const Camera camera{640, 480, 500, 500, 320, 240, {-1.0, 0, 0, 0, 0, 0, 0, 0}};
  EXPECT_TRUE(camera.project({0.5, 0, 1}));
  EXPECT_FALSE(camera.project({0.7, 0, 1}));
  // Nothing is seen beyond 0.577 (1 - 1/3) = 0.385 focal lengths from the middle.
  EXPECT_TRUE(camera.directionOf({320 + 0.384 * 500, 240}));
  EXPECT_FALSE(camera.directionOf({320 + 0.386 * 500, 240}));
}

}  // namespace
}  // namespace helix_arm::estimation
