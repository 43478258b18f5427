#pragma once

#include <array>
#include <vector>

namespace helix_arm::test {

/// Faults of one channel's hardware.
enum class ChannelFault {
  kNone,
  kInletStuckOpen,
  kInletStuckShut,
  kOutletStuckOpen,
  kOutletStuckShut,
  kSensorOpen,             ///< the signal wire is off: the board's resistor pulls it to ground
  kSensorShortedToGround,  ///< or without its supply
  kSensorShortedToSupply,  ///< or without its ground
  kSensorBlocked,          ///< it keeps telling the pressure of the start of the fault
  kSensorDrifts,           ///< it tells ever less, down to 25 kPa too little
  kLeak,                   ///< a hole as wide as a tenth of the outlet
};

/// What drives one channel: mean levels of its pins over a step, 0 to 1.
struct ValveDrive {
  double inlet = 0, outlet = 0;
};

/// Muscles behind the valves of a board, and the sensors that look at them.
///
/// A supply valve fills or empties the manifold in front of all inlets. Every flow is first order:
/// dp/dt = x (p_from - p) / tau, where the opening x of a valve follows from its current, which
/// lags behind its drive. Inlet and supply valve are shut and the outlet is open without current.
class Pneumatics {
 public:
  struct Config {
    double supply = 5e5;          ///< gauge [Pa]
    double fill_time = 0.25;      ///< of a muscle through its inlet [s]
    double vent_time = 0.2;       ///< of a muscle through its outlet [s]
    double manifold_time = 0.02;  ///< both ways [s]
    double valve_time = 0.003;    ///< lag of a current [s]
  };

  /// @param proportional  whether the inlets are proportional valves, which begin to open at a
  ///     drive of 0.3; else they are solenoids.
  Pneumatics(int channels, const Config& config, bool proportional);

  /// @param drives  (channels).
  /// @param supply  mean level of the supply valve's pin, 0 to 1.
  void step(double dt, const std::vector<ValveDrive>& drives, double supply);

  /// At once, instead of what it had; two are faults of different parts.
  void fail(int channel, ChannelFault fault, ChannelFault another = ChannelFault::kNone);
  void setSupply(double pressure) { config_.supply = pressure; }

  double pressure(int channel) const { return channels_.at(channel).pressure; }  ///< gauge [Pa]
  /// Highest pressure of any muscle so far, or since forgetPeak() [Pa].
  double peak() const { return peak_; }
  void forgetPeak() { peak_ = 0; }
  /// Output of a channel's sensor as a share of its supply voltage: 0.1 to 0.9 for 0 to 700 kPa.
  double sensor(int channel) const;

 private:
  struct Channel {
    double pressure = 0;           // [Pa]
    double inlet = 0, outlet = 0;  // currents, 0 to 1
    std::array<ChannelFault, 2> faults{};
    double blocked_at = 0, drift = 0;  // [Pa]

    bool has(ChannelFault fault) const { return faults[0] == fault || faults[1] == fault; }
  };
  double opening(double current) const;

  Config config_;
  const bool proportional_;
  std::vector<Channel> channels_;
  double manifold_ = 0, supply_valve_ = 0, peak_ = 0;
};

}  // namespace helix_arm::test
