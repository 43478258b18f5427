#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>

#include <netinet/in.h>
#include <sys/socket.h>

#include "emulation.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::simulation {
namespace {

using control::Valve;

constexpr int kBacklog = 16;
// Functions, and how many registers a request may have.
constexpr int kReadHolding = 3, kReadInputs = 4, kWriteOne = 6, kWriteMany = 16;
constexpr int kMostRead = 125, kMostWritten = 123;
// Exceptions.
constexpr char kNoSuchRegister = 2, kNoSuchNumber = 3;
// Where a request has its length, the function, the first register, and their number or value.
constexpr std::size_t kLength = 4, kFunction = 7, kFirst = 8, kCount = 10, kWords = 13;

constexpr double kWrongUnit = 0.1;  // kPa in the place of millibar
constexpr int kHighestRegister = 0xffff;

int slotsOf(const regulator::ModbusProfile& profile, const EmulatedDeviceConfig& config) {
  profile.validate();
  basics::requireValue(config.channels >= 1, "emulated Modbus device", "the number of places",
                       config.channels, "at least 1");
  basics::requireValue(config.activation_time >= 0, "emulated Modbus device",
                       "the activation time [s]", config.activation_time, "a value >= 0");
  const int slots = profile.slot(config.channels - 1) + 1;
  basics::requireValue(profile.output_base + slots * profile.output_stride <= kHighestRegister &&
                           profile.input_base + slots * profile.input_stride <= kHighestRegister,
                       "emulated Modbus device", "the number of places", config.channels,
                       "as many as have registers below 65536");
  return slots;
}

int word(const std::string& bytes, std::size_t at) {
  return static_cast<std::uint8_t>(bytes[at]) << 8 | static_cast<std::uint8_t>(bytes[at + 1]);
}

class ModbusEmulation : public Emulation {
 public:
  ModbusEmulation(const regulator::ModbusConfig& regulator, const EmulatedDeviceConfig& config)
      : Emulation(slotsOf(regulator.profile, config) * regulator.profile.outlets, config.valves,
                  {regulator.profile.timeout, ""}),
        profile_(regulator.profile),
        valves_(config.valves),
        activation_time_(config.activation_time),
        slots_(static_cast<std::size_t>(slotsOf(regulator.profile, config))),
        holding_(kHighestRegister + 1),
        inputs_(kHighestRegister + 1),
        port_(regulator.port) {
    ModbusEmulation::restart();
    ModbusEmulation::open();
  }

  int port() const override { return port_; }
  void jam(int slot, bool jammed) override {
    Slot& changed = slots_.at(static_cast<std::size_t>(slot));
    changed.jammed = jammed;
    if (jammed) changed.app = App::kNotReady;
    regulate();
  }
  Eigen::VectorXd setPoint() const override {
    Eigen::VectorXd set_point(follows_.size());
    for (int place = 0; place < set_point.size(); ++place) set_point[place] = ordered(place);
    return set_point;
  }

  std::vector<Valve> valves() const override {
    std::vector<Valve> valves;
    for (int place = 0; place < follows_.size(); ++place) {
      valves.push_back(!runs(place)          ? Valve::kClose
                       : ordered(place) <= 0 ? Valve::kVent
                                             : Valve::kRegulate);
    }
    return valves;
  }

 private:
  enum class App { kNotReady, kReady, kStarting, kRunning };
  struct Slot {
    App app = App::kNotReady;
    double since = 0;  // it began to start [s]
    bool jammed = false;
  };

