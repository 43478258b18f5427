#include <Eigen/Core>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/regulator/serial_profile.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"
#include "helix_arm/simulation/emulated_device.hpp"
#include "pseudo_terminal.hpp"

namespace helix_arm::simulation {
namespace {

using Clock = std::chrono::steady_clock;
using control::Valve;
using regulator::LineFields;
using regulator::LineFormat;

constexpr const char* kSerialDevice = "serial device";
constexpr double kPsi = 6894.757293168;
constexpr std::chrono::milliseconds kEmptyLine{2};    // between checks for a new client
constexpr std::chrono::milliseconds kNoTerminal{50};  // between attempts to create one
constexpr double kSlowness = 2.5;                     // of an answer, in timeouts

double seconds(Clock::duration span) { return std::chrono::duration<double>(span).count(); }
Clock::duration spanOf(double s) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
}

const SerialDeviceConfig& valid(const SerialDeviceConfig& config) {
  config.profile.validate();
  config.regulator.validate();
  basics::requireValue(config.channels >= 1, kSerialDevice, "the number of channels",
                       config.channels, "at least 1");
  const bool addressed = regulator::SerialLines(config.profile).write->has("{address}");
  basics::requireValue(
      config.addresses.size() == static_cast<std::size_t>(addressed ? config.channels : 0),
      kSerialDevice, "the number of addresses", config.addresses.size(),
      "one per channel if the profile has {address}, else none");
  basics::require(addressed || config.channels == 1 || !config.profile.one_by_one, kSerialDevice,
                  ": the profile has no {address} to distinguish channels");
  basics::requireValue(config.period > 0, kSerialDevice, "the period [s]", config.period,
                       "a value > 0");
  return config;
}

bool ventsByMode(const regulator::SerialLines& lines, bool one_by_one) {
  const std::string last = lines.vent.back().line("A", {{0.0}, {}, {}});
  return !one_by_one || !lines.write->match(last, "A", 1).has_value();
}

constexpr const char* kFaultNames[kDeviceFaultCount] = {
    "none",     "silence",     "garbage", "half_line",  "wrong_unit", "slow",      "restart",
    "nan_text", "stuck_value", "burst",   "stuck_open", "stuck_shut", "low_supply"};
static_assert(kFaultNames[kDeviceFaultCount - 1] != nullptr, "each fault has a name");

}  // namespace

const char* nameOf(DeviceFault fault) { return kFaultNames[static_cast<std::size_t>(fault)]; }

std::string deviceFaultNames() { return basics::joined(kFaultNames); }

std::optional<DeviceFault> parseDeviceFault(const std::string& name) {
  for (int i = 0; i < kDeviceFaultCount; ++i) {
    if (name == kFaultNames[i]) return static_cast<DeviceFault>(i);
  }
  return std::nullopt;
}

regulator::AirFault airFaultOf(DeviceFault fault) {
  switch (fault) {
    case DeviceFault::kBurst:
      return regulator::AirFault::kBurst;
    case DeviceFault::kStuckOpen:
      return regulator::AirFault::kStuckOpen;
    case DeviceFault::kStuckShut:
      return regulator::AirFault::kStuckShut;
    case DeviceFault::kLowSupply:
      return regulator::AirFault::kLowSupply;
    default:
      return regulator::AirFault::kNone;
  }
}

/// Protocol and valves of an emulated device, without line or clock.
class SerialDialogue {
 public:
  /// @throws std::invalid_argument naming the value and its rule.
  explicit SerialDialogue(const SerialDeviceConfig& config)
      : config_(valid(config)),
        lines_(config.profile),
        vents_by_mode_(ventsByMode(lines_, config.profile.one_by_one)),
        simulated_(config.channels, config.regulator),
        stuck_(Eigen::VectorXd::Zero(config.channels)) {
    restart();
  }

  /// Advances time by dt [s].
  void step(double dt) {
    const double left = config_.profile.watchdog - silence_;
    silence_ += dt;
    if (left > 0 && dt >= left) {
      simulated_.step(left);
      dt -= left;
      ventAll();
    }
    simulated_.step(dt);
  }

