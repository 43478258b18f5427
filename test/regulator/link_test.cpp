// What befalls a link, and how long a call takes at most.
#include <cmath>

#include <gtest/gtest.h>

#include "regulator/tcp_link.hpp"
#include "support/eventually.hpp"
#include "support/has.hpp"
#include "support/modbus_profiles.hpp"
#include "support/process.hpp"
#include "support/refusal.hpp"
#include "support/reply_server.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::regulator {
namespace {

using simulation::DeviceFault;
using simulation::EmulatedDevice;
using test::eventually;
using test::mpaProfile;
using test::quietDevice;
using test::refusal;
using test::ReplyServer;
using test::vtemProfile;
using Bytes = ReplyServer::Bytes;

// Far above the timeout, and far below what would hold up a thread for good [s].
constexpr double kBounded = 10 * test::kPatience;

ModbusConfig configOf(const ModbusProfile& profile, int port) {
  return {profile, "127.0.0.1", port, {0, 1, 2}};
}

control::ValveOrders regulate(double pressure) {
  control::ValveOrders orders(3);
  orders.valve.assign(3, control::Valve::kRegulate);
  orders.set_point.setConstant(pressure);
  return orders;
}

enum class End { kDone, kBadReply, kLinkError };

End endOf(const std::function<void()>& call) {
  try {
    call();
  } catch (const BadReply& error) {
    EXPECT_STRNE(error.what(), "");
    return End::kBadReply;
  } catch (const LinkError& error) {
    EXPECT_STRNE(error.what(), "");
    return End::kLinkError;
  }
  return End::kDone;
}

double secondsOf(const std::function<void()>& call) {
  const auto begin = std::chrono::steady_clock::now();
  call();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

// A device of each profile, 2 bar in it, with a driver connected.
class Link : public testing::TestWithParam<const char*> {
 protected:
  Link()
      : profile_(std::string(GetParam()) == "festo_vtem" ? vtemProfile() : mpaProfile()),
        device_(quietDevice(profile_, 3)),
        driver_(modbusTcpDriver(configOf(profile_, device_.port()))) {
    driver_->connect();
    fill(2e5);
  }
  void fill(double pressure) {
    driver_->write(regulate(pressure));
    ASSERT_TRUE(eventually([=] { return std::abs(device_.pressure()[2] - pressure) < 1; }));
  }
  // What a call comes to, which does not take long.
  End ends(const std::function<void()>& call) const {
    End end = End::kDone;
    EXPECT_LT(secondsOf([&] { end = endOf(call); }), kBounded);
    return end;
  }
  Eigen::VectorXd read() {
    Pressures pressures(3);
    driver_->read(pressures);
    return pressures.pressure;
  }
  void heal() {
    device_.setFault(DeviceFault::kNone);
    reconnect();
  }
  // Connects until the device is there again.
  void reconnect() {
    ASSERT_TRUE(eventually([this] { return endOf([this] { driver_->connect(); }) == End::kDone; }));
  }

  ModbusProfile profile_;
  EmulatedDevice device_;
  std::unique_ptr<Driver> driver_;
};

INSTANTIATE_TEST_SUITE_P(Profiles, Link, testing::Values("festo_vtem", "festo_mpa"),
                         [](const auto& parameter) { return std::string(parameter.param); });

TEST_P(Link, SilenceIsALostLinkWithinTheTimeout) {
  device_.setFault(DeviceFault::kSilence);
  const double seconds = secondsOf([this] {
    const std::string error = refusal<LinkError>([this] { read(); });
    EXPECT_TRUE(test::has(error, "127.0.0.1:" + std::to_string(device_.port())));
    EXPECT_TRUE(test::has(error, "timed out"));
    EXPECT_TRUE(test::has(error, "check that it is switched on"));
  });
  EXPECT_GE(seconds, 0.09);
  EXPECT_LT(seconds, kBounded);
  // A lost link stays lost until the next connect().
  EXPECT_TRUE(
      test::has(refusal<LinkError>([this] { driver_->write(regulate(1e5)); }), "there is no link"));
  // The port is open, so it connects, and then there is no answer.
  EXPECT_EQ(ends([this] { driver_->connect(); }), End::kLinkError);
  heal();
  EXPECT_EQ(device_.setPoint().head(3), Eigen::Vector3d(0, 0, 0));
}

TEST_P(Link, ASlowDeviceIsALostLinkAndItsLateRepliesAreNoOthers) {
  device_.setFault(DeviceFault::kSlow);
  EXPECT_EQ(ends([this] { read(); }), End::kLinkError);
  heal();
  fill(1e5);
  EXPECT_EQ(read(), Eigen::Vector3d(1e5, 1e5, 1e5));
}

TEST_P(Link, ALateDeviceReceivesTheVentAndEmptiesWhileTheLinkIsHeld) {
  fill(1e5);
  device_.setFault(DeviceFault::kSlow);
  EXPECT_EQ(endOf([this] { read(); }), End::kLinkError);
  EXPECT_NE(endOf([this] { driver_->vent(); }), End::kDone);
  EXPECT_EQ(driver_->keepsAirOnClose(), profile_.app.has_value());
  EXPECT_TRUE(eventually([this] { return device_.pressure().maxCoeff() < 100; }));
  EXPECT_EQ(endOf([this] { driver_->write(regulate(1e5)); }), End::kLinkError);
  driver_->close();
  EXPECT_FALSE(driver_->keepsAirOnClose());
}

// What is asked again is never taken for a reading, and whoever is well again is read.
TEST_P(Link, EveryFaultComesToItsEndInTimeAndIsSurvived) {
  const Eigen::Vector3d full = Eigen::Vector3d::Constant(2e5);
  const struct {
    DeviceFault fault;
    End end;
    double reads;  // where it is done [Pa]
  } kRows[] = {{DeviceFault::kHalfLine, End::kLinkError, 0},
               {DeviceFault::kGarbage, End::kBadReply, 0},  // or a lost link
               {DeviceFault::kWrongUnit, End::kDone, 2e4},
               {DeviceFault::kNanText, End::kDone, std::nan("")},
               {DeviceFault::kStuckValue, End::kDone, 2e5}};
  for (const auto& row : kRows) {
    SCOPED_TRACE(simulation::nameOf(row.fault));
    device_.setFault(row.fault);
    if (row.fault == DeviceFault::kStuckValue) {
      driver_->vent();
      ASSERT_TRUE(eventually([this] { return device_.pressure().maxCoeff() < 1e3; }));
    }
    for (int i = 0; i < 20 && row.fault == DeviceFault::kGarbage; ++i) {
      EXPECT_NE(ends([this] { read(); }), End::kDone);
      EXPECT_NE(ends([this] { driver_->vent(); }), End::kDone);
      EXPECT_EQ(endOf([this] { driver_->connect(); }), End::kLinkError);
    }
    Eigen::VectorXd reading;
    const End end = ends([&] { reading = read(); });
    EXPECT_EQ(end == End::kDone, row.end == End::kDone);
    EXPECT_TRUE(row.end != End::kLinkError || end == End::kLinkError);
    for (const double one : reading) {
      EXPECT_TRUE(one == row.reads || (std::isnan(one) && std::isnan(row.reads))) << one;
    }
    heal();
    fill(2e5);
    EXPECT_EQ(read(), full);
  }
}

TEST_P(Link, ARestartedDeviceIsConnectedAnewAndVented) {
  device_.setFault(DeviceFault::kRestart);
  ASSERT_TRUE(eventually([this] { return endOf([this] { read(); }) == End::kLinkError; }));
  EXPECT_EQ(endOf([this] { driver_->write(regulate(2e5)); }), End::kLinkError);  // not by itself
  reconnect();
  EXPECT_EQ(device_.fault(), DeviceFault::kNone);
  EXPECT_EQ(read(), Eigen::Vector3d(0, 0, 0));
  fill(2e5);
  EXPECT_EQ(read(), Eigen::Vector3d(2e5, 2e5, 2e5));
}

TEST_P(Link, ReconnectingLeavesNothingOpen) {
  driver_->connect();
  ASSERT_TRUE(eventually([this] { return device_.connections() == 1; }));
  const int before = test::openFiles();
  for (int i = 0; i < 200; ++i) driver_->connect();
  device_.setFault(DeviceFault::kGarbage);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(endOf([this] { driver_->connect(); }), End::kLinkError);
  device_.setFault(DeviceFault::kNone);
  driver_->connect();
  ASSERT_TRUE(eventually([this] { return device_.connections() == 1; }));
  EXPECT_EQ(test::openFiles(), before);
  driver_->close();
  driver_->close();
  EXPECT_TRUE(eventually([this] { return device_.connections() == 0; }));
}

std::string connectRefusal(const std::string& host, int port) {
  const auto driver = modbusTcpDriver({mpaProfile(), host, port, {0}});
  return refusal<LinkError>([&driver] { driver->connect(); });
}

TEST(ModbusConnecting, WithoutALinkNothingIsSent) {
  const auto driver = modbusTcpDriver({mpaProfile(), "127.0.0.1", 502, {0, 1, 2}});
  Pressures pressures(3);
  for (const auto& call : std::vector<std::function<void()>>{[&] { driver->write(regulate(0)); },
                                                             [&] { driver->vent(); },
                                                             [&] { driver->read(pressures); }}) {
    EXPECT_TRUE(
        test::has(refusal<LinkError>(call), "127.0.0.1:502: there is no link; connect first"));
  }
}

TEST(ModbusConnecting, ARefusalNamesTheRemedy) {
  const int port = test::freePort();
  EXPECT_EQ(connectRefusal("127.0.0.1", port), "127.0.0.1:" + std::to_string(port) +
                                                   ": cannot connect: Connection refused; check "
                                                   "that its Modbus server runs, and on this port");
  EXPECT_EQ(connectRefusal("::1", port).find("[::1]:" + std::to_string(port) + ": cannot connect"),
            0u);
}

TEST(ModbusConnecting, AnUnknownNameDoesNotHoldItUp) {
  std::string error;
  EXPECT_LT(secondsOf([&error] { error = connectRefusal("no-such-regulator.invalid", 502); }),
            kBounded);
  EXPECT_TRUE(test::has(error, "give an address such as 192.168.1.10 as host"));
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
  EXPECT_TRUE(
      test::has(error, "cannot connect: Connection timed out; check that it is switched on"));
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
        driver_(modbusTcpDriver({mpaProfile(), "127.0.0.1", server_.port(), {0}})) {
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

TEST(ModbusReplies, NoPressureIsBelowVacuum) {
  Answered device([](const Bytes& request) { return framed(request, {3, 2, 0x80, 0x01}); });
  const std::string error = refusal<BadReply>([&] { device.read(); });
  EXPECT_TRUE(test::has(error,
                        "register 45395 of festo_mpa reads -3276.7 kPa; expected no less than "
                        "vacuum"));
}

TEST(ModbusReplies, AnExceptionIsABadReplyAndTheLinkLives) {
  int asked = 0;
  Answered device([&asked](const Bytes& request) {
    return ++asked == 1 ? framed(request, {0x83, 2}) : framed(request, {3, 2, 0, 10});
  });
  const std::string error = refusal<BadReply>([&] { device.read(); });
  EXPECT_TRUE(
      test::has(error, "festo_mpa gives no readings: Illegal data address; check the registers"));
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

// A byte at a time, each of them within the timeout: it holds for all of them.
TEST(ModbusReplies, BytesThatDripDoNotProlongTheTimeout) {
  const Listener listener(1);
  std::thread dripping([&listener] {
    const int client = accept(listener.socket(), nullptr, nullptr);
    char request[64];
    recv(client, request, sizeof request, 0);
    // The beginning of a frame that says it is long.
    for (const char byte :
         {0, 1, 0, 0, 0, 60, -1, 3, 57, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}) {
      if (send(client, &byte, 1, MSG_NOSIGNAL) != 1) break;
      std::this_thread::sleep_for(std::chrono::duration<double>(0.8 * test::kPatience));
    }
    close(client);
  });
  EXPECT_LT(secondsOf([&] { EXPECT_NE(connectRefusal("127.0.0.1", listener.port()), "accepted"); }),
            kBounded);
  dripping.join();
}

}  // namespace
}  // namespace helix_arm::regulator
