#include "helix_arm/regulator/simulated_regulator.hpp"

#include <cmath>

#include "helix_arm/basics/number_requirement.hpp"

namespace helix_arm::regulator {
namespace {

constexpr char kCulprit[] = "simulated regulator";
constexpr double kLowSupply = 0.1;  // of the supply

void require(bool holds, const char* what, double value, const char* rule) {
  basics::requireValue(holds, kCulprit, what, value, rule);
}

int requireChannels(int channels) {
  require(channels >= 1, "the number of channels", channels, "at least 1");
  return channels;
}

}  // namespace

void SimulatedRegulatorConfig::validate() const {
  basics::requirePositive(kCulprit, "the time constant [s]", time_constant);
  basics::requirePositive(kCulprit, "the supply pressure [Pa]", supply_pressure);
  basics::requireNotNegative(kCulprit, "the noise [Pa]", noise);
}

SimulatedRegulator::SimulatedRegulator(int channels, const SimulatedRegulatorConfig& config)
    : config_(config),
      set_point_(Eigen::VectorXd::Zero(requireChannels(channels))),
      pressure_(Eigen::VectorXd::Zero(channels)),
      generator_(config.seed) {
  config_.validate();
}

void SimulatedRegulator::command(const Eigen::Ref<const Eigen::VectorXd>& set_point) {
  require(set_point.size() == pressure_.size(), "the number of set points",
          static_cast<double>(set_point.size()), "one per channel");
  for (int i = 0; i < set_point.size(); ++i) {
    require(std::isfinite(set_point[i]), "a set point [Pa]", set_point[i], "a finite value");
  }
  set_point_ = set_point.cwiseMax(0.0);
}

void SimulatedRegulator::step(double dt) {
  require(dt >= 0, "the time step [s]", dt, "a value >= 0");
  const double covered = -std::expm1(-dt / config_.time_constant);  // exact also for tiny steps
  const double first = pressure_[0];
  // Pressure above the supply does not flow back.
  pressure_ += covered * (set_point_.cwiseMin(pressure_.cwiseMax(supply())) - pressure_);
  if (fault_ == AirFault::kBurst) pressure_[0] = (1 - covered) * first;
  if (fault_ == AirFault::kStuckOpen) pressure_[0] = first + covered * (supply() - first);
  if (fault_ == AirFault::kStuckShut) pressure_[0] = first;
}

double SimulatedRegulator::supply() const {
  return fault_ == AirFault::kLowSupply ? kLowSupply * config_.supply_pressure
                                        : config_.supply_pressure;
}

Eigen::VectorXd SimulatedRegulator::measure() {
  Eigen::VectorXd reading = pressure_;
  for (int i = 0; i < reading.size(); ++i) reading[i] += config_.noise * normal_(generator_);
  return reading;
}

}  // namespace helix_arm::regulator
