// Emulated devices against a bare line or connection, without a driver.

#include "simulation/emulated_device.hpp"

#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <unistd.h>

#include "regulator/line_format.hpp"
#include "regulator/regulator_io.hpp"
#include "regulator/serial_port.hpp"
#include "support/eventually.hpp"
#include "support/modbus_profiles.hpp"
#include "support/raw_modbus.hpp"
#include "support/refusal.hpp"
#include "support/serial_profiles.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::simulation {
namespace {

using control::Valve;
using namespace regulator;
using namespace test;

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
  terminal.ask("p0=29.01");
  EXPECT_NEAR(device.setPoint()[0], 2e5, 35);
  device.setFault(DeviceFault::kNone);
  terminal.ask("p0=200.00");
  ASSERT_TRUE(eventually([&] { return std::abs(device.pressure()[0] - 2e5) < 1; }));
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

// ---- Devices on Modbus --------------------------------------------------------------------------

using Words = RawModbus::Words;

// Valves, clock and times are the same on every line.
TEST(ModbusDevice, MpaGoesToItsSetPointsByTheLagOfItsRegulator) {
  EmulatedDeviceConfig config = quietDevice(mpaProfile(), 2);
  config.valves.time_constant = 0.3;
  EmulatedDevice device(config);
  const RawModbus raw(device.port());
  EXPECT_EQ(raw.read(45395, 6), (Words{0, 0, 0, 0, 0, 0}));
  ASSERT_TRUE(raw.write(40003, {2000, 500}));
  const double begin = device.lastSetTime();
  const double before = regulator::steadyNow();
  const Eigen::VectorXd pressure = device.pressure();
  const double after = regulator::steadyNow();
  EXPECT_GE(pressure[0], 2e5 * -std::expm1(-(before - begin) / 0.3) - 1e-6);
  EXPECT_LE(pressure[0], 2e5 * -std::expm1(-(after - begin) / 0.3) + 1e-6);
  EXPECT_NEAR(pressure[1], pressure[0] / 4, 1e-6);
  ASSERT_TRUE(eventually([&] { return std::abs(device.pressure()[0] - 2e5) < 1; }));
  EXPECT_EQ(raw.read(45395, 6), (Words{2000, 0, 0, 500, 0, 0}));
  EXPECT_EQ(device.setPoint(), Eigen::Vector2d(2e5, 5e4));
  EXPECT_EQ(device.valves(), (std::vector<Valve>{Valve::kRegulate, Valve::kRegulate}));
}

TEST(ModbusDevice, VtemRegulatesOnceAcknowledgedAndTold) {
  EmulatedDevice device(quietDevice(vtemProfile(), 2));
  const RawModbus raw(device.port());
  const auto status = [&raw] { return raw.read(45395, 1).at(0); };
  EXPECT_NE(status(), 125);
  ASSERT_TRUE(raw.write(40003, {195, 1000, 500}));  // not acknowledged
  EXPECT_NE(status(), 125);
  EXPECT_EQ(device.valves()[0], Valve::kClose);
  ASSERT_TRUE(raw.write(40003, {126, 0, 0}));
  EXPECT_EQ(status(), 125);
  ASSERT_TRUE(raw.write(40003, {195, 1000, 500}));
  ASSERT_TRUE(eventually([&] { return status() == 131; }));
  ASSERT_TRUE(eventually([&] { return std::abs(device.pressure()[0] - 1e5) < 1; }));
  EXPECT_EQ(raw.read(45395, 3), (Words{131, 1000, 500}));
  ASSERT_TRUE(raw.write(40003, {61, 0, 0}));  // its app ends, its air stays
  EXPECT_EQ(status(), 125);
  EXPECT_EQ(device.valves(), (std::vector<Valve>{Valve::kClose, Valve::kClose}));
  const double kept = device.pressure()[0];
  std::this_thread::sleep_for(std::chrono::milliseconds(60));
  EXPECT_NEAR(device.pressure()[0], kept, 1e-3);
  EXPECT_GT(kept, 0.99e5);
}

// config/regulators/festo_vtem.yaml: what the device does when the link is lost.
TEST(ModbusDevice, VtemEndsItsAppsAndKeepsItsAirWithoutAConnection) {
  for (const bool device_closes : {false, true}) {
    EmulatedDevice device(quietDevice(vtemProfile(), 4));
    auto first = std::make_unique<RawModbus>(device.port());
    auto second = std::make_unique<RawModbus>(device.port());
    ASSERT_TRUE(first->write(40003, {126, 0, 0}));
    ASSERT_TRUE(first->write(40003, {195, 1000, 500}));
    ASSERT_TRUE(eventually([&] { return std::abs(device.pressure()[0] - 1e5) < 1; }));
    first.reset();
    ASSERT_TRUE(eventually([&] { return device.connections() == 1; }));
    EXPECT_EQ(second->read(45395, 1), (Words{131}));  // somebody is there yet
    EXPECT_EQ(device.valves()[0], Valve::kRegulate);
    if (device_closes) {
      device.setFault(DeviceFault::kSilence);
      device.setFault(DeviceFault::kNone);
    } else {
      second.reset();
    }
    ASSERT_TRUE(eventually([&] { return device.connections() == 0; }));
    ASSERT_TRUE(
        eventually([&] { return device.valves() == std::vector<Valve>(4, Valve::kClose); }));
    EXPECT_EQ(device.setPoint().maxCoeff(), 0);
    const RawModbus next(device.port());
    EXPECT_EQ(next.read(40003, 3), (Words{0, 0, 0}));
    EXPECT_EQ(next.read(45395, 3), (Words{125, 1000, 500}));  // ready again, the air is in
    EXPECT_NE(next.read(45398, 1), (Words{125}));  // never acknowledged, not ready now either
    ASSERT_TRUE(next.write(40003, {195, 0, 0}));
    EXPECT_TRUE(eventually([&] { return device.pressure().maxCoeff() < 1e3; }));
  }
}

TEST(ModbusDevice, RegistersThatAreNotItsOwnAreRefused) {
  EmulatedDevice device(quietDevice(mpaProfile(), 2));
  const RawModbus raw(device.port());
  EXPECT_TRUE(raw.read(40002, 1).empty());
  EXPECT_TRUE(raw.read(40003, 3).empty());
  EXPECT_TRUE(raw.read(45394, 2).empty());
  EXPECT_TRUE(raw.readInputs(45395, 1).empty());
  EXPECT_FALSE(raw.write(40005, {1}));
  EXPECT_FALSE(raw.write(45395, {1}));
  EXPECT_EQ(device.taken(), 0u);
  EXPECT_TRUE(std::isinf(device.lastSetTime()));
  EXPECT_EQ(raw.read(40003, 2), (Words{0, 0}));  // and it is still there
}

}  // namespace
}  // namespace helix_arm::simulation
