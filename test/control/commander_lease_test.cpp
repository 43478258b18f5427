#include "helix_arm/control/commander_lease.hpp"

#include <cmath>
#include <limits>
#include <stdexcept>

#include <gtest/gtest.h>

namespace helix_arm::control {
namespace {

constexpr double kTimeout = 0.5;

TEST(CommanderLease, TheFirstSenderHoldsIt) {
  CommanderLease lease(kTimeout);
  EXPECT_TRUE(lease.holder().empty());
  EXPECT_TRUE(lease.claim("first", 10.0));
  EXPECT_EQ(lease.holder(), "first");
}

TEST(CommanderLease, TheNewerIsRefusedUntilTheFirstWasSilentForTheTimeout) {
  CommanderLease lease(kTimeout);
  ASSERT_TRUE(lease.claim("first", 10.0));
  EXPECT_FALSE(lease.claim("second", 10.0));
  EXPECT_FALSE(lease.claim("second", std::nextafter(10.0 + kTimeout, 0.0)));
  EXPECT_EQ(lease.holder(), "first");
  EXPECT_TRUE(lease.claim("second", 10.0 + kTimeout));
  EXPECT_EQ(lease.holder(), "second");
}

TEST(CommanderLease, EveryClaimOfTheHolderRenewsIt) {
  CommanderLease lease(kTimeout);
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(lease.claim("first", 0.4 * i));
  EXPECT_FALSE(lease.claim("second", 0.4 * 9 + 0.4));
}

TEST(CommanderLease, RefusedClaimsNeitherRenewNorShortenIt) {
  CommanderLease lease(kTimeout);
  ASSERT_TRUE(lease.claim("first", 0.0));
  EXPECT_FALSE(lease.claim("second", 0.2));
  EXPECT_FALSE(lease.claim("second", 0.4));
  EXPECT_TRUE(lease.claim("second", 0.5));
}

TEST(CommanderLease, TheOldHolderWaitsLikeAnyOther) {
  CommanderLease lease(kTimeout);
  ASSERT_TRUE(lease.claim("first", 0.0));
  ASSERT_TRUE(lease.claim("second", 1.0));
  EXPECT_FALSE(lease.claim("first", 1.1));
  EXPECT_TRUE(lease.claim("first", 1.6));
}

TEST(CommanderLease, AnUnusableTimeoutIsRefused) {
  for (const double timeout : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    EXPECT_THROW(CommanderLease{timeout}, std::invalid_argument) << timeout;
  }
}

TEST(RestedCommander, WhoRepeatsItsTargetsIsRefusedUntilItPauses) {
  RestedCommander rested;
  EXPECT_FALSE(rested.refuses("first", 0.0, kTimeout));
  rested.hold("first", 1.0);
  EXPECT_FALSE(rested.refuses("second", 1.0, kTimeout));
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

TEST(RestedCommander, OneThatKnowsOfTheRestCountsAtOnce) {
  RestedCommander rested;
  rested.hold("first", 0.0);
  rested.acknowledge("second");
  EXPECT_TRUE(rested.refuses("first", 0.0, kTimeout));
  rested.acknowledge("first");
  EXPECT_FALSE(rested.refuses("first", 0.0, kTimeout));
  rested.hold("first", 0.0);
  rested.release();
  EXPECT_FALSE(rested.refuses("first", 0.0, kTimeout));
  rested.hold("", 0.0);  // nobody has commanded yet
  EXPECT_FALSE(rested.refuses("", 0.0, kTimeout));
}

}  // namespace
}  // namespace helix_arm::control
