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
  }
  return "?";
}

std::optional<DeviceFault> parseDeviceFault(const std::string& name) {
  for (int i = 0; i < kDeviceFaultCount; ++i) {
    const auto fault = static_cast<DeviceFault>(i);
    if (name == nameOf(fault)) return fault;
  }
  return std::nullopt;
}

}  // namespace helix_arm::simulation
