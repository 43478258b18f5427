// The emulated device against a bare line, without a driver.

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <thread>

#include <gtest/gtest.h>

#include "helix_arm/regulator/line_format.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "helix_arm/simulation/emulated_device.hpp"
#include "regulator/serial_port.hpp"
#include "support/eventually.hpp"
#include "support/refusal.hpp"
#include "support/serial_profiles.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::simulation {
namespace {

using control::Valve;
using namespace regulator;
using test::eventually;
using test::refusal;

constexpr double kTau = 0.02;     // [s]
constexpr double kSoon = 5.0;     // on a machine that is busy [s]
constexpr double kSilence = 0.3;  // after which nothing is to come [s]

EmulatedDeviceConfig configOf(const SerialProfile& profile, std::vector<std::string> addresses,
                              int channels, const std::string& link = "") {
  EmulatedDeviceConfig config;
  config.regulator = SerialConfig{profile, link, std::move(addresses)};
  config.channels = channels;
  config.valves = {kTau, 6e5, 0.0, 1};
  return config;
}

// One channel behind a link in a folder of its own.
struct Linked {
  test::TemporaryFolder folder;
  const std::string link = folder / "regulator";
  const EmulatedDeviceConfig config = configOf(test::genericProfile(), {"0"}, 1, link);
};

// A user at a terminal.
class Terminal {
 public:
  Terminal(const EmulatedDevice& device, std::string terminator)
      : terminator_(std::move(terminator)) {
    port_.open(device.path(), 115200);
  }
  void say(const std::string& line) { port_.send(line + terminator_, in(kSoon)); }
  std::optional<std::string> hear(double time = kSoon) {
    return port_.receiveLine(terminator_, in(time));
  }
  std::string ask(const std::string& line) {
    say(line);
    return hear().value_or("silence");
  }
  bool asksInVain(const std::string& line) {
    say(line);
    return !hear(kSilence);
  }

 private:
  static double in(double time) { return regulator::steadyNow() + time; }

