#include <stdexcept>

#include <gtest/gtest.h>

#include "helix_arm/vision/charuco_board.hpp"
#include "helix_arm/vision/tag_detector.hpp"
#include "support/refusal.hpp"

namespace helix_arm::vision {
namespace {

TEST(TagBoard, IdsCountRowByRowFromTheTopLeftCornersAreThoseOfTheBorder) {
  TagBoard board;
  board.first_id = 7;
  board.columns = 3;
  board.rows = 2;
  board.tag_size = 0.02;
  board.pitch = 0.03;
  EXPECT_EQ(board.count(), 6);
  EXPECT_NEAR(board.width(), 0.08, 1e-15);
  EXPECT_NEAR(board.height(), 0.05, 1e-15);
  estimation::Corners first, last;
  first << -0.04, -0.02, -0.02, -0.04, 0.005, 0.005, 0.025, 0.025;
  last << 0.02, 0.04, 0.04, 0.02, -0.025, -0.025, -0.005, -0.005;
  EXPECT_TRUE(board.corners(7).isApprox(first, 1e-12)) << board.corners(7);
  EXPECT_TRUE(board.corners(12).isApprox(last, 1e-12)) << board.corners(12);
}

TEST(TagBoard, OtherIdsAreRefused) {
  const TagBoard board;
  for (const int id : {board.first_id - 1, board.first_id + board.count()}) {
    EXPECT_FALSE(board.has(id));
    EXPECT_EQ(test::refusal<std::out_of_range>([&] { board.corners(id); }),
              "tag id is " + std::to_string(id) + "; the board has 557 to 586");
  }
}

TEST(TagBoard, TheShippedOneHasTheLastTagsOfItsFamily) {
  const TagBoard board;
  EXPECT_EQ(board.first_id + board.count(), TagFamily(board.family).count());
}

}  // namespace
}  // namespace helix_arm::vision
