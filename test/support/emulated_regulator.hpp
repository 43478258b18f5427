#pragma once

#include <variant>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "helix_arm/simulation/emulated_device.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {

/// Rules of the scene of an EmulatedRegulator, brisk ones [s].
inline constexpr double kTargetTimeout = 0.5;
inline constexpr double kReadingTimeout = 0.4;
inline constexpr double kSpikeTime = 0.1;
inline constexpr double kFollowTime = 0.4;
inline constexpr double kVentTime = 2;
inline constexpr double kVentedBelow = 1.5e4;  ///< and what is no pressure [Pa]
inline constexpr double kNoise = 100;          ///< of the device's readings [Pa]
/// What is left in a device whose readings show no pressure: it may keep that without its link
/// [Pa].
inline constexpr double kEmpty = kVentedBelow + 5 * kNoise;
/// In which a channel that was told to move much has left, or should have left, where it was: two
/// time constants [s].
inline constexpr double kLag = 0.1;

/// An emulated pressure regulator, whichever line it is on.
class EmulatedRegulator {
 public:
  static constexpr int kChannels = 3;
  enum class Line { kSerial, kModbus };
  enum class Extra {
    kNone,
    kSupplySensor,  ///< and the scene has a least supply
    kWatchdog,      ///< that of its profile; without it what vents it is ours
  };

  explicit EmulatedRegulator(Line line, Extra extra = Extra::kNone)
      : measures_supply_(extra == Extra::kSupplySensor) {
    if (measures_supply_) writeProfiles();
    // The profile is the scene's: what the driver speaks, the device does.
    const io::Scene scene = io::loadScene(TemporaryFile(sceneText(line, "/dev/null", 1)).path());
    regulator::SimulatedRegulatorConfig valves;
    valves.time_constant = kLag / 2;
    valves.noise = kNoise;
    if (line == Line::kSerial) {
      const auto& config = std::get<regulator::SerialConfig>(*scene.regulator);
      simulation::SerialDeviceConfig device;
      device.profile = config.profile;
      if (extra != Extra::kWatchdog) {
        device.profile.watchdog = std::numeric_limits<double>::infinity();
      }
      device.addresses = config.addresses;
      device.channels = kChannels;
      device.regulator = valves;
      device.link = folder_ / "line";
      device_ = std::make_unique<simulation::EmulatedDevice>(device);
    } else {
      simulation::ModbusDeviceConfig device;
      device.profile = std::get<regulator::ModbusConfig>(*scene.regulator).profile;
      device.regulator = valves;
      device_ = std::make_unique<simulation::EmulatedDevice>(device);
    }
    scene_.emplace(sceneText(line, folder_ / "line", device_->port()));
  }

  const std::string& scene() const { return scene_->path(); }
  void setFault(simulation::DeviceFault fault) { device_->setFault(fault); }
  Eigen::VectorXd setPoint() const { return device_->setPoint().head(kChannels); }
  /// When the last set point came, of regulator::steadyNow() [s].
  double lastSetTime() const { return device_->lastSetTime(); }
  Eigen::VectorXd pressure() const { return device_->pressure().head(kChannels); }
  /// Whether every channel lets its air out, by its valve or by its set point.
  bool vents() const {
    const auto valves = device_->valves();
    const Eigen::VectorXd set_point = setPoint();
    for (int i = 0; i < kChannels; ++i) {
      const bool lets_out = valves[i] == control::Valve::kVent ||
                            (valves[i] == control::Valve::kRegulate && set_point[i] == 0);
      if (!lets_out) return false;
    }
    return true;
  }
  /// Or has: one that is empty had the order, even if it has closed since.
  bool isVented() const { return vents() || pressure().maxCoeff() < kEmpty; }

 private:
  std::string regulatorText(Line line, const std::string& device, int port) const {
    const std::string serial = measures_supply_ ? folder_ / "serial.yaml" : "generic";
    const std::string modbus = measures_supply_ ? folder_ / "modbus.yaml" : "festo_vtem";
    return line == Line::kSerial ? "ascii_serial: {profile: " + serial + ", device: " + device +
                                       ", addresses: [0, 1, 2]}"
                                 : "modbus_tcp: {profile: " + modbus +
                                       ", host: 127.0.0.1, port: " + std::to_string(port) + "}";
  }

  std::string sceneText(Line line, const std::string& device, int port) const {
    return R"(name: hardware
contractions:
  muscle:
    table: {pressure_kpa: [0, 200, 400], length_m: [0.40, 0.36, 0.30]}
arm:
  geometry: spatial
  stiffness: {K_gamma: 10, K_tau_m2: 0, K_kappa_m2: 1.0e-4}
  sections:
    - name: arm
      ring: {count: 3, radius_m: 0.03, contraction: muscle, max_pressure_kpa: 300}
regulator:
  )" + regulatorText(line, device, port) +
           R"(
safety:
  slew_kpa_s: 2000
  target_timeout_s: )" +
           std::to_string(kTargetTimeout) +
           "\n  reading_timeout_s: " + std::to_string(kReadingTimeout) +
           "\n  spike_time_s: " + std::to_string(kSpikeTime) +
           "\n  follow: {tolerance_kpa: 30, time_s: " + std::to_string(kFollowTime) +
           ", time_constant_s: " + std::to_string(kLag / 2) +
           "}\n  vent_time_s: " + std::to_string(kVentTime) +
           "\n  vented_below_kpa: " + std::to_string(kVentedBelow / 1e3) + "\n" +
           (measures_supply_ ? "  min_supply_kpa: 350\n" : "");
  }

  // Devices with the shipped profiles, except for a sensor at the supply.
  void writeProfiles() const {
    std::ofstream(folder_ / "serial.yaml") << R"(ascii_serial:
  {baud: 115200, terminator: lf, unit: kPa, unit_word: kPa, write: "p{address}={pressure}",
   write_reply: "p{address}={pressure} {unit} of {supply}", read: "p{address}?",
   reply: "p{address}={pressure} {unit} of {supply}", vent: "p{address}=vent",
   vent_reply: "p{address}={pressure} {unit} of {supply}"}
)";
    std::ofstream(folder_ / "modbus.yaml") << R"(modbus_tcp:
  {count_pa: 100, highest_count: 10000, outputs: {first: 10, stride: 1, pressure: 0},
   inputs: {first: 100, stride: 1, pressure: 0, registers: holding}, supply: 99}
)";
  }

  const bool measures_supply_;
  TemporaryFolder folder_;
  std::unique_ptr<simulation::EmulatedDevice> device_;
  std::optional<TemporaryFile> scene_;
};

}  // namespace helix_arm::test
