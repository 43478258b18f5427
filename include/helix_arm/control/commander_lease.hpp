#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <optional>
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

/// Refuses the targets of all commanders after somebody has brought the arm to rest, each until it
/// has paused: it may not know of the rest yet. Times are seconds on any steady clock.
class RestedCommanders {
 public:
  /// Commanders whose targets are remembered; each target of a further one counts as its first.
  static constexpr std::size_t kMost = 32;

  /// @param caller  who asked for the rest and so knows of it; empty: none of the commanders.
  void hold(const std::string& caller, double now) {
    since_ = now;
    last_try_.clear();
    acknowledge(caller);
  }
  /// Lets everybody command: the arm was enabled, or follows one who knows of the rest.
  void release() { since_.reset(); }
  /// From now on this commander knows of the rest.
  void acknowledge(const std::string& commander) {
    if (since_) last_try_[commander] = -std::numeric_limits<double>::infinity();
  }

  /// Whether the target of a commander at `now` [s] is to be refused; each of them restarts the
  /// pause [s], which begins with the rest.
  bool refuses(const std::string& commander, double now, double pause) {
    if (!since_) return false;
    const auto known = last_try_.find(commander);
    const bool paused = now - (known == last_try_.end() ? *since_ : known->second) >= pause;
    if (paused) return false;
    if (known != last_try_.end()) {
      known->second = now;
    } else if (last_try_.size() < kMost) {
      last_try_.emplace(commander, now);
    }
    return true;
  }

 private:
  std::optional<double> since_;             ///< the rest [s]; nothing: no target is refused
  std::map<std::string, double> last_try_;  ///< of each commander since then [s]
};

}  // namespace helix_arm::control
