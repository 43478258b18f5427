#include <algorithm>
#include <cerrno>
#include <cmath>
#include <functional>
#include <iomanip>
#include <iostream>
#include <limits>
#include <memory>
#include <sstream>
#include <vector>

#include <poll.h>
#include <unistd.h>

#include "helix_arm/regulator/regulator_io.hpp"
#include "helix_arm/simulation/modbus_device.hpp"
#include "helix_arm/simulation/serial_device.hpp"
#include "interrupt_watch.hpp"
#include "regulator_actions.hpp"

namespace helix_arm::cli {
namespace {

using control::Valve;
using regulator::steadyNow;
using simulation::DeviceFault;

constexpr double kBetweenReports = 1;  // [s]
constexpr double kSupplyAbove = 1.25;  // relative to the largest pressure limit
constexpr double kNoise = 500;         // [Pa]

// An emulated device of either kind, through the functions that this command needs.
struct Emulated {
  std::shared_ptr<void> device;
  std::vector<int> channels;  // (actuators) positions in the device
  std::function<Eigen::VectorXd()> pressure, setPoint;
  std::function<std::vector<Valve>()> valves;
  std::function<void(DeviceFault)> setFault;
};

template <class Device>
Emulated wrap(const std::shared_ptr<Device>& device, std::vector<int> channels) {
  return {device,
          std::move(channels),
          [device] { return device->pressure(); },
          [device] { return device->setPoint(); },
          [device] { return device->valves(); },
          [device](DeviceFault fault) { device->setFault(fault); }};
}

regulator::SimulatedRegulatorConfig emulatedConfigOf(const io::Scene& scene) {
  regulator::SimulatedRegulatorConfig config;
  config.supply_pressure =
      std::max(config.supply_pressure, kSupplyAbove * scene.arm.inputAt(1).maxCoeff());
  config.noise = kNoise;
  return config;
}

Emulated emulate(const regulator::ModbusConfig& config, const io::Scene& scene) {
  if (config.host != "127.0.0.1" && config.host != "localhost") {
    throw CallerError("emulate listens on 127.0.0.1, but the scene's regulator is at " +
                      config.host + "; add --set regulator.modbus_tcp.host=127.0.0.1");
  }
  simulation::ModbusDeviceConfig device;
  device.profile = config.profile;
  device.places = *std::max_element(config.slots.begin(), config.slots.end()) + 1;
  device.regulator = emulatedConfigOf(scene);
  device.port = config.port;
  const auto made = std::make_shared<simulation::ModbusDevice>(device);
  return wrap(made, config.slots);
}

Emulated emulate(const regulator::SerialConfig& config, const io::Scene& scene) {
  simulation::SerialDeviceConfig device;
  device.profile = config.profile;
  device.addresses = config.addresses;
  device.channels = scene.arm.actuatorCount();
  device.regulator = emulatedConfigOf(scene);
  device.link = config.device;
  const auto made = std::make_shared<simulation::SerialDevice>(device);
  std::vector<int> channels;
  for (int i = 0; i < device.channels; ++i) channels.push_back(i);
  return wrap(made, channels);
}

[[noreturn]] Emulated emulate(const regulator::SimulatedRegulatorConfig&, const io::Scene& scene) {
  throw CallerError("scene " + scene.name +
                    " has a simulated regulator, hence no device to emulate; expected "
                    "regulator.ascii_serial or regulator.modbus_tcp");
}

const char* wordOf(Valve valve) {
  switch (valve) {
    case Valve::kVent:
      return "vents";
    case Valve::kRegulate:
      return "regulates";
    case Valve::kClose:
      break;
  }
  return "is closed";
}

void tell(const Emulated& emulated, const io::Scene& scene) {
  const Eigen::VectorXd pressure = emulated.pressure();
  const Eigen::VectorXd set_point = emulated.setPoint();
  const std::vector<Valve> valves = emulated.valves();
  std::ostringstream line;
  line << std::fixed << std::setprecision(1);
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    const int k = emulated.channels[static_cast<std::size_t>(i)];
    line << (i > 0 ? ", " : "") << scene.arm.actuator(i).name << " "
         << wordOf(valves[static_cast<std::size_t>(k)]) << ": set " << set_point[k] / 1e3
         << ", has " << pressure[k] / 1e3 << " kPa";
  }
  std::cout << line.str() << std::endl;
}

void obey(const std::string& word, const Emulated& emulated) {
  if (const auto fault = simulation::parseDeviceFault(word)) {
    emulated.setFault(*fault);
    std::cout << "fault: " << word << std::endl;
    return;
  }
  std::cerr << "unknown fault " << word << "; expected one of " << simulation::deviceFaultNames()
            << "\n";
}

// Reads stdin line by line, until its end.
class Lines {
 public:
  // Waits for lines, at most this long [s].
  std::vector<std::string> await(double seconds) {
    pollfd waited{open_ ? STDIN_FILENO : -1, POLLIN, 0};
    if (poll(&waited, 1, static_cast<int>(std::ceil(1e3 * std::max(seconds, 0.0)))) <= 0) return {};
    char bytes[256];
    const ssize_t size = read(STDIN_FILENO, bytes, sizeof bytes);
    if (size == 0 || (size < 0 && errno != EINTR)) open_ = false;
    if (size > 0) begun_.append(bytes, static_cast<std::size_t>(size));
    std::vector<std::string> lines;
    for (std::size_t end; (end = begun_.find('\n')) != std::string::npos;) {
      if (end > 0) lines.push_back(begun_.substr(0, end));
      begun_.erase(0, end + 1);
    }
    return lines;
  }

 private:
  bool open_ = true;
  std::string begun_;
};

}  // namespace

int emulateRegulator(const RegulatorOptions& options, const GlobalOptions& global) {
  if (global.format != Format::kText)
    throw CallerError("emulate prints only text; leave out --format");
  const io::Scene scene = loadRegulatedScene(options, global);
  const InterruptWatch watch;
  const Emulated emulated =
      std::visit([&scene](const auto& config) { return emulate(config, scene); }, *scene.regulator);
  std::cout << "emulates " << regulator::describe(*scene.regulator)
            << "; faults by name on stdin, Ctrl-C ends" << std::endl;
  const double end =
      steadyNow() + options.seconds.value_or(std::numeric_limits<double>::infinity());
  Lines lines;
  double next = steadyNow();
  while (!interrupted() && steadyNow() < end) {
    if (steadyNow() >= next) {
      tell(emulated, scene);
      next += kBetweenReports;
    }
    for (const std::string& line : lines.await(std::min(next, end) - steadyNow())) {
      obey(line, emulated);
    }
  }
  return kDone;
}

}  // namespace helix_arm::cli
