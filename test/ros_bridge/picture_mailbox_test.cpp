#include "ros_bridge/vision/picture_mailbox.hpp"

#include <future>

#include <gtest/gtest.h>

namespace helix_arm::ros_bridge {
namespace {

using std::chrono::steady_clock;

Picture pictureAt(double seconds) { return {ros::Time(seconds), cv::Mat()}; }

// How long a wait is given that must not end yet, and one that must.
constexpr std::chrono::milliseconds kShort(20);
constexpr std::chrono::seconds kLong(20);

TEST(PictureMailbox, ANewerPictureReplacesTheOneThatWaits) {
  PictureMailbox mailbox;
  EXPECT_FALSE(mailbox.put(pictureAt(1)));
  EXPECT_TRUE(mailbox.put(pictureAt(2)));
  const auto taken = mailbox.take();
  ASSERT_TRUE(taken);
  EXPECT_EQ(taken->stamp, ros::Time(2));
  // The one that is measured is not replaced.
  EXPECT_FALSE(mailbox.put(pictureAt(3)));
}

TEST(PictureMailbox, IdleIsWhenNoneWaitsAndTheLastIsDone) {
  PictureMailbox mailbox;
  EXPECT_TRUE(mailbox.waitUntilIdle());
  mailbox.put(pictureAt(1));
  auto idle = std::async(std::launch::async, [&] { return mailbox.waitUntilIdle(); });
  EXPECT_EQ(idle.wait_for(kShort), std::future_status::timeout);
  mailbox.take();
  EXPECT_EQ(idle.wait_for(kShort), std::future_status::timeout);
  mailbox.done();
  ASSERT_EQ(idle.wait_for(kLong), std::future_status::ready);
  EXPECT_TRUE(idle.get());
}

TEST(PictureMailbox, TakeWaitsForAPicture) {
  PictureMailbox mailbox;
  auto taken = std::async(std::launch::async, [&] { return mailbox.take(); });
  EXPECT_EQ(taken.wait_for(kShort), std::future_status::timeout);
  mailbox.put(pictureAt(1));
  ASSERT_EQ(taken.wait_for(kLong), std::future_status::ready);
  EXPECT_EQ(taken.get()->stamp, ros::Time(1));
}

TEST(PictureMailbox, StoppingEndsAllWaits) {
  PictureMailbox mailbox;
  auto taken = std::async(std::launch::async, [&] { return mailbox.take().has_value(); });
  auto slept = std::async(std::launch::async,
                          [&] { return mailbox.sleepUntil(steady_clock::now() + 2 * kLong); });
  EXPECT_EQ(taken.wait_for(kShort), std::future_status::timeout);
  EXPECT_EQ(slept.wait_for(kShort), std::future_status::timeout);
  mailbox.stop();
  ASSERT_EQ(taken.wait_for(kLong), std::future_status::ready);
  ASSERT_EQ(slept.wait_for(kLong), std::future_status::ready);
  EXPECT_FALSE(taken.get());
  EXPECT_FALSE(slept.get());
}

TEST(PictureMailbox, StoppedItGivesNoPictureAndDoesNotWait) {
  PictureMailbox mailbox;
  mailbox.put(pictureAt(1));
  EXPECT_FALSE(mailbox.stopped());
  mailbox.stop();
  EXPECT_TRUE(mailbox.stopped());
  EXPECT_FALSE(mailbox.take());
  EXPECT_FALSE(mailbox.waitUntilIdle());
  EXPECT_FALSE(mailbox.sleepUntil(steady_clock::now() + kLong));
}

TEST(PictureMailbox, SleepsUntilItIsDue) {
  PictureMailbox mailbox;
  const auto due = steady_clock::now() + kShort;
  EXPECT_TRUE(mailbox.sleepUntil(due));
  EXPECT_GE(steady_clock::now(), due);
  EXPECT_TRUE(mailbox.sleepUntil(due));  // past
}

}  // namespace
}  // namespace helix_arm::ros_bridge
