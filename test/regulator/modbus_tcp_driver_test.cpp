#include <cerrno>
#include <cmath>

#include <gtest/gtest.h>

#include "modbus/modbus.h"
#include "support/end_of.hpp"
#include "support/eventually.hpp"
#include "support/has.hpp"
#include "support/modbus_profiles.hpp"
#include "support/refusal.hpp"
#include "support/reply_server.hpp"

namespace helix_arm::regulator {
namespace {

using control::Valve;
using control::ValveOrders;
using namespace simulation;
using namespace test;
using Bytes = ReplyServer::Bytes;

// A bare client of a Modbus server on 127.0.0.1: registers as they are on the wire.
class RawModbus {
 public:
  using Words = std::vector<std::uint16_t>;

  explicit RawModbus(int port) : context_(modbus_new_tcp("127.0.0.1", port), modbus_free) {
    modbus_set_response_timeout(context_.get(), 5, 0);
    if (modbus_connect(context_.get()) != 0) throw std::runtime_error(modbus_strerror(errno));
  }
  ~RawModbus() { modbus_close(context_.get()); }
  RawModbus(const RawModbus&) = delete;
  RawModbus& operator=(const RawModbus&) = delete;

  // Holding registers; empty where they are refused.
  Words read(int first, int count) const {
    Words words(static_cast<std::size_t>(count));
    if (modbus_read_registers(context_.get(), first, count, words.data()) != count) return {};
    return words;
  }
  bool write(int first, const Words& words) const {
    const auto count = static_cast<int>(words.size());
    return modbus_write_registers(context_.get(), first, count, words.data()) == count;
  }