  // A port that was open is closed for a moment first.
  bool open() override {
    clients_.clear();
    if (listener_.file() >= 0) {
      listener_ = Stream();
      return false;
    }
    Stream listener(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    const int on = 1;
    setsockopt(listener.file(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port_));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    auto* const generic = reinterpret_cast<sockaddr*>(&address);
    socklen_t size = sizeof address;
    if (bind(listener.file(), generic, size) != 0 || listen(listener.file(), kBacklog) != 0) {
      throw std::runtime_error("cannot listen at 127.0.0.1:" + std::to_string(port_) + ": " +
                               std::strerror(errno) + "; choose another port, above 1023");
    }
    getsockname(listener.file(), generic, &size);
    port_ = ntohs(address.sin_port);
    listener_ = std::move(listener);
    return true;
  }
  int listener() const override { return listener_.file(); }
  void accept() override {
    for (;;) {
      Stream client(accept4(listener(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
      if (client.file() < 0) return;
      clients_.push_back({std::move(client)});
    }
  }

  // Running apps end and wait for another command.
  void loseLink() override {
    if (!profile_.app) return;
    std::fill(holding_.begin(), holding_.end(), std::uint16_t{0});
    for (Slot& slot : slots_) {
      if (slot.app != App::kNotReady) slot.app = App::kReady;
    }
    regulate();
  }

  std::optional<std::string> next(std::string& input) const override {
    if (input.size() < kLength + 2) return std::nullopt;
    const std::size_t size = kLength + 2 + static_cast<std::size_t>(word(input, kLength));
    if (input.size() < size) return std::nullopt;
    std::string request = input.substr(0, size);
    input.erase(0, size);
    return request;
  }

  Outcome take(const std::string& request) override {
    if (request.size() < kCount + 2) return {};
    measure();
    const int function = static_cast<std::uint8_t>(request[kFunction]);
    const int first = word(request, kFirst);
    const int count = function == kWriteOne ? 1 : word(request, kCount);
    const bool reads = function == kReadHolding || function == kReadInputs;
    const std::size_t words = function == kWriteOne ? kCount : kWords;
    Outcome outcome;
    std::string reply;
    if (!allows(function, first, count)) {
      reply = {static_cast<char>(function | 0x80), kNoSuchRegister};
    } else if (count > (reads ? kMostRead : kMostWritten) ||
               (!reads && request.size() < words + 2 * static_cast<std::size_t>(count))) {
      reply = {static_cast<char>(function | 0x80), kNoSuchNumber};
    } else if (reads) {
      const std::vector<std::uint16_t>& from = function == kReadInputs ? inputs_ : holding_;
      reply = {static_cast<char>(function), static_cast<char>(2 * count)};
      for (int i = first; i < first + count; ++i) {
        reply += {static_cast<char>(from[i] >> 8), static_cast<char>(from[i] & 0xff)};
      }
    } else {
      for (int i = 0; i < count; ++i) {
        holding_[first + i] = static_cast<std::uint16_t>(word(request, words + 2 * i));
      }
      obey();
      outcome.taken = outcome.sets = true;
      reply = request.substr(kFunction, kCount + 2 - kFunction);
    }
    const std::string header = request.substr(0, kLength);
    outcome.answer =
        header + '\0' + static_cast<char>(reply.size() + 1) + request[kFunction - 1] + reply;
    return outcome;
  }

  // Whether a request touches only registers that the device has.
  bool allows(int function, int first, int count) const {
    const auto inside = [this](int number, int base, int stride) {
      return number >= base && number < base + slots() * stride;
    };
    const bool of_inputs = function == (profile_.input_registers ? kReadInputs : kReadHolding);
    const bool of_outputs =
        function == kReadHolding || function == kWriteOne || function == kWriteMany;
    for (int number = first; number < first + count; ++number) {
      const bool input =
          inside(number, profile_.input_base, profile_.input_stride) || number == profile_.supply;
      const bool output = inside(number, profile_.output_base, profile_.output_stride);
      if (!(input && of_inputs) && !(output && of_outputs)) return false;
    }
    return count > 0;
  }

  void restart() override {
    for (Slot& slot : slots_) slot.app = App::kNotReady;
    std::fill(holding_.begin(), holding_.end(), std::uint16_t{0});
    regulator_ = regulator::SimulatedRegulator(slots() * profile_.outlets, valves_);
    follows_ = regulator_.pressure();
  }

  void step(double dt) override {
    regulator_.step(dt);
    bool started = false;
    for (Slot& slot : slots_) {
      if (slot.app != App::kStarting || time_ + dt - slot.since < activation_time_) continue;
      slot.app = App::kRunning;
      started = true;
    }
    if (started) regulate();
  }

  // Updates the input registers.
  void measure() {
    const Eigen::VectorXd reading = readings();
    const double factor = fault_ == DeviceFault::kWrongUnit ? kWrongUnit : 1.0;
    const auto number = [&](double pressure) {
      if (std::isnan(pressure)) return static_cast<std::uint16_t>(regulator::kNoReading);
      const double count = std::round(factor * (pressure + profile_.atmosphere) / profile_.pascals);
      return static_cast<std::uint16_t>(
          static_cast<std::int16_t>(std::clamp(count, -32767., 32767.)));
    };
    std::vector<std::uint16_t>& inputs = profile_.input_registers ? inputs_ : holding_;
    for (int place = 0; place < reading.size(); ++place) {
      inputs[profile_.reading(place)] = number(reading[place]);
    }
    if (profile_.supply) inputs[*profile_.supply] = number(regulator_.supply());
    for (int i = 0; profile_.app && i < slots(); ++i) {
      const App app = slots_[static_cast<std::size_t>(i)].app;
      const int status = app == App::kRunning    ? profile_.app->running
                         : app == App::kNotReady ? profile_.app->status_mask ^ profile_.app->ready
                                                 : profile_.app->ready;
      inputs[profile_.status(i)] = static_cast<std::uint16_t>(status);
    }
  }

  // Executes the output registers.
  void obey() {
    for (int i = 0; profile_.app && i < slots(); ++i) {
      Slot& slot = slots_[static_cast<std::size_t>(i)];
      const int command = holding_[profile_.command(i)];
      if (slot.jammed) continue;
      if (command == profile_.app->acknowledge) {
        slot.app = App::kReady;
      } else if (command != profile_.app->regulate) {
        if (slot.app != App::kNotReady) slot.app = App::kReady;
      } else if (slot.app == App::kReady) {
        slot.app = App::kStarting;
        slot.since = time_;
      }
    }
    regulate();
  }

  int slots() const { return static_cast<int>(slots_.size()); }
  // Set point as written [Pa].
  double ordered(int place) const {
    return holding_[profile_.setPoint(place)] * profile_.pascals - profile_.atmosphere;
  }
  bool runs(int place) const {
    return !profile_.app || slots_[profile_.slot(place)].app == App::kRunning;
  }

  void regulate() {
    for (int place = 0; place < follows_.size(); ++place) {
      follows_[place] = runs(place) ? ordered(place) : regulator_.pressure()[place];
    }
    regulator_.command(follows_);
  }

  const regulator::ModbusProfile profile_;
  const regulator::SimulatedRegulatorConfig valves_;
  const double activation_time_;
  std::vector<Slot> slots_;
  Eigen::VectorXd follows_;                      // pressure that each place follows [Pa]
  std::vector<std::uint16_t> holding_, inputs_;  // registers, by number
  int port_;
  Stream listener_;
};

}  // namespace

std::unique_ptr<Emulation> emulate(const regulator::ModbusConfig& regulator,
                                   const EmulatedDeviceConfig& config) {
  return std::make_unique<ModbusEmulation>(regulator, config);
}

}  // namespace helix_arm::simulation
