#include "emulated_device.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "basics/text.hpp"
#include "emulation.hpp"
#include "regulator/line_format.hpp"
#include "regulator/regulator_io.hpp"

namespace helix_arm::simulation {
namespace {

constexpr double kSlowness = 2.5;       // of an answer, in timeouts
constexpr double kBetweenTries = 0.05;  // to come back [s]
constexpr double kEmptyLine = 0.002;    // between checks for a new client [s]
constexpr double kLongestWait = 1;      // [s]

constexpr const char* kFaultNames[kDeviceFaultCount] = {
    "none",     "silence",     "garbage", "half_line",  "wrong_unit", "slow",      "restart",
    "nan_text", "stuck_value", "burst",   "stuck_open", "stuck_shut", "low_supply"};
static_assert(kFaultNames[kDeviceFaultCount - 1] != nullptr, "each fault has a name");

// The last faults are those of the air behind the device, in their order.
regulator::AirFault airFaultOf(DeviceFault fault) {
  constexpr int kBefore = static_cast<int>(DeviceFault::kBurst) - 1;
  static_assert(static_cast<int>(DeviceFault::kLowSupply) - kBefore ==
                static_cast<int>(regulator::AirFault::kLowSupply));
  return static_cast<regulator::AirFault>(std::max(0, static_cast<int>(fault) - kBefore));
}

[[noreturn]] std::unique_ptr<Emulation> emulate(const regulator::SimulatedRegulatorConfig&,
                                                const EmulatedDeviceConfig&) {
  throw std::invalid_argument("emulated device: its regulator is simulated; expected hardware");
}

}  // namespace

const char* nameOf(DeviceFault fault) { return kFaultNames[static_cast<std::size_t>(fault)]; }

std::string deviceFaultNames() { return basics::joined(kFaultNames); }

std::optional<DeviceFault> parseDeviceFault(const std::string& name) {
  for (int i = 0; i < kDeviceFaultCount; ++i) {
    if (name == kFaultNames[i]) return static_cast<DeviceFault>(i);
  }
  return std::nullopt;
}

Emulation::Emulation(int channels, const regulator::SimulatedRegulatorConfig& valves,
                     DeviceTiming timing)
    : timing_(std::move(timing)),
      regulator_(channels, valves),
      time_(regulator::steadyNow()),
      generator_(timing_.seed) {}

double Emulation::work() {
  catchUp();
  if (is_away_ && !comesBack()) return kBetweenTries;
  accept();
  for (std::size_t i = clients_.size(); i-- > 0;) hear(i);
  if (time_ >= next_unasked_) {
    next_unasked_ = time_ + timing_.period;
    for (Client& client : clients_) {
      if (!client.is_there || fault_ == DeviceFault::kSilence) continue;
      if (const auto line = unasked()) say(client, *line);
    }
  }
  return std::min({sendLate(), next_unasked_ - time_, kLongestWait});
}

std::vector<int> Emulation::files() const {
  if (is_away_) return {};
  std::vector<int> files;
  if (listener() >= 0) files.push_back(listener());
  for (const Client& client : clients_) {
    if (client.is_there) files.push_back(client.stream.file());
  }
  return files;
}

void Emulation::setFault(DeviceFault fault) {
  catchUp();
  if (fault_ == DeviceFault::kSilence && fault != fault_) {
    accept();
    for (std::size_t i = clients_.size(); i-- > 0;) hear(i);
    if (listener() >= 0 && !clients_.empty()) {
      clients_.clear();
      loseLink();
    }
  }
  if (fault == DeviceFault::kStuckValue) stuck_ = regulator_.pressure();
  if (fault == DeviceFault::kRestart) is_away_ = true;
  regulator_.fail(airFaultOf(fault));
  fault_ = fault;
}

void Emulation::catchUp() {
  const double now = regulator::steadyNow();
  step(now - time_);
  time_ = now;
}

Eigen::VectorXd Emulation::readings() {
  if (fault_ == DeviceFault::kStuckValue) return stuck_;
  Eigen::VectorXd readings = regulator_.measure();
  if (fault_ == DeviceFault::kNanText) {
    readings.setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  return readings;
}

bool Emulation::comesBack() {
  try {
    if (!open()) return false;
  } catch (const std::runtime_error&) {  // its place is taken: try again later
    return false;
  }
  is_away_ = false;
  if (fault_ == DeviceFault::kRestart) fault_ = DeviceFault::kNone;
  restart();
  ++restarts_;
  return true;
}

void Emulation::hear(std::size_t i) {
  Client& client = clients_[i];
  const std::optional<std::string> bytes = client.stream.receive();
  client.is_there = bytes.has_value();
  if (!bytes && listener() >= 0) {
    clients_.erase(clients_.begin() + static_cast<std::ptrdiff_t>(i));
    if (clients_.empty()) loseLink();
    return;
  }
  if (!bytes || fault_ == DeviceFault::kSilence) return;
  client.input += *bytes;
  for (auto request = next(client.input); request; request = next(client.input)) {
    catchUp();
    const Outcome outcome = take(*request);
    if (outcome.sets) last_set_ = time_;
    if (outcome.taken) ++taken_;
    if (outcome.answer) say(client, *outcome.answer);
  }
  if (client.input.size() > regulator::kLongestLine) client.input.clear();
}

void Emulation::say(Client& client, std::string answer) {
  if (fault_ == DeviceFault::kHalfLine) {
    answer.resize(answer.size() / 2);
  } else {
    std::uniform_int_distribution<int> byte(0, 255);
    for (char& c : answer) {
      if (fault_ == DeviceFault::kGarbage) c = static_cast<char>(byte(generator_));
    }
    answer += timing_.terminator;
  }
  if (fault_ == DeviceFault::kSlow) {
    // One at a time, like a device that is busy.
    const double begin = client.late.empty() ? time_ : client.late.back().first;
    client.late.emplace_back(begin + kSlowness * timing_.timeout, std::move(answer));
  } else {
    client.stream.send(answer);
  }
}

double Emulation::sendLate() {
  double wait = kLongestWait;
  for (Client& client : clients_) {
    auto& late = client.late;
    for (; !late.empty() && (fault_ != DeviceFault::kSlow || late.front().first <= time_);
         late.pop_front()) {
      client.stream.send(late.front().second);
    }
    if (!late.empty()) wait = std::min(wait, late.front().first - time_);
    if (!client.is_there) wait = std::min(wait, kEmptyLine);
  }
  return wait;
}

EmulatedDevice::EmulatedDevice(const EmulatedDeviceConfig& config)
    : emulation_(
          std::visit([&](const auto& kind) { return emulate(kind, config); }, config.regulator)),
      wake_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)),
      thread_([this] { run(); }) {}

