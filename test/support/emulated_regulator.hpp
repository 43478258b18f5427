#pragma once

#include <fstream>
#include <regex>
#include <variant>

#include "helix_arm/io/scene.hpp"
#include "regulator/regulator_io.hpp"
#include "simulation/emulated_device.hpp"
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

/// A device with a place on this machine: a link in the folder, or any free port.
inline simulation::EmulatedDeviceConfig placed(simulation::EmulatedDeviceConfig device,
                                               const TemporaryFolder& folder) {
  regulator::Config& config = device.regulator;
  if (auto* serial = std::get_if<regulator::SerialConfig>(&config))
    serial->device = folder / "line";
  if (auto* modbus = std::get_if<regulator::ModbusConfig>(&config)) modbus->port = 0;
  return device;
}
/// The configuration of a driver of a device.
inline regulator::Config reached(regulator::Config config,
                                 const simulation::EmulatedDevice& device) {
  if (auto* modbus = std::get_if<regulator::ModbusConfig>(&config)) modbus->port = device.port();
  return config;
}

/// Each kind of line, and what a scene says of it.
enum class Line { kSerial, kModbus };
inline constexpr Line kLines[] = {Line::kSerial, Line::kModbus};
struct LineKind {
  const char* name;  ///< in names of nodes and of tests
  const char *key, *profile;
  const char* place;         ///< with FOLDER or PORT
  const char* measuring;     ///< a profile with a sensor at the supply
  const char *part, *other;  ///< of the scene, and what would make it another regulator
  bool names_unit;           ///< in its answers
};
inline constexpr LineKind kLineKinds[] = {
    {"serial", "ascii_serial", "generic", "device: FOLDER/line, addresses: [0, 1, 2]",
     R"({baud: 115200, terminator: lf, unit: kPa, unit_word: kPa, write: "p{address}={pressure}",
   write_reply: "p{address}={pressure} {unit} of {supply}", read: "p{address}?",
   reply: "p{address}={pressure} {unit} of {supply}", vent: "p{address}=vent",
   vent_reply: "p{address}={pressure} {unit} of {supply}"})",
     "addresses: [0, 1, 2]", "addresses: [2, 1, 0]", true},
    {"modbus", "modbus_tcp", "festo_vtem", "host: 127.0.0.1, port: PORT",
     R"({count_pa: 100, highest_count: 10000, outputs: {first: 10, stride: 1, pressure: 0},
   inputs: {first: 100, stride: 1, pressure: 0, registers: holding}, supply: 99})",
     "profile: festo_vtem", "profile: festo_mpa", false}};
inline const LineKind& kindOf(Line line) { return kLineKinds[static_cast<int>(line)]; }
inline std::string nameOf(Line line) { return kindOf(line).name; }

/// An emulated pressure regulator, whichever line it is on.
class EmulatedRegulator {
 public:
  static constexpr int kChannels = 3;
  enum class Extra {
    kNone,
    kSupplySensor,  ///< and the scene has a least supply
    kWatchdog,      ///< that of its profile; without it what vents it is ours
  };

  explicit EmulatedRegulator(Line line, Extra extra = Extra::kNone)
      : measures_supply_(extra == Extra::kSupplySensor) {
    // The profile is the scene's: what the driver speaks, the device does.
    const io::Scene scene = io::loadScene(TemporaryFile(sceneText(line, 1)).path());
    simulation::EmulatedDeviceConfig device = placed({*scene.regulator, kChannels, {}}, folder_);
    auto* const serial = std::get_if<regulator::SerialConfig>(&device.regulator);
    if (serial != nullptr && extra != Extra::kWatchdog) {
      serial->profile.watchdog = std::numeric_limits<double>::infinity();
    }
    device.valves.time_constant = kLag / 2;
    device.valves.noise = kNoise;
    device_ = std::make_unique<simulation::EmulatedDevice>(device);
    scene_.emplace(sceneText(line, device_->port()));
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
  std::string regulatorText(Line line, int port) const {
    const LineKind& kind = kindOf(line);
    const std::string key = kind.key, own = folder_ / "profile.yaml";
    if (measures_supply_) std::ofstream(own) << key << ":\n  " << kind.measuring << "\n";
    const std::string place = std::regex_replace(kind.place, std::regex("FOLDER"), folder_.path());
    return key + ": {profile: " + (measures_supply_ ? own : kind.profile) + ", " +
           std::regex_replace(place, std::regex("PORT"), std::to_string(port)) + "}";
  }

  std::string sceneText(Line line, int port) const {
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
  )" + regulatorText(line, port) +
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

  const bool measures_supply_;
  TemporaryFolder folder_;
  std::unique_ptr<simulation::EmulatedDevice> device_;
  std::optional<TemporaryFile> scene_;
};

}  // namespace helix_arm::test
