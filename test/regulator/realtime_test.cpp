// Real-time priority and locked memory are never required: where the user's limits refuse them, the
// reason and the remedy are returned.
#include "helix_arm/regulator/realtime.hpp"

#include <thread>

#include <gtest/gtest.h>
#include <sched.h>

#include "support/bounded_child.hpp"
#include "support/has.hpp"

namespace helix_arm::regulator {
namespace {

constexpr uid_t kNobody = 65534;

// The answer in a process that may have neither.
std::string refusalOf(std::string (*ask)()) {
  const auto run = test::runInChild([ask]() -> std::string {
    const rlimit none{0, 0};
    const bool limited = setrlimit(RLIMIT_RTPRIO, &none) == 0 &&
                         setrlimit(RLIMIT_MEMLOCK, &none) == 0 &&
                         (geteuid() != 0 || setuid(kNobody) == 0);
    return limited ? ask() : "the limits cannot be set";
  });
  EXPECT_EQ(run.signal, 0);
  return run.text;
}

TEST(Realtime, ARefusalNamesTheLimitAndItsRemedy) {
  const std::string priority = refusalOf([] { return tryRealtime(kRealtimePriority); });
  EXPECT_EQ(priority.find("real-time priority 40 is refused ("), 0U) << priority;
  EXPECT_TRUE(test::has(priority, "`@realtime - rtprio 40` in /etc/security/limits.conf"));
  const std::string memory = refusalOf([] { return lockMemory(); });
  EXPECT_EQ(memory.find("locked memory is refused ("), 0U) << memory;
  EXPECT_TRUE(test::has(memory, "`@realtime - memlock unlimited`"));
}

TEST(Realtime, NoneIsAskedForWithPriority0) {
  EXPECT_EQ(refusalOf([] { return scheduleRealtime(0); }), "");
}

TEST(Realtime, ItIsTheCallingThreadsAlone) {
  if (!tryRealtime(1).empty()) GTEST_SKIP() << "this user has no real-time priority";
  int mine = -1, childs = -1;
  std::thread([&] {
    scheduleRealtime(1);
    mine = sched_getscheduler(0) & ~SCHED_RESET_ON_FORK;
    std::thread([&] { childs = sched_getscheduler(0); }).join();
  }).join();
  EXPECT_EQ(mine, SCHED_FIFO);
  EXPECT_EQ(childs, SCHED_OTHER);
  EXPECT_EQ(sched_getscheduler(0), SCHED_OTHER);
}

}  // namespace
}  // namespace helix_arm::regulator
