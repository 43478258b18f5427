#include "helix_arm/simulation/serial_device.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <stdexcept>
#include <thread>

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "helix_arm/basics/mutex.hpp"
#include "pseudo_terminal.hpp"
#include "serial_dialogue.hpp"

namespace helix_arm::simulation {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kEmptyLine{2};    // between checks for a new client
constexpr std::chrono::milliseconds kNoTerminal{50};  // between attempts to create one
constexpr double kSlowness = 2.5;                     // of an answer, in timeouts

double seconds(Clock::duration span) { return std::chrono::duration<double>(span).count(); }
Clock::duration spanOf(double s) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
}

}  // namespace

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
  Eigen::VectorXd pressure() {
    const basics::MutexLock lock(mutex_);
    advance();
    return dialogue_.pressure();
  }
  Eigen::VectorXd setPoint() const {
    const basics::MutexLock lock(mutex_);
    return dialogue_.setPoint();
  }
  std::vector<control::Valve> valves() const {
    const basics::MutexLock lock(mutex_);
    return dialogue_.valves();
  }
  std::uint64_t lines() const { return lines_; }
  std::uint64_t restarts() const { return restarts_; }
  double lastSetTime() const { return last_set_; }

 private:
  void wake() const {
    const std::uint64_t one = 1;
    // Fails only if the thread is already due to wake.
    [[maybe_unused]] const ssize_t ignored = write(wake_, &one, sizeof one);
  }

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
    std::uint64_t count = 0;
    [[maybe_unused]] const ssize_t ignored = read(wake_, &count, sizeof count);
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
Eigen::VectorXd SerialDevice::pressure() const { return worker_->pressure(); }
Eigen::VectorXd SerialDevice::setPoint() const { return worker_->setPoint(); }
std::vector<control::Valve> SerialDevice::valves() const { return worker_->valves(); }
std::uint64_t SerialDevice::lines() const { return worker_->lines(); }
std::uint64_t SerialDevice::restarts() const { return worker_->restarts(); }
double SerialDevice::lastSetTime() const { return worker_->lastSetTime(); }

}  // namespace helix_arm::simulation
