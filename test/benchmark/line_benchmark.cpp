// From a target to what the regulator has taken in: through safety core, I/O thread and line, for
// each kind of emulated device, beside the bare exchange on the same line. Prints p50 and p99.
#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <modbus/modbus.h>
#include <poll.h>
#include <unistd.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/pressure_path.hpp"
#include "support/emulated_regulator.hpp"
#include "support/eventually.hpp"

namespace helix_arm {
namespace {

using regulator::steadyNow;
using test::EmulatedRegulator;
using test::eventually;
using Line = EmulatedRegulator::Line;

constexpr int kTargets = 2000;
constexpr int kWarmUp = 100;
constexpr double kRate = 1000;  // of the turns between targets [Hz]

struct Times {
  double p50, p99;  // [us]
};

Times quantiles(std::vector<double> seconds) {
  std::sort(seconds.begin(), seconds.end());
  return {1e6 * seconds[seconds.size() / 2], 1e6 * seconds[seconds.size() * 99 / 100]};
}

// Targets through the whole path.
Times pathTimes(EmulatedRegulator& device) {
  const io::Scene scene = io::loadScene(device.scene());
  regulator::IoRules rules;
  rules.period = 0.9 / kRate;
  auto io = std::make_unique<regulator::RegulatorIo>(
      regulator::makeDriver(*scene.regulator, EmulatedRegulator::kChannels),
      EmulatedRegulator::kChannels, rules);
  control::SafetyRules safety = scene.safety.rules;
  safety.target_timeout = 60;
  std::vector<control::ChannelRules> channels = scene.safety.channels;
  for (control::ChannelRules& channel : channels) channel.slew = 1e12;
  regulator::PressurePath path({channels, safety}, std::move(io));
  eventually([&] {
    path.turn(steadyNow());
    return path.core().enable(steadyNow()).empty();
  });
  std::vector<double> seconds;
  for (int i = -kWarmUp; i < kTargets; ++i) {
    const Eigen::Vector3d wanted = Eigen::Vector3d::Constant(1e4 + 100 * (i % 2));
    const double sent = steadyNow();
    path.target(sent, wanted);
    while (device.setPoint()[2] != wanted[2]) std::this_thread::yield();
    if (i >= 0) seconds.push_back(device.lastSetTime() - sent);
    for (const double end = sent + 1 / kRate; steadyNow() < end;) std::this_thread::yield();
    path.turn(steadyNow());
  }
  return quantiles(std::move(seconds));
}

// One bare write and read of three registers.
Times modbusTimes(int port, int first) {
  modbus_t* link = modbus_new_tcp("127.0.0.1", port);
  std::vector<double> seconds;
  std::array<std::uint16_t, 3> words{};
  if (modbus_connect(link) == 0) {
    for (int i = -kWarmUp; i < kTargets; ++i) {
      const double sent = steadyNow();
      if (modbus_read_registers(link, first, 3, words.data()) != 3) break;
      if (i >= 0) seconds.push_back(steadyNow() - sent);
    }
    modbus_close(link);
  }
  modbus_free(link);
  if (seconds.empty()) return {-1, -1};
  return quantiles(std::move(seconds));
}

void tell(const char* what, const Times& times) {
  std::printf("%-64s p50 %6.0f us, p99 %6.0f us\n", what, times.p50, times.p99);
}

}  // namespace
}  // namespace helix_arm

int main() {
  using namespace helix_arm;
  std::printf("pressure target -> the device has taken it in, %d targets at most every %g ms\n",
              kTargets, 1e3 / kRate);
  EmulatedRegulator serial(Line::kSerial), modbus(Line::kModbus);
  tell("ascii_serial generic on a pseudo terminal, three lines", pathTimes(serial));
  tell("modbus_tcp festo_vtem on loopback, one write", pathTimes(modbus));
  const io::Scene scene = io::loadScene(modbus.scene());
  const auto& config = std::get<regulator::ModbusConfig>(*scene.regulator);
  tell("bare libmodbus, one read of three registers",
       modbusTimes(config.port, config.profile.reading(0)));
}
