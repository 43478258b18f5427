// Time from a target to its arrival in the regulator, through safety core, I/O thread and line, for
// each kind of emulated device. Prints p50 and p99.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "helix_arm/io/scene.hpp"
#include "regulator/guard_process.hpp"
#include "support/emulated_regulator.hpp"
#include "support/eventually.hpp"

namespace helix_arm {
namespace {

using regulator::steadyNow;
using test::EmulatedRegulator;
using test::eventually;
using test::Line;

constexpr int kTargets = 2000;
constexpr int kWarmUp = 100;
constexpr double kDeadline = 1;  // of a target [s]
constexpr double kRate = 1000;   // of the turns between targets [Hz]

struct Times {
  double p50, p99;  // [us]
};

Times quantiles(std::vector<double> seconds) {
  std::sort(seconds.begin(), seconds.end());
  return {1e6 * seconds[seconds.size() / 2], 1e6 * seconds[seconds.size() * 99 / 100]};
}

double setPointOf(int i) { return 1e4 + 100 * (i & 1); }  // [Pa]

Times fail(const regulator::PressurePath& path) {
  std::fprintf(stderr, "%s\n", path.core().reason().c_str());
  std::exit(1);
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
  const bool enabled = eventually([&] {
    path.turn(steadyNow());
    return path.core().enable(steadyNow()).empty();
  });
  if (!enabled) return fail(path);
  std::vector<double> seconds;
  for (int i = -kWarmUp; i < kTargets; ++i) {
    const Eigen::Vector3d wanted = Eigen::Vector3d::Constant(setPointOf(i));
    const double sent = steadyNow();
    const auto arrived = [&] { return device.setPoint()[2] == wanted[2]; };
    if (!path.target(sent, wanted)) return fail(path);
    while (!arrived() && steadyNow() - sent < kDeadline) std::this_thread::yield();
    if (!arrived()) return fail(path);
    if (i >= 0) seconds.push_back(device.lastSetTime() - sent);
    for (const double end = sent + 1 / kRate; steadyNow() < end;) std::this_thread::yield();
    path.turn(steadyNow());
  }
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
  tell("modbus_tcp festo_vtem on loopback, one request", pathTimes(modbus));
}
