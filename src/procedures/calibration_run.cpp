#include "helix_arm/procedures/calibration_run.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::procedures {
namespace {

constexpr double kSamePressure = 1.0;  // commands are rounded in messages [Pa]
// After a pause of the caller, a ramp continues without a jump.
constexpr double kLongestStep = 0.1;  // [s]

constexpr std::array<const char*, 4> kPhases = {"ramping", "settling", "returning", "ended"};

void requirePositive(const char* what, double value) {
  basics::requirePositive("a calibration run", what, value);
}

}  // namespace

const char* nameOf(RunPhase phase) { return kPhases[static_cast<std::size_t>(phase)]; }

void RunRules::validate() const {
  basics::requireValue(captures >= 1 && captures <= kMaxCaptures, "a calibration run", "captures",
                       captures, "1 to 5 per pressure");
  requirePositive("ramp", ramp);
  requirePositive("patience", patience);
}

CalibrationRun::CalibrationRun(Eigen::MatrixXd plan, Eigen::VectorXd from, Eigen::VectorXd rest,
                               const RunRules& rules)
    : plan_(std::move(plan)), pressure_(std::move(from)), rest_(std::move(rest)), rules_(rules) {
  rules_.validate();
  basics::require(plan_.rows() >= 1, "a calibration run without steps; expected at least one");
  basics::require(plan_.cols() == pressure_.size() && plan_.cols() == rest_.size(), "a plan of ",
                  plan_.cols(), " actuators, from ", pressure_.size(), " pressures to ",
                  rest_.size(), "; expected those of one arm");
  basics::require(plan_.allFinite() && pressure_.allFinite() && rest_.allFinite(),
                  "a calibration run with pressures that are not finite");
}

bool CalibrationRun::rampTo(const Eigen::VectorXd& target, double dt) {
  const double most = rules_.ramp * dt;
  pressure_ += (target - pressure_).cwiseMax(-most).cwiseMin(most);
  return pressure_ == target;
}

bool CalibrationRun::obeys(const Settling& settling) const {
  return settling.set_point &&
         (*settling.set_point - pressure_).cwiseAbs().maxCoeff() < kSamePressure;
}

void CalibrationRun::lookAt(double now, const Settling& settling, Order& order) {
  const bool obeyed = obeys(settling);
  if (obeyed && settling.settled() && settling.last->time > last_capture_) {
    last_capture_ = settling.last->time;
    settling_since_ = now;
    order.capture = settling.last;
    order.step_done = ++captures_ == rules_.captures;
  } else if (now - settling_since_ > rules_.patience) {
    end(RunEnd::kAborted,
        "step " + std::to_string(step_ + 1) + " has not settled within " +
            std::to_string(std::lround(rules_.patience)) + " s: " +
            (obeyed ? settling.reason : "pressure_command does not follow pressure_target"));
  }
  if (!order.step_done) return;
  captures_ = 0;
  if (step_ + 1 == steps()) {
    end(RunEnd::kCompleted, "");
  } else {
    ++step_;
    phase_ = RunPhase::kRamping;
  }
}

void CalibrationRun::watchPictures(double now, const Settling& settling) {
  const bool under_way = phase_ == RunPhase::kRamping || phase_ == RunPhase::kSettling;
  if (!under_way || !settling.unseen()) {
    unseen_since_.reset();
    return;
  }
  if (!unseen_since_) unseen_since_ = now;
  if (phase_ == RunPhase::kSettling || now - *unseen_since_ <= rules_.patience) return;
  unseen_since_.reset();
  end(RunEnd::kAborted, "step " + std::to_string(step_ + 1) + " has waited for pictures for " +
                            std::to_string(std::lround(rules_.patience)) +
                            " s (~patience_s): " + settling.reason);
}

CalibrationRun::Order CalibrationRun::advance(double now, const Settling& settling) {
  if (last_time_ && now < *last_time_) {
    end(RunEnd::kAborted, "time went back by " + std::to_string(*last_time_ - now) +
                              " s; was a clock set, or the node that publishes /clock restarted?");
  }
  const double dt = last_time_ ? std::clamp(now - *last_time_, 0.0, kLongestStep) : 0.0;
  last_time_ = now;
  if (settling.state == SettleState::kStale) end(RunEnd::kAborted, settling.reason);
  watchPictures(now, settling);
  Order order;
  const bool ramps = phase_ == RunPhase::kRamping && !waitsForPictures();
  if (ramps && rampTo(plan_.row(step_).transpose(), dt)) {
    phase_ = RunPhase::kSettling;
    settling_since_ = now;
  } else if (phase_ == RunPhase::kSettling) {
    lookAt(now, settling, order);
  } else if (phase_ == RunPhase::kReturning && rampTo(rest_, dt)) {
    // A run ends once the command is at rest, since the next one starts from the command.
    if (!returned_at_) returned_at_ = now;
    const bool at_rest =
        settling.state == SettleState::kStale || !settling.set_point || obeys(settling);
    if (at_rest || now - *returned_at_ > rules_.patience) phase_ = RunPhase::kEnded;
  }
  order.pressure = pressure_;
  return order;
}

void CalibrationRun::end(RunEnd verdict, const std::string& reason) {
  const bool done = phase_ == RunPhase::kReturning && verdict_ == RunEnd::kCompleted;
  if (phase_ == RunPhase::kEnded || (phase_ == RunPhase::kReturning && !done)) return;
  phase_ = RunPhase::kReturning;
  verdict_ = verdict;
  reason_ = reason;
}

void CalibrationRun::yield(const std::string& reason) {
  if (phase_ == RunPhase::kRamping || phase_ == RunPhase::kSettling) {
    verdict_ = RunEnd::kAborted;
    reason_ = reason;
  }
  phase_ = RunPhase::kEnded;
}

}  // namespace helix_arm::procedures
