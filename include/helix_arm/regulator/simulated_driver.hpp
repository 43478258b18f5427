#pragma once

#include "helix_arm/regulator/driver.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"

namespace helix_arm::regulator {

/// Driver of a simulated regulator. It follows the steady clock and its link never fails.
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
  double time_;  ///< time up to which it was simulated, steady clock [s]
};

}  // namespace helix_arm::regulator
