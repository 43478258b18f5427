// What a strip chart remembers.
#include <cmath>
#include <stdexcept>

#include <gtest/gtest.h>

#include "ros_bridge/cockpit/cockpit_view.hpp"

namespace helix_arm::ros_bridge {
namespace {

TEST(StripHistory, KeepsItsSpanAndNoMore) {
  StripHistory history(30, 0.05);
  for (int k = 0; k < 10000; ++k) history.add(0.1 * k, {1e5}, 1e-3);
  EXPECT_NEAR(history.rows().front().time, history.newest() - 30, 0.11);
  EXPECT_LE(history.rows().size(), 302U);
}

TEST(StripHistory, LeavesOutRowsThatComeTooSoon) {
  StripHistory history(30, 0.05);
  for (int k = 0; k < 1000; ++k) history.add(0.001 * k, {0}, 0);
  EXPECT_LE(history.rows().size(), 21U);
  EXPECT_GE(history.rows().size(), 19U);
}

TEST(StripHistory, BeginsAnewWhereTimeJumpsBackOrTheArmIsAnother) {
  StripHistory history(30, 0);
  history.add(5, {1, 2}, 0);
  history.add(4, {1, 2}, 0);
  EXPECT_EQ(history.rows().size(), 1U);
  history.add(6, {1, 2, 3}, 0);
  EXPECT_EQ(history.rows().size(), 1U);
  history.add(std::nan(""), {1, 2, 3}, 0);
  EXPECT_EQ(history.rows().size(), 1U);
}

TEST(StripHistory, AxesHoldAllValuesInSteps) {
  StripHistory history(30, 0);
  EXPECT_EQ(history.pressureTop(1e5), 1e5);
  history.add(0, {1e5, std::nan("")}, std::nan(""));
  EXPECT_EQ(history.pressureTop(1e5), 1e5);
  EXPECT_EQ(history.errorTop(1e-3), 1e-3);
  history.add(1, {1.1e5, 0}, 0.0011);
  EXPECT_EQ(history.pressureTop(1e5), 2e5);
  EXPECT_DOUBLE_EQ(history.errorTop(1e-3), 2e-3);
  history.add(2, {2.1e5, 0}, 0.0051);
  EXPECT_EQ(history.pressureTop(1e5), 5e5);
  EXPECT_DOUBLE_EQ(history.errorTop(1e-3), 1e-2);
}

TEST(StripHistory, NamesTheValueThatBreaksItsRule) {
  EXPECT_THROW(StripHistory(0, 0.1), std::invalid_argument);
  EXPECT_THROW(StripHistory(1, -0.1), std::invalid_argument);
}

}  // namespace
}  // namespace helix_arm::ros_bridge
