// The pressure path, from targets to the devices' valves, for minutes on end with trouble at
// random: a thousand targets a second for each of two arms, one on a serial line and one on Modbus
// TCP. Exits with 1 where a vent was missed, a pressure stayed off its set point in an enabled arm,
// an arm could not be enabled again, a pressure went beyond its limit and the margin, or memory
// grew.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <thread>
#include <vector>

#include <unistd.h>

#include "helix_arm/simulation/emulated_device.hpp"
#include "soaked_arm.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

constexpr double kMostGrowth = 0.1;
constexpr double kWarmUp = 30;  // until every buffer has had its use [s]

io::Scene sceneWith(const std::string& regulator) {
  return io::loadScene(HELIX_ARM_SOURCE_DIR "/config/scenes/spatial_50.yaml",
                       {{"regulator", regulator},
                        {"safety.target_timeout_s", "0.5"},
                        {"safety.reading_timeout_s", "0.5"}});
}

regulator::SimulatedRegulatorConfig valves(unsigned seed) {
  regulator::SimulatedRegulatorConfig config;
  config.time_constant = 0.1;
  config.noise = 1e3;
  config.seed = seed;
  return config;
}

SoakedArm serialArm(const TemporaryFolder& folder, unsigned seed) {
  simulation::SerialDeviceConfig config;
  config.link = folder.path() + "/line";
  const io::Scene scene = sceneWith("{ascii_serial: {profile: alicat, device: " + config.link +
                                    ", addresses: [A, B, C]}}");
  const auto& spoken = std::get<regulator::SerialConfig>(*scene.regulator);
  config.profile = spoken.profile;
  config.addresses = spoken.addresses;
  config.channels = scene.arm.actuatorCount();
  config.regulator = valves(seed);
  config.seed = seed;
  const auto device = std::make_shared<simulation::SerialDevice>(config);
  return {scene,
          {"ascii_serial alicat", device,
           [device](simulation::DeviceFault fault) { device->setFault(fault); },
           [device] { return device->pressure(); }, [device] { return device->lastSetTime(); }},
          seed};
}

SoakedArm modbusArm(unsigned seed) {
  const auto sceneAt = [](int port) {
    return sceneWith("{modbus_tcp: {profile: festo_vtem, host: 127.0.0.1, port: " +
                     std::to_string(port) + ", slots: [0, 1, 2]}}");
  };
  simulation::ModbusDeviceConfig config;
  config.profile = std::get<regulator::ModbusConfig>(*sceneAt(502).regulator).profile;
  config.places = 4;
  config.regulator = valves(seed);
  const auto device = std::make_shared<simulation::ModbusDevice>(config);
  return {sceneAt(device->port()),
          {"modbus_tcp festo_vtem", device,
           [device](simulation::DeviceFault fault) { device->setFault(fault); },
           [device] { return device->pressure(); }, [device] { return device->lastWrite(); }},
          seed + 1};
}

double residentMegabytes() {
  std::ifstream file("/proc/self/statm");
  double total = 0, resident = 0;
  file >> total >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
}

void print(const std::string& name, const SoakTally& tally) {
  std::printf("\n%s: %llu targets taken, highest pressure %.2f of the limit\n", name.c_str(),
              static_cast<unsigned long long>(tally.targets), tally.highest);
  std::printf("  target -> device write: p50 %.0f us, p99 %.0f us, most %.1f ms (%llu)\n",
              1e6 * tally.writes.quantile(0.5), 1e6 * tally.writes.quantile(0.99),
              1e3 * tally.writes.most(), static_cast<unsigned long long>(tally.writes.total()));
  std::printf("  %-17s %8s %8s %7s   %-24s %-24s\n", "trouble", "injected", "endured", "missed",
              "to the decision p50, p99", "to no pressure p50, p99");
  for (int i = 1; i < kTroubleCount; ++i) {
    const TroubleTally& t = tally.troubles[static_cast<std::size_t>(i)];
    std::printf("  %-17s %8d %8d %7d   %8.3f s %8.3f s    %8.3f s %8.3f s\n", troubleName(i),
                t.injected, t.endured, t.missed, t.decided.quantile(0.5), t.decided.quantile(0.99),
                t.empty.quantile(0.5), t.empty.quantile(0.99));
  }
  if (tally.unprovoked > 0) std::printf("  %d faults without trouble\n", tally.unprovoked);
  if (!tally.last_reason.empty()) std::printf("  last: %s\n", tally.last_reason.c_str());
}

int soak(double minutes, unsigned seed) {
  const TemporaryFolder folder;
  SoakedArm arms[] = {serialArm(folder, seed), modbusArm(seed)};
  const char* names[] = {"ascii_serial alicat", "modbus_tcp festo_vtem"};
  std::atomic<bool> stop{false};
  std::vector<std::thread> threads;
  for (SoakedArm& arm : arms) threads.emplace_back([&arm, &stop] { arm.run(stop); });

  const double seconds = 60 * minutes;
  const double warm_up = std::min(kWarmUp, seconds / 2);
  std::this_thread::sleep_for(std::chrono::duration<double>(warm_up));
  const double start = residentMegabytes();
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds - warm_up));
  const double end = residentMegabytes();
  stop = true;
  for (std::thread& thread : threads) thread.join();

  int injected = 0, missed = 0, stranded = 0, burst = 0;
  for (int i = 0; i < 2; ++i) {
    const SoakTally& tally = arms[i].tally();
    print(names[i], tally);
    for (const TroubleTally& trouble : tally.troubles) injected += trouble.injected;
    missed += tally.missed;
    stranded += tally.stranded;
    burst += tally.burst ? 1 : 0;
  }
  const double growth = end / start - 1;
  std::printf(
      "\n%d troubles in %g minutes (seed %u), %d missed vents, %d arms stranded, %d beyond "
      "their limits\n",
      injected, minutes, seed, missed, stranded, burst);
  std::printf("memory: %.1f MB after %.0f s, %.1f MB at the end: ratio %.3f\n", start, warm_up, end,
              1 + growth);
  return missed > 0 || stranded > 0 || burst > 0 || injected == 0 || growth > kMostGrowth ? 1 : 0;
}

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) {
  double minutes = 10;
  unsigned seed = 1;
  for (int i = 1; i < argc; i += 2) {
    char* end = nullptr;
    const double value = i + 1 < argc ? std::strtod(argv[i + 1], &end) : 0;
    const bool sound = end != nullptr && *end == '\0';
    if (sound && std::strcmp(argv[i], "--minutes") == 0 && value > 0 && value <= 1e5) {
      minutes = value;
    } else if (sound && std::strcmp(argv[i], "--seed") == 0 && value >= 0 && value <= 1e9) {
      seed = static_cast<unsigned>(value);
    } else {
      std::cerr << "usage: soak [--minutes N] [--seed N]\n";
      return 2;
    }
  }
  return helix_arm::test::soak(minutes, seed);
}
