// What befalls a link, and how long a call takes at most, with each kind of device.
#include <cmath>

#include <gtest/gtest.h>

#include "support/emulated_regulator.hpp"
#include "support/end_of.hpp"
#include "support/eventually.hpp"
#include "support/has.hpp"
#include "support/modbus_profiles.hpp"
#include "support/refusal.hpp"
#include "support/serial_profiles.hpp"

namespace helix_arm::regulator {
namespace {

using namespace simulation;
using namespace test;

constexpr int kChannels = 3;

// A device, and what the driver makes of its answers.
struct LinkedDevice {
  const char* name;
  EmulatedDeviceConfig device;
  End half_line;                                    // cut short
  std::optional<double> wrong_unit = std::nullopt;  // reading of 2 bar [Pa]; nothing: refused
  std::optional<double> nan_text = std::nullopt;    // reading [Pa]; nothing: refused
};

std::vector<LinkedDevice> devices() {
  EmulatedDeviceConfig board;
  board.regulator = SerialConfig{genericProfile(), "", {"A", "B", "C"}};
  board.channels = kChannels;
  board.valves = {0.01, 6e5, 0.0, 1};
  return {{"generic", board, End::kBadReply},
          {"festo_vtem", quietDevice(vtemProfile(), kChannels), End::kLinkError, 2e4, std::nan("")},
          {"festo_mpa", quietDevice(mpaProfile(), kChannels), End::kLinkError, 2e4, std::nan("")}};
}

control::ValveOrders regulate(double pressure) {
  control::ValveOrders orders(kChannels);
  orders.valve.assign(kChannels, control::Valve::kRegulate);
  orders.set_point.setConstant(pressure);
  return orders;
}

// 2 bar in the device, with a driver connected.
class Link : public testing::TestWithParam<LinkedDevice> {
 protected:
  Link()
      : config_(placed(GetParam().device, folder_)),
        device_(config_),
        regulator_(reached(config_.regulator, device_)),
        driver_(makeDriver(regulator_, kChannels)) {
    driver_->connect();
    fill(2e5);
  }
  void fill(double pressure) {
    driver_->write(regulate(pressure));
    const Eigen::Vector3d full = Eigen::Vector3d::Constant(pressure);
    ASSERT_TRUE(eventually([&] { return device_.pressure().head(3).isApprox(full, 1e-6); }));
  }
  // What a call comes to, which does not take long.
  End ends(const std::function<void()>& call) const {
    End end = End::kDone;
    EXPECT_LT(secondsOf([&] { end = endOf(call); }), kBounded);
    return end;
  }
  // What the device answers to this call: readings may have come with the answer to a write before.
  static Eigen::VectorXd readingOf(Driver& driver) {
    Pressures pressures(kChannels);
    driver.read(pressures);
    driver.read(pressures);
    return pressures.pressure;
  }
  Eigen::VectorXd read() { return readingOf(*driver_); }
  void heal() {
    device_.setFault(DeviceFault::kNone);
    reconnect();
  }
  // Connects until the device is there again.
  void reconnect() {
    ASSERT_TRUE(eventually([this] { return endOf([this] { driver_->connect(); }) == End::kDone; }));
  }

  TemporaryFolder folder_;
  EmulatedDeviceConfig config_;
  EmulatedDevice device_;
  Config regulator_;
  std::unique_ptr<Driver> driver_;
};

INSTANTIATE_TEST_SUITE_P(Devices, Link, testing::ValuesIn(devices()),
                         [](const auto& device) { return std::string(device.param.name); });

TEST_P(Link, SilenceIsALostLinkWithinTheTimeout) {
  device_.setFault(DeviceFault::kSilence);
  const double seconds = secondsOf([this] {
    const std::string error = refusal<LinkError>([this] { read(); });
    EXPECT_TRUE(has(error, factsOf(regulator_).address));
    EXPECT_TRUE(has(error, "; check "));
  });
  EXPECT_GE(seconds, 0.09);
  EXPECT_LT(seconds, kBounded);
  EXPECT_EQ(ends([this] { driver_->write(regulate(1e5)); }), End::kLinkError);
  // The line or the port is open, so it connects, and then there is no answer.
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

// What is asked again is never taken for a reading, and whoever is well again is read.
TEST_P(Link, EveryFaultComesToItsEndInTimeAndIsSurvived) {
  const Eigen::Vector3d full = Eigen::Vector3d::Constant(2e5);
  const LinkedDevice& of = GetParam();
  const struct {
    DeviceFault fault;
    std::optional<double> reads;  // [Pa]
    End end = End::kBadReply;     // where it is refused; of garbage, a lost link as well
  } kRows[] = {{DeviceFault::kHalfLine, std::nullopt, of.half_line},
               {DeviceFault::kGarbage, std::nullopt},
               {DeviceFault::kWrongUnit, of.wrong_unit},
               {DeviceFault::kNanText, of.nan_text},
               {DeviceFault::kStuckValue, 2e5}};
  for (const auto& row : kRows) {
    SCOPED_TRACE(nameOf(row.fault));
    device_.setFault(row.fault);
    if (row.fault == DeviceFault::kStuckValue) {
      driver_->vent();
      ASSERT_TRUE(eventually([this] { return device_.pressure().maxCoeff() < 1e3; }));
    }
    const bool garbage = row.fault == DeviceFault::kGarbage;
    for (int i = 0; i < 20 && garbage; ++i) {
      EXPECT_NE(ends([this] { read(); }), End::kDone);
      EXPECT_NE(ends([this] { driver_->vent(); }), End::kDone);
      EXPECT_EQ(endOf([this] { driver_->connect(); }), End::kLinkError);
    }
    Eigen::VectorXd reading;
    const End end = ends([&] { reading = read(); });
    EXPECT_TRUE(garbage || end == (row.reads ? End::kDone : row.end));
    EXPECT_EQ(reading.size() > 0, row.reads.has_value());
    for (const double one : reading) {
      EXPECT_TRUE(one == row.reads || (std::isnan(one) && std::isnan(*row.reads))) << one;
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
  ASSERT_TRUE(eventually([this] { return device_.pressure().maxCoeff() < 1; }));
  EXPECT_EQ(read(), Eigen::Vector3d(0, 0, 0));
  fill(2e5);
  EXPECT_EQ(read(), Eigen::Vector3d(2e5, 2e5, 2e5));
}

}  // namespace
}  // namespace helix_arm::regulator