EmulatedDevice::~EmulatedDevice() {
  {
    const basics::MutexLock lock(mutex_);
    ended_ = true;
  }
  eventfd_write(wake_, 1);
  thread_.join();
  ::close(wake_);
}

void EmulatedDevice::run() {
  for (;;) {
    std::vector<pollfd> waited{{wake_, POLLIN, 0}};
    double longest = 0;
    {
      const basics::MutexLock lock(mutex_);
      if (ended_) return;
      longest = emulation_->work();
      for (const int file : emulation_->files()) waited.push_back({file, POLLIN, 0});
    }
    poll(waited.data(), waited.size(), static_cast<int>(std::ceil(1e3 * std::max(longest, 0.0))));
    eventfd_t count = 0;
    eventfd_read(wake_, &count);
  }
}

template <class Ask>
auto EmulatedDevice::ask(const Ask& ask) const {
  const basics::MutexLock lock(mutex_);
  emulation_->catchUp();
  return std::invoke(ask, *emulation_);
}

void EmulatedDevice::setFault(DeviceFault fault) {
  ask([=](Emulation& device) { device.setFault(fault); });
  eventfd_write(wake_, 1);
}
void EmulatedDevice::jam(int slot, bool jammed) {
  ask([=](Emulation& device) { device.jam(slot, jammed); });
}
std::string EmulatedDevice::path() const { return ask(&Emulation::path); }
int EmulatedDevice::port() const { return ask(&Emulation::port); }
DeviceFault EmulatedDevice::fault() const { return ask(&Emulation::fault); }
Eigen::VectorXd EmulatedDevice::pressure() const { return ask(&Emulation::pressure); }
Eigen::VectorXd EmulatedDevice::setPoint() const { return ask(&Emulation::setPoint); }
std::vector<control::Valve> EmulatedDevice::valves() const { return ask(&Emulation::valves); }
std::uint64_t EmulatedDevice::taken() const { return ask(&Emulation::taken); }
std::uint64_t EmulatedDevice::restarts() const { return ask(&Emulation::restarts); }
int EmulatedDevice::connections() const { return ask(&Emulation::connections); }
double EmulatedDevice::lastSetTime() const { return ask(&Emulation::lastSetTime); }

}  // namespace helix_arm::simulation
