#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <new>
#include <random>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include <netinet/in.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <unistd.h>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "helix_arm/simulation/emulated_device.hpp"
#include "modbus/modbus.h"

namespace helix_arm::simulation {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr int kBacklog = 16;
constexpr double kRestartTime = 0.05;             // [s]
constexpr std::uint32_t kRestOfRequest = 100000;  // longest wait for it [us]

// Owns a file descriptor.
class File {
 public:
  explicit File(int number = -1) : number_(number) {}
  File(File&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  File& operator=(File&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~File() {
    if (number_ >= 0) close(number_);
  }
  int number() const { return number_; }

 private:
  int number_;
};

File openCounter() {
  File counter(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  if (counter.number() < 0) throw std::system_error(errno, std::generic_category(), "eventfd");
  return counter;
}

struct Freer {
  void operator()(modbus_t* context) const { modbus_free(context); }
};
using Context = std::unique_ptr<modbus_t, Freer>;

Context newContext(int port) {
  Context context(modbus_new_tcp("127.0.0.1", port));
  if (!context) throw std::runtime_error(modbus_strerror(errno));
  modbus_set_byte_timeout(context.get(), 0, kRestOfRequest);
  // libmodbus waits this long before it answers some requests with an exception.
  modbus_set_response_timeout(context.get(), 0, 1);
  return context;
}

int word(const Bytes& bytes, std::size_t at) { return bytes[at] << 8 | bytes[at + 1]; }

constexpr double kWrongUnit = 0.1;  // kPa in the place of millibar
constexpr int kHighestRegister = 0xffff;

int slotsOf(const ModbusDeviceConfig& config) {
  config.profile.validate();
  basics::requireValue(config.places >= 1, "emulated Modbus device", "the number of places",
                       config.places, "at least 1");
  basics::requireValue(config.activation_time >= 0, "emulated Modbus device",
                       "the activation time [s]", config.activation_time, "a value >= 0");
  const regulator::ModbusProfile& profile = config.profile;
  const int slots = profile.slot(config.places - 1) + 1;
  basics::requireValue(profile.output_base + slots * profile.output_stride <= kHighestRegister &&
                           profile.input_base + slots * profile.input_stride <= kHighestRegister,
                       "emulated Modbus device", "the number of places", config.places,
                       "as many as have registers below 65536");
  return slots;
}

modbus_mapping_t* newMap(const regulator::ModbusProfile& profile, int slots) {
  int first = profile.output_base;
  int end = first + slots * profile.output_stride;
  const auto cover = [&first, &end](int from, int to) {
    first = std::min(first, from);
    end = std::max(end, to);
  };
  int first_input = profile.input_base;
  int input_end = first_input + slots * profile.input_stride;
  if (profile.supply) {
    first_input = std::min(first_input, *profile.supply);
    input_end = std::max(input_end, *profile.supply + 1);
  }
  if (!profile.input_registers) cover(first_input, input_end);
  const auto size = [](int count) { return static_cast<unsigned>(count); };
  modbus_mapping_t* map = modbus_mapping_new_start_address(
      0, 0, 0, 0, size(first), size(end - first), size(first_input),
      profile.input_registers ? size(input_end - first_input) : 0);
  if (map == nullptr) throw std::bad_alloc();
  return map;
}

}  // namespace

/// State of an emulated device: its register map, the apps of its slots, its pressures.
class ModbusImage {
 public:
  /// Not ready, vented.
  explicit ModbusImage(const ModbusDeviceConfig& config)
      : profile_(config.profile),
        rules_(config.regulator),
        activation_time_(config.activation_time),
        slots_(static_cast<std::size_t>(slotsOf(config))),
        regulator_(slots() * profile_.outlets, rules_),
        time_(regulator::steadyNow()),
        map_(newMap(profile_, slots()), modbus_mapping_free) {
    restart();
  }

  /// The registers that modbus_reply() reads and writes.
  modbus_mapping_t* map() { return map_.get(); }

  /// Restarts, as after power-on.
  void restart() {
    for (Slot& slot : slots_) slot.app = App::kNotReady;
    clear();
    regulator_ = regulator::SimulatedRegulator(slots() * profile_.outlets, rules_);
    follows_ = regulator_.pressure();
    stuck_.assign(static_cast<std::size_t>(follows_.size()), 0);
  }

  /// The last connection is gone: running apps end and wait for another command.
  void loseLink() {
    if (!profile_.app) return;
    clear();
    for (Slot& slot : slots_) {
      if (slot.app != App::kNotReady) slot.app = App::kReady;
    }
    regulate();
  }

  void jam(int slot, bool jammed) {
    Slot& changed = slots_.at(static_cast<std::size_t>(slot));
    changed.jammed = jammed;
    if (jammed) changed.app = App::kNotReady;
    regulate();
  }

  /// Whether a request touches only registers that the device has.
  bool allows(int function, int first, int count) const {
    const auto inside = [](int number, int from, int size) {
      return number >= from && number < from + size;
    };
    const auto isOutput = [&](int number) {
      return inside(number, profile_.output_base, slots() * profile_.output_stride);
    };
    const auto isInput = [&](int number) {
      return inside(number, profile_.input_base, slots() * profile_.input_stride) ||
             number == profile_.supply;
    };
    const bool reads_inputs = function == MODBUS_FC_READ_INPUT_REGISTERS;
    const bool reads_holding = function == MODBUS_FC_READ_HOLDING_REGISTERS;
    const bool writes = function == MODBUS_FC_WRITE_SINGLE_REGISTER ||
                        function == MODBUS_FC_WRITE_MULTIPLE_REGISTERS;
    for (int number = first; number < first + count; ++number) {
      const bool input = isInput(number), output = isOutput(number);
      const bool allowed = (reads_inputs && input && profile_.input_registers) ||
                           (reads_holding && (output || (input && !profile_.input_registers))) ||
                           (writes && output);
      if (!allowed) return false;
    }
    return count > 0;
  }

  /// Advances the simulation to now [s].
  void catchUp(double now) {
    regulator_.step(std::max(0.0, now - time_));
    time_ = std::max(time_, now);
    bool started = false;
    for (Slot& slot : slots_) {
      if (slot.app != App::kStarting || now - slot.since < activation_time_) continue;
      slot.app = App::kRunning;
      started = true;
    }
    if (started) regulate();
  }

  /// Updates the input registers.
  void measure(DeviceFault fault) {
    const Eigen::VectorXd reading = regulator_.measure();
    const double factor = fault == DeviceFault::kWrongUnit ? kWrongUnit : 1.0;
    const auto word = [&](double pressure) {
      const double count = std::round(factor * (pressure + profile_.atmosphere) / profile_.pascals);
      return static_cast<std::uint16_t>(
          static_cast<std::int16_t>(std::clamp(count, -32767., 32767.)));
    };
    for (int place = 0; place < reading.size(); ++place) {
      std::uint16_t& number = input(profile_.reading(place));
      if (fault == DeviceFault::kNanText) {
        number = regulator::kNoReading;
      } else if (fault == DeviceFault::kStuckValue) {
        number = stuck_[static_cast<std::size_t>(place)];
      } else {
        number = word(reading[place]);
      }
    }
    if (profile_.supply) input(*profile_.supply) = word(regulator_.supply());
    for (int i = 0; profile_.app && i < slots(); ++i) {
      const App app = slots_[static_cast<std::size_t>(i)].app;
      const int status = app == App::kRunning    ? profile_.app->running
                         : app == App::kNotReady ? profile_.app->status_mask ^ profile_.app->ready
                                                 : profile_.app->ready;
      input(profile_.status(i)) = static_cast<std::uint16_t>(status);
    }
  }

  /// Freezes the readings, for kStuckValue.
  void stick() {
    measure(DeviceFault::kNone);
    for (std::size_t i = 0; i < stuck_.size(); ++i) {
      stuck_[i] = input(profile_.reading(static_cast<int>(i)));
    }
  }

  void fail(regulator::AirFault fault) { regulator_.fail(fault); }

  /// Executes the output registers.
  void obey(double now) {
    for (int i = 0; profile_.app && i < slots(); ++i) {
      Slot& slot = slots_[static_cast<std::size_t>(i)];
      const int command = output(profile_.command(i));
      if (slot.jammed) continue;
      if (command == profile_.app->acknowledge) {
        slot.app = App::kReady;
      } else if (command != profile_.app->regulate) {
        if (slot.app != App::kNotReady) slot.app = App::kReady;
      } else if (slot.app == App::kReady) {
        slot.app = App::kStarting;
        slot.since = now;
      }
    }
    regulate();
  }

  const Eigen::VectorXd& pressure() const { return regulator_.pressure(); }

  Eigen::VectorXd setPoint() const {
    Eigen::VectorXd set_point(follows_.size());
    for (int place = 0; place < set_point.size(); ++place) set_point[place] = ordered(place);
    return set_point;
  }

  std::vector<control::Valve> valves() const {
    std::vector<control::Valve> valves;
    for (int place = 0; place < follows_.size(); ++place) {
      valves.push_back(!runs(place)          ? control::Valve::kClose
                       : ordered(place) <= 0 ? control::Valve::kVent
                                             : control::Valve::kRegulate);
    }
    return valves;
  }

  int slots() const { return static_cast<int>(slots_.size()); }

 private:
  enum class App { kNotReady, kReady, kStarting, kRunning };
  struct Slot {
    App app = App::kNotReady;
    double since = 0;  // it began to start [s]
    bool jammed = false;
  };

  void clear() { std::fill_n(map_->tab_registers, map_->nb_registers, std::uint16_t{0}); }

  std::uint16_t& output(int number) const {
    return map_->tab_registers[number - map_->start_registers];
  }

  std::uint16_t& input(int number) const {
    return profile_.input_registers
               ? map_->tab_input_registers[number - map_->start_input_registers]
               : output(number);
  }

  // Set point as written [Pa].
  double ordered(int place) const {
    return output(profile_.setPoint(place)) * profile_.pascals - profile_.atmosphere;
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
  const regulator::SimulatedRegulatorConfig rules_;
  const double activation_time_;
  std::vector<Slot> slots_;
  regulator::SimulatedRegulator regulator_;
  Eigen::VectorXd follows_;  // pressure that each place follows [Pa]
  std::vector<std::uint16_t> stuck_;
  double time_;  // of the pressures [s]
  std::unique_ptr<modbus_mapping_t, void (*)(modbus_mapping_t*)> map_;
};

class ModbusDevice::Server {
 public:
  explicit Server(const ModbusDeviceConfig& config)
      : timeout_(config.profile.timeout), image_(config), wake_(openCounter()) {
    listen(config.port);
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, pair_.data()) != 0) {
      throw std::system_error(errno, std::generic_category(), "socketpair");
    }
    ends_ = {File(pair_[0]), File(pair_[1])};
    thread_ = std::thread([this] { run(); });
  }
  ~Server() {
    {
      const basics::MutexLock lock(mutex_);
      stop_ = true;
    }
    eventfd_write(wake_.number(), 1);
    thread_.join();
  }

  int port() const { return port_; }

  void setFault(DeviceFault fault) {
    {
      const basics::MutexLock lock(mutex_);
      image_.catchUp(regulator::steadyNow());
      if (fault == DeviceFault::kStuckValue) image_.stick();
      if (fault_ == DeviceFault::kSilence && fault != fault_) deaf_before_ = true;
      image_.fail(airFaultOf(fault));
      fault_ = fault;
    }
    eventfd_write(wake_.number(), 1);
  }

  // Asks the device for its present state.
  template <class Ask>
  auto ask(const Ask& ask) {
    const basics::MutexLock lock(mutex_);
    image_.catchUp(regulator::steadyNow());
    return ask(image_);
  }
  DeviceFault fault() const {
    const basics::MutexLock lock(mutex_);
    return fault_;
  }
  std::uint64_t writes() const {
    const basics::MutexLock lock(mutex_);
    return writes_;
  }
  double lastWrite() const {
    const basics::MutexLock lock(mutex_);
    return last_write_;
  }
  int connections() const {
    const basics::MutexLock lock(mutex_);
    return connections_;
  }

 private:
  // A delayed answer.
  struct Late {
    double due;
    int client;
    Bytes reply;
  };

  void listen(int port) {
    context_ = newContext(port);
    listener_ = File(modbus_tcp_listen(context_.get(), kBacklog));
    if (listener_.number() < 0) {
      throw std::runtime_error("cannot listen at 127.0.0.1:" + std::to_string(port) + ": " +
                               modbus_strerror(errno) + "; choose another port, above 1023");
    }
    sockaddr_in address{};
    socklen_t size = sizeof address;
    getsockname(listener_.number(), reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
  }

  void run() {
    for (;;) {
      DeviceFault fault;
      bool deaf_before;
      {
        const basics::MutexLock lock(mutex_);
        if (stop_) break;
        fault = fault_;
        deaf_before = std::exchange(deaf_before_, false);
      }
      if (deaf_before) {
        accept();
        dropAll();
      }
      if (fault == DeviceFault::kRestart) {
        restart();
        continue;
      }
      const bool hears = fault != DeviceFault::kSilence;
      await(hears);
      sendLate();
      if (!hears) continue;
      for (std::size_t i = clients_.size(); i-- > 0;) {
        if (waited_[i + 2].revents != 0) serve(i);
      }
      if (waited_[1].revents != 0) accept();
    }
  }

  void restart() {
    dropAll();
    listener_ = File();
    {
      const basics::MutexLock lock(mutex_);
      image_.catchUp(regulator::steadyNow());
      image_.restart();
    }
    for (bool listens = false; !listens && !stopped();) {
      std::this_thread::sleep_for(std::chrono::duration<double>(kRestartTime));
      try {
        listen(port_);
        listens = true;
      } catch (const std::runtime_error&) {  // the port is in use: try again later
      }
    }
    const basics::MutexLock lock(mutex_);
    if (fault_ == DeviceFault::kRestart) fault_ = DeviceFault::kNone;
  }

  bool stopped() const {
    const basics::MutexLock lock(mutex_);
    return stop_;
  }

  void accept() {
    pollfd waited{listener_.number(), POLLIN, 0};
    while (poll(&waited, 1, 0) > 0) {
      File client(accept4(listener_.number(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
      if (client.number() < 0 || client.number() >= FD_SETSIZE) return;
      clients_.push_back(std::move(client));
      const basics::MutexLock lock(mutex_);
      ++connections_;
    }
  }

  void drop(std::size_t client) {
    const int number = clients_[client].number();
    late_.erase(std::remove_if(late_.begin(), late_.end(),
                               [number](const Late& late) { return late.client == number; }),
                late_.end());
    clients_.erase(clients_.begin() + static_cast<std::ptrdiff_t>(client));
    const basics::MutexLock lock(mutex_);
    if (--connections_ > 0) return;
    image_.catchUp(regulator::steadyNow());
    image_.loseLink();
  }

  void dropAll() {
    while (!clients_.empty()) drop(clients_.size() - 1);
  }

  void serve(std::size_t client) {
    Bytes request(MODBUS_TCP_MAX_ADU_LENGTH);
    modbus_set_socket(context_.get(), clients_[client].number());
    const int size = modbus_receive(context_.get(), request.data());
    if (size <= 0) {
      drop(client);
      return;
    }
    request.resize(static_cast<std::size_t>(size));
    DeviceFault fault;
    Bytes said;
    {
      const basics::MutexLock lock(mutex_);
      fault = fault_;
      if (fault == DeviceFault::kSilence) return;
      said = answer(request, fault);
    }
    reply(client, std::move(said), fault);
  }

  Bytes answer(const Bytes& request, DeviceFault fault) HELIX_ARM_REQUIRES(mutex_) {
    const auto header = static_cast<std::size_t>(modbus_get_header_length(context_.get()));
    const double now = regulator::steadyNow();
    image_.catchUp(now);
    image_.measure(fault);
    modbus_set_socket(context_.get(), ends_[0].number());
    const int function = request[header];
    const int first = word(request, header + 1);
    const int count = function == MODBUS_FC_WRITE_SINGLE_REGISTER ? 1 : word(request, header + 3);
    const auto size = static_cast<int>(request.size());
    if (!image_.allows(function, first, count)) {
      modbus_reply_exception(context_.get(), request.data(), MODBUS_EXCEPTION_ILLEGAL_DATA_ADDRESS);
    } else if (modbus_reply(context_.get(), request.data(), size, image_.map()) > 0 &&
               function != MODBUS_FC_READ_HOLDING_REGISTERS &&
               function != MODBUS_FC_READ_INPUT_REGISTERS) {
      image_.obey(now);
      ++writes_;
      last_write_ = now;
    }
    Bytes said(MODBUS_TCP_MAX_ADU_LENGTH);
    const ssize_t got = recv(ends_[1].number(), said.data(), said.size(), 0);
    said.resize(static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
    return said;
  }

  void reply(std::size_t client, Bytes reply, DeviceFault fault) {
    if (fault == DeviceFault::kHalfLine) reply.resize(reply.size() / 2);
    if (fault == DeviceFault::kGarbage) {
      std::uniform_int_distribution<int> byte(0, 255);
      for (std::uint8_t& each : reply) each = static_cast<std::uint8_t>(byte(random_));
    }
    const int number = clients_[client].number();
    if (fault == DeviceFault::kSlow) {
      late_.push_back({regulator::steadyNow() + 1.5 * timeout_, number, std::move(reply)});
    } else if (send(number, reply.data(), reply.size(), MSG_NOSIGNAL) < 0) {
      drop(client);
    }
  }

  void sendLate() {
    const double now = regulator::steadyNow();
    for (std::size_t i = late_.size(); i-- > 0;) {
      if (late_[i].due > now) continue;
      // Fails if the client has closed; it is removed when that is noticed.
      send(late_[i].client, late_[i].reply.data(), late_[i].reply.size(), MSG_NOSIGNAL);
      late_.erase(late_.begin() + static_cast<std::ptrdiff_t>(i));
    }
  }

  // Waits for a request, a due answer or a change.
  void await(bool clients) {
    waited_.assign({{wake_.number(), POLLIN, 0}});
    if (clients) {
      waited_.push_back({listener_.number(), POLLIN, 0});
      for (const File& client : clients_) waited_.push_back({client.number(), POLLIN, 0});
    }
    double left = -1;
    for (const Late& late : late_) {
      const double until = std::max(0.0, late.due - regulator::steadyNow());
      left = left < 0 ? until : std::min(left, until);
    }
    poll(waited_.data(), waited_.size(), left < 0 ? -1 : static_cast<int>(std::ceil(1e3 * left)));
    eventfd_t count = 0;
    eventfd_read(wake_.number(), &count);
  }

  const double timeout_;
  mutable basics::Mutex mutex_;
  ModbusImage image_ HELIX_ARM_GUARDED_BY(mutex_);
  DeviceFault fault_ HELIX_ARM_GUARDED_BY(mutex_) = DeviceFault::kNone;
  bool deaf_before_ HELIX_ARM_GUARDED_BY(mutex_) = false;  // whether it was silent before
  std::uint64_t writes_ HELIX_ARM_GUARDED_BY(mutex_) = 0;
  double last_write_ HELIX_ARM_GUARDED_BY(mutex_) = -std::numeric_limits<double>::infinity();
  int connections_ HELIX_ARM_GUARDED_BY(mutex_) = 0;
  bool stop_ HELIX_ARM_GUARDED_BY(mutex_) = false;

  File wake_, listener_;
  int port_ = 0;
  Context context_;
  std::array<int, 2> pair_{};
  std::array<File, 2> ends_;  // libmodbus writes its answers to the first
  std::vector<File> clients_;
  std::vector<pollfd> waited_;
  std::vector<Late> late_;
  std::mt19937 random_{1};
  std::thread thread_;
};

ModbusDevice::ModbusDevice(const ModbusDeviceConfig& config)
    : server_(std::make_unique<Server>(config)) {}

ModbusDevice::~ModbusDevice() = default;

int ModbusDevice::port() const { return server_->port(); }

void ModbusDevice::setFault(DeviceFault fault) { server_->setFault(fault); }

DeviceFault ModbusDevice::fault() const { return server_->fault(); }

void ModbusDevice::jam(int slot, bool jammed) {
  server_->ask([slot, jammed](ModbusImage& image) { image.jam(slot, jammed); });
}

Eigen::VectorXd ModbusDevice::pressure() const {
  return server_->ask([](const ModbusImage& image) -> Eigen::VectorXd { return image.pressure(); });
}

Eigen::VectorXd ModbusDevice::setPoint() const {
  return server_->ask([](const ModbusImage& image) { return image.setPoint(); });
}

std::vector<control::Valve> ModbusDevice::valves() const {
  return server_->ask([](const ModbusImage& image) { return image.valves(); });
}

std::uint64_t ModbusDevice::writes() const { return server_->writes(); }

double ModbusDevice::lastWrite() const { return server_->lastWrite(); }

int ModbusDevice::connections() const { return server_->connections(); }

}  // namespace helix_arm::simulation