  SerialPort port_;
  std::string terminator_;
};

TEST(SerialDevice, AnAlicatAnswersWithItsFrame) {
  const EmulatedDevice device(configOf(test::alicatProfile(), {"A", "B"}, 2));
  Terminal terminal(device, "\r");
  EXPECT_EQ(terminal.ask("A"), "A 0.00 0.00");
  EXPECT_EQ(terminal.ask("BS20.00"), "B 0.00 20.00");
  ASSERT_TRUE(eventually([&] { return device.pressure()[1] > 20 * 6894.757 - 1; }));
  EXPECT_EQ(terminal.ask("B"), "B 20.00 20.00");
  EXPECT_EQ(terminal.ask("C"), "?");
  EXPECT_EQ(device.pressure()[0], 0.0);
  EXPECT_NEAR(device.setPoint()[1], 20 * 6894.757293168, 1e-6);
}

// Every flipped bit shows in a checksum: line_format_test.
TEST(SerialDevice, WithChecksumsALineWithoutOrWithAWrongOneIsRefused) {
  const SerialProfile profile = test::withChecksums(test::genericProfile());
  const EmulatedDevice device(configOf(profile, {"0"}, 1));
  Terminal terminal(device, "\n");
  const std::string line = regulator::withChecksum("p0=100.00");
  for (const std::string& wrong : {std::string("p0=100.00"), "p0=101.00" + line.substr(9)}) {
    EXPECT_EQ(terminal.ask(wrong), regulator::withChecksum("?"));
    EXPECT_EQ(device.setPoint()[0], 0) << wrong;
  }
  EXPECT_TRUE(regulator::withoutChecksum(terminal.ask(line))) << "the line itself";
  EXPECT_EQ(device.setPoint()[0], 1e5);
}

TEST(SerialDevice, AHeldAlicatAcceptsSetPointsButFollowsThemOnlyWhenReleased) {
  const EmulatedDevice device(configOf(test::alicatProfile(), {"A"}, 1));
  Terminal terminal(device, "\r");
  terminal.ask("AS20.00");
  ASSERT_TRUE(eventually([&] { return device.pressure()[0] > 1.378e5; }));
  terminal.ask("AHC");
  EXPECT_EQ(device.valves(), std::vector<Valve>{Valve::kClose});
  terminal.ask("AS0.00");
  std::this_thread::sleep_for(std::chrono::duration<double>(5 * kTau));
  EXPECT_GT(device.pressure()[0], 1.378e5);
  terminal.ask("AC");
  EXPECT_TRUE(eventually([&] { return device.pressure()[0] < 100; }));
}

TEST(SerialDevice, ACtrlPSendsOnceItIsSwitchedOnAndVentsByItsMode) {
  const EmulatedDevice device(configOf(test::ctrlPProfile(), {}, 3));
  Terminal terminal(device, "\n");
  EXPECT_FALSE(terminal.hear(kSilence));
  terminal.say("on");
  EXPECT_EQ(terminal.hear(), "0\t1\t0.00\t0.00\t0.00");
  terminal.say("set;0;100;50;25");
  ASSERT_TRUE(eventually([&] { return device.pressure()[0] > 9.99e4; }));
  terminal.say("mode;0");
  ASSERT_TRUE(eventually([&] { return device.pressure()[0] < 100; }));
  terminal.say("set;0;100;50;25");
  ASSERT_TRUE(eventually([&] { return device.setPoint()[0] == 1e5; }));
  EXPECT_EQ(device.valves(), std::vector<Valve>(3, Valve::kVent));
  terminal.say("mode;1");
  EXPECT_TRUE(eventually([&] { return device.pressure()[2] > 2.49e4; }));
}

TEST(SerialDevice, ADeviceWithAWatchdogVentsByItselfWithoutLines) {
  SerialProfile profile = test::genericProfile();
  profile.watchdog = 2;
  const EmulatedDevice device(configOf(profile, {"0", "1"}, 2));
  Terminal terminal(device, "\n");
  terminal.ask("p0=200.00");
  terminal.ask("p1=close");
  double last = steadyNow();
  // Any line will do, also one that it does not know.
  for (const char* line : {"p0?", "hello", "p1?", "p0?"}) {
    ASSERT_TRUE(eventually([&] { return steadyNow() > last + 0.6; }, kSoon));
    EXPECT_EQ(device.valves(), (std::vector{Valve::kRegulate, Valve::kClose}));
    last = steadyNow();
    terminal.ask(line);
  }
  ASSERT_TRUE(eventually(
      [&] {
        return device.valves() == std::vector{Valve::kVent, Valve::kVent};
      },
      kSoon));
  EXPECT_GT(steadyNow(), last + profile.watchdog);
  EXPECT_TRUE(device.setPoint().isZero());
  EXPECT_TRUE(eventually([&] { return device.pressure().isZero(1); }, kSoon));
  terminal.ask("p0=100.00");
  EXPECT_EQ(device.valves(), (std::vector{Valve::kRegulate, Valve::kVent}));
}

TEST(SerialDevice, EachFaultIsWhatItsNameSays) {
  SerialProfile profile = test::genericProfile();
  EmulatedDevice device(configOf(profile, {"0"}, 1));
  Terminal terminal(device, "\n");
  terminal.ask("p0=200.00");
  ASSERT_TRUE(eventually([&] { return device.pressure()[0] > 2e5 - 1; }));
  ASSERT_EQ(terminal.ask("p0?"), "p0=200.00 kPa");

  device.setFault(DeviceFault::kWrongUnit);
  EXPECT_EQ(terminal.ask("p0?"), "p0=29.01 psi");  // 200 kPa / 6.894757 kPa
  device.setFault(DeviceFault::kNanText);
  EXPECT_EQ(terminal.ask("p0?"), "p0=nan kPa");
  device.setFault(DeviceFault::kStuckValue);
  terminal.ask("p0=100.00");
  ASSERT_TRUE(eventually([&] { return device.pressure()[0] < 1e5 + 1; }));
  EXPECT_EQ(terminal.ask("p0?"), "p0=200.00 kPa");
  device.setFault(DeviceFault::kHalfLine);
  EXPECT_TRUE(terminal.asksInVain("p0?"));
  device.setFault(DeviceFault::kNone);
  EXPECT_EQ(terminal.ask("p0?"), "p0=100p0=100.00 kPa");  // and what came of the half line before

  device.setFault(DeviceFault::kSilence);
  const std::uint64_t lines = device.taken();
  EXPECT_TRUE(terminal.asksInVain("p0=50.00"));
  EXPECT_EQ(device.taken(), lines);
  EXPECT_EQ(device.setPoint()[0], 1e5);
  device.setFault(DeviceFault::kSlow);
  const double asked = regulator::steadyNow();
  EXPECT_EQ(terminal.ask("p0?"), "p0=100.00 kPa");
  EXPECT_GT(regulator::steadyNow() - asked, profile.timeout);
  constexpr int kOwed = 100;
  const std::uint64_t asked_before = device.taken();
  for (int i = 0; i < kOwed; ++i) terminal.say("p0?");
  ASSERT_TRUE(eventually([&] { return device.taken() == asked_before + kOwed; }));
  device.setFault(DeviceFault::kNone);  // else it would be busy with them for much longer
  int heard = 0;
  EXPECT_TRUE(eventually([&] {
    heard += terminal.hear(kSilence) == "p0=100.00 kPa" ? 1 : 0;
    return heard == kOwed;
  })) << heard;
  device.setFault(DeviceFault::kGarbage);
  terminal.say("p0?");
  EXPECT_NE(terminal.hear(), "p0=100.00 kPa");
}

TEST(SerialDevice, ARestartHangsUpAndComesBackVentedBehindTheSameLink) {
  const Linked at;
  {
    EmulatedDevice device(at.config);
    EXPECT_EQ(device.path(), at.link);
    Terminal before(device, "\n");
    before.ask("p0=200.00");
    ASSERT_TRUE(eventually([&] { return device.pressure()[0] > 1.9e5; }));
    device.setFault(DeviceFault::kRestart);
    ASSERT_TRUE(eventually([&] { return device.restarts() == 1; }));
    EXPECT_EQ(device.fault(), DeviceFault::kNone);
    EXPECT_THROW(before.ask("p0?"), regulator::LinkError);
    EXPECT_TRUE(eventually([&] { return device.pressure()[0] < 1e3; }));
    Terminal after(device, "\n");
    EXPECT_EQ(after.ask("p0?").substr(0, 3), "p0=");
  }
  EXPECT_FALSE(std::filesystem::is_symlink(at.link));
}

TEST(SerialDevice, ARestartWaitsUntilItsLinkHasAPlace) {
  const Linked at;
  EmulatedDevice device(at.config);
  std::filesystem::remove(at.link);
  std::ofstream(at.link) << "precious";
  device.setFault(DeviceFault::kRestart);
  EXPECT_FALSE(eventually([&] { return device.restarts() > 0; }, kSilence));
  std::filesystem::remove(at.link);
  ASSERT_TRUE(eventually([&] { return device.restarts() == 1; }));
  Terminal terminal(device, "\n");
  EXPECT_EQ(terminal.ask("p0?"), "p0=0.00 kPa");
}

TEST(SerialDevice, OnlyALinkIsReplacedByTheLink) {
  const test::TemporaryFolder folder;
  const auto configAt = [](const std::string& link) {
    return configOf(test::genericProfile(), {"0"}, 1, link);
  };
  const std::string file = folder / "file", stale = folder / "stale";
  std::ofstream(file) << "precious";
  EXPECT_EQ(refusal<std::runtime_error>([&] { EmulatedDevice device(configAt(file)); }),
            file + " exists and is not a symlink; expected a path where one can be created");
  std::filesystem::create_symlink("/dev/pts/nowhere", stale);
  const EmulatedDevice device(configAt(stale));
  Terminal terminal(device, "\n");
  EXPECT_EQ(terminal.ask("p0?"), "p0=0.00 kPa");
}

TEST(SerialDevice, TheLinkOfAnotherIsLeftToIt) {
  const Linked at;
  {
    EmulatedDevice first(at.config);
    const std::string terminal = std::filesystem::read_symlink(at.link);
    EXPECT_EQ(refusal<std::runtime_error>([&] { EmulatedDevice second(at.config); }),
              at.link + " points to " + terminal +
                  ", which is in use; end the program that made it, or remove the link");
    EXPECT_EQ(std::filesystem::read_symlink(at.link), terminal);
    Terminal user(first, "\n");
    EXPECT_EQ(user.ask("p0?"), "p0=0.00 kPa");
    // A removed link of its own is free: the first device returns behind it.
    first.setFault(DeviceFault::kRestart);
    EXPECT_TRUE(eventually([&] { return first.restarts() == 1; }));
  }
  EXPECT_FALSE(std::filesystem::is_symlink(at.link));
  const EmulatedDevice later(at.config);
  EXPECT_TRUE(std::filesystem::is_symlink(at.link));
}

TEST(DeviceFault, EveryNameIsItsOwnAndIsUnderstood) {
  std::set<std::string> names;
  for (int i = 0; i < kDeviceFaultCount; ++i) {
    const auto fault = static_cast<DeviceFault>(i);
    names.insert(nameOf(fault));
    EXPECT_EQ(parseDeviceFault(nameOf(fault)), fault);
  }
  EXPECT_EQ(names.size(), static_cast<std::size_t>(kDeviceFaultCount));
  EXPECT_EQ(names.count("half_line"), 1u);
  EXPECT_FALSE(parseDeviceFault("halfline"));
}

}  // namespace
}  // namespace helix_arm::simulation
