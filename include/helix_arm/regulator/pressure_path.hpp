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

/// I/O rules for a core with these safety rules: the pressure that counts as vented and the time
/// allowed to vent. The rest has its defaults.
IoRules ioRulesOf(const control::SafetyRules& rules);

/// Connects targets to the regulator through the safety core; node, command and tests use the same
/// one. For one thread, or behind one lock.
class PressurePath {
 public:
  /// @param io           null if another node regulates: pass its readings to the core and the
  ///                     orders to it.
  /// @param longest_gap  longest time between turns, > 0 [s]. After a longer one the regulator may
  ///                     have vented by itself, and the link counts as lost.
  /// @throws std::invalid_argument naming the value and its rule.
  PressurePath(control::SafetyCore core, std::unique_ptr<RegulatorIo> io, double longest_gap = 0.4);

  /// Sets the guard, whose state is checked on every turn and before enabling; null: none is
  /// needed.
  void guardedBy(std::shared_ptr<const GuardProcess> guard) { guard_ = std::move(guard); }

  /// One turn at `now`, as steadyNow() [s]: takes readings, lets the core decide, passes on its
  /// orders. Call it often. Neither waits nor allocates.
  const control::ValveOrders& turn(double now);
  /// Like turn(), with a new target: (channels) gauge [Pa]. Returns false, without effect, unless
  /// enabled.
  bool target(double now, const Eigen::Ref<const Eigen::VectorXd>& pressure);

  /// The newest reading if it came with the last turn, otherwise null.
  const Reading* news() const { return fresh_ ? &reading_ : nullptr; }

  /// As SafetyCore::text(), with the line's last error if the line is the cause. Allocates.
  control::SafetyText text() const;
  std::string reason() const { return text().line(core_.state()); }
  /// As SafetyCore::enable(), with the line's last error if there are no readings. Allocates.
  std::string enable(double now);

  control::SafetyCore& core() { return core_; }
  const control::SafetyCore& core() const { return core_; }
  /// Null if another node regulates.
  const RegulatorIo* io() const { return io_.get(); }
  /// As RegulatorIo::end(); false if another node regulates.
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
