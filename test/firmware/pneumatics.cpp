#include "pneumatics.hpp"

#include <algorithm>
#include <cmath>

namespace helix_arm::test {
namespace {

constexpr double kSensorZero = 0.1, kSensorSpan = 0.8, kSensorRange = 7e5;  // ratiometric, [Pa]
constexpr double kProportionalFrom = 0.3;
constexpr double kDriftRate = 2.5e4, kDriftMost = 2.5e4;  // [Pa/s], [Pa]
constexpr double kLeakOpening = 0.1;                      // of the outlet's

// Exact for a constant drive.
void lag(double& value, double goal, double dt, double time) {
  value += -std::expm1(-dt / time) * (goal - value);
}

}  // namespace

Pneumatics::Pneumatics(int channels, const Config& config, bool proportional)
    : config_(config), proportional_(proportional), channels_(static_cast<std::size_t>(channels)) {}

double Pneumatics::opening(double current) const {
  if (!proportional_) return current;
  return std::max(0.0, (current - kProportionalFrom) / (1 - kProportionalFrom));
}

void Pneumatics::step(double dt, const std::vector<ValveDrive>& drives, double supply) {
  lag(supply_valve_, supply, dt, config_.valve_time);
  lag(manifold_, supply_valve_ * config_.supply, dt, config_.manifold_time);
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    Channel& channel = channels_[i];
    lag(channel.inlet, drives[i].inlet, dt, config_.valve_time);
    lag(channel.outlet, drives[i].outlet, dt, config_.valve_time);
    double inlet = opening(channel.inlet), outlet = 1 - channel.outlet;
    if (channel.has(ChannelFault::kInletStuckOpen)) inlet = 1;
    if (channel.has(ChannelFault::kInletStuckShut)) inlet = 0;
    if (channel.has(ChannelFault::kOutletStuckOpen)) outlet = 1;
    if (channel.has(ChannelFault::kOutletStuckShut)) outlet = 0;
    if (channel.has(ChannelFault::kLeak)) outlet += kLeakOpening;
    if (channel.has(ChannelFault::kSensorDrifts)) {
      channel.drift = std::min(channel.drift + kDriftRate * dt, kDriftMost);
    }
    channel.pressure += dt * (inlet * (manifold_ - channel.pressure) / config_.fill_time -
                              outlet * channel.pressure / config_.vent_time);
    peak_ = std::max(peak_, channel.pressure);
  }
}

void Pneumatics::fail(int channel, ChannelFault fault, ChannelFault another) {
  Channel& of = channels_.at(channel);
  of.faults = {fault, another};
  of.blocked_at = of.pressure;
  of.drift = 0;
}

double Pneumatics::sensor(int channel) const {
  const Channel& of = channels_.at(channel);
  for (const ChannelFault fault : of.faults) {
    if (fault == ChannelFault::kSensorOpen || fault == ChannelFault::kSensorShortedToGround)
      return 0;
    if (fault == ChannelFault::kSensorShortedToSupply) return 1;
  }
  const double told = of.has(ChannelFault::kSensorBlocked) ? of.blocked_at : of.pressure;
  return kSensorZero + kSensorSpan * (told - of.drift) / kSensorRange;
}

}  // namespace helix_arm::test
