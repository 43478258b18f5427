#include "helix_arm/control/pressure_observer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/target_check.hpp"

namespace helix_arm::control {
namespace {

constexpr char kObserver[] = "pressure observer";
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
constexpr int kMostMoments = 4096;      // more than kMemory of readings at 1000 Hz
constexpr double kRestlessness = 50.0;  // per turn, deviation of what the lag does not model [Pa]
// How far ahead of the readings it looks: at least so much, and so many of their periods.
constexpr double kPatience = 0.05;  // [s]
constexpr double kPatientPeriods = 1.5;
constexpr double kMostPatience = 1.0;    // [s]
constexpr double kLagUncertainty = 0.2;  // of a change that the lag predicts

// Not so if it is NaN.
bool isPressure(double value) { return kPossibleReading.contains(value); }

}  // namespace

PressureObserver::PressureObserver(int channels, double time_constant, double noise)
    : time_constant_(time_constant), noise_(noise) {
  basics::requireValue(channels >= 1, kObserver, "the number of channels", channels, "at least 1");
  basics::requirePositive(kObserver, "the time constant [s]", time_constant);
  basics::requirePositive(kObserver, "the noise of readings [Pa]", noise);
  now_ = {Eigen::VectorXd::Zero(channels), Eigen::VectorXd::Zero(channels)};
  set_point_ = Eigen::VectorXd::Constant(channels, kUnknown);
  history_.assign(kMostMoments, {0.0, now_});
}

void PressureObserver::restart() { count_ = 0; }

double PressureObserver::time() const { return moment(0).time; }
double PressureObserver::earliest() const { return moment(count_ - 1).time; }

const PressureObserver::Moment& PressureObserver::moment(int age) const {
  return history_[static_cast<std::size_t>((newest_ - age + kMostMoments) % kMostMoments)];
}

void PressureObserver::remember(double time) {
  newest_ = (newest_ + 1) % kMostMoments;
  Moment& next = history_[static_cast<std::size_t>(newest_)];
  next.time = time;
  next.estimate = now_;
  count_ = std::min(count_ + 1, kMostMoments);
  while (count_ > 2 && moment(count_ - 2).time <= time - kMemory) --count_;
}

void PressureObserver::predict(double dt, Estimate& estimate) const {
  const double share = -std::expm1(-dt / time_constant_);
  for (Eigen::Index i = 0; i < set_point_.size(); ++i) {
    double& p = estimate.pressure[i];
    double& V = estimate.variance[i];
    const double move = isPressure(set_point_[i]) ? share * (set_point_[i] - p) : 0.0;
    p += move;
    const double unsure = kLagUncertainty * move;
    V = (1 - share) * (1 - share) * V + unsure * unsure + kRestlessness * kRestlessness;
  }
}

bool PressureObserver::ahead(double time, Estimate& out) const {
  if (count_ == 0) return false;
  const double period = count_ > 1 ? moment(0).time - moment(1).time : 0.0;
  const double dt = time - moment(0).time;
  if (!(dt >= 0 && dt <= std::min(std::max(kPatience, kPatientPeriods * period), kMostPatience))) {
    return false;
  }
  out = now_;
  predict(dt, out);
  return true;
}

void PressureObserver::update(double time, const Eigen::VectorXd& set_point,
                              const Eigen::VectorXd& reading) {
  if (count_ > 0 && time < moment(0).time) restart();
  if (count_ == 0) {
    set_point_.setConstant(kUnknown);
    if (!std::all_of(reading.begin(), reading.end(), isPressure)) return;
    now_.pressure = reading;
    now_.variance.setConstant(noise_ * noise_);
    return remember(time);
  }
  const double dt = time - moment(0).time;
  if (dt == 0) return;
  set_point_ = set_point;
  predict(dt, now_);
  for (Eigen::Index i = 0; i < reading.size(); ++i) {
    if (!isPressure(reading[i])) continue;
    double& p = now_.pressure[i];
    double& V = now_.variance[i];
    const double gain = V / (V + noise_ * noise_);
    p += gain * (reading[i] - p);
    V *= 1 - gain;
  }
  remember(time);
}

bool PressureObserver::at(double time, Estimate& out) const {
  if (count_ == 0 || !(time <= moment(0).time) || !(time >= moment(count_ - 1).time)) return false;
  int age = 0;
  while (age + 1 < count_ && moment(age).time > time) ++age;
  const Moment& before = moment(age);
  const Moment& after = moment(std::max(age - 1, 0));
  const double span = after.time - before.time;
  const double share = span > 0 ? (time - before.time) / span : 0.0;
  out.pressure =
      before.estimate.pressure + share * (after.estimate.pressure - before.estimate.pressure);
  out.variance =
      before.estimate.variance + share * (after.estimate.variance - before.estimate.variance);
  return true;
}

}  // namespace helix_arm::control
