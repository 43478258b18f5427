#include <cmath>

#include <gtest/gtest.h>

#include "regulator/tcp_link.hpp"
#include "support/eventually.hpp"
#include "support/modbus_profiles.hpp"
#include "support/raw_modbus.hpp"
#include "support/refusal.hpp"

namespace helix_arm::regulator {
namespace {

using control::Valve;
using control::ValveOrders;
using simulation::EmulatedDevice;
using simulation::ModbusDeviceConfig;
using test::eventually;
using test::mpaProfile;
using test::quietDevice;
using test::RawModbus;
using test::refusal;
using test::vtemProfile;
using Words = RawModbus::Words;

ModbusConfig configOf(const ModbusProfile& profile, int port, std::vector<int> places) {
  return {profile, "127.0.0.1", port, std::move(places)};
}

ValveOrders regulate(const std::vector<double>& set_points) {
  ValveOrders orders(static_cast<int>(set_points.size()));
  for (std::size_t i = 0; i < set_points.size(); ++i) {
    orders.valve[i] = Valve::kRegulate;
    orders.set_point[static_cast<Eigen::Index>(i)] = set_points[i];
  }
  return orders;
}

Eigen::VectorXd readingOf(const std::unique_ptr<Driver>& driver, int channels) {
  Pressures pressures(channels);
  driver->read(pressures);
  return pressures.pressure;
}

void expectHas(const std::string& text, const std::vector<std::string>& parts) {
  for (const std::string& part : parts) {
    EXPECT_NE(text.find(part), std::string::npos) << text << "\nlacks: " << part;
  }
}

// A quiet device and a driver that is connected.
struct Connected {
  Connected(const ModbusProfile& profile, int channels, std::vector<int> places)
      : device(quietDevice(profile, channels)),
        driver(modbusTcpDriver(configOf(profile, device.port(), std::move(places)))) {
    driver->connect();
  }
  EmulatedDevice device;
  std::unique_ptr<Driver> driver;
};

// Set points of 100, 25.7 and 699.95 kPa are 1000, 257 and 6999.5 mbar.
TEST(ModbusTcpDriver, VtemHasACommandAndTwoSetPointsASlot) {
  Connected at(vtemProfile(), 6, {0, 1, 4});
  const RawModbus raw(at.device.port());
  EXPECT_EQ(raw.read(40003, 9), (Words{195, 0, 0, 0, 0, 0, 195, 0, 0}));
  at.driver->write(regulate({1e5, 25.7e3, 699.95e3}));
  EXPECT_EQ(raw.read(40003, 9), (Words{195, 1000, 257, 0, 0, 0, 195, 6999, 0}));
  at.driver->vent();
  EXPECT_EQ(raw.read(40003, 9), (Words{195, 0, 0, 0, 0, 0, 195, 0, 0}));
}

TEST(ModbusTcpDriver, MpaHasOneSetPointARegulator) {
  Connected at(mpaProfile(), 4, {3, 0});
  at.driver->write(regulate({1e5, 25.7e3}));
  const RawModbus raw(at.device.port());
  EXPECT_EQ(raw.read(40003, 4), (Words{257, 0, 0, 1000}));
  at.driver->vent();
  EXPECT_EQ(raw.read(40003, 4), (Words{0, 0, 0, 0}));
}

TEST(ModbusTcpDriver, ReadsWhatTheDeviceReachesInTheArmsOrder) {
  for (const ModbusProfile& profile : {vtemProfile(), mpaProfile()}) {
    Connected at(profile, 6, {5, 0, 2});
    at.driver->write(regulate({3e5, 1e5, 2e5}));
    // The lag of 0.01 s leaves less than half a count after 20 of it.
    ASSERT_TRUE(eventually([&] { return std::abs(at.device.pressure()[5] - 3e5) < 1e-3; }));
    EXPECT_EQ(readingOf(at.driver, 3), Eigen::Vector3d(3e5, 1e5, 2e5)) << profile.name;
  }
}

TEST(ModbusTcpDriver, ConnectingVentsWhatAnotherLeftBehind) {
  for (const ModbusProfile& profile : {vtemProfile(), mpaProfile()}) {
    Connected at(profile, 4, {0, 1, 2, 3});
    const EmulatedDevice& device = at.device;
    at.driver->write(regulate({3e5, 3e5, 3e5, 3e5}));
    ASSERT_TRUE(eventually([&] { return device.pressure().minCoeff() > 2.9e5; }));
    // Of a slot that it uses, the outlet as well that it does not.
    const auto second = modbusTcpDriver(configOf(profile, device.port(), {0, 2}));
    second->ignoreOthers();  // as a program on another machine does, which sees no lock
    second->connect();
    const int used = profile.outlets == 2 ? 1 : 0;
    EXPECT_TRUE(
        eventually([&] { return device.pressure()[0] < 1e3 && device.pressure()[2] < 1e3; }));
    EXPECT_EQ(device.setPoint()[1], used == 1 ? 0 : 3e5) << profile.name;
  }
}

TEST(ModbusTcpDriver, SlotsOfOthersAreNotTouched) {
  Connected at(vtemProfile(), 6, {0, 4});
  const RawModbus raw(at.device.port());
  ASSERT_TRUE(raw.write(40006, {126, 0, 0}));
  ASSERT_TRUE(raw.write(40006, {195, 1234, 567}));
  at.driver->connect();
  at.driver->write(regulate({1e5, 1e5}));
  at.driver->vent();
  EXPECT_EQ(raw.read(40006, 3), (Words{195, 1234, 567}));
}

TEST(ModbusTcpDriver, CountsAreRoundedDownAndStayInTheDevicesRange) {
  Connected at(mpaProfile(), 6, {0, 1, 2, 3, 4, 5});
  at.driver->write(regulate({-5e4, 1e9, 99.999e3, 100e3, 0.1 * 3 * 1e3, -0.0}));
  const RawModbus raw(at.device.port());
  EXPECT_EQ(raw.read(40003, 6), (Words{0, 10000, 999, 1000, 3, 0}));
}

TEST(ModbusTcpDriver, AbsoluteDevicesAreGaugeAbove) {
  ModbusProfile profile = mpaProfile();
  profile.atmosphere = 101.3e3;
  Connected at(profile, 1, {0});
  at.driver->write(regulate({1e5}));
  EXPECT_EQ(RawModbus(at.device.port()).read(40003, 1), (Words{2013}));
  ASSERT_TRUE(eventually([&] { return std::abs(at.device.pressure()[0] - 1e5) < 1e-3; }));
  EXPECT_NEAR(readingOf(at.driver, 1)[0], 1e5, 1e-6);
}

TEST(ModbusTcpDriver, TheSupplyIsReadIfTheProfileHasIt) {
  ModbusProfile profile = mpaProfile();
  profile.supply = 45390;
  ModbusDeviceConfig config = quietDevice(profile, 2);
  config.regulator.supply_pressure = 6.1e5;
  EmulatedDevice device(config);
  const auto driver = modbusTcpDriver(configOf(profile, device.port(), {0, 1}));
  driver->connect();
  Pressures pressures(2);
  driver->read(pressures);
  EXPECT_EQ(pressures.supply, 6.1e5);
}

TEST(ModbusTcpDriver, InputRegistersAreReadByTheirOwnFunction) {
  ModbusProfile profile = mpaProfile();
  profile.input_registers = true;
  profile.input_base = 0;
  Connected at(profile, 2, {0, 1});
  at.driver->write(regulate({1e5, 2e5}));
  ASSERT_TRUE(eventually([&] { return std::abs(at.device.pressure()[1] - 2e5) < 1e-3; }));
  EXPECT_EQ(readingOf(at.driver, 2), Eigen::Vector2d(1e5, 2e5));
}

// 125 registers a request to read, 123 a request to write: 300 set points are 3 requests.
TEST(ModbusTcpDriver, ManyChannelsGoInPieces) {
  constexpr int kChannels = 300;
  std::vector<int> places(kChannels);
  std::vector<double> set_points(kChannels);
  for (int i = 0; i < kChannels; ++i) {
    places[static_cast<std::size_t>(i)] = kChannels - 1 - i;
    set_points[static_cast<std::size_t>(i)] = 1e3 * i;
  }
  Connected at(mpaProfile(), kChannels, places);
  const std::uint64_t before = at.device.taken();
  at.driver->write(regulate(set_points));
  EXPECT_EQ(at.device.taken(), before + 3);
  ASSERT_TRUE(eventually([&] { return std::abs(at.device.pressure()[0] - 299e3) < 1e-3; }));
  const Eigen::VectorXd reading = readingOf(at.driver, kChannels);
  for (int i = 0; i < kChannels; ++i) EXPECT_EQ(reading[i], 1e3 * i) << i;
  // Of slots with a command each, those that follow each other.
  Connected apps(vtemProfile(), 8, {0, 1, 2, 3, 4, 5, 6, 7});
  const std::uint64_t taken = apps.device.taken();
  apps.driver->write(regulate(std::vector<double>(8, 1e5)));
  EXPECT_EQ(apps.device.taken(), taken + 1);
}

TEST(ModbusTcpDriver, AppsAreAcknowledgedAndStartedVentedAndASlotThatDoesNotGetReadyIsNamed) {
  EmulatedDevice device(quietDevice(vtemProfile(), 6));
  EXPECT_EQ(device.valves(), std::vector<Valve>(6, Valve::kClose));
  device.jam(2, true);
  const auto driver = modbusTcpDriver(configOf(vtemProfile(), device.port(), {0, 4}));
  const std::string error = refusal<LinkError>([&] { driver->connect(); });
  expectHas(error, {"127.0.0.1:" + std::to_string(device.port()), "slot 2 of festo_vtem",
                    "does not get ready within 0.3 s", "expected 0x007d"});
  EXPECT_EQ(refusal<LinkError>([&] { readingOf(driver, 2); }).find("slot"), std::string::npos);
  EXPECT_TRUE(eventually([&] { return device.connections() == 0; }));
  device.jam(2, false);
  driver->connect();
  EXPECT_EQ(device.valves()[0], Valve::kVent);
  EXPECT_EQ(device.valves()[4], Valve::kVent);
}

TEST(ModbusTcpDriver, ASlotThatDoesNotStartIsNamed) {
  ModbusDeviceConfig config = quietDevice(vtemProfile(), 2);
  config.activation_time = 1e6;
  EmulatedDevice device(config);
  const auto driver = modbusTcpDriver(configOf(vtemProfile(), device.port(), {0, 1}));
  expectHas(refusal<LinkError>([&] { driver->connect(); }),
            {"slot 0 of festo_vtem does not start regulating within 0.3 s",
             "its status is 0x007d, expected 0x0083"});
}

TEST(ModbusTcpDriver, ASlotThatStopsBreaksTheLink) {
  Connected at(vtemProfile(), 4, {0, 2});
  at.driver->write(regulate({1e5, 1e5}));
  readingOf(at.driver, 2);
  at.device.jam(1, true);
  std::string error;
  ASSERT_TRUE(eventually([&] {
    error = refusal<LinkError>([&] { readingOf(at.driver, 2); });
    return error != "accepted";
  }));
  expectHas(error, {"slot 1 of festo_vtem has stopped regulating", "expected 0x0083"});
  expectHas(refusal<LinkError>([&] { at.driver->vent(); }), {"there is no link"});
}

TEST(ModbusTcpDriver, ASlotClosesWhereAllItsChannelsDo) {
  Connected at(vtemProfile(), 4, {0, 1, 2, 3});
  at.driver->write(regulate({1e5, 1e5, 1e5, 1e5}));
  ASSERT_TRUE(eventually([&] { return at.device.pressure().minCoeff() > 0.99e5; }));
  ValveOrders orders = regulate({1e5, 1e5, 1e5, 1e5});
  orders.valve[0] = orders.valve[1] = orders.valve[2] = Valve::kClose;
  at.driver->write(orders);
  EXPECT_EQ(at.device.valves(),
            (std::vector<Valve>{Valve::kClose, Valve::kClose, Valve::kVent, Valve::kRegulate}));
  ASSERT_TRUE(eventually([&] { return at.device.pressure()[2] < 1e3; }));
  EXPECT_GT(at.device.pressure()[0], 0.98e5);
  EXPECT_NO_THROW(readingOf(at.driver, 4));  // an app that was told to end is no fault
  at.driver->vent();
  EXPECT_TRUE(eventually([&] { return at.device.pressure().maxCoeff() < 1e3; }));
  EXPECT_NO_THROW(readingOf(at.driver, 4));
}

TEST(ModbusTcpDriver, WithoutAppsChannelsThatAreToCloseVent) {
  Connected at(mpaProfile(), 2, {0, 1});
  ValveOrders orders = regulate({1e5, 1e5});
  orders.valve[0] = Valve::kClose;
  at.driver->write(orders);
  EXPECT_EQ(at.device.setPoint(), Eigen::Vector2d(0, 1e5));
}

TEST(ModbusTcpDriver, PlacesThatTheDeviceCannotHaveAreRefused) {
  const auto said = [](const ModbusProfile& profile, std::vector<int> places) {
    return refusal<std::invalid_argument>(
        [&] { modbusTcpDriver(configOf(profile, 502, std::move(places))); });
  };
  expectHas(said(mpaProfile(), {}), {"festo_mpa", "there are no slots; expected one per channel"});
  expectHas(said(mpaProfile(), {-1}), {"slot is -1; expected a number >= 0"});
  expectHas(said(vtemProfile(), {0, 1, 0}), {"slot is 0; expected distinct slots"});
  expectHas(said(mpaProfile(), {7000}), {"slot is 7000; expected one whose registers are below"});
  ModbusProfile broken = mpaProfile();
  broken.pascals = 0;
  expectHas(said(broken, {0}), {"profile festo_mpa: count_pa is 0"});
}

// The sixteenth outlet is the second one of the eighth slot.
TEST(ModbusProfile, PlacesCountTheOutletsOfAllSlots) {
  const ModbusProfile vtem = vtemProfile();
  EXPECT_EQ(vtem.slot(15), 7);
  EXPECT_EQ(vtem.command(7), 40024);
  EXPECT_EQ(vtem.setPoint(14), 40025);
  EXPECT_EQ(vtem.setPoint(15), 40026);
  EXPECT_EQ(vtem.status(7), 45416);
  EXPECT_EQ(vtem.reading(15), 45418);
  const ModbusProfile mpa = mpaProfile();
  EXPECT_EQ(mpa.setPoint(3), 40006);
  EXPECT_EQ(mpa.reading(3), 45404);
}

// What a file may break as well: test/io/broken_rules.txt.
TEST(ModbusProfile, EachRuleThatAFileCannotBreakIsNamedWithItsValue) {
  const struct {
    std::function<void(ModbusProfile&)> breaks;
    const char* said;
  } kRules[] = {
      {[](auto& p) { p.unit_id = 256; }, "unit_id is 256; expected 0 to 255"},
      {[](auto& p) { p.unit_id = -1; }, "unit_id is -1; expected 0 to 255"},
      {[](auto& p) { p.pascals = 0; }, "count_pa is 0; expected 0.001 to 1e+06"},
      {[](auto& p) { p.pascals = std::stod("nan"); }, "count_pa is nan"},
      {[](auto& p) { p.atmosphere = -1e3; }, "atmosphere_kpa is -1; expected 0 to 200"},
      {[](auto& p) { p.highest_count = 0; }, "highest_count is 0; expected 1 to 32767"},
      {[](auto& p) { p.highest_count = 32768; }, "highest_count is 32768"},
      {[](auto& p) { p.outlets = 0; }, "outlets is 0; expected 1 to 64"},
      {[](auto& p) { p.output_base = 65536; }, "outputs.first is 65536; expected 0 to 65535"},
      {[](auto& p) { p.output_stride = 0; }, "outputs.stride is 0; expected 1 to 1024"},
      {[](auto& p) { p.input_base = -1; }, "inputs.first is -1; expected 0 to 65535"},
      {[](auto& p) { p.input_stride = 1025; }, "inputs.stride is 1025; expected 1 to 1024"},
      {[](auto& p) { p.input_pressure = -1; }, "inputs.pressure is -1; expected 0 to 2"},
      {[](auto& p) { p.supply = 70000; }, "supply is 70000; expected 0 to 65535"},
      {[](auto& p) { p.timeout = 0; }, "timeout_s is 0; expected 0.001 to 10"},
      {[](auto& p) { p.app->command = 3; }, "app.command is 3; expected 0 to 2"},
      {[](auto& p) { p.app->regulate = 65536; }, "app.regulate is 65536; expected 0 to 65535"},
      {[](auto& p) { p.app->off = -1; }, "app.off is -1; expected 0 to 65535"},
      {[](auto& p) { p.app->acknowledge = 1 << 16; }, "app.acknowledge is 65536"},
      {[](auto& p) { p.app->status_mask = 0; }, "app.status_mask is 0; expected 1 to 65535"},
      {[](auto& p) { p.app->activation_time = 0; },
       "app.activation_time_s is 0; expected 0.01 to 60"},
  };
  EXPECT_NO_THROW(vtemProfile().validate());
  EXPECT_NO_THROW(mpaProfile().validate());
  EXPECT_NO_THROW(ModbusProfile().validate());
  for (const auto& rule : kRules) {
    ModbusProfile profile = vtemProfile();
    rule.breaks(profile);
    const std::string said = refusal([&profile] { profile.validate(); });
    EXPECT_EQ(said.find(std::string("profile festo_vtem: ") + rule.said), 0u)
        << said << "\nexpected " << rule.said;
  }
}

}  // namespace
}  // namespace helix_arm::regulator