  /// Executes a line.
  /// @return whether it was understood, whether it has set points, and the answer to send, if any.
  struct Outcome {
    bool understood = false;
    bool sets = false;
    std::optional<std::string> answer;  // without a terminator
  };

  Outcome take(const std::string& line, DeviceFault fault) {
    if (!config_.profile.checksum) return takeText(line, fault);
    const std::optional<std::string> text = regulator::withoutChecksum(line);
    Outcome outcome = text ? takeText(*text, fault) : refusal();
    if (outcome.answer) outcome.answer = regulator::withChecksum(*outcome.answer);
    return outcome;
  }

  /// The next unsolicited line, if it sends any.
  std::optional<std::string> unasked(DeviceFault fault) {
    if (lines_.read || !speaks_) return std::nullopt;
    const std::string line = readings(*lines_.reply, 0, fault);
    return config_.profile.checksum ? regulator::withChecksum(line) : line;
  }

  /// Freezes the readings, for kStuckValue.
  void rememberReadings() { stuck_ = simulated_.pressure(); }
  void fail(regulator::AirFault fault) { simulated_.fail(fault); }

  /// Restarts, as after power-on.
  void restart() {
    ventAll();
    speaks_ = lines_.start.empty();
    silence_ = 0;
  }

  const Eigen::VectorXd& pressure() const { return simulated_.pressure(); }
  const Eigen::VectorXd& setPoint() const { return set_point_; }
  const std::vector<control::Valve>& valves() const { return valves_; }

 private:
  std::string readings(const LineFormat& format, int channel, DeviceFault fault) {
    const regulator::SerialProfile& profile = config_.profile;
    const bool wrong_unit = fault == DeviceFault::kWrongUnit;
    const double other = profile.pascals == kPsi ? 1e3 : kPsi;
    const auto number = [&](double pressure) {
      return wrong_unit ? (pressure + profile.atmosphere) / other : profile.fromPascals(pressure);
    };
    const Eigen::VectorXd pressures =
        fault == DeviceFault::kStuckValue ? stuck_ : simulated_.measure();
    LineFields fields;
    for (int i = firstOf(channel); i < endOf(channel); ++i) {
      fields.pressures.push_back(fault == DeviceFault::kNanText
                                     ? std::numeric_limits<double>::quiet_NaN()
                                     : number(pressures[i]));
    }
    fields.set_point = number(set_point_[channel]);
    fields.supply = number(simulated_.supply());
    std::string line = format.line(addressOf(channel), fields);
    if (wrong_unit && format.has("{unit}")) {
      // The last occurrence is the unit: numbers contain no letters, and addresses come first.
      const std::size_t at = line.rfind(profile.unit_word);
      line.replace(at, profile.unit_word.size(), profile.unit_word == "psi" ? "kPa" : "psi");
    }
    return line;
  }

  Outcome takeText(const std::string& line, DeviceFault fault) {
    silence_ = 0;
    for (std::size_t i = 0; i < lines_.start.size(); ++i) {
      if (!lines_.start[i].match(line, "", 0)) continue;
      speaks_ = speaks_ || i + 1 == lines_.start.size();
      return {true, false, std::nullopt};
    }
    const int talkers = config_.profile.one_by_one ? config_.channels : 1;
    for (int channel = 0; channel < talkers; ++channel) {
      Outcome outcome = takeOf(line, channel, fault);
      if (outcome.understood) return outcome;
    }
    return refusal();
  }

  // Empty if the profile's lines have no {address}.
  std::string addressOf(int channel) const {
    return config_.addresses.empty() ? std::string() : config_.addresses[channel];
  }
  // The channels that a line to one of them concerns.
  int firstOf(int channel) const { return config_.profile.one_by_one ? channel : 0; }
  int endOf(int channel) const {
    return config_.profile.one_by_one ? channel + 1 : config_.channels;
  }

