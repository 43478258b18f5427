// One program of a machine drives a device at a time.

#include <unistd.h>

#include "regulator/tcp_link.hpp"
#include "support/bounded_child.hpp"
#include "support/has.hpp"
#include "support/modbus_profiles.hpp"
#include "support/refusal.hpp"

namespace helix_arm::test {
namespace {

using regulator::DeviceLock;
using regulator::LinkError;

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

TEST(DeviceLock, ALongNameIsCutAndTakenAllTheSame) {
  DeviceLock one, other;
  EXPECT_FALSE(one.take(deviceName() + std::string(5000, 'x')));
  EXPECT_TRUE(other.take(deviceName() + std::string(4000, 'x')));
}

class TwoDrivers : public ::testing::Test {
 protected:
  regulator::ModbusConfig config(const std::string& host = "127.0.0.1") const {
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

// What is not reached is not held.
TEST_F(TwoDrivers, ADeviceThatDoesNotAnswerIsFree) {
  regulator::ModbusConfig nowhere = config();
  nowhere.port = 1;
  const auto lost = nowhere.makeDriver(2);
  EXPECT_THROW(lost->connect(), LinkError);
  DeviceLock lock;
  EXPECT_FALSE(lock.take("modbus_tcp 127.0.0.1 port 1"));
}

}  // namespace
}  // namespace helix_arm::test
