#pragma once

#include <string>

namespace helix_arm::control {

/// Grants one commander at a time the right to command the arm: the first to send a command keeps
/// it until it is silent for the timeout. Times are seconds on any steady clock.
class CommanderLease {
 public:
  /// @param timeout  silence after which another commander may take over, > 0 [s].
  /// @throws std::invalid_argument when timeout is not finite and > 0.
  explicit CommanderLease(double timeout);

  /// True if `commander` may command at `now` [s]; if so, grants or renews the lease.
  bool claim(const std::string& commander, double now);

  /// Holder of the lease, empty before the first claim. An expired lease still names its last
  /// holder.
  const std::string& holder() const { return holder_; }
  double timeout() const { return timeout_; }

 private:
  double timeout_;
  std::string holder_;
  double last_claim_ = 0.0;
};

/// Refuses the targets of the commander whose arm was brought to rest by somebody else until it has
/// paused: it may not know of the rest yet. Times are seconds on any steady clock.
class RestedCommander {
 public:
  /// @param commander  whose targets the arm followed; empty: nobody.
  void hold(const std::string& commander, double now);
  /// Lets everybody command.
  void release() { commander_.clear(); }
  /// As release(), if it is `commander` that knows of the rest.
  void acknowledge(const std::string& commander);

  /// Whether the target of a commander at `now` [s] is to be refused; each of them restarts the
  /// pause [s].
  bool refuses(const std::string& commander, double now, double pause);

 private:
  std::string commander_;  ///< empty: nobody
  double last_try_ = 0.0;
};

}  // namespace helix_arm::control
