#include <cmath>
#include <limits>
#include <stdexcept>

#include <gtest/gtest.h>

#include "helix_arm/procedures/pressure_plan.hpp"

namespace helix_arm::procedures {
namespace {

Eigen::MatrixXd twoRows() {
  Eigen::MatrixXd rows(2, 2);
  rows << 100, 200, 300, 0;
  return rows;
}

const Eigen::Vector2d kRest(0, 0);

TEST(SeriesPlayer, RampsInAStraightLineThenHolds) {
  SeriesPlayer player(twoRows(), kRest, {2.0, 1.0, false});
  EXPECT_EQ(player.pressure(), kRest);
  player.advance(0.5);
  EXPECT_EQ(player.pressure(), Eigen::Vector2d(25, 50));
  player.advance(1.5);
  EXPECT_EQ(player.pressure(), Eigen::Vector2d(100, 200));
  player.advance(0.75);
  EXPECT_EQ(player.pressure(), Eigen::Vector2d(100, 200));
  EXPECT_EQ(player.row(), 0);
  player.advance(1.25);  // 1 s into the ramp to the second row
  EXPECT_EQ(player.row(), 1);
  EXPECT_EQ(player.pressure(), Eigen::Vector2d(200, 100));
}

TEST(SeriesPlayer, EndsAtTheLastRowAndStaysThere) {
  SeriesPlayer player(twoRows(), kRest, {2.0, 1.0, false});
  player.advance(5.75);
  EXPECT_FALSE(player.finished());
  player.advance(0.25);
  EXPECT_TRUE(player.finished());
  player.advance(1e6);
  EXPECT_TRUE(player.finished());
  EXPECT_EQ(player.pressure(), Eigen::Vector2d(300, 0));
}

TEST(SeriesPlayer, ALoopRampsFromTheLastRowToTheFirst) {
  SeriesPlayer player(twoRows(), kRest, {2.0, 1.0, true});
  player.advance(7.0);
  EXPECT_FALSE(player.finished());
  EXPECT_EQ(player.row(), 0);
  EXPECT_EQ(player.pressure(), Eigen::Vector2d(200, 100));
}

TEST(SeriesPlayer, TheSizeOfTheStepsDoesNotMatter) {
  SeriesPlayer coarse(twoRows(), kRest, {2.0, 1.0, true}), fine = coarse;
  coarse.advance(97.0);
  for (int i = 0; i < 97 * 64; ++i) fine.advance(1.0 / 64);
  EXPECT_EQ(coarse.row(), fine.row());
  EXPECT_EQ(coarse.pressure(), fine.pressure());
}

TEST(SeriesPlayer, ResumesTheCurrentRowFromWhereOthersLeftTheArm) {
  SeriesPlayer player(twoRows(), kRest, {2.0, 1.0, false});
  player.advance(4.5);
  ASSERT_EQ(player.row(), 1);
  player.resume(Eigen::Vector2d(50, 50));
  EXPECT_EQ(player.row(), 1);
  EXPECT_EQ(player.pressure(), Eigen::Vector2d(50, 50));
  player.advance(1.0);
  EXPECT_EQ(player.pressure(), Eigen::Vector2d(175, 25));
}

TEST(SeriesPlayer, WithoutARampItJumps) {
  SeriesPlayer player(twoRows(), kRest, {0.0, 1.0, false});
  EXPECT_EQ(player.pressure(), Eigen::Vector2d(100, 200));
  player.advance(1.0);
  EXPECT_EQ(player.pressure(), Eigen::Vector2d(300, 0));
}

TEST(SeriesPlayer, UnusableArgumentsAreRefused) {
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_THROW(SeriesPlayer(Eigen::MatrixXd(0, 2), kRest, {}), std::invalid_argument);
  EXPECT_THROW(SeriesPlayer(twoRows(), Eigen::Vector3d::Zero(), {}), std::invalid_argument);
  EXPECT_THROW(SeriesPlayer(twoRows(), kRest, {0.0, 0.0, false}), std::invalid_argument);
  EXPECT_THROW(SeriesPlayer(twoRows(), kRest, {-1.0, 2.0, false}), std::invalid_argument);
  EXPECT_THROW(SeriesPlayer(twoRows(), kRest, {1.0, infinity, false}), std::invalid_argument);
  EXPECT_THROW(SeriesPlayer(twoRows(), kRest, {std::nan(""), 1.0, false}), std::invalid_argument);
}

}  // namespace
}  // namespace helix_arm::procedures