 private:
  std::unique_ptr<modbus_t, void (*)(modbus_t*)> context_;
};

using Words = RawModbus::Words;

std::unique_ptr<Driver> driverOf(const ModbusProfile& profile, int port, std::vector<int> places) {
  const auto channels = static_cast<int>(places.size());
  return ModbusConfig{profile, "127.0.0.1", port, std::move(places)}.makeDriver(channels);
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
        driver(driverOf(profile, device.port(), std::move(places))) {
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

// It has one set point a regulator and no valves: what is to close vents.
TEST(ModbusTcpDriver, MpaRegulatesVentsAndClosesByItsSetPoints) {
  Connected at(mpaProfile(), 4, {3, 0});
  ValveOrders orders = regulate({1e5, 25.7e3});
  at.driver->write(orders);
  const RawModbus raw(at.device.port());
  EXPECT_EQ(raw.read(40003, 4), (Words{257, 0, 0, 1000}));
  orders.valve[0] = Valve::kClose;
  at.driver->write(orders);
  EXPECT_EQ(raw.read(40003, 4), (Words{257, 0, 0, 0}));
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
    const auto second = driverOf(profile, device.port(), {0, 2});
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

TEST(ModbusTcpDriver, AppsAreAcknowledgedAndStartedVentedAndASlotThatDoesNotGetReadyIsNamed) {
  EmulatedDevice device(quietDevice(vtemProfile(), 6));
  EXPECT_EQ(device.valves(), std::vector<Valve>(6, Valve::kClose));
  device.jam(2, true);
  const auto driver = driverOf(vtemProfile(), device.port(), {0, 4});
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

TEST(ModbusLink, ALateDeviceReceivesTheVentAndEmptiesWhileTheLinkIsHeld) {
  for (const ModbusProfile& profile : {vtemProfile(), mpaProfile()}) {
    Connected at(profile, 3, {0, 1, 2});
    at.driver->write(regulate({1e5, 1e5, 1e5}));
    ASSERT_TRUE(eventually([&] { return at.device.pressure()[2] > 0.99e5; }));
    at.device.setFault(DeviceFault::kSlow);
    EXPECT_EQ(endOf([&] { readingOf(at.driver, 3); }), End::kLinkError);
    EXPECT_NE(endOf([&] { at.driver->vent(); }), End::kDone);
    EXPECT_EQ(at.driver->keepsAirOnClose(), profile.app.has_value());
    EXPECT_TRUE(eventually([&] { return at.device.pressure().maxCoeff() < 100; }));
    EXPECT_EQ(endOf([&] { at.driver->write(regulate({1e5, 1e5, 1e5})); }), End::kLinkError);
    at.driver->close();
    EXPECT_FALSE(at.driver->keepsAirOnClose());
  }
}

std::string connectRefusal(const std::string& host, int port) {
  const auto driver = ModbusConfig{mpaProfile(), host, port, {0}}.makeDriver(1);
  return refusal<LinkError>([&driver] { driver->connect(); });
}

// A port of 127.0.0.1 with a queue of those who have not been accepted.
class Listener {
 public:
  explicit Listener(int backlog) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    address_.sin_family = AF_INET;
    address_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    auto* const generic = reinterpret_cast<sockaddr*>(&address_);
    socklen_t size = sizeof address_;
    EXPECT_EQ(bind(socket_, generic, size), 0);
    EXPECT_EQ(listen(socket_, backlog), 0);
    EXPECT_EQ(getsockname(socket_, generic, &size), 0);
  }
  ~Listener() { close(socket_); }
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  int socket() const { return socket_; }
  int port() const { return ntohs(address_.sin_port); }
  void join(int client) const {
    connect(client, reinterpret_cast<const sockaddr*>(&address_), sizeof address_);
  }

 private:
  const int socket_;
  sockaddr_in address_{};
};

// A listener with a full backlog: further connections are not answered.
TEST(ModbusConnecting, ADeviceThatDoesNotAnswerDoesNotHoldItUp) {
  const Listener listener(0);
  std::vector<int> queue;
  for (int i = 0; i < 4; ++i) {
    queue.push_back(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0));
    listener.join(queue.back());
  }
  std::string error;
  EXPECT_LT(secondsOf([&] { error = connectRefusal("127.0.0.1", listener.port()); }), kBounded);
  EXPECT_TRUE(has(error, "cannot connect: Connection timed out; check that it is switched on"));
  for (const int each : queue) close(each);
}

// The header of the request's reply with these bytes behind it.
Bytes framed(const Bytes& request, const Bytes& rest) {
  Bytes reply(request.begin(), request.begin() + 4);
  reply.push_back(0);
  reply.push_back(static_cast<std::uint8_t>(1 + rest.size()));
  reply.push_back(request[6]);
  reply.insert(reply.end(), rest.begin(), rest.end());
  return reply;
}

constexpr std::uint8_t kWrite = 16;

// Takes every write, and answers the request to read one register in its own way.
class Answered {
 public:
  explicit Answered(std::function<Bytes(const Bytes&)> answer)
      : server_([answer](const Bytes& request) {
          if (request[7] != kWrite) return answer(request);
          return framed(request, Bytes(request.begin() + 7, request.begin() + 12));
        }),
        driver_(driverOf(mpaProfile(), server_.port(), {0})) {
    driver_->connect();
  }
  double read() {
    Pressures pressures(1);
    driver_->read(pressures);
    return pressures.pressure[0];
  }

 private:
  ReplyServer server_;
  std::unique_ptr<Driver> driver_;
};

TEST(ModbusReplies, ARegisterIsANumberWithASign) {
  const auto reading = [](std::uint8_t high, std::uint8_t low) {
    return Answered([=](const Bytes& request) {
             return framed(request, {3, 2, high, low});
           })
        .read();
  };
  EXPECT_EQ(reading(0x03, 0xe8), 100e3);
  EXPECT_EQ(reading(0xff, 0x9c), -10e3);
  EXPECT_EQ(reading(0x7f, 0xff), 3276.7e3);
  EXPECT_TRUE(std::isnan(reading(0x80, 0x00)));
}

TEST(ModbusReplies, AnExceptionIsABadReplyAndTheLinkLives) {
  int asked = 0;
  Answered device([&asked](const Bytes& request) {
    return ++asked == 1 ? framed(request, {0x83, 2}) : framed(request, {3, 2, 0, 10});
  });
  const std::string error = refusal<BadReply>([&] { device.read(); });
  EXPECT_TRUE(has(error, "festo_mpa gives no readings: Illegal data address; check the registers"));
  EXPECT_EQ(device.read(), 1e3);
}

TEST(ModbusReplies, ThoseOfAnotherNumberOfRegistersOrToAnotherRequestAreBad) {
  for (const Bytes& rest : {Bytes{3, 4, 0, 10, 0, 10}, {3, 0}, {3, 2, 0, 10}}) {
    Answered device([&](const Bytes& request) {
      Bytes reply = framed(request, rest);
      if (rest.size() == 4) reply[1] ^= 1;  // the number of the request
      return reply;
    });
    EXPECT_EQ(endOf([&] { device.read(); }), End::kBadReply) << rest.size();
  }
}

TEST(ModbusReplies, WhatFollowsAReplyIsNotTakenForTheNextOne) {
  int asked = 0;
  Answered device([&asked](const Bytes& request) {
    Bytes reply = framed(request, {3, 2, 0, 10});
    if (++asked == 1) {
      reply[7] = 4;  // another function
      const Bytes more = framed(request, {3, 2, 0, 99});
      reply.insert(reply.end(), more.begin(), more.end());
    }
    return reply;
  });
  EXPECT_EQ(endOf([&] { device.read(); }), End::kBadReply);
  EXPECT_EQ(device.read(), 1e3);
}

}  // namespace
}  // namespace helix_arm::regulator
