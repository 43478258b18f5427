#include "helix_arm/basics/text.hpp"
#include "helix_arm/simulation/emulated_device.hpp"

namespace helix_arm::simulation {
namespace {

constexpr const char* kFaultNames[kDeviceFaultCount] = {
    "none",     "silence",     "garbage", "half_line",  "wrong_unit", "slow",      "restart",
    "nan_text", "stuck_value", "burst",   "stuck_open", "stuck_shut", "low_supply"};
static_assert(kFaultNames[kDeviceFaultCount - 1] != nullptr, "each fault has a name");

}  // namespace

const char* nameOf(DeviceFault fault) { return kFaultNames[static_cast<std::size_t>(fault)]; }

std::string deviceFaultNames() { return basics::joined(kFaultNames); }

std::optional<DeviceFault> parseDeviceFault(const std::string& name) {
  for (int i = 0; i < kDeviceFaultCount; ++i) {
    if (name == kFaultNames[i]) return static_cast<DeviceFault>(i);
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
