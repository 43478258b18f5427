#pragma once

#include <variant>

#include <poll.h>
#include <sys/eventfd.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "regulator/ascii_serial_driver.hpp"
#include "simulated_board.hpp"
#include "simulation/pseudo_terminal.hpp"
#include "support/temporary_file.hpp"
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

  explicit LiveBoard(const BoardKind& kind) : board_(kind) {
    link_.pointTo(terminal_->path());
    thread_ = std::thread([this] { run(); });
  }
  ~LiveBoard() {
    ended_ = true;
    wake();
    thread_.join();
    ::close(wake_);
  }
  LiveBoard(const LiveBoard&) = delete;
  LiveBoard& operator=(const LiveBoard&) = delete;

  const std::string& path() const { return link_.path(); }

  /// What `use` returns of the board, which stands still meanwhile.
  template <class Use>
  auto with(Use use) {
    const basics::MutexLock lock(mutex_);
    return use(board_);
  }

  /// Lets time pass [s], and returns when it has.
  void pass(double dt) {
    basics::MutexLock lock(mutex_);
    const double end = board_.time() + dt;
    granted_ = end;
    wake();
    passed_.wait(lock, [&]() HELIX_ARM_REQUIRES(mutex_) { return board_.time() >= end; });
  }
  /// As SimulatedBoard::time() [s].
  double time() {
    return with([](const SimulatedBoard& board) { return board.time(); });
  }
  /// To bytes on their way from the host to the board; null: none.
  void damage(Damage damage) {
    const basics::MutexLock lock(mutex_);
    damage_ = std::move(damage);
  }
  /// To lines on their way from the board to the host; null: none.
  void damageAnswers(Damage damage) {
    const basics::MutexLock lock(mutex_);
    answer_damage_ = std::move(damage);
  }
  /// The link drops once and comes back, and the board with it.
  void unplug() {
    const basics::MutexLock lock(mutex_);
    unplugged_ = true;
    wake();
  }

 private:
  static constexpr double kStep = 0.0005;          // [s]
  static constexpr double kAnswerTime = 0.005;     // after the last byte either way [s]
  static constexpr int kUnopenedMilliseconds = 2;  // between looks whether somebody has come

  void wake() const { eventfd_write(wake_, 1); }

  void run() {
    while (!ended_) {
      if (step()) continue;
      pollfd files[2] = {{wake_, POLLIN, 0}, {terminal_->file(), POLLIN, 0}};
      poll(files, 2, -1);
      // While nobody has opened it, the terminal is ready all the time.
      if ((files[1].revents & POLLHUP) != 0) poll(files, 1, kUnopenedMilliseconds);
      eventfd_t count = 0;
      eventfd_read(wake_, &count);
    }
  }

  // Whether there was anything to do.
  bool step() {
    const std::optional<std::string> bytes = terminal_->receive();
    const basics::MutexLock lock(mutex_);
    if (std::exchange(unplugged_, false)) {
      terminal_.emplace();
      link_.pointTo(terminal_->path());
      board_.chip().reset(SimulatedChip::Reset::kPowerOn);
      board_.receive();
      return true;
    }
    if (bytes && !bytes->empty()) board_.send(damage_ ? damage_(*bytes) : *bytes);
    if (board_.isReceiving()) quiet_from_ = board_.time() + kAnswerTime;
    if (board_.time() >= granted_ && board_.time() >= quiet_from_) return false;
    board_.advance(kStep);
    const std::string sent = board_.receive();
    if (!sent.empty()) {
      quiet_from_ = board_.time() + kAnswerTime;
      answer(sent);
    }
    if (board_.time() >= granted_) passed_.notifyAll();
    return true;
  }

  void answer(const std::string& bytes) HELIX_ARM_REQUIRES(mutex_) {
    if (!answer_damage_) return terminal_->send(std::exchange(answer_, {}) + bytes);
    answer_ += bytes;
    for (std::size_t end = answer_.find('\n'); end != std::string::npos; end = answer_.find('\n')) {
      terminal_->send(answer_damage_(answer_.substr(0, end + 1)));
      answer_.erase(0, end + 1);
    }
  }

  const TemporaryFolder folder_;
  simulation::DeviceLink link_{folder_ / "board"};
  // Beyond the constructor, of the thread alone.
  std::optional<simulation::PseudoTerminal> terminal_{std::in_place};
  basics::Mutex mutex_;
  basics::Condition passed_;
  SimulatedBoard board_ HELIX_ARM_GUARDED_BY(mutex_);
  Damage damage_ HELIX_ARM_GUARDED_BY(mutex_), answer_damage_ HELIX_ARM_GUARDED_BY(mutex_);
  bool unplugged_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  std::string answer_ HELIX_ARM_GUARDED_BY(mutex_);  // a line that has not ended
  double granted_ HELIX_ARM_GUARDED_BY(mutex_) = 0;  // time until which it may run [s]
  double quiet_from_ = 0;  // time at which no answer is due any more; of the thread alone [s]
  std::atomic<bool> ended_{false};
  int wake_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  std::thread thread_;
};

