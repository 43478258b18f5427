#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <set>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <unistd.h>

#include "helix_arm/regulator/regulator_io.hpp"
#include "helix_arm/simulation/emulated_device.hpp"
#include "support/eventually.hpp"
#include "support/modbus_profiles.hpp"
#include "support/raw_modbus.hpp"

namespace helix_arm::simulation {
namespace {

using control::Valve;
using namespace test;
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

TEST(ModbusDevice, ServesSeveralAtOnce) {
  EmulatedDevice device(quietDevice(mpaProfile(), 1));
  std::vector<std::unique_ptr<RawModbus>> clients;
  for (int i = 0; i < 5; ++i) clients.push_back(std::make_unique<RawModbus>(device.port()));
  for (int round = 0; round < 3; ++round) {
    for (std::size_t i = 0; i < clients.size(); ++i) {
      const auto count = static_cast<std::uint16_t>(100 * (i + 1));
      ASSERT_TRUE(clients[i]->write(40003, {count}));
      EXPECT_EQ(clients[(i + 1) % clients.size()]->read(40003, 1), (Words{count}));
    }
  }
  EXPECT_EQ(device.connections(), 5);
  EXPECT_EQ(device.taken(), 15u);
  clients.resize(2);
  EXPECT_TRUE(eventually([&] { return device.connections() == 2; }));
}

TEST(ModbusDevice, ItsNoiseIsThatOfItsRegulator) {
  EmulatedDeviceConfig config = quietDevice(mpaProfile(), 1);
  config.valves.noise = 5e3;
  EmulatedDevice device(config);
  const RawModbus raw(device.port());
  std::set<std::uint16_t> seen;
  for (int i = 0; i < 50; ++i) seen.insert(raw.read(45395, 1).at(0));
  EXPECT_GT(seen.size(), 10u);
  EXPECT_TRUE(std::any_of(seen.begin(), seen.end(), [](int word) { return word > 0x7fff; }));
}

TEST(ModbusDevice, ASilentDeviceAcceptsNothing) {
  EmulatedDevice device(quietDevice(mpaProfile(), 1));
  const RawModbus raw(device.port());
  ASSERT_TRUE(raw.write(40003, {1000}));
  device.setFault(DeviceFault::kSilence);
  ASSERT_TRUE(raw.order(40003, 3000));
  ASSERT_TRUE(eventually([&raw] { return raw.delivered(); }));
  device.setFault(DeviceFault::kNone);
  EXPECT_TRUE(eventually([&] { return device.connections() == 0; }));
  EXPECT_EQ(device.setPoint()[0], 1e5);
  EXPECT_EQ(RawModbus(device.port()).read(40003, 1), (Words{1000}));
}

TEST(ModbusDevice, ARestartWaitsUntilItsPortIsFree) {
  EmulatedDevice device(quietDevice(mpaProfile(), 1));
  std::unique_ptr<modbus_t, void (*)(modbus_t*)> thief(modbus_new_tcp("127.0.0.1", device.port()),
                                                       modbus_free);
  int listener = -1;
  ASSERT_TRUE(eventually([&] {
    device.setFault(DeviceFault::kRestart);
    listener = modbus_tcp_listen(thief.get(), 1);
    return listener >= 0;
  }));
  std::this_thread::sleep_for(std::chrono::milliseconds(200));  // it has tried in vain by now
  EXPECT_EQ(device.fault(), DeviceFault::kRestart);
  close(listener);
  ASSERT_TRUE(eventually([&] { return device.fault() == DeviceFault::kNone; }));
  EXPECT_EQ(RawModbus(device.port()).read(40003, 1), (Words{0}));
}

}  // namespace
}  // namespace helix_arm::simulation
