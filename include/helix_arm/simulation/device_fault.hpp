#pragma once

#include <optional>
#include <string>

#include "helix_arm/regulator/simulated_regulator.hpp"

namespace helix_arm::simulation {

/// What an emulated pressure regulator, or the arm behind it, does wrong, on demand.
enum class DeviceFault {
  kNone,
  kSilence,     ///< takes nothing in and answers nothing
  kGarbage,     ///< answers with random bytes
  kHalfLine,    ///< answers end before they are complete
  kWrongUnit,   ///< answers in another unit than its profile says
  kSlow,        ///< answers later than the profile's timeout
  kRestart,     ///< drops the link once, comes back vented, then is well again
  kNanText,     ///< answers "nan", or the register of a sensor that is broken
  kStuckValue,  ///< answers what it read when the fault began; the pressures go on
  kBurst,       ///< and the next ones: as regulator::AirFault
  kStuckOpen,
  kStuckShut,
  kLowSupply,
};
inline constexpr int kDeviceFaultCount = 13;

/// "none", "silence", "garbage", "half_line", "wrong_unit", "slow", "restart", "nan_text",
/// "stuck_value", "burst", "stuck_open", "stuck_shut" or "low_supply".
const char* nameOf(DeviceFault fault);
/// All of them, joined by commas.
std::string deviceFaultNames();
/// The fault of a name; nothing where there is none.
std::optional<DeviceFault> parseDeviceFault(const std::string& name);
/// What of it is wrong with the air; kNone where the device alone is to blame.
regulator::AirFault airFaultOf(DeviceFault fault);

}  // namespace helix_arm::simulation
