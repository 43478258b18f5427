#pragma once

#include <cmath>
#include <string>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::control {

/// Grants one commander at a time the right to command the arm: the first to send a command keeps
/// it until it is silent for the timeout. Times are seconds on any steady clock.
class CommanderLease {
 public:
  /// @param timeout  silence after which another commander may take over, > 0 [s].
  /// @throws std::invalid_argument when timeout is not finite and > 0.
  explicit CommanderLease(double timeout) : timeout_(timeout) {
    basics::require(std::isfinite(timeout) && timeout > 0, "the commander's timeout is ",
                    std::to_string(timeout), " s; expected a finite value > 0");
  }

  /// True if `commander` may command at `now` [s]; if so, grants or renews the lease.
  bool claim(const std::string& commander, double now) {
    if (!isFree(now) && commander != holder_) return false;
    holder_ = commander;
    last_claim_ = now;
    return true;
  }

  /// Whether anybody may command at `now` [s].
  bool isFree(double now) const { return holder_.empty() || now - last_claim_ >= timeout_; }

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
  void hold(const std::string& commander, double now) {
    if (commander.empty()) return;
    commander_ = commander;
    last_try_ = now;
  }
  /// Lets everybody command.
  void release() { commander_.clear(); }
  /// As release(), if it is `commander` that knows of the rest.
  void acknowledge(const std::string& commander) {
    if (commander == commander_) release();
  }

  /// Whether the target of a commander at `now` [s] is to be refused; each of them restarts the
  /// pause [s].
  bool refuses(const std::string& commander, double now, double pause) {
    if (commander_.empty() || commander != commander_) return false;
    const bool paused = now - last_try_ >= pause;
    last_try_ = now;
    if (paused) release();
    return !paused;
  }

 private:
  std::string commander_;  ///< empty: nobody
  double last_try_ = 0.0;
};

}  // namespace helix_arm::control
