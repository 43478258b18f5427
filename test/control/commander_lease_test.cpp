#include "helix_arm/control/commander_lease.hpp"

#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace helix_arm::control {
namespace {

constexpr double kTimeout = 0.5;

// Claims in their order: whose, when [s], and whether it is granted.
TEST(CommanderLease, IsOfTheFirstUntilItWasSilentForTheTimeout) {
  struct Claim {
    const char* sender;
    double time;
    bool granted;
  };
  const std::vector<Claim> kSequences[] = {
      {{"first", 10.0, true},
       {"second", 10.0, false},
       {"second", std::nextafter(10.0 + kTimeout, 0.0), false},
       {"second", 10.0 + kTimeout, true}},
      // Every claim of the holder renews it.
      {{"first", 0, true}, {"first", 0.4, true}, {"first", 0.8, true}, {"second", 1.2, false}},
      // Refused claims neither renew nor shorten it.
      {{"first", 0, true}, {"second", 0.2, false}, {"second", 0.4, false}, {"second", 0.5, true}},
      // The old holder waits like any other.
      {{"first", 0, true}, {"second", 1, true}, {"first", 1.1, false}, {"first", 1.6, true}}};
  for (const std::vector<Claim>& sequence : kSequences) {
    CommanderLease lease(kTimeout);
    std::string holder;
    for (const auto& [sender, time, granted] : sequence) {
      EXPECT_EQ(lease.holder(), holder) << time;
      EXPECT_EQ(lease.claim(sender, time), granted) << sender << ", " << time;
      if (granted) holder = sender;
    }
    EXPECT_EQ(lease.holder(), holder);
  }
}

TEST(RestedCommanders, WhoRepeatsItsTargetsIsRefusedUntilItPauses) {
  RestedCommanders rested;
  EXPECT_FALSE(rested.refuses("first", 0.0, kTimeout));
  rested.hold("", 1.0);
  double now = 1.0;
  for (int k = 0; k < 100; ++k) {
    now += 0.9 * kTimeout;
    ASSERT_TRUE(rested.refuses("first", now, kTimeout)) << k;
  }
  EXPECT_TRUE(rested.refuses("first", std::nextafter(now + kTimeout, 0.0), kTimeout));
  now = std::nextafter(now + kTimeout, 0.0) + kTimeout;
  EXPECT_FALSE(rested.refuses("first", now, kTimeout));
  EXPECT_FALSE(rested.refuses("first", now, kTimeout));
}

// Such as one that gave way to the commander, and goes on once that is silent.
TEST(RestedCommanders, ARestReachesThoseWhoDidNotCommand) {
  RestedCommanders rested;
  rested.hold("caller", 1.0);
  EXPECT_TRUE(rested.refuses("second", 1.0 + 0.9 * kTimeout, kTimeout));
  EXPECT_TRUE(rested.refuses("second", 1.0 + 1.1 * kTimeout, kTimeout)) << "it has not paused";
  EXPECT_FALSE(rested.refuses("third", 1.0 + kTimeout, kTimeout)) << "silent since the rest";
  EXPECT_FALSE(rested.refuses("caller", 1.0, kTimeout));
  for (std::size_t k = 0; k < 2 * RestedCommanders::kMost; ++k) {
    EXPECT_TRUE(rested.refuses("more" + std::to_string(k), 1.0, kTimeout));
  }
}

TEST(RestedCommanders, OneThatKnowsOfTheRestCountsAtOnce) {
  RestedCommanders rested;
  rested.acknowledge("first");
  rested.hold("", 0.0);
  EXPECT_TRUE(rested.refuses("first", 0.0, kTimeout));
  rested.acknowledge("first");
  EXPECT_FALSE(rested.refuses("first", 0.0, kTimeout));
  EXPECT_TRUE(rested.refuses("second", 0.0, kTimeout));
  rested.release();
  EXPECT_FALSE(rested.refuses("second", 0.0, kTimeout));
}

}  // namespace
}  // namespace helix_arm::control
