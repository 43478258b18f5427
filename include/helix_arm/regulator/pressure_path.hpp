#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <utility>

#include "helix_arm/control/safety.hpp"
#include "helix_arm/regulator/guard_process.hpp"
#include "helix_arm/regulator/regulator_io.hpp"

namespace helix_arm::regulator {

/// Of the I/O below a core with these rules: what is no pressure, and how long it may take to vent;
/// the rest is as by default.
IoRules ioRulesFor(const control::SafetyRules& rules);

/// From targets to the regulator's line, with the safety core between: the same for node, command
/// and tests. Of one thread, or behind one lock.
class PressurePath {
 public:
  /// @param io           null where somebody else regulates: hand its readings to the core and the
  ///                     orders to it.
  /// @param longest_gap  between turns: after a longer one whoever regulates may have vented by
  ///                     itself, and the link counts as lost, > 0 [s].
  /// @throws std::invalid_argument naming the value and its rule.
  PressurePath(control::SafetyCore core, std::unique_ptr<RegulatorIo> io, double longest_gap = 0.4);

  /// Who guards from now on, asked on every turn and before it is enabled; null: nobody needs to.
  void guardedBy(std::shared_ptr<const GuardProcess> guard) { guard_ = std::move(guard); }

  /// One turn at `now`, of steadyNow() [s]: takes readings in, lets the core decide, hands its
  /// orders on. To be called often, and neither waits nor allocates.
  const control::ValveOrders& turn(double now);
  /// The same with a new target: (channels) gauge [Pa]. False, and without effect, unless enabled.
  bool target(double now, const Eigen::Ref<const Eigen::VectorXd>& pressure);

  /// The newest reading, when it came with the last turn; else null.
  const Reading* news() const { return fresh_ ? &reading_ : nullptr; }

  /// As SafetyCore::reason(), with the line's last error where the line is the matter. Allocates.
  std::string reason() const;
  /// As SafetyCore::enable(), with the line's last error where nothing is read. Allocates.
  std::string enable(double now);

  control::SafetyCore& core() { return core_; }
  const control::SafetyCore& core() const { return core_; }
  /// Null where somebody else regulates.
  const RegulatorIo* io() const { return io_.get(); }
  /// As RegulatorIo::end(); false where somebody else regulates.
  bool end() { return io_ && io_->end(); }

 private:
  void askGuard(double now);

  control::SafetyCore core_;
  Reading reading_;
  bool fresh_ = false;
  double longest_gap_;
  double last_turn_ = std::numeric_limits<double>::infinity();  // so far none [s]
  std::uint64_t breaks_seen_ = 0;
  std::shared_ptr<const GuardProcess> guard_;
  std::unique_ptr<RegulatorIo> io_;
};

}  // namespace helix_arm::regulator