  void turn(int channel, Valve valve, bool hold) {
    for (int i = firstOf(channel); i < endOf(channel); ++i) {
      valves_[i] = valve;
      held_[i] = hold && !lines_.resume.empty();
    }
  }

  Outcome takeOf(const std::string& line, int channel, DeviceFault fault) {
    const std::string address = addressOf(channel);
    const auto count = static_cast<std::size_t>(config_.channels);
    const auto is = [&](const LineFormat& f) { return f.match(line, address, count).has_value(); };
    const auto isAny = [&](const std::vector<LineFormat>& formats) {
      return std::any_of(formats.begin(), formats.end(), is);
    };
    const auto isLast = [&](const std::vector<LineFormat>& formats) {
      return !formats.empty() && is(formats.back());
    };
    const int first = firstOf(channel), end = endOf(channel);
    const std::optional<LineFormat>* reply = &lines_.vent_reply;
    bool sets = false;
    if (lines_.read && is(*lines_.read)) {
      reply = &lines_.reply;
    } else if (isLast(lines_.vent) && (vents_by_mode_ || !held_[channel])) {
      turn(channel, Valve::kVent, vents_by_mode_);
      set_point_.segment(first, end - first).setZero();
    } else if (isLast(lines_.resume)) {
      for (int i = first; i < end; ++i) {
        if (held_[i]) valves_[i] = Valve::kRegulate;
        held_[i] = false;
      }
    } else if (isLast(lines_.close)) {
      turn(channel, Valve::kClose, true);
    } else if (const auto fields = lines_.write->match(line, address, count)) {
      for (int i = first; i < end; ++i) {
        set_point_[i] =
            std::clamp(config_.profile.toPascals(fields->pressures[i - first]), 0.0, 1e7);
        if (!held_[i]) valves_[i] = Valve::kRegulate;
      }
      reply = &lines_.write_reply;
      sets = true;
    } else if (!isAny(lines_.vent) && !isAny(lines_.resume) && !isAny(lines_.close)) {
      return {};
    }
    apply();
    Outcome outcome{true, sets, std::nullopt};
    if (*reply) outcome.answer = readings(**reply, channel, fault);
    return outcome;
  }

  // Of a line that is not understood.
  Outcome refusal() const {
    return {false, false, lines_.read ? std::optional<std::string>("?") : std::nullopt};
  }

  // A closed channel keeps its pressure.
  void apply() {
    Eigen::VectorXd goal = Eigen::VectorXd::Zero(config_.channels);
    for (int i = 0; i < goal.size(); ++i) {
      const Valve valve = valves_[i];
      if (valve == Valve::kRegulate) goal[i] = set_point_[i];
      if (valve == Valve::kClose) goal[i] = simulated_.pressure()[i];
    }
    simulated_.command(goal);
  }

  // In force until the next set point.
  void ventAll() {
    const auto channels = static_cast<std::size_t>(config_.channels);
    set_point_ = Eigen::VectorXd::Zero(config_.channels);
    valves_.assign(channels, Valve::kVent);
    held_.assign(channels, false);
    apply();
  }

  SerialDeviceConfig config_;
  regulator::SerialLines lines_;
  bool vents_by_mode_;  // by a line that is not a set point
  regulator::SimulatedRegulator simulated_;
  Eigen::VectorXd set_point_;
  std::vector<control::Valve> valves_;
  std::vector<bool> held_;  // (channels) until a resume line
  Eigen::VectorXd stuck_;
  bool speaks_ = false;
  double silence_ = 0;  // time since the last line [s]
};

