#include "regulator/guard_process.hpp"

#include <csignal>

#include <gtest/gtest.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "regulator/realtime.hpp"
#include "regulator/tcp_link.hpp"
#include "support/eventually.hpp"
#include "support/has.hpp"
#include "support/holding_child.hpp"
#include "support/modbus_profiles.hpp"
#include "support/refusal.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::regulator {
namespace {

namespace fs = std::filesystem;
using control::Guard;
using namespace test;

// A guard that answers, and notes what it was told, beats aside, until its input ended.
class Noting : public ::testing::Test {
 protected:
  std::string told() const {
    std::string words = contentOf(note());
    words.erase(std::remove(words.begin(), words.end(), GuardProcess::kBeat), words.end());
    return words;
  }
  std::uintmax_t beats() const { return fs::exists(note()) ? fs::file_size(note()) : 0; }
  std::string note() const { return folder_ / "told"; }
  std::string done() const { return folder_ / "done"; }
  std::vector<std::string> command() const {
    return {"/bin/sh", "-c", "tee \"$0\" >&0 2>/dev/null; : > \"$1\"", note(), done()};
  }
  // The same in one process, whose number is in done().
  std::vector<std::string> single() const {
    return {"/bin/sh", "-c", "echo $$ > \"$1\"; exec tee \"$0\" >&0 2>/dev/null", note(), done()};
  }
  pid_t numberOfSingle() const {
    pid_t number = 0;
    std::ifstream(done()) >> number;
    return number;
  }

  TemporaryFolder folder_;
};

TEST_F(Noting, IsDismissedAtAnOrderlyEnd) {
  {
    GuardProcess guard(command());
    EXPECT_FALSE(control::isGone(guard.state()));
    guard.dismiss();
    EXPECT_EQ(guard.state(), Guard::kEnded);
  }
  EXPECT_TRUE(eventually([&] { return fs::exists(done()); }));
  EXPECT_EQ(told(), std::string(1, GuardProcess::kDismissal));
}

TEST_F(Noting, OutlivesAKilledProcessGroupAndNoticesIt) {
  const pid_t ward = fork();
  if (ward == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    setpgid(0, 0);
    const GuardProcess guard(command());
    while (true) pause();
  }
  setpgid(ward, ward);
  ASSERT_TRUE(eventually([&] { return fs::exists(note()); }));
  EXPECT_FALSE(fs::exists(done()));
  ASSERT_EQ(kill(-ward, SIGKILL), 0);
  int status = 0;
  ASSERT_EQ(waitpid(ward, &status, 0), ward);
  ASSERT_TRUE(WIFSIGNALED(status));
  EXPECT_TRUE(eventually([&] { return fs::exists(done()); }));
  EXPECT_EQ(told(), "");
}

// Silence takes ten beats to be known, an end takes none.
TEST_F(Noting, ThatIsKilledIsKnownToHaveEndedBeforeItMissesABeat) {
  const GuardProcess guard(single());
  ASSERT_TRUE(eventually([&] { return guard.state() == Guard::kStands; }));
  ASSERT_EQ(kill(numberOfSingle(), SIGKILL), 0);
  ASSERT_EQ(waitid(P_PID, static_cast<id_t>(numberOfSingle()), nullptr, WEXITED | WNOWAIT), 0);
  EXPECT_EQ(guard.state(), Guard::kEnded);
}

TEST_F(Noting, IsNotReadyWhileStopped) {
  GuardProcess guard(single());
  ASSERT_TRUE(eventually([&] { return beats() >= 3; }));
  EXPECT_TRUE(eventually([&] { return guard.state() == Guard::kStands; }));
  ASSERT_EQ(kill(numberOfSingle(), SIGSTOP), 0);
  EXPECT_TRUE(eventually([&] { return guard.state() == Guard::kStandsStill; }));
  ASSERT_EQ(kill(numberOfSingle(), SIGCONT), 0);
  EXPECT_TRUE(eventually([&] { return guard.state() == Guard::kStands; }));
}

TEST_F(Noting, ThatNeverAnswersDoesNotStand) {
  GuardProcess guard({"/bin/sh", "-c", "exec cat > \"$0\"", note()});
  EXPECT_EQ(guard.state(), Guard::kStarting);
  EXPECT_TRUE(eventually([&] { return guard.state() == Guard::kStandsStill; }));
  EXPECT_GT(beats(), 0U);
}

// ---- One program of a machine drives a device at a time -----------------------------------------

// A name that is unique to this test process.
std::string deviceName(pid_t process = getpid()) {
  return "test of process " + std::to_string(process);
}

TEST(DeviceLock, IsHeldByOneAtATime) {
  DeviceLock one, other;
  EXPECT_FALSE(one.take(deviceName()));
  EXPECT_FALSE(one.take(deviceName())) << "it is the holder's already";
  const auto holder = other.take(deviceName());
  ASSERT_TRUE(holder);
  EXPECT_EQ(holder->find("process " + std::to_string(getpid()) + " ("), 0U) << *holder;
  EXPECT_FALSE(other.take(deviceName() + ", another device"));
  one.release();
  EXPECT_FALSE(other.take(deviceName()));
  EXPECT_FALSE(one.take(deviceName() + ", another device")) << "what it held before is free";
}

TEST(DeviceLock, IsFreeOnceItsHolderIsKilled) {
  HoldingChild holder([] {
    static DeviceLock held;
    return held.take(deviceName(getppid())).value_or("");
  });
  ASSERT_EQ(holder.text(), "");
  DeviceLock lock;
  // Asked more often than the holder's queue of callers is long.
  for (int k = 0; k < 10000; ++k) {
    const auto told = lock.take(deviceName());
    ASSERT_TRUE(told);
    if (k == 0) {
      EXPECT_EQ(told->find("process " + std::to_string(holder.id())), 0U) << *told;
    }
  }
  holder.kill();
  EXPECT_FALSE(lock.take(deviceName()));
}

class TwoDrivers : public ::testing::Test {
 protected:
  ModbusConfig config(const std::string& host = "127.0.0.1") const {
    return {vtemProfile(), host, device_.port(), {0, 1}};
  }
  simulation::EmulatedDevice device_{quietDevice(vtemProfile(), 2)};
};

TEST_F(TwoDrivers, TheSecondIsToldWhoDrivesTheDevice) {
  const auto first = config().makeDriver(2), second = config().makeDriver(2),
             by_name = config("localhost").makeDriver(2);
  first->connect();
  const std::uint64_t writes = device_.taken();
  for (const auto* driver : {&second, &by_name}) {
    EXPECT_TRUE(
        has(refusal<LinkError>([&] { (*driver)->connect(); }),
            std::to_string(device_.port()) + " is driven by process " + std::to_string(getpid())));
  }
  EXPECT_EQ(device_.taken(), writes);
  first->connect();  // again: it stays its own
  EXPECT_THROW(second->connect(), LinkError);
  first->close();
  second->connect();
  EXPECT_THROW(first->connect(), LinkError);
}

// A guard vents immediately, whichever program drives the device.
TEST_F(TwoDrivers, OneThatIgnoresOthersConnectsAndKeepsThemOut) {
  const auto ward = config().makeDriver(2), guard = config().makeDriver(2),
             third = config().makeDriver(2);
  ward->connect();
  guard->ignoreOthers();
  guard->connect();
  guard->vent();
  ward->close();
  guard->connect();
  EXPECT_THROW(third->connect(), LinkError);
}

}  // namespace
}  // namespace helix_arm::regulator
