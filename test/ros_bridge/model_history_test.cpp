#include "ros_bridge/vision/model_history.hpp"

#include <gtest/gtest.h>

namespace helix_arm::ros_bridge {
namespace {

class History : public ::testing::Test {
 protected:
  // A model whose first number tells which one it is.
  void add(double seconds, double mark) {
    history_.add(ros::Time(seconds), model::Twists(model::Twists::Constant(6, 1, mark)));
  }
  double markAt(double seconds) const {
    const auto entry = history_.nearest(ros::Time(seconds));
    return entry ? entry->shape.pieces()(0, 0) : -1.0;
  }

  ModelHistory history_;
};

TEST_F(History, TheNearestInTimeIsTaken) {
  add(10.0, 1);
  add(10.1, 2);
  add(10.2, 3);
  EXPECT_EQ(markAt(10.04), 1);
  EXPECT_EQ(markAt(10.06), 2);
  EXPECT_EQ(markAt(10.14), 2);
  EXPECT_EQ(markAt(10.3), 3);
}

TEST_F(History, BeyondItsReachThereIsNone) {
  EXPECT_EQ(markAt(10.0), -1);
  add(10.0, 1);
  EXPECT_EQ(markAt(10.0 + 0.99 * ModelHistory::kReach), 1);
  EXPECT_EQ(markAt(10.0 + 1.01 * ModelHistory::kReach), -1);
  EXPECT_EQ(markAt(10.0 - 1.01 * ModelHistory::kReach), -1);
}

TEST_F(History, OldOnesAreForgotten) {
  add(10.0, 1);
  add(10.0 + 1.01 * ModelHistory::kMemory, 2);
  EXPECT_EQ(markAt(10.0), -1);
}

TEST_F(History, AJumpBackInTimeForgetsWhatWasAhead) {
  add(10.0, 1);
  add(5.0, 2);
  EXPECT_EQ(markAt(10.0), -1);
  EXPECT_EQ(markAt(5.0), 2);
}

TEST_F(History, APictureFromBeforeForgetsModelsFromBeforeTheJump) {
  add(5.0, 1);
  add(6.0, 2);
  history_.forgetFuture(ros::Time(5.1));
  EXPECT_EQ(markAt(5.1), 1);
  EXPECT_EQ(markAt(6.0), -1);
}

TEST_F(History, ANearerModelMayComeUntilOneIsAsLate) {
  EXPECT_FALSE(history_.mayGetNearer(ros::Time(10.0)));  // none comes at all
  add(9.9, 1);
  EXPECT_TRUE(history_.mayGetNearer(ros::Time(10.0)));
  add(10.0, 2);
  EXPECT_FALSE(history_.mayGetNearer(ros::Time(10.0)));
  EXPECT_FALSE(history_.mayGetNearer(ros::Time(20.0)));  // they stopped coming
}

TEST_F(History, MemoryIsBoundedForAnyStamps) {
  for (int k = 0; k < 100000; ++k) add(10.0, k);
  EXPECT_EQ(history_.size(), 1U);
  EXPECT_EQ(markAt(10.0), 99999);
  for (int k = 0; k < 100000; ++k) {
    history_.add(ros::Time(20, k), model::Twists(model::Twists::Constant(6, 1, k)));
  }
  EXPECT_EQ(history_.size(), ModelHistory::kMost);
  EXPECT_EQ(history_.nearest(ros::Time(20, 99999))->shape.pieces()(0, 0), 99999);
}

TEST_F(History, TheLagIsOfTheLatestModel) {
  EXPECT_FALSE(history_.lag(ros::Time(10.0)));
  add(9.0, 1);
  add(9.5, 2);
  EXPECT_NEAR(*history_.lag(ros::Time(10.0)), 0.5, 1e-9);
  EXPECT_NEAR(*history_.lag(ros::Time(9.0)), -0.5, 1e-9);
}

TEST_F(History, StampsOfAnyKindArePutUpWith) {
  add(0.0, 1);
  history_.add(ros::TIME_MAX, model::Twists(model::Twists::Constant(6, 1, 2)));
  EXPECT_EQ(markAt(0.0), -1);  // forgotten long since
  EXPECT_FALSE(history_.mayGetNearer(ros::Time(0.0)));
  history_.forgetFuture(ros::Time(10.0));
  add(10.0, 3);
  EXPECT_EQ(markAt(10.0), 3);
  EXPECT_EQ(secondsBetween(ros::TIME_MAX, ros::Time(0.0)), -ros::TIME_MAX.toSec());
}

}  // namespace
}  // namespace helix_arm::ros_bridge
