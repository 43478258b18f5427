#include <cmath>

#include <sys/stat.h>

#include "regulator/regulator_io.hpp"
#include "regulator/serial_port.hpp"
#include "simulation/emulated_device.hpp"
#include "support/eventually.hpp"
#include "support/has.hpp"
#include "support/holding_child.hpp"
#include "support/serial_profiles.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::regulator {
namespace {

using control::Valve;
using control::ValveOrders;
using simulation::DeviceFault;
using simulation::EmulatedDevice;
using simulation::EmulatedDeviceConfig;
using test::eventually;
using test::has;

constexpr int kChannels = 3;
constexpr double kTau = 0.02;  // of the emulated valves [s]
constexpr double kSoon = 5.0;  // on a machine that is busy [s]

std::vector<std::string> addressesOf(const SerialProfile& profile) {
  if (has(profile.write, "{address}")) return {"A", "B", "C"};
  return {};
}

EmulatedDeviceConfig deviceOf(const SerialProfile& profile, const std::string& link = "") {
  EmulatedDeviceConfig config;
  config.regulator = SerialConfig{profile, link, addressesOf(profile)};
  config.channels = kChannels;
  config.valves = {kTau, 6e5, 0.0, 1};
  return config;
}

std::unique_ptr<Driver> driverOf(const SerialProfile& profile, const std::string& device) {
  return SerialConfig{profile, device, addressesOf(profile)}.makeDriver(kChannels);
}

ValveOrders regulate(const Eigen::VectorXd& set_point) {
  ValveOrders orders(kChannels);
  orders.valve.assign(kChannels, Valve::kRegulate);
  orders.set_point = set_point;
  return orders;
}

// Readings of all channels; of those that come unasked, the next ones.
Pressures readAll(const std::unique_ptr<Driver>& driver) {
  Pressures pressures(kChannels);
  const bool read = eventually([&] {
    driver->read(pressures);
    return pressures.pressure.allFinite();
  });
  EXPECT_TRUE(read);
  return pressures;
}

struct Failure {
  std::string kind;  // "link", "reply" or "none"
  std::string text;
};

Failure failureOf(const std::function<void()>& call) {
  try {
    call();
    return {"none", ""};
  } catch (const LinkError& error) {
    return {"link", error.what()};
  } catch (const BadReply& error) {
    return {"reply", error.what()};
  }
}

// A device and the driver at the other end of its line.
struct SerialLine {
  explicit SerialLine(const SerialProfile& profile = test::genericProfile())
      : device(deviceOf(profile)), driver(driverOf(profile, device.path())) {}

  bool fills() {
    driver->write(regulate(kFull));
    return eventually([this] { return device.pressure().minCoeff() > 1.99e5; });
  }
  bool empties() const {
    return eventually([this] { return device.pressure().maxCoeff() < 1e3; });
  }
  // All valves, once they are told so.
  bool comesTo(Valve valve) const {
    return eventually([&] { return device.valves() == std::vector<Valve>(kChannels, valve); });
  }

