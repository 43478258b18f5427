#include "helix_arm/control/commander_lease.hpp"

#include <cmath>
#include <stdexcept>

namespace helix_arm::control {

CommanderLease::CommanderLease(double timeout) : timeout_(timeout) {
  if (!std::isfinite(timeout) || !(timeout > 0)) {
    throw std::invalid_argument("the commander's timeout is " + std::to_string(timeout) +
                                " s; expected a finite value > 0");
  }
}

bool CommanderLease::claim(const std::string& commander, double now) {
  const bool free = holder_.empty() || now - last_claim_ >= timeout_;
  if (!free && commander != holder_) return false;
  holder_ = commander;
  last_claim_ = now;
  return true;
}

void RestedCommander::hold(const std::string& commander, double now) {
  if (commander.empty()) return;
  commander_ = commander;
  last_try_ = now;
}

void RestedCommander::acknowledge(const std::string& commander) {
  if (commander == commander_) release();
}

bool RestedCommander::refuses(const std::string& commander, double now, double pause) {
  if (commander_.empty() || commander != commander_) return false;
  const bool paused = now - last_try_ >= pause;
  last_try_ = now;
  if (paused) release();
  return !paused;
}

}  // namespace helix_arm::control
