#include "helix_arm/regulator/simulated_driver.hpp"

#include "helix_arm/regulator/regulator_io.hpp"

namespace helix_arm::regulator {

SimulatedDriver::SimulatedDriver(int channels, const SimulatedRegulatorConfig& config)
    : regulator_(channels, config),
      valve_(static_cast<std::size_t>(channels), control::Valve::kVent),
      set_point_(Eigen::VectorXd::Zero(channels)),
      time_(steadyNow()) {}

void SimulatedDriver::connect() { vent(); }

void SimulatedDriver::write(const control::ValveOrders& orders) {
  catchUp();
  for (Eigen::Index i = 0; i < set_point_.size(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    const bool closes = orders.valve[k] == control::Valve::kClose;
    if (orders.valve[k] == control::Valve::kVent) set_point_[i] = 0;
    if (orders.valve[k] == control::Valve::kRegulate) set_point_[i] = orders.set_point[i];
    // A closed channel without leaks keeps its pressure.
    if (closes && valve_[k] != control::Valve::kClose) set_point_[i] = regulator_.pressure()[i];
    valve_[k] = orders.valve[k];
  }
  regulator_.command(set_point_);
}

void SimulatedDriver::read(Pressures& pressures) {
  catchUp();
  pressures.pressure = regulator_.measure();
  pressures.supply = regulator_.supply();
}

void SimulatedDriver::vent() {
  catchUp();
  valve_.assign(valve_.size(), control::Valve::kVent);
  set_point_.setZero();
  regulator_.command(set_point_);
}

void SimulatedDriver::catchUp() {
  const double now = steadyNow();
  regulator_.step(now - time_);
  time_ = now;
}

}  // namespace helix_arm::regulator
