#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "helix_arm/control/safety.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "live_board.hpp"
#include "regulator/ascii_serial_driver.hpp"

namespace helix_arm::test {

/// A board with the driver and the safety core of the scene in docs/board.md, in lockstep: every
/// time in it is the chip's.
class BoardRig {
 public:
  static constexpr double kTurn = 0.02;  ///< between exchanges [s]

  explicit BoardRig(const BoardKind& kind);

  /// A turn of the pressure loop and of its I/O, as regulator::PressurePath and RegulatorIo do it.
  void turn();
  /// Turns until a state or for at most so long [s]; whether it was reached.
  bool reaches(control::SafetyState state, double longest);
  /// Enables it and turns until every muscle is within 5 kPa of the goal; empty, or what kept it.
  std::string bringTo(double goal);

  LiveBoard& board() { return board_; }
  control::SafetyCore& core() { return core_; }
  control::SafetyState state() const { return core_.state(); }
  std::string cause() const { return control::nameOf(core_.report().cause); }
  /// Last failure of the driver, empty if there was none.
  const std::string& error() const { return error_; }
  /// What `use` returns of the simulated board.
  template <class Use>
  auto with(Use use) {
    return board_.with(use);
  }
  void setGoal(double goal) { goal_.setConstant(goal); }

 private:
  void connect();
  void disconnect();
  void exchange();

  LiveBoard board_;
  const io::Scene scene_;
  regulator::AsciiSerialDriver driver_;
  control::SafetyCore core_;
  Eigen::VectorXd goal_;
  bool up_ = false;
  int bad_in_a_row_ = 0;
  double tries_at_ = 0;  // when it may connect again [s]
  double back_off_ = regulator::IoRules().first_back_off;
  std::string error_;
};

}  // namespace helix_arm::test