/// config/scenes/demo_serial.yaml with the regulator and the safety rules that docs/board.md gives
/// a board, at this device.
/// @throws std::runtime_error, io::DocumentError if the document has none, or a faulty one.
inline io::Scene readScene(const std::string& device) {
  constexpr char kDocument[] = HELIX_ARM_SOURCE_DIR "/docs/board.md";
  constexpr char kArm[] = HELIX_ARM_SOURCE_DIR "/config/scenes/demo_serial.yaml";
  constexpr char kBegin[] = "```yaml\n", kEnd[] = "```\n";
  const std::string document = contentOf(kDocument), arm = contentOf(kArm);
  const std::size_t begin = document.find(kBegin), regulator = arm.find("\nregulator:");
  if (begin == std::string::npos || regulator == std::string::npos) {
    throw std::runtime_error(std::string(kDocument) + " has no scene, or " + kArm +
                             " no regulator");
  }
  const std::size_t first = begin + sizeof kBegin - 1;
  const std::string part = document.substr(first, document.find(kEnd, first) - first);
  const std::regex placeholder("/dev/serial/by-id/[^ ,\n]+");
  if (!std::regex_search(part, placeholder)) {
    throw std::runtime_error(std::string(kDocument) + " has a scene without a device");
  }
  return io::sceneOfText(
      arm.substr(0, regulator + 1) + std::regex_replace(part, placeholder, device), kDocument);
}

/// A board with the driver and the safety core of the scene in docs/board.md, in lockstep: every
/// time in it is the chip's.
class BoardRig {
 public:
  static constexpr double kTurn = 0.02;  ///< between exchanges [s]

  explicit BoardRig(const BoardKind& kind)
      : board_(kind),
        scene_(readScene(board_.path())),
        driver_({profileOf(scene_), board_.path(), addressesOf(kind.channels())}, kind.channels()),
        core_(coreOf(scene_, kind.channels())),
        goal_(Eigen::VectorXd::Zero(kind.channels())) {
    core_.linked(0, false);
    board_.pass(0.1);
  }

  /// What `use` returns of the simulated board.
  template <class Use>
  auto with(Use use) {
    return board_.with(use);
  }
  /// A turn of the pressure loop and of its I/O, as regulator::PressurePath and RegulatorIo do it.
  void turn() {
    exchange();
    core_.target(board_.time(), goal_);
    core_.advance(board_.time());
    board_.pass(kTurn);
  }
  /// Turns until a state or for at most so long [s]; whether it was reached.
  bool reaches(control::SafetyState state, double longest) {
    const double end = board_.time() + longest;
    while (core_.state() != state && board_.time() < end) turn();
    return core_.state() == state;
  }
  /// Enables it and turns until every muscle is within 5 kPa of the goal; empty, or what kept it.
  std::string bringTo(double goal) {
    constexpr double kLongest = 5, kNear = 5e3;
    setGoal(goal);
    const double end = board_.time() + kLongest;
    while (state() != control::SafetyState::kEnabled) {
      turn();
      const std::string refusal = core_.enable(board_.time());
      if (!refusal.empty() && board_.time() > end) return refusal + "; " + error_;
    }
    const auto isThere = [&] {
      return with([&](const SimulatedBoard& board) {
        for (int i = 0; i < board.channels(); ++i) {
          if (std::abs(board.pressure(i) - goal) > kNear) return false;
        }
        return true;
      });
    };
    while (!isThere()) {
      turn();
      if (state() != control::SafetyState::kEnabled) return core_.reason() + "; " + error_;
      if (board_.time() > end) return "the muscles do not come to the goal";
    }
    return "";
  }

  LiveBoard& board() { return board_; }
  control::SafetyCore& core() { return core_; }
  control::SafetyState state() const { return core_.state(); }
  std::string cause() const { return control::nameOf(core_.report().cause); }
  /// Last failure of the driver, empty if there was none.
  const std::string& error() const { return error_; }
  void setGoal(double goal) { goal_.setConstant(goal); }

 private:
  // Except for a time by the wall clock: the board's is another.
  static regulator::SerialProfile profileOf(const io::Scene& scene) {
    regulator::SerialProfile profile = std::get<regulator::SerialConfig>(*scene.regulator).profile;
    profile.timeout = 0.3;
    profile.watchdog = std::numeric_limits<double>::infinity();
    return profile;
  }
  static std::vector<std::string> addressesOf(int channels) {
    std::vector<std::string> addresses;
    for (int i = 0; i < channels; ++i) addresses.push_back(std::to_string(i));
    return addresses;
  }
  // Of a board with more channels than the scene, each is as the first.
  static control::SafetyCore coreOf(const io::Scene& scene, int channels) {
    std::vector<control::ChannelRules> all(static_cast<std::size_t>(channels),
                                           scene.safety.channels.front());
    for (std::size_t i = 0; i < all.size(); ++i) all[i].name = "muscle_" + std::to_string(i + 1);
    return {all, scene.safety.rules};
  }

  void connect() {
    if (board_.time() < tries_at_) return;
    try {
      driver_.connect();
      up_ = true;
      bad_in_a_row_ = 0;
      back_off_ = regulator::IoRules().first_back_off;
    } catch (const regulator::LinkError& error) {
      error_ = error.what();
      driver_.close();
      tries_at_ = board_.time() + back_off_;
      back_off_ = std::min(2 * back_off_, regulator::IoRules().longest_back_off);
    }
  }
  void disconnect() {
    try {
      driver_.vent();
    } catch (const std::runtime_error&) {
      // A board whose answers are lost may hear all the same.
    }
    driver_.close();
    up_ = false;
  }
  void exchange() {
    regulator::Pressures pressures(static_cast<int>(goal_.size()));
    if (!up_) connect();
    try {
      if (up_) {
        driver_.write(core_.orders());
        driver_.read(pressures);
        bad_in_a_row_ = 0;
      }
    } catch (const regulator::BadReply& error) {
      error_ = error.what();
      if (++bad_in_a_row_ >= regulator::IoRules().most_bad_replies) disconnect();
    } catch (const regulator::LinkError& error) {
      error_ = error.what();
      disconnect();
    }
    core_.linked(board_.time(), up_);
    core_.measured(board_.time(), pressures.pressure);
  }

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
