#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "basics/mutex.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/regulator/config.hpp"

namespace helix_arm::simulation {

/// Faults that an emulated pressure regulator, or the arm behind it, can be given.
enum class DeviceFault {
  kNone,
  kSilence,     ///< accepts nothing and answers nothing
  kGarbage,     ///< answers with random bytes
  kHalfLine,    ///< answers are cut short
  kWrongUnit,   ///< has a unit other than its profile's
  kSlow,        ///< answers later than the profile's timeout
  kRestart,     ///< drops the link once and comes back vented, without fault
  kNanText,     ///< answers "nan", or the register value of a broken sensor
  kStuckValue,  ///< answers the readings of the start of the fault; the true pressures change
  kBurst,       ///< this and the following: as regulator::AirFault
  kStuckOpen,
  kStuckShut,
  kLowSupply,
};
inline constexpr int kDeviceFaultCount = 13;  ///< number of values

/// "none", "silence", "garbage", "half_line", "wrong_unit", "slow", "restart", "nan_text",
/// "stuck_value", "burst", "stuck_open", "stuck_shut" or "low_supply".
const char* nameOf(DeviceFault fault);
/// All names, separated by commas.
std::string deviceFaultNames();
/// The fault with this name; nothing if there is none.
std::optional<DeviceFault> parseDeviceFault(const std::string& name);

/// Configuration of an emulated regulator.
struct EmulatedDeviceConfig {
  /// Configuration for its driver: not simulated. On a serial line, `device` is a symlink to it
  /// that is removed at the end; empty: none. An existing symlink is replaced, unless it points to
  /// an existing pseudo terminal. A port is of 127.0.0.1; 0: any free one. Slots are ignored.
  regulator::Config regulator;
  int channels = 1;  ///< of the device, >= 1; of Modbus, the last slot has all of its outlets
  regulator::SimulatedRegulatorConfig valves;  ///< dynamics of its valves
  double period = 0.02;                        ///< period of unsolicited lines, > 0 [s]
  double activation_time = 0.02;               ///< time that an app takes to start, >= 0 [s]
  std::uint32_t seed = 1;                      ///< seed of the garbage
};

class Emulation;

/// Emulates a pressure regulator in its own thread: speaks the device's side of a profile, follows
/// its set points by the steady clock, and produces faults on demand. Starts vented. All members
/// are thread-safe.
///
/// On a serial line it is at the other end of a pseudo terminal. Once closed, or vented by a line
/// that is not a set point, it accepts set points but follows them only after a resume line, if the
/// profile has such lines. It sends unsolicited lines only after the last of the profile's start
/// lines. It vents by itself if the profile has a watchdog.
///
/// With Modbus TCP it is a server on 127.0.0.1 for several connections. A device with apps starts
/// not ready, regulates once it is acknowledged and commanded to, and keeps its air while no app
/// runs. When the last connection is closed, by either side, its outputs are reset, which ends its
/// apps; a device without apps continues as commanded. Access to registers that it does not have is
/// refused, and so are writes to its inputs. A pressure beyond a register's range reads as the
/// limit of the range.
///
/// Faults: kHalfLine omits the second half of every answer; kGarbage replaces it by random bytes;
/// kWrongUnit takes and answers numbers in another unit; registers are still written in the
/// profile's, and read a tenth (kPa for millibar); kNanText reads
/// regulator::kNoReading in registers; kSlow answers after two and a half times the profile's
/// timeout, one after the other, and what is still owed at once when the fault ends. kRestart gives
/// a terminal another path, and closes all sockets for a moment. After kSilence, all sockets are
/// closed and what was sent meanwhile is lost.
class EmulatedDevice {
 public:
  /// @throws std::invalid_argument naming the value and its rule.
  /// @throws std::runtime_error if the system provides no terminal, the link cannot be made (the
  /// message names the other terminal if the link points to one), or the port is in use.
  explicit EmulatedDevice(const EmulatedDeviceConfig& config);
  ~EmulatedDevice();
  EmulatedDevice(const EmulatedDevice&) = delete;
  EmulatedDevice& operator=(const EmulatedDevice&) = delete;

  /// Path to connect to: the link, or the terminal's own path, which a restart changes.
  std::string path() const;
  int port() const;  ///< of Modbus

  /// Takes effect with the next request; kRestart takes effect immediately and then counts as
  /// kNone.
  void setFault(DeviceFault fault);
  DeviceFault fault() const;
  /// Gives a slot with an app a fault that cannot be acknowledged: its app ends and does not start.
  void jam(int slot, bool jammed);

  Eigen::VectorXd pressure() const;            ///< (channels) true, gauge, now [Pa]
  Eigen::VectorXd setPoint() const;            ///< (channels) last taken, gauge [Pa]
  std::vector<control::Valve> valves() const;  ///< (channels)
  std::uint64_t taken() const;     ///< number of lines understood, or of writes accepted
  std::uint64_t restarts() const;  ///< number of completed restarts
  int connections() const;         ///< number of open ones, of Modbus
  /// Time of the last set points, as regulator::steadyNow(); -infinity before the first [s].
  double lastSetTime() const;

 private:
  template <class Ask>
  auto ask(const Ask& ask) const;
  void run();

  mutable basics::Mutex mutex_;
  const std::unique_ptr<Emulation> emulation_ HELIX_ARM_GUARDED_BY(mutex_);
  bool ended_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  const int wake_;  // event counter: a new fault, or the end
  std::thread thread_;
};

}  // namespace helix_arm::simulation
