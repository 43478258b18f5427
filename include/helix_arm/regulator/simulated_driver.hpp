#pragma once

#include "helix_arm/regulator/driver.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"

namespace helix_arm::regulator {

/// A simulated regulator behind the interface of the real ones: its time is that of the steady
/// clock, and its line never fails.
class SimulatedDriver : public Driver {
 public:
  /// @throws std::invalid_argument as SimulatedRegulator.
  SimulatedDriver(int channels, const SimulatedRegulatorConfig& config);

  void connect() override;
  void write(const control::ValveOrders& orders) override;
  void read(Pressures& pressures) override;
  void vent() override;
  void close() noexcept override {}

 private:
  void catchUp();

  SimulatedRegulator regulator_;
  std::vector<control::Valve> valve_;
  Eigen::VectorXd set_point_;
  double time_;  ///< up to which it was simulated, of the steady clock [s]
};

}  // namespace helix_arm::regulator
