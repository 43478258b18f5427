#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <random>

namespace helix_arm::regulator {

class Driver;
struct DeviceFacts;

/// Pneumatic fault behind a simulated regulator.
enum class AirFault : std::uint8_t {
  kNone,
  kBurst,      ///< the first muscle has burst and holds no pressure
  kStuckOpen,  ///< the first inlet stays open: the channel goes to the supply pressure
  kStuckShut,  ///< the first valve stays shut: the channel keeps its pressure
  kLowSupply,  ///< the supply falls to a tenth; pressures above it stay
};

/// Configuration of a simulated regulator.
struct SimulatedRegulatorConfig {
  static constexpr const char* kKind = "simulated";  ///< key in a scene
  double time_constant = 0.1;                        ///< first-order lag of every channel, > 0 [s]
  double supply_pressure = 5e5;                      ///< gauge, > 0; no channel rises above it [Pa]
  double noise = 5e3;      ///< standard deviation of the measurement, >= 0 [Pa]
  std::uint32_t seed = 1;  ///< of the noise
  /// Lag where the pressure falls, > 0 [s]; absent: as where it rises.
  std::optional<double> fall_time_constant = std::nullopt;
  double dead_time = 0.0;  ///< of line and valve, until a set point has an effect, >= 0 [s]

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
  DeviceFacts facts() const;
  /// Its driver follows the steady clock and its link never fails.
  /// @throws std::invalid_argument as SimulatedRegulator.
  std::unique_ptr<Driver> makeDriver(int channels) const;
};

/// Pressure channels that follow their set points with a lag, not above the supply, measured with
/// noise.
///
/// dp/dt = (min(p_set, max(p_supply, p)) - p) / tau, integrated exactly: the result does not depend
/// on the step size. p_set has an effect after the dead time. It has no clock; its time is the sum
/// of the steps. The same seed and calls give the same measurements.
class SimulatedRegulator {
 public:
  /// Starts vented: set points and pressures are 0.
  ///
  /// @param channels  >= 1.
  /// @throws std::invalid_argument naming the value and its rule.
  SimulatedRegulator(int channels, const SimulatedRegulatorConfig& config);

  /// Sets the set points: (channels) gauge, finite; a set point below
  /// that of a vacuum counts as one [Pa].
  /// @throws std::invalid_argument on a wrong size or a value that is not finite; the old set
  /// points stay.
  void command(const Eigen::Ref<const Eigen::VectorXd>& set_point);

  /// Advances time by dt >= 0 [s].
  /// @throws std::invalid_argument if dt is negative or NaN.
  void step(double dt);

  /// Sets the fault; kNone removes it.
  void fail(AirFault fault) { fault_ = fault; }

  /// Supply pressure, gauge [Pa].
  double supply() const;
  /// True pressures (channels), gauge [Pa].
  const Eigen::VectorXd& pressure() const { return pressure_; }

  /// One noisy reading (channels), gauge, may be below 0 [Pa]; each call draws anew.
  Eigen::VectorXd measure();

 private:
  SimulatedRegulatorConfig config_;
  AirFault fault_ = AirFault::kNone;
  // A set point on its way through line and valve.
  struct Coming {
    double time;  // when it has an effect
    Eigen::VectorXd set_point;
  };
  void advance(double dt);

  double time_ = 0.0;          // sum of the steps [s]
  std::deque<Coming> coming_;  // in order of their times
  Eigen::VectorXd set_point_;  // in effect
  Eigen::VectorXd pressure_;
  std::mt19937_64 generator_;
  std::normal_distribution<double> normal_;
};

}  // namespace helix_arm::regulator