// Thread of a device, with all state that it shares.
class SerialDevice::Worker {
 public:
  explicit Worker(SerialDeviceConfig config)
      : config_(std::move(config)),
        dialogue_(config_),
        link_(config_.link),
        last_step_(Clock::now()),
        terminal_(std::make_unique<PseudoTerminal>()),
        generator_(config_.seed),
        wake_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
    try {
      terminal_path_ = terminal_->path();
      link_.pointTo(terminal_path_);
    } catch (...) {
      ::close(wake_);
      throw;
    }
    thread_ = std::thread([this] { run(); });
  }
  ~Worker() {
    ended_ = true;
    wake();
    thread_.join();
    ::close(wake_);
  }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  std::string path() const {
    const basics::MutexLock lock(mutex_);
    return link_.path().empty() ? terminal_path_ : link_.path();
  }
  void setFault(DeviceFault fault) {
    {
      const basics::MutexLock lock(mutex_);
      advance();
      if (fault == DeviceFault::kStuckValue) dialogue_.rememberReadings();
      dialogue_.fail(airFaultOf(fault));
      fault_ = fault;
    }
    wake();
  }
  DeviceFault fault() const {
    const basics::MutexLock lock(mutex_);
    return fault_;
  }
  // Asks the device for its present state.
  template <class Ask>
  auto ask(const Ask& ask) {
    const basics::MutexLock lock(mutex_);
    advance();
    return ask(dialogue_);
  }
  std::uint64_t lines() const { return lines_; }
  std::uint64_t restarts() const { return restarts_; }
  double lastSetTime() const { return last_set_; }

 private:
  void wake() const { eventfd_write(wake_, 1); }

  void advance() HELIX_ARM_REQUIRES(mutex_) {
    const Clock::time_point now = Clock::now();
    dialogue_.step(seconds(now - last_step_));
    last_step_ = now;
  }

  void waitUntil(Clock::time_point time, bool for_input) {
    pollfd files[2] = {{wake_, POLLIN, 0}, {terminal_->file(), POLLIN, 0}};
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(time - Clock::now());
    poll(files, for_input ? 2 : 1,
         static_cast<int>(std::clamp<std::int64_t>(left.count(), 0, 1000)));
    eventfd_t count = 0;
    eventfd_read(wake_, &count);
  }

  // False if no terminal or no link is available at present.
  bool restart() {
    const basics::MutexLock lock(mutex_);
    std::unique_ptr<PseudoTerminal> fresh;
    try {
      fresh = std::make_unique<PseudoTerminal>();
      link_.pointTo(fresh->path());
    } catch (const std::runtime_error&) {
      return false;
    }
    advance();
    fault_ = DeviceFault::kNone;
    dialogue_.restart();
    terminal_path_ = fresh->path();
    terminal_ = std::move(fresh);
    input_.clear();
    delayed_.clear();
    ++restarts_;
    return true;
  }

  void run() {
    Clock::time_point next_unasked = Clock::now();
    while (!ended_) {
      const DeviceFault now_fault = fault();
      if (now_fault == DeviceFault::kRestart && !restart()) {
        waitUntil(Clock::now() + kNoTerminal, false);
        continue;
      }
      const std::optional<std::string> bytes = terminal_->receive();
      if (bytes && now_fault != DeviceFault::kSilence) {
        input_ += *bytes;
        takeLines();
      }
      const Clock::time_point now = Clock::now();
      if (bytes && now >= next_unasked) {
        speakUnasked();
        next_unasked = now + spanOf(config_.period);
      }
      // Once it is no longer slow, delayed answers are sent at once.
      sendDelayed(fault() == DeviceFault::kSlow ? now : Clock::time_point::max());
      Clock::time_point next = now + std::chrono::milliseconds(1000);
      if (config_.profile.read.empty()) next = std::min(next, next_unasked);
      if (!delayed_.empty()) next = std::min(next, delayed_.front().first);
      if (!bytes) next = std::min(next, now + kEmptyLine);
      waitUntil(next, bytes.has_value());
    }
  }

  void takeLines() {
    const std::string& terminator = config_.profile.terminator;
    for (std::size_t end = input_.find(terminator); end != std::string::npos;
         end = input_.find(terminator)) {
      const std::string line = input_.substr(0, end);
      input_.erase(0, end + terminator.size());
      SerialDialogue::Outcome outcome;
      DeviceFault fault = DeviceFault::kNone;
      {
        const basics::MutexLock lock(mutex_);
        advance();
        fault = fault_;
        outcome = dialogue_.take(line, fault);
      }
      if (outcome.sets) last_set_ = seconds(Clock::now().time_since_epoch());
      if (outcome.understood) ++lines_;
      if (outcome.answer) say(*outcome.answer, fault);
    }
    if (input_.size() > regulator::kLongestLine) input_.clear();
  }

  void speakUnasked() {
    std::optional<std::string> line;
    DeviceFault fault = DeviceFault::kNone;
    {
      const basics::MutexLock lock(mutex_);
      advance();
      fault = fault_;
      line = dialogue_.unasked(fault);
    }
    if (line && fault != DeviceFault::kSilence) say(*line, fault);
  }

  void say(const std::string& line, DeviceFault fault) {
    std::string bytes = line + config_.profile.terminator;
    if (fault == DeviceFault::kHalfLine) bytes = line.substr(0, line.size() / 2);
    if (fault == DeviceFault::kGarbage) {
      std::uniform_int_distribution<int> byte(0, 255);
      for (char& c : bytes) c = static_cast<char>(byte(generator_));
      bytes += config_.profile.terminator;
    }
    if (fault == DeviceFault::kSlow) {
      // One line at a time, like a device that is busy.
      const Clock::time_point begin = delayed_.empty() ? Clock::now() : delayed_.back().first;
      delayed_.emplace_back(begin + spanOf(kSlowness * config_.profile.timeout), bytes);
    } else {
      terminal_->send(bytes);
    }
  }

  void sendDelayed(Clock::time_point now) {
    while (!delayed_.empty() && delayed_.front().first <= now) {
      terminal_->send(delayed_.front().second);
      delayed_.erase(delayed_.begin());
    }
  }

  const SerialDeviceConfig config_;
  mutable basics::Mutex mutex_;
  SerialDialogue dialogue_ HELIX_ARM_GUARDED_BY(mutex_);
  DeviceLink link_ HELIX_ARM_GUARDED_BY(mutex_);
  std::string terminal_path_ HELIX_ARM_GUARDED_BY(mutex_);
  DeviceFault fault_ HELIX_ARM_GUARDED_BY(mutex_) = DeviceFault::kNone;
  Clock::time_point last_step_ HELIX_ARM_GUARDED_BY(mutex_);

  // Used only by the thread.
  std::unique_ptr<PseudoTerminal> terminal_;
  std::mt19937 generator_;
  std::string input_;
  std::vector<std::pair<Clock::time_point, std::string>> delayed_;

  std::atomic<std::uint64_t> lines_{0}, restarts_{0};
  std::atomic<double> last_set_{std::numeric_limits<double>::quiet_NaN()};
  std::atomic<bool> ended_{false};
  const int wake_;
  std::thread thread_;
};

SerialDevice::SerialDevice(SerialDeviceConfig config)
    : worker_(std::make_unique<Worker>(std::move(config))) {}
SerialDevice::~SerialDevice() = default;

std::string SerialDevice::path() const { return worker_->path(); }
void SerialDevice::setFault(DeviceFault fault) { worker_->setFault(fault); }
DeviceFault SerialDevice::fault() const { return worker_->fault(); }
Eigen::VectorXd SerialDevice::pressure() const {
  return worker_->ask(
      [](const SerialDialogue& device) { return Eigen::VectorXd(device.pressure()); });
}
Eigen::VectorXd SerialDevice::setPoint() const {
  return worker_->ask(
      [](const SerialDialogue& device) { return Eigen::VectorXd(device.setPoint()); });
}
std::vector<control::Valve> SerialDevice::valves() const {
  return worker_->ask(
      [](const SerialDialogue& device) { return std::vector<Valve>(device.valves()); });
}
std::uint64_t SerialDevice::lines() const { return worker_->lines(); }
std::uint64_t SerialDevice::restarts() const { return worker_->restarts(); }
double SerialDevice::lastSetTime() const { return worker_->lastSetTime(); }

}  // namespace helix_arm::simulation
