#pragma once

#include <string>

namespace helix_arm::control {

/// Who may command the arm: the first to speak keeps it until silent for the timeout. Time is a
/// number, any steady clock's.
class CommanderLease {
 public:
  /// @param timeout  silence after which another commander may take over, > 0 [s].
  /// @throws std::invalid_argument when timeout is not finite and > 0.
  explicit CommanderLease(double timeout);

  /// True when `commander` may command at `now` [s]; grants or renews the lease as it does.
  bool claim(const std::string& commander, double now);

  /// Who holds the lease, empty before the first claim; an expired lease still names its last
  /// holder.
  const std::string& holder() const { return holder_; }
  double timeout() const { return timeout_; }

 private:
  double timeout_;
  std::string holder_;
  double last_claim_ = 0.0;
};

}  // namespace helix_arm::control
