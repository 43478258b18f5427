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

}  // namespace helix_arm::control
