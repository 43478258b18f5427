#include "helix_arm/simulation/device_fault.hpp"

namespace helix_arm::simulation {

const char* nameOf(DeviceFault fault) {
  switch (fault) {
    case DeviceFault::kNone:
      return "none";
    case DeviceFault::kSilence:
      return "silence";
    case DeviceFault::kGarbage:
      return "garbage";
    case DeviceFault::kHalfLine:
      return "half_line";
    case DeviceFault::kWrongUnit:
      return "wrong_unit";
    case DeviceFault::kSlow:
      return "slow";
    case DeviceFault::kRestart:
      return "restart";
    case DeviceFault::kNanText:
      return "nan_text";
    case DeviceFault::kStuckValue:
      return "stuck_value";
    case DeviceFault::kBurst:
      return "burst";
    case DeviceFault::kStuckOpen:
      return "stuck_open";
    case DeviceFault::kStuckShut:
      return "stuck_shut";
    case DeviceFault::kLowSupply:
      return "low_supply";
  }
  return "?";
}

std::string deviceFaultNames() {
  std::string names = nameOf(DeviceFault::kNone);
  for (int i = 1; i < kDeviceFaultCount; ++i) {
    names += std::string(", ") + nameOf(static_cast<DeviceFault>(i));
  }
  return names;
}

std::optional<DeviceFault> parseDeviceFault(const std::string& name) {
  for (int i = 0; i < kDeviceFaultCount; ++i) {
    const auto fault = static_cast<DeviceFault>(i);
    if (name == nameOf(fault)) return fault;
  }
  return std::nullopt;
}

regulator::AirFault airFaultOf(DeviceFault fault) {
  switch (fault) {
    case DeviceFault::kBurst:
      return regulator::AirFault::kBurst;
    case DeviceFault::kStuckOpen:
      return regulator::AirFault::kStuckOpen;
    case DeviceFault::kStuckShut:
      return regulator::AirFault::kStuckShut;
    case DeviceFault::kLowSupply:
      return regulator::AirFault::kLowSupply;
    default:
      return regulator::AirFault::kNone;
  }
}

}  // namespace helix_arm::simulation