  static inline const Eigen::Vector3d kFull = Eigen::Vector3d::Constant(2e5);
  EmulatedDevice device;
  std::unique_ptr<Driver> driver;
};

class AsciiSerialProfiles : public testing::TestWithParam<SerialProfile> {
 protected:
  SerialLine line_{GetParam()};
  EmulatedDevice& device_ = line_.device;
  const std::unique_ptr<Driver>& driver_ = line_.driver;
};

std::string nameOfProfile(const testing::TestParamInfo<SerialProfile>& info) {
  return info.param.name;
}

TEST_P(AsciiSerialProfiles, SetPointsArriveAndReadingsComeBackInPascals) {
  driver_->connect();
  const Eigen::Vector3d goal(1.2e5, 0.5e5, 3e5);
  driver_->write(regulate(goal));
  // What the device's digits hold, and never more than was ordered.
  const double digit = GetParam().pascals * std::pow(10.0, -GetParam().decimals);
  ASSERT_TRUE(eventually([&] { return device_.setPoint().isApprox(goal, 2e-3); }));
  for (int i = 0; i < kChannels; ++i) {
    EXPECT_LE(device_.setPoint()[i], goal[i] + 1e-6 * digit);
    EXPECT_GT(device_.setPoint()[i], goal[i] - 1.01 * digit);
  }
  EXPECT_TRUE(line_.comesTo(Valve::kRegulate)) << "orders of their own";
  ASSERT_TRUE(eventually(
      [&] { return (device_.pressure() - device_.setPoint()).cwiseAbs().maxCoeff() < 1.0; }));
  // Lines that were under way hold earlier pressures.
  const double tolerance = 0.51 * digit + 1.0;
  Pressures pressures(kChannels);
  eventually([&] {
    pressures = readAll(driver_);
    return (pressures.pressure - device_.setPoint()).cwiseAbs().maxCoeff() <= tolerance;
  });
  for (int i = 0; i < kChannels; ++i) {
    EXPECT_NEAR(pressures.pressure[i], device_.setPoint()[i], tolerance);
  }
}

TEST_P(AsciiSerialProfiles, ConnectingVentsWhatStood) {
  driver_->connect();
  ASSERT_TRUE(line_.fills());
  driver_->close();
  driver_->connect();
  EXPECT_TRUE(line_.empties());
}

TEST_P(AsciiSerialProfiles, VentingLetsAllAirOutAndSetPointsBringItBack) {
  driver_->connect();
  for (int round = 0; round < 2; ++round) {
    ASSERT_TRUE(line_.fills()) << round;
    driver_->vent();
    ASSERT_TRUE(line_.empties()) << round;
    EXPECT_EQ(device_.valves(), std::vector<Valve>(kChannels, Valve::kVent));
    driver_->write(ValveOrders(kChannels));  // stays so
    EXPECT_EQ(device_.valves(), std::vector<Valve>(kChannels, Valve::kVent));
  }
}

TEST_P(AsciiSerialProfiles, ClosedChannelsKeepTheirPressureUntilTheyRegulateOrVent) {
  driver_->connect();
  ASSERT_TRUE(line_.fills());
  ValveOrders orders = regulate(SerialLine::kFull);
  orders.valve.assign(kChannels, Valve::kClose);
  driver_->write(orders);
  if (GetParam().close.empty()) {
    EXPECT_TRUE(line_.empties());
    return;
  }
  ASSERT_TRUE(line_.comesTo(Valve::kClose));
  const Eigen::VectorXd closed = device_.pressure();
  EXPECT_FALSE(eventually([&] { return device_.pressure() != closed; }, 5 * kTau));
  driver_->write(regulate(Eigen::Vector3d::Constant(1e5)));
  ASSERT_TRUE(eventually([&] { return device_.pressure().maxCoeff() < 1.1e5; }));
  driver_->write(orders);
  driver_->vent();
  EXPECT_TRUE(line_.empties());
}

// After a silence in which the device may have vented by itself, nothing is fed again.
TEST(AsciiSerialWatchdog, ADeviceThatMayHaveVentedIsNotFedAgain) {
  SerialProfile profile = test::genericProfile();
  profile.watchdog = 1;
  EmulatedDevice device(deviceOf(profile));
  const auto driver = driverOf(profile, device.path());
  const auto standStill = [](double time) {
    const double end = steadyNow() + time;
    eventually([&] { return steadyNow() >= end; }, kSoon);
  };
  const Eigen::Vector3d set_point(1e5, 2e5, 1.5e5);
  driver->connect();
  standStill(0.9);  // nothing stands, nothing can jump
  EXPECT_EQ(failureOf([&] { driver->write(regulate(set_point)); }).text, "");
  EXPECT_TRUE(device.setPoint().isApprox(set_point));
  standStill(0.9);  // not yet, but its clock may be faster
  const double before = device.lastSetTime();
  ValveOrders orders = regulate(set_point);
  orders.valve[0] = Valve::kVent;  // the first line after the silence lets air out
  const Failure late = failureOf([&] { driver->write(orders); });
  EXPECT_EQ(late.kind, "link");
  EXPECT_TRUE(has(late.text, "may have vented by itself (watchdog_s of its profile generic)"));
  EXPECT_EQ(device.lastSetTime(), before);
  EXPECT_EQ(device.valves()[0], Valve::kVent);
  Pressures pressures(kChannels);
  EXPECT_EQ(failureOf([&] { driver->read(pressures); }).kind, "link");
  EXPECT_EQ(failureOf([&] { driver->vent(); }).text, "");
  EXPECT_EQ(failureOf([&] { driver->write(regulate(set_point)); }).text, "");
}

std::vector<SerialProfile> profiles() {
  return {test::alicatProfile(),
          test::ctrlPProfile(),
          test::genericProfile(),
          test::togetherProfile(),
          test::withChecksums(test::genericProfile()),
          test::withChecksums(test::ctrlPProfile())};
}
INSTANTIATE_TEST_SUITE_P(Each, AsciiSerialProfiles, testing::ValuesIn(profiles()), nameOfProfile);

// It takes numbers in its own unit and echoes them, so no answer to a set point shows the fault.
TEST(AsciiSerialDriver, ADeviceWithAnotherUnitIsRefusedBeforeItsFirstSetPoint) {
  SerialProfile profile = test::alicatProfile();
  EmulatedDevice device(deviceOf(profile));
  device.setFault(DeviceFault::kWrongUnit);
  const auto asks = driverOf(profile, device.path());
  const Failure refused = failureOf([&] { asks->connect(); });
  EXPECT_EQ(refused.kind, "link");
  EXPECT_TRUE(has(refused.text, "\"A 0 0 0 kPa\" does not match")) << refused.text;
  EXPECT_TRUE(has(refused.text, "expected the unit PSIG at \"kPa\". Set the unit PSIG on the"));
  EXPECT_TRUE(device.setPoint().isZero());
  profile.unit_query.clear();
  profile.unit_reply.clear();
  const auto trusts = driverOf(profile, device.path());
  trusts->connect();
  trusts->write(regulate(Eigen::Vector3d::Constant(6894.757293168)));
  EXPECT_TRUE(device.setPoint().isConstant(1e3));
  trusts->close();
  EXPECT_EQ(failureOf([&] { asks->connect(); }).text, refused.text);
  EXPECT_TRUE(device.setPoint().isZero()) << "it is vented";
}

// One unit of a bus is dead (the device knows another address): the others still vent.
TEST(AsciiSerialDriver, AChannelThatDoesNotAnswerDoesNotKeepOthersFromVenting) {
  SerialLine line;
  const EmulatedDevice& device = line.device;
  line.driver->connect();
  ASSERT_TRUE(line.fills());
  line.driver->close();
  const auto driver =
      SerialConfig{test::genericProfile(), device.path(), {"X", "B", "C"}}.makeDriver(kChannels);
  EXPECT_NE(failureOf([&] { driver->connect(); }).kind, "none");
  EXPECT_TRUE(eventually([&] { return device.pressure().tail(2).maxCoeff() < 1e3; }));
  EXPECT_GT(device.pressure()[0], 1.9e5);
}

TEST(AsciiSerialDriver, AnUnpluggedDeviceIsReportedAndReconnects) {
  const test::TemporaryFolder folder;
  const std::string link = folder / "regulator";
  const auto driver = driverOf(test::genericProfile(), link);
  Pressures pressures(kChannels);
  for (int round = 0; round < 3; ++round) {
    {
      EmulatedDevice device(deviceOf(test::genericProfile(), link));
      driver->connect();
      driver->write(regulate(Eigen::Vector3d::Constant(1e5)));
      driver->read(pressures);
      EXPECT_TRUE(pressures.pressure.allFinite());
    }
    const Failure gone = failureOf([&] { driver->read(pressures); });
    EXPECT_EQ(gone.kind, "link");
    EXPECT_EQ(gone.text,
              link + " hung up: it was unplugged or switched off; check its cable and power");
    const Failure missing = failureOf([&] { driver->connect(); });
    EXPECT_EQ(missing.kind, "link");
    EXPECT_EQ(
        missing.text,
        link + " does not exist; plug it in, or use a name that `ls /dev/serial/by-id` lists");
  }
}

// What opening a line says in a process of its own, that of a user without privileges: "" where it
// can be opened. It then holds the line until it is killed.
std::string openedByNobody(const std::string& device) {
  constexpr int kNobody = 65534;
  static SerialPort port;
  if (getuid() == 0 && (setgid(kNobody) != 0 || setuid(kNobody) != 0)) return "still root";
  return failureOf([&] { port.open(device, 115200); }).text;
}

TEST(AsciiSerialDriver, ALineIsFreeOnceItsProgramWasKilled) {
  EmulatedDevice device(deviceOf(test::genericProfile()));
  const std::string path = device.path();  // here, as its lock may be held while a child is forked
  ASSERT_EQ(chmod(path.c_str(), 0666), 0);
  const auto driver = driverOf(test::genericProfile(), path);
  const std::string held =
      path + " is used by another program; end that one (fuser shows which it is)";
  const auto open = [&] { return openedByNobody(path); };
  {
    const test::HoldingChild holder(open);
    ASSERT_EQ(holder.text(), "");
    EXPECT_EQ(failureOf([&] { driver->connect(); }).text, held);
    EXPECT_EQ(test::HoldingChild(open).text(), held);
  }
  EXPECT_EQ(test::HoldingChild(open).text(), "");
  EXPECT_EQ(failureOf([&] { driver->connect(); }).text, "");
}

}  // namespace
}  // namespace helix_arm::regulator
