#pragma once

#include <optional>
#include <string>

#include "helix_arm/regulator/simulated_regulator.hpp"

namespace helix_arm::simulation {

/// Faults that an emulated pressure regulator, or the arm behind it, can be given.
enum class DeviceFault {
  kNone,
  kSilence,     ///< accepts nothing and answers nothing
  kGarbage,     ///< answers with random bytes
  kHalfLine,    ///< answers are cut short
  kWrongUnit,   ///< answers in a unit other than its profile's
  kSlow,        ///< answers later than the profile's timeout
  kRestart,     ///< drops the link once and comes back vented, without fault
  kNanText,     ///< answers "nan", or the register value of a broken sensor
  kStuckValue,  ///< answers the readings of the start of the fault; the true pressures change
  kBurst,       ///< this and the following: as regulator::AirFault
  kStuckOpen,
  kStuckShut,
  kLowSupply,
};
inline constexpr int kDeviceFaultCount = 13;

/// "none", "silence", "garbage", "half_line", "wrong_unit", "slow", "restart", "nan_text",
/// "stuck_value", "burst", "stuck_open", "stuck_shut" or "low_supply".
const char* nameOf(DeviceFault fault);
/// All names, separated by commas.
std::string deviceFaultNames();
/// The fault with this name; nothing if there is none.
std::optional<DeviceFault> parseDeviceFault(const std::string& name);
/// The pneumatic fault behind it; kNone if only the device is faulty.
regulator::AirFault airFaultOf(DeviceFault fault);

}  // namespace helix_arm::simulation
