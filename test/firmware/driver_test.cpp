// The board with the driver and the safety core of an arm: what each fault comes to on both sides.
#include <set>
#include <variant>

#include <poll.h>
#include <sys/eventfd.h>

#include "helix_arm/io/scene.hpp"
#include "regulator/regulator_io.hpp"
#include "simulated_board.hpp"
#include "simulation/emulated_device.hpp"
#include "simulation/emulation.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_size.hpp"

namespace helix_arm::test {
namespace {

// A simulated board at the other end of a pseudo terminal, for a driver that blocks.
//
// Its time stands still except for what pass() grants, and while bytes are on their way to it or
// an answer may be due. A host that a busy machine holds up is therefore not silent to the board.
class LiveBoard {
 public:
  // What arrives instead of bytes, or of a whole line.
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

  // What `use` returns of the board, which stands still meanwhile.
  template <class Use>
  auto with(Use use) {
    const basics::MutexLock lock(mutex_);
    return use(board_);
  }

  // Lets time pass [s], and returns when it has.
  void pass(double dt) {
    basics::MutexLock lock(mutex_);
    const double end = board_.time() + dt;
    granted_ = end;
    wake();
    passed_.wait(lock, [&]() HELIX_ARM_REQUIRES(mutex_) { return board_.time() >= end; });
  }
  // As SimulatedBoard::time() [s].
  double time() {
    return with([](const SimulatedBoard& board) { return board.time(); });
  }
  // To bytes on their way from the host to the board; null: none.
  void damage(Damage damage) {
    const basics::MutexLock lock(mutex_);
    damage_ = std::move(damage);
  }
  // To lines on their way from the board to the host; null: none.
  void damageAnswers(Damage damage) {
    const basics::MutexLock lock(mutex_);
    answer_damage_ = std::move(damage);
  }
  // The link drops once and comes back, and the board with it.
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

// config/scenes/demo_serial.yaml with the regulator and the safety rules that docs/board.md gives
// a board, at this device.
// @throws std::runtime_error, io::DocumentError if the document has none, or a faulty one.
io::Scene readScene(const std::string& device) {
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

// A board with the driver and the safety core of the scene in docs/board.md, in lockstep: every
// time in it is the chip's.
class BoardRig {
 public:
  static constexpr double kTurn = 0.02;  //< between exchanges [s]

  explicit BoardRig(const BoardKind& kind)
      : board_(kind),
        scene_(readScene(board_.path())),
        driver_(
            regulator::SerialConfig{profileOf(scene_), board_.path(), addressesOf(kind.channels())}
                .makeDriver(kind.channels())),
        core_(coreOf(scene_, kind.channels())),
        goal_(Eigen::VectorXd::Zero(kind.channels())) {
    core_.linked(0, false);
    board_.pass(0.1);
  }

  // What `use` returns of the simulated board.
  template <class Use>
  auto with(Use use) {
    return board_.with(use);
  }
  // A turn of the pressure loop and of its I/O, as regulator::PressurePath and RegulatorIo do it.
  void turn() {
    exchange();
    core_.target(board_.time(), goal_);
    core_.advance(board_.time());
    board_.pass(kTurn);
  }
  // Turns until a state or for at most so long [s]; whether it was reached.
  bool reaches(control::SafetyState state, double longest) {
    const double end = board_.time() + longest;
    while (core_.state() != state && board_.time() < end) turn();
    return core_.state() == state;
  }
  // Enables it and turns until every muscle is within 5 kPa of the goal; empty, or what kept it.
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
  // Last failure of the driver, empty if there was none.
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
      driver_->connect();
      up_ = true;
      bad_in_a_row_ = 0;
      back_off_ = regulator::IoRules().first_back_off;
    } catch (const regulator::LinkError& error) {
      error_ = error.what();
      driver_->close();
      tries_at_ = board_.time() + back_off_;
      back_off_ = std::min(2 * back_off_, regulator::IoRules().longest_back_off);
    }
  }
  void disconnect() {
    try {
      driver_->vent();
    } catch (const std::runtime_error&) {
      // A board whose answers are lost may hear all the same.
    }
    driver_->close();
    up_ = false;
  }
  void exchange() {
    regulator::Pressures pressures(static_cast<int>(goal_.size()));
    if (!up_) connect();
    try {
      if (up_) {
        driver_->write(core_.orders());
        driver_->read(pressures);
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
  std::unique_ptr<regulator::Driver> driver_;
  control::SafetyCore core_;
  Eigen::VectorXd goal_;
  bool up_ = false;
  int bad_in_a_row_ = 0;
  double tries_at_ = 0;  // when it may connect again [s]
  double back_off_ = regulator::IoRules().first_back_off;
  std::string error_;
};

using control::SafetyState;
using Causes = std::set<std::string>;

constexpr double kGoal = 1.5e5, kHighest = 4e5, kSupply = 5e5;  // [Pa]
constexpr double kWatched = 0.5;  // of the board: silence until it vents [s]

using Damage = LiveBoard::Damage;

const Damage kCut = [](const std::string&) { return std::string(); };
// Every line is cut in half, its end included.
const Damage kHalved = [](const std::string& bytes) { return bytes.substr(0, bytes.size() / 2); };
// Random bytes in between: one for every fourth.
const Damage kNoisy = [generator = std::mt19937(5)](const std::string& bytes) mutable {
  std::string out;
  for (const char sent : bytes) {
    out += sent;
    if (std::bernoulli_distribution(0.25)(generator)) out += static_cast<char>(generator());
  }
  return out;
};
// Every line comes when the next one is due.
const Damage kLate = [waiting = std::string()](const std::string& line) mutable {
  return std::exchange(waiting, line);
};
// Each channel's first reading, whatever comes after it.
const Damage kStuck = [first =
                           std::map<std::string, std::string>()](const std::string& line) mutable {
  return first.try_emplace(line.substr(0, line.find('=')), line).first->second;
};

void failFirst(BoardRig& rig, ChannelFault fault) {
  rig.with([&](SimulatedBoard& board) { board.air().fail(0, fault); });
}

struct Row {
  const char* name;
  Causes causes;        ///< of the host, any of them
  double vents_within;  ///< all channels, by the board's own record [s]
  std::function<void(BoardRig&)> fail, mend;
};

std::string nameOfRow(const testing::TestParamInfo<Row>& info) { return info.param.name; }

void PrintTo(const Row& row, std::ostream* out) { *out << row.name; }

class BoardAndDriver : public testing::TestWithParam<Row> {};

TEST_P(BoardAndDriver, EndVentedAndNothingMovesUntilEnabledAgain) {
  constexpr double kLongest = 3;  // [s]
  const Row& row = GetParam();
  BoardRig rig(kSmallBoard);
  ASSERT_EQ(rig.bringTo(kGoal), "");
  rig.with([](SimulatedBoard& board) { board.air().forgetPeak(); });

  row.fail(rig);
  const double begin = rig.board().time();
  double vents = kLongest;
  const auto turn = [&] {
    rig.turn();
    const bool vented = rig.with([](SimulatedBoard& board) { return board.allVent(); });
    if (vented && rig.state() != SafetyState::kEnabled) {
      vents = std::min(vents, rig.board().time() - begin);
    }
  };
  while (rig.state() == SafetyState::kEnabled && rig.board().time() < begin + kLongest) turn();
  const double fault = rig.board().time() - begin;
  const std::string cause = rig.cause(), error = rig.error();
  while (vents == kLongest && rig.board().time() < begin + kLongest) turn();
  EXPECT_TRUE(row.causes.count(cause)) << cause << ": " << rig.core().reason() << "; " << error;
  EXPECT_LT(vents, row.vents_within);

  row.mend(rig);
  rig.board().damage(nullptr);
  rig.board().damageAnswers(nullptr);
  EXPECT_TRUE(rig.reaches(SafetyState::kVented, 5)) << rig.core().reason() << rig.error();
  EXPECT_LT(rig.with([](SimulatedBoard& board) { return board.highest(); }), 2e4);
  for (int i = 0; i < 10; ++i) {  // the commander goes on all the while
    rig.turn();
    EXPECT_TRUE(rig.with([](SimulatedBoard& board) { return board.allVent(); }));
  }
  const double peak = rig.with([](SimulatedBoard& board) { return board.air().peak(); });
  EXPECT_LT(peak, kHighest);
  EXPECT_EQ(rig.bringTo(kGoal), "");
  std::printf("[  FIGURE  ] %s: %s after %.0f ms, all vent after %.0f ms, peak %.0f kPa; %s\n",
              row.name, cause.c_str(), 1e3 * fault, 1e3 * vents, peak / 1e3, error.c_str());
}

const Causes kLine = {"stale_reading", "regulator_lost"};
const Causes kReading = {"not_following", "leak", "regulator_lost", "stale_reading"};
const auto kNothing = [](BoardRig&) {};

Row onChannel(const char* name, Causes causes, double vents_within, ChannelFault fault) {
  return {name, std::move(causes), vents_within, [=](BoardRig& rig) { failFirst(rig, fault); },
          [](BoardRig& rig) { failFirst(rig, ChannelFault::kNone); }};
}
// One that shows once the pressure is to move.
Row onMove(Row row) {
  row.fail = [fail = std::move(row.fail)](BoardRig& rig) {
    fail(rig);
    rig.setGoal(2.5e5);
  };
  return row;
}
Row onAnswers(const char* name, Damage damage) {
  return {name, kLine, 0.6, [=](BoardRig& rig) { rig.board().damageAnswers(damage); }, kNothing};
}
template <class Fail>
Row onBoard(const char* name, Causes causes, Fail fail) {
  return {name, std::move(causes), 0.5, [=](BoardRig& rig) { rig.with(fail); }, kNothing};
}

std::vector<Row> rowsOfTheLine() {
  return {
      Row{"host_silent", kReading, 0.1, [](BoardRig& rig) { rig.board().pass(kWatched + 0.02); },
          kNothing},
      Row{"line_cut", kLine, 0.6,
          [](BoardRig& rig) {
            rig.board().damage(kCut);
            rig.board().damageAnswers(kCut);
          },
          kNothing},
      Row{"line_noisy", kReading, 2.0, [](BoardRig& rig) { rig.board().damage(kNoisy); }, kNothing},
      Row{"half_lines", kLine, 1.0, [](BoardRig& rig) { rig.board().damage(kHalved); }, kNothing},
      onAnswers("answers_cut", kCut),
      onAnswers("answers_halved", kHalved),
      onAnswers("answers_late", kLate),
      onMove(Row{"answers_stuck", kReading, 1.0,
                 [](BoardRig& rig) { rig.board().damageAnswers(kStuck); }, kNothing}),
      Row{"unplugged", kLine, 0.3, [](BoardRig& rig) { rig.board().unplug(); }, kNothing},
  };
}

std::vector<Row> rowsOfTheBoard() {
  return {
      onBoard("reset", kReading,
              [](SimulatedBoard& board) { board.chip().reset(SimulatedChip::Reset::kPin); }),
      onBoard("hang", kReading, [](SimulatedBoard& board) { board.chip().hang(); }),
      Row{"brown_out", kLine, 0.5,
          [](BoardRig& rig) { rig.with([](SimulatedBoard& board) { board.setVoltage(3.5); }); },
          [](BoardRig& rig) { rig.with([](SimulatedBoard& board) { board.setVoltage(5); }); }},
      onChannel("inlet_stuck_open", {"over_limit", "not_following", "regulator_lost"}, 1.0,
                ChannelFault::kInletStuckOpen),
      onMove(onChannel("inlet_stuck_shut", kReading, 1.0, ChannelFault::kInletStuckShut)),
      // To the pressure a burst muscle is the same.
      onChannel("outlet_stuck_open", kReading, 1.5, ChannelFault::kOutletStuckOpen),
      onChannel("sensor_open", kLine, 0.6, ChannelFault::kSensorOpen),
      onChannel("sensor_shorted_to_ground", kLine, 0.6, ChannelFault::kSensorShortedToGround),
      onChannel("sensor_shorted_to_supply", kLine, 0.6, ChannelFault::kSensorShortedToSupply),
      onMove(onChannel("sensor_blocked", kReading, 1.0, ChannelFault::kSensorBlocked)),
      onMove(Row{"low_supply", kReading, 1.5,
                 [](BoardRig& rig) {
                   rig.with([](SimulatedBoard& board) { board.air().setSupply(5e4); });
                 },
                 [](BoardRig& rig) {
                   rig.with([](SimulatedBoard& board) { board.air().setSupply(kSupply); });
                 }}),
  };
}

INSTANTIATE_TEST_SUITE_P(Line, BoardAndDriver, testing::ValuesIn(rowsOfTheLine()), nameOfRow);
INSTANTIATE_TEST_SUITE_P(Board, BoardAndDriver, testing::ValuesIn(rowsOfTheBoard()), nameOfRow);

// ---- Two faults of one channel at once ----------------------------------------------------------

enum class Part { kInlet, kOutlet, kSensor, kMuscle, kManifold };
struct Ill {
  const char* name;
  Part part;
  ChannelFault fault;  ///< none: the supply is weak
};
constexpr Ill kIlls[] = {
    {"inlet_stuck_open", Part::kInlet, ChannelFault::kInletStuckOpen},
    {"inlet_stuck_shut", Part::kInlet, ChannelFault::kInletStuckShut},
    {"outlet_stuck_open", Part::kOutlet, ChannelFault::kOutletStuckOpen},
    {"outlet_stuck_shut", Part::kOutlet, ChannelFault::kOutletStuckShut},
    {"sensor_open", Part::kSensor, ChannelFault::kSensorOpen},
    {"sensor_shorted_to_supply", Part::kSensor, ChannelFault::kSensorShortedToSupply},
    {"sensor_blocked", Part::kSensor, ChannelFault::kSensorBlocked},
    {"sensor_drifts", Part::kSensor, ChannelFault::kSensorDrifts},
    {"leak", Part::kMuscle, ChannelFault::kLeak},
    {"low_supply", Part::kManifold, ChannelFault::kNone},
};
void PrintTo(const Ill& ill, std::ostream* out) { *out << ill.name; }
using Pair = std::pair<Ill, Ill>;

// Pairs of different parts, since a part fails in one way; by default every tenth.
std::vector<Pair> pairsOfIlls() {
  std::vector<Pair> out;
  int number = 0;
  for (const Ill& first : kIlls) {
    for (const Ill& second : kIlls) {
      if (first.part < second.part && isDrawn(number++, 10)) out.emplace_back(first, second);
    }
  }
  return out;
}
bool are(const Pair& pair, ChannelFault first, ChannelFault second) {
  return pair.first.fault == first && pair.second.fault == second;
}
bool holds(const Pair& pair, ChannelFault fault) {
  return pair.first.fault == fault || pair.second.fault == fault;
}

class BoardWithTwoFaults : public testing::TestWithParam<Pair> {};

// With a target that moves: a reading that stands tells nothing while nothing is to move.
TEST_P(BoardWithTwoFaults, LeavesEnabledByNameShutsTheSupplyAndIsNeverWellAboveTheLimit) {
  constexpr double kLongest = 5, kMoves = 1, kVents = 1.5;  // [s]
  constexpr double kLimit = 3.3e5, kAboveLimit = 1;         // with its margin [Pa]; [s]
  const Pair& pair = GetParam();
  BoardRig rig(kSmallBoard);
  ASSERT_EQ(rig.bringTo(kGoal), "");
  rig.with([&](SimulatedBoard& board) {
    board.air().forgetPeak();
    board.air().fail(0, pair.first.fault, pair.second.fault);
    if (pair.second.part == Part::kManifold) board.air().setSupply(5e4);
  });
  const auto pressure = [&] { return rig.with([](SimulatedBoard& b) { return b.pressure(0); }); };

  const double begin = rig.board().time();
  double now = begin, well_above = 0;
  const auto turn = [&] {
    rig.setGoal(static_cast<int>((now - begin) / kMoves) % 2 == 0 ? 2.5e5 : 0.5e5);
    const double before = now;
    rig.turn();
    now = rig.board().time();
    if (rig.state() == SafetyState::kEnabled && pressure() > kLimit) well_above += now - before;
  };
  while (rig.state() == SafetyState::kEnabled && now < begin + kLongest) turn();
  const double left = now - begin;
  const std::string cause = rig.cause(), error = rig.error();
  while (rig.state() != SafetyState::kEnabled && now < begin + left + kVents) turn();
  const double peak = rig.with([](SimulatedBoard& board) { return board.air().peak(); });
  std::printf(
      "[  FIGURE  ] %s and %s: %s after %.0f ms, peak %.0f kPa, above the limit and well %.0f ms; "
      "%s\n",
      pair.first.name, pair.second.name, cause.c_str(), 1e3 * left, peak / 1e3, 1e3 * well_above,
      error.c_str());

  // Nobody sees an inlet that leaks behind a sensor that stands: the relief valve limits that one.
  const bool is_blind = are(pair, ChannelFault::kInletStuckOpen, ChannelFault::kSensorBlocked);
  EXPECT_LT(peak, is_blind ? kSupply : kHighest);
  EXPECT_LT(well_above, kAboveLimit);
  if (rig.state() == SafetyState::kEnabled) {
    // A small drift and a small leak may be regulated away.
    EXPECT_TRUE(are(pair, ChannelFault::kSensorDrifts, ChannelFault::kLeak));
    EXPECT_LT(peak, kLimit);
    return;
  }
  EXPECT_NE(cause, "none");
  EXPECT_TRUE(rig.state() == SafetyState::kFault || rig.state() == SafetyState::kVented);
  rig.with([](SimulatedBoard& board) {
    EXPECT_TRUE(board.allVent());
    EXPECT_FALSE(board.isSupplied());
    EXPECT_LT(board.pressure(1), 2e4);
    EXPECT_LT(board.pressure(2), 2e4);
  });
  // An outlet that stays shut keeps its air, and the arm is not said to be empty.
  if (rig.state() == SafetyState::kVented || !holds(pair, ChannelFault::kOutletStuckShut)) {
    EXPECT_LT(pressure(), 2e4);
  }
}

std::string nameOfPair(const testing::TestParamInfo<Pair>& info) {
  return std::string(info.param.first.name) + "_and_" + info.param.second.name;
}
INSTANTIATE_TEST_SUITE_P(, BoardWithTwoFaults, testing::ValuesIn(pairsOfIlls()), nameOfPair);

TEST(BoardAndHost, AnOutletThatStaysShutIsReportedAsSuch) {
  BoardRig rig(kSmallBoard);
  ASSERT_EQ(rig.bringTo(kGoal), "");
  failFirst(rig, ChannelFault::kOutletStuckShut);
  rig.core().vent(rig.board().time());
  EXPECT_FALSE(rig.reaches(SafetyState::kVented, 4));
  EXPECT_TRUE(rig.core().report().vent_overdue);
  failFirst(rig, ChannelFault::kNone);
  EXPECT_TRUE(rig.reaches(SafetyState::kVented, 2));
}

}  // namespace
}  // namespace helix_arm::test
