#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <random>

namespace helix_arm::regulator {

/// What is wrong behind a simulated regulator.
enum class AirFault : std::uint8_t {
  kNone,
  kBurst,      ///< the first muscle has burst: its air is lost as fast as it comes
  kStuckOpen,  ///< the first inlet stays open: the channel goes to the supply's pressure
  kStuckShut,  ///< the first valve stays shut: the channel keeps what it has
  kLowSupply,  ///< the supply falls to a tenth; what is above it stays
};

/// What a simulated regulator is like.
struct SimulatedRegulatorConfig {
  double time_constant = 0.1;    ///< first-order lag of every channel, > 0 [s]
  double supply_pressure = 5e5;  ///< gauge, > 0; no channel rises above it [Pa]
  double noise = 5e3;            ///< standard deviation of the measurement, >= 0 [Pa]
  std::uint32_t seed = 1;        ///< of the noise

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// Pressure channels that follow their set points as real ones do: late, not above the supply, and
/// seen through noise.
///
/// dp/dt = (min(p_set, max(p_supply, p)) - p) / tau, integrated exactly: the size of the steps does
/// not matter. It has no clock; its time is the sum of the steps. The same seed and calls give the
/// same measurements.
class SimulatedRegulator {
 public:
  /// Starts vented: set points and pressures are 0.
  ///
  /// @param channels  >= 1.
  /// @throws std::invalid_argument naming the value and its rule.
  SimulatedRegulator(int channels, const SimulatedRegulatorConfig& config);

  /// Sets what the channels follow from now on: (channels) gauge, finite; below 0 counts as 0 [Pa].
  /// @throws std::invalid_argument on a wrong size or a value that is not finite; the old set
  /// points stay.
  void command(const Eigen::Ref<const Eigen::VectorXd>& set_point);

  /// Advances time by dt >= 0 [s].
  /// @throws std::invalid_argument when dt is negative or not a number.
  void step(double dt);

  /// From now on this is wrong; kNone: it is mended.
  void fail(AirFault fault) { fault_ = fault; }

  /// Of the supply, gauge [Pa].
  double supply() const;
  /// True pressures (channels), gauge [Pa].
  const Eigen::VectorXd& pressure() const { return pressure_; }

  /// One noisy reading (channels), gauge, may be below 0 [Pa]; each call draws anew.
  Eigen::VectorXd measure();

 private:
  SimulatedRegulatorConfig config_;
  AirFault fault_ = AirFault::kNone;
  Eigen::VectorXd set_point_;
  Eigen::VectorXd pressure_;
  std::mt19937_64 generator_;
  std::normal_distribution<double> normal_;
};

}  // namespace helix_arm::regulator
