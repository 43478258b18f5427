#include "helix_arm/regulator/simulated_regulator.hpp"

#include <algorithm>
#include <cmath>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/regulator/config.hpp"
#include "regulator_io.hpp"

namespace helix_arm::regulator {
namespace {

constexpr char kCulprit[] = "simulated regulator";
constexpr double kLowSupply = 0.1;      // of the supply
constexpr double kVacuum = -101.325e3;  // gauge [Pa]

void require(bool holds, const char* what, double value, const char* rule) {
  basics::requireValue(holds, kCulprit, what, value, rule);
}

int requireChannels(int channels) {
  require(channels >= 1, "the number of channels", channels, "at least 1");
  return channels;
}

class SimulatedDriver : public Driver {
 public:
  SimulatedDriver(int channels, const SimulatedRegulatorConfig& config)
      : regulator_(channels, config),
        valve_(static_cast<std::size_t>(channels), control::Valve::kVent),
        set_point_(Eigen::VectorXd::Zero(channels)) {}

  void connect() override { vent(); }

  void write(const control::ValveOrders& orders) override {
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

  void read(Pressures& pressures) override {
    catchUp();
    pressures.pressure = regulator_.measure();
    pressures.supply = regulator_.supply();
  }

  void vent() override {
    catchUp();
    valve_.assign(valve_.size(), control::Valve::kVent);
    set_point_.setZero();
    regulator_.command(set_point_);
  }

  void close() noexcept override {}

 private:
  void catchUp() {
    const double now = steadyNow();
    regulator_.step(now - time_);
    time_ = now;
  }

  SimulatedRegulator regulator_;
  std::vector<control::Valve> valve_;
  Eigen::VectorXd set_point_;
  double time_ = steadyNow();  // up to which it was simulated [s]
};

}  // namespace

void SimulatedRegulatorConfig::validate() const {
  basics::requirePositive(kCulprit, "the time constant [s]", time_constant);
  basics::requirePositive(kCulprit, "the supply pressure [Pa]", supply_pressure);
  basics::requireNotNegative(kCulprit, "the noise [Pa]", noise);
  basics::requirePositive(kCulprit, "the fall time constant [s]",
                          fall_time_constant.value_or(time_constant));
  basics::requireNotNegative(kCulprit, "the dead time [s]", dead_time);
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
  if (config_.dead_time == 0) {
    set_point_ = set_point.cwiseMax(kVacuum);
  } else {
    // Repeated in one instant, the last one counts.
    const double time = time_ + config_.dead_time;
    if (coming_.empty() || coming_.back().time < time) coming_.push_back({time, {}});
    coming_.back().set_point = set_point.cwiseMax(kVacuum);
  }
}

void SimulatedRegulator::step(double dt) {
  require(dt >= 0, "the time step [s]", dt, "a value >= 0");
  const double end = time_ + dt;
  for (; !coming_.empty() && coming_.front().time <= end; coming_.pop_front()) {
    const double wait = std::max(coming_.front().time - time_, 0.0);
    advance(wait);
    dt = std::max(dt - wait, 0.0);
    set_point_ = coming_.front().set_point;
  }
  // A step without end settles the pressures, but time goes on from the last set point.
  const double last = time_;
  advance(dt);
  time_ = std::isfinite(end) ? end : last;
}

void SimulatedRegulator::advance(double dt) {
  const auto covered = [dt](double time_constant) {
    return -std::expm1(-dt / time_constant);  // exact also for tiny steps
  };
  const double rises = covered(config_.time_constant);
  const double falls = covered(config_.fall_time_constant.value_or(config_.time_constant));
  const double first = pressure_[0];
  for (double& pressure : pressure_) {
    const double set_point = set_point_[&pressure - pressure_.data()];
    // Pressure above the supply does not flow back.
    const double goal = std::min(set_point, std::max(pressure, supply()));
    pressure += (goal > pressure ? rises : falls) * (goal - pressure);
  }
  if (fault_ == AirFault::kBurst) pressure_[0] = (1 - falls) * first;
  if (fault_ == AirFault::kStuckOpen) {
    pressure_[0] = first + (supply() > first ? rises : falls) * (supply() - first);
  }
  if (fault_ == AirFault::kStuckShut) pressure_[0] = first;
  time_ += dt;
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

DeviceFacts SimulatedRegulatorConfig::facts() const {
  DeviceFacts facts{kKind};
  facts.closes_valves = true;
  return facts;
}

std::unique_ptr<Driver> SimulatedRegulatorConfig::makeDriver(int channels) const {
  return std::make_unique<SimulatedDriver>(channels, *this);
}

}  // namespace helix_arm::regulator
