#pragma once

#include <atomic>
#include <functional>
#include <optional>
#include <string>
#include <thread>

#include "helix_arm/basics/mutex.hpp"
#include "simulated_board.hpp"
#include "simulation/pseudo_terminal.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {

/// A simulated board at the other end of a pseudo terminal, for a driver that blocks.
///
/// Its time stands still except for what pass() grants, and while bytes are on their way to it or
/// an answer may be due. A host that a busy machine holds up is therefore not silent to the board.
class LiveBoard {
 public:
  /// What arrives instead of bytes, or of a whole line.
  using Damage = std::function<std::string(const std::string& bytes)>;

  explicit LiveBoard(const BoardKind& kind);
  ~LiveBoard();
  LiveBoard(const LiveBoard&) = delete;
  LiveBoard& operator=(const LiveBoard&) = delete;

  const std::string& path() const { return link_.path(); }

  /// Lets time pass [s], and returns when it has.
  void pass(double dt);
  double time();  ///< as SimulatedBoard::time() [s]
  /// To bytes on their way from the host to the board; null: none.
  void damage(Damage damage);
  /// To lines on their way from the board to the host; null: none.
  void damageAnswers(Damage damage);
  /// The link drops once and comes back, and the board with it.
  void unplug();

  /// What `use` returns of the board, which stands still meanwhile.
  template <class Use>
  auto with(Use use) {
    const basics::MutexLock lock(mutex_);
    return use(board_);
  }

 private:
  void run();
  bool step();
  void answer(const std::string& bytes) HELIX_ARM_REQUIRES(mutex_);
  void wake() const;

  const TemporaryFolder folder_;
  simulation::DeviceLink link_;
  // Beyond the constructor, of the thread alone.
  std::optional<simulation::PseudoTerminal> terminal_;
  basics::Mutex mutex_;
  basics::Condition passed_;
  SimulatedBoard board_ HELIX_ARM_GUARDED_BY(mutex_);
  Damage damage_ HELIX_ARM_GUARDED_BY(mutex_), answer_damage_ HELIX_ARM_GUARDED_BY(mutex_);
  bool unplugged_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  std::string answer_ HELIX_ARM_GUARDED_BY(mutex_);  // a line that has not ended
  double granted_ HELIX_ARM_GUARDED_BY(mutex_) = 0;  // time until which it may run [s]
  double quiet_from_ = 0;  // time at which no answer is due any more; of the thread alone [s]
  std::atomic<bool> ended_{false};
  int wake_;
  std::thread thread_;
};

}  // namespace helix_arm::test
