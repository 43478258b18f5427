#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <fstream>
#include <future>
#include <limits>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/regulator/driver.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "modbus/modbus.h"
#include "tcp_link.hpp"

namespace helix_arm::regulator {
namespace {

constexpr char kPrefix[] = "helix_arm regulator ";
constexpr std::size_t kLongestName = 80;

struct SocketAddress {
  SocketAddress(const void* address, std::size_t length)
      : size(static_cast<socklen_t>(std::min(length, sizeof storage))) {
    std::memcpy(&storage, address, size);
  }
  const sockaddr* get() const { return reinterpret_cast<const sockaddr*>(&storage); }

  sockaddr_storage storage{};
  socklen_t size;
};

SocketAddress lockOf(const std::string& device) {
  const std::string text = kPrefix + device.substr(0, kLongestName);
  sockaddr_un address{};
  static_assert(sizeof kPrefix + kLongestName < sizeof address.sun_path);
  address.sun_family = AF_UNIX;
  std::copy(text.begin(), text.end(), address.sun_path + 1);  // after a 0: an abstract socket
  return {&address, offsetof(sockaddr_un, sun_path) + 1 + text.size()};
}

int makeSocket() { return socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0); }

// Describes the process that listens on the socket.
std::string holderOf(const SocketAddress& name) {
  const int caller = makeSocket();
  ucred holder{};
  socklen_t size = sizeof holder;
  // A full backlog refuses the call, and the holder may just have ended.
  const bool told = caller >= 0 && connect(caller, name.get(), name.size) == 0 &&
                    getsockopt(caller, SOL_SOCKET, SO_PEERCRED, &holder, &size) == 0 &&
                    holder.pid > 0;
  if (caller >= 0) ::close(caller);
  if (!told) return "another program";
  std::string program;
  std::ifstream command("/proc/" + std::to_string(holder.pid) + "/cmdline");
  std::getline(command, program, '\0');
  program.erase(0, program.rfind('/') + 1);  // npos + 1 is 0
  return "process " + std::to_string(holder.pid) +
         (program.empty() ? "" : " (" + basics::quoted(program) + ")");
}

constexpr std::size_t kMostAddresses = 3;

// Returns 0 on success, otherwise errno.
int connectWithin(int socket, const SocketAddress& address, double timeout) {
  if (connect(socket, address.get(), address.size) == 0) return 0;
  if (errno != EINPROGRESS) return errno;
  const double end = steadyNow() + timeout;
  for (;;) {
    const double left = std::max(end - steadyNow(), 0.0);
    pollfd waited{socket, POLLOUT, 0};
    const int ready = poll(&waited, 1, static_cast<int>(std::ceil(1e3 * left)));
    if (ready == 0) return ETIMEDOUT;
    if (ready < 0 && errno == EINTR) continue;
    if (ready < 0) return errno;
    int error = 0;
    socklen_t error_size = sizeof error;
    getsockopt(socket, SOL_SOCKET, SO_ERROR, &error, &error_size);
    return error;
  }
}

const char* remedyOf(int error) {
  switch (error) {
    case ECONNREFUSED:
      return "check that its Modbus server runs, and on this port";
    case ETIMEDOUT:
    case EHOSTUNREACH:
    case ENETUNREACH:
      return "check that it is switched on, and on this network";
    default:
      return "check host, port and cable";
  }
}

constexpr int kHighestRegister = 0xffff;
constexpr double kVacuum = -1.05e5;     // gauge, with the error of a sensor [Pa]
constexpr double kHairOfACount = 1e-6;  // rounding error of counts computed in doubles
constexpr std::chrono::milliseconds kBetweenLooks(5);

struct Freer {
  void operator()(modbus_t* context) const { modbus_free(context); }
};

const ModbusConfig& valid(const ModbusConfig& config) {
  const ModbusProfile& profile = config.profile;
  profile.validate();
  const std::string culprit = "regulator " + profile.name;
  basics::require(!config.slots.empty(), culprit, ": there are no slots; expected one per channel");
  std::set<int> seen;
  for (const int place : config.slots) {
    basics::requireValue(place >= 0, culprit.c_str(), "slot", place, "a number >= 0");
    basics::requireValue(seen.insert(place).second, culprit.c_str(), "slot", place,
                         "distinct slots");
    const int last = profile.slot(place) + 1;
    basics::requireValue(profile.output_base + last * profile.output_stride <= kHighestRegister &&
                             profile.input_base + last * profile.input_stride <= kHighestRegister,
                         culprit.c_str(), "slot", place, "one whose registers are below 65536");
  }
  return config;
}

std::set<int> slotsOf(const ModbusConfig& config) {
  std::set<int> slots;
  for (const int place : config.slots) slots.insert(config.profile.slot(place));
  return slots;
}

std::set<int> outputsOf(const ModbusConfig& config) {
  const ModbusProfile& profile = config.profile;
  std::set<int> registers;
  for (const int slot : slotsOf(config)) {
    for (int i = 0; i < profile.outlets; ++i) {
      registers.insert(profile.setPoint(slot * profile.outlets + i));
    }
    if (profile.app) registers.insert(profile.command(slot));
  }
  return registers;
}

std::set<int> inputsOf(const ModbusConfig& config) {
  const ModbusProfile& profile = config.profile;
  std::set<int> registers;
  for (const int place : config.slots) registers.insert(profile.reading(place));
  if (profile.app) {
    for (const int slot : slotsOf(config)) registers.insert(profile.status(slot));
  }
  // Registers between slots are included if one request then suffices.
  std::set<int> filled;
  for (const int number : registers) {
    if (!filled.empty() && number - *filled.rbegin() < MODBUS_MAX_READ_REGISTERS) {
      for (int i = *filled.rbegin() + 1; i < number; ++i) filled.insert(i);
    }
    filled.insert(number);
  }
  if (profile.supply) filled.insert(*profile.supply);
  return filled;
}

// The reply was complete: an exception, or the answer to another request.
bool isReply(int error) { return error > MODBUS_ENOBASE && error <= EMBBADSLAVE; }

std::string hex(int word) { return basics::format("0x%04x", word); }

}  // namespace

std::optional<std::string> DeviceLock::take(const std::string& device) {
  if (socket_ >= 0 && device == device_) return std::nullopt;
  release();
  const SocketAddress name = lockOf(device);
  const int mine = makeSocket();
  if (mine < 0) return std::nullopt;  // the device's own socket will fail, too
  if (bind(mine, name.get(), name.size) != 0) {
    const bool taken = errno == EADDRINUSE;
    ::close(mine);
    return taken ? std::optional(holderOf(name)) : std::nullopt;
  }
  listen(mine, SOMAXCONN);  // lets callers find the holder; no call is answered
  socket_ = mine;
  device_ = device;
  return std::nullopt;
}

void DeviceLock::release() noexcept {
  if (socket_ >= 0) ::close(socket_);
  socket_ = -1;
}

/// Opens TCP connections with timeouts to a device that one program on this machine drives at a
/// time.
class TcpLink {
 public:
  /// @param host  name or address.
  TcpLink(std::string host, int port)
      : host_(std::move(host)),
        port_(std::to_string(port)),
        place_((host_.find(':') == std::string::npos ? host_ : "[" + host_ + "]") + ":" + port_) {}

  /// Returns a connected socket, without delay of small messages, which the caller closes. The
  /// device is locked until release().
  ///
  /// @param timeout  for resolving the name, and again for each of at most three addresses [s].
  /// @throws LinkError naming host, port, cause and remedy, and the program that already drives the
  /// device.
  int open(double timeout) {
    const std::vector<SocketAddress> addresses = resolve(timeout);
    const std::size_t most = std::min(addresses.size(), kMostAddresses);
    int error = EADDRNOTAVAIL;
    for (std::size_t i = 0; i < most; ++i) {
      const SocketAddress& address = addresses[i];
      claim(address);
      const int socket =
          ::socket(address.storage.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
      if (socket < 0) {
        error = errno;
        continue;
      }
      // libmodbus waits with select(), which cannot handle larger descriptors.
      error = socket < FD_SETSIZE ? connectWithin(socket, address, timeout) : EMFILE;
      if (error == 0) {
        const int on = 1;
        setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
        return socket;
      }
      ::close(socket);
    }
    release();
    throw LinkError(place_ + ": cannot connect: " + std::strerror(error) + "; " + remedyOf(error));
  }

  /// Unlocks the device for other programs.
  void release() noexcept { lock_.release(); }
  /// Makes open() connect even if another program drives the device.
  void ignoreOthers() noexcept { ignores_others_ = true; }

  /// "host:port".
  const std::string& place() const { return place_; }

 private:
  struct Resolved {
    std::vector<SocketAddress> addresses;
    std::string error;
  };

  std::vector<SocketAddress> resolve(double timeout) {
    const auto look = [](const std::string& host, const std::string& port, int flags) {
      Resolved resolved;
      addrinfo hints{};
      hints.ai_socktype = SOCK_STREAM;
      hints.ai_flags = flags | AI_NUMERICSERV;
      addrinfo* found = nullptr;
      const int error = getaddrinfo(host.c_str(), port.c_str(), &hints, &found);
      if (error != 0) {
        resolved.error = error == EAI_SYSTEM ? std::strerror(errno) : gai_strerror(error);
        return resolved;
      }
      const std::unique_ptr<addrinfo, void (*)(addrinfo*)> owner(found, freeaddrinfo);
      for (const addrinfo* entry = found; entry != nullptr; entry = entry->ai_next) {
        resolved.addresses.emplace_back(entry->ai_addr, entry->ai_addrlen);
      }
      return resolved;
    };
    Resolved resolved = look(host_, port_, AI_NUMERICHOST);
    if (resolved.error.empty()) return resolved.addresses;

    // The resolver has no adjustable timeout: it runs in a thread of its own that nothing waits
    // for.
    if (!pending_.valid()) {
      auto promise = std::make_shared<std::promise<Resolved>>();
      pending_ = promise->get_future().share();
      std::thread([look, promise, host = host_, port = port_] {
        promise->set_value(look(host, port, 0));
      }).detach();
    }
    if (pending_.wait_for(std::chrono::duration<double>(timeout)) != std::future_status::ready) {
      throw LinkError(place_ +
                      ": no name server has answered yet; give an address such as "
                      "192.168.1.10 as host");
    }
    resolved = pending_.get();
    pending_ = {};
    if (!resolved.error.empty()) {
      throw LinkError(place_ + ": " + host_ + " is not known: " + resolved.error +
                      "; give an address such as 192.168.1.10 as host");
    }
    return resolved.addresses;
  }

  /// @throws LinkError if another program drives the device at this address.
  void claim(const SocketAddress& address) {
    char host[NI_MAXHOST] = "";
    getnameinfo(address.get(), address.size, host, sizeof host, nullptr, 0, NI_NUMERICHOST);
    const auto holder = lock_.take("modbus_tcp " + std::string(host) + " port " + port_);
    if (!holder || ignores_others_) return;
    throw LinkError(place_ + " is driven by " + *holder + "; end that one first");
  }

  std::string host_;
  std::string port_;
  std::string place_;
  DeviceLock lock_;
  bool ignores_others_ = false;
  /// Pending answer of a slow name server; a new request is made only after it.
  std::shared_future<Resolved> pending_;
};

/// Registers by number, and the consecutive runs of those in use, as Modbus transfers them.
struct ModbusRegisters {
  struct Run {
    int first, size;
  };

  /// @param longest  longest run, >= 1.
  ModbusRegisters(const std::set<int>& used, int longest) : words(kHighestRegister + 1) {
    for (const int number : used) {
      if (runs.empty() || number != runs.back().first + runs.back().size ||
          runs.back().size == longest) {
        runs.push_back({number, 0});
      }
      ++runs.back().size;
    }
  }

  std::vector<std::uint16_t> words;
  std::vector<Run> runs;
};

class ModbusTcpDriver : public Driver {
 public:
  explicit ModbusTcpDriver(const ModbusConfig& config)
      : profile_(valid(config).profile),
        places_(config.slots),
        tcp_(config.host, config.port),
        outputs_(outputsOf(config), MODBUS_MAX_WRITE_REGISTERS),
        inputs_(inputsOf(config), MODBUS_MAX_READ_REGISTERS) {
    for (const int slot : slotsOf(config)) slots_.push_back({slot, 0, 0.0});
  }
  ~ModbusTcpDriver() override { ModbusTcpDriver::close(); }

  void connect() override {
    disconnect();
    open();
    clearOutputs();
    try {
      if (profile_.app) {
        // A slot that already regulates continues, at no pressure: acknowledging would end its app,
        // and an ended app keeps the air in. If replies cannot be understood, this is all that is
        // sent.
        commandAll(profile_.app->regulate);
        send();
        fetch();
        const bool running = std::all_of(slots_.begin(), slots_.end(), [this](const Slot& slot) {
          return statusOf(slot) == profile_.app->running;
        });
        if (running) return;
        commandAll(profile_.app->acknowledge);
        send();
        awaitStatus(profile_.app->ready, "get ready");
        commandAll(profile_.app->regulate);
        send();
        awaitStatus(profile_.app->running, "start regulating");
      } else {
        send();
      }
    } catch (const BadReply& error) {
      close();
      throw LinkError(error.what());
    } catch (const LinkError&) {
      close();
      throw;
    }
  }

  void write(const control::ValveOrders& orders) override {
    basics::require(orders.valve.size() == places_.size() &&
                        orders.set_point.size() == static_cast<Eigen::Index>(places_.size()),
                    "regulator ", profile_.name, ": orders are of ", orders.valve.size(),
                    " channels; expected ", places_.size());
    basics::require(orders.set_point.allFinite(), "regulator ", profile_.name,
                    ": a set point is not finite; expected finite pascals");
    context();
    clearOutputs();
    for (Slot& slot : slots_) {
      bool closes = profile_.app.has_value();
      for (std::size_t i = 0; i < places_.size(); ++i) {
        if (profile_.slot(places_[i]) != slot.number) continue;
        closes = closes && orders.valve[i] == control::Valve::kClose;
        if (orders.valve[i] != control::Valve::kRegulate) continue;
        outputs_.words.at(profile_.setPoint(places_[i])) =
            countOf(orders.set_point[static_cast<Eigen::Index>(i)]);
      }
      if (profile_.app) command(slot, closes ? profile_.app->off : profile_.app->regulate);
    }
    send();
  }

  void read(Pressures& pressures) override {
    basics::require(pressures.pressure.size() == static_cast<Eigen::Index>(places_.size()),
                    "regulator ", profile_.name, ": readings are of ", pressures.pressure.size(),
                    " channels; expected ", places_.size());
    fetch();
    for (const Slot& slot : slots_) {
      if (!profile_.app || slot.command != profile_.app->regulate) continue;
      if (statusOf(slot) == profile_.app->running) continue;
      if (steadyNow() - slot.since < profile_.app->activation_time) continue;
      const int status = statusOf(slot);
      close();
      throw LinkError(tcp_.place() + ": slot " + std::to_string(slot.number) + " of " +
                      profile_.name + " has stopped regulating: its status is " + hex(status) +
                      ", expected " + hex(profile_.app->running) +
                      "; check its faults, its air and its power");
    }
    for (std::size_t i = 0; i < places_.size(); ++i) {
      const int place = profile_.reading(places_[i]);
      pressures.pressure[static_cast<Eigen::Index>(i)] = pressureOf(place, inputs_.words.at(place));
    }
    if (profile_.supply) {
      pressures.supply = pressureOf(*profile_.supply, inputs_.words.at(*profile_.supply));
    }
  }

  void vent() override {
    bool lost = std::exchange(lost_, false);
    context();
    clearOutputs();
    if (profile_.app) commandAll(profile_.app->regulate);
    std::exception_ptr error;
    for (const ModbusRegisters::Run& run : outputs_.runs) {
      try {
        send(run);
      } catch (const std::exception&) {
        error = std::current_exception();
        lost = std::exchange(lost_, false) || lost;  // the next answers must be awaited, too
      }
      if (!context_) break;
    }
    lost_ = lost;
    if (error) std::rethrow_exception(error);
  }

  bool keepsAirOnClose() const noexcept override { return profile_.app && context_; }
  void ignoreOthers() noexcept override { tcp_.ignoreOthers(); }
  void close() noexcept override {
    disconnect();
    tcp_.release();
  }

 private:
  struct Slot {
    int number;
    int command;   // last command sent
    double since;  // time of its last change [s]
  };

  void disconnect() noexcept {
    if (context_) modbus_close(context_.get());
    context_.reset();
  }

  void open() {
    const int socket = tcp_.open(profile_.timeout);
    // The address is not used: libmodbus' own connect() has no time limit.
    context_.reset(modbus_new_tcp("127.0.0.1", 0));
    if (!context_) {
      ::close(socket);
      throw LinkError(tcp_.place() + ": " + modbus_strerror(errno));
    }
    lost_ = false;
    modbus_set_socket(context_.get(), socket);
    const auto seconds = static_cast<std::uint32_t>(profile_.timeout);
    const auto microseconds = static_cast<std::uint32_t>(1e6 * (profile_.timeout - seconds));
    modbus_set_slave(context_.get(), profile_.unit_id);
    modbus_set_error_recovery(context_.get(), MODBUS_ERROR_RECOVERY_NONE);
    modbus_set_response_timeout(context_.get(), seconds, microseconds);
    // Without a timeout of its own, a byte is limited by that of the response.
    modbus_set_byte_timeout(context_.get(), 0, 0);
  }

  void command(Slot& slot, int word) {
    outputs_.words.at(profile_.command(slot.number)) = static_cast<std::uint16_t>(word);
    if (slot.command == word) return;
    slot.command = word;
    slot.since = steadyNow();
  }

  void commandAll(int word) {
    for (Slot& slot : slots_) command(slot, word);
  }

  void awaitStatus(int status, const char* purpose) {
    const double end = steadyNow() + profile_.app->activation_time;
    for (;;) {
      fetch();
      const auto late = std::find_if(slots_.begin(), slots_.end(),
                                     [&](const Slot& slot) { return statusOf(slot) != status; });
      if (late == slots_.end()) return;
      if (steadyNow() >= end) {
        throw LinkError(basics::messageOf(
            tcp_.place(), ": slot ", late->number, " of ", profile_.name, " does not ", purpose,
            " within ", profile_.app->activation_time, " s: its status is ", hex(statusOf(*late)),
            ", expected ", hex(status), "; check that the slot exists and has no fault or lock"));
      }
      std::this_thread::sleep_for(kBetweenLooks);
    }
  }

  int statusOf(const Slot& slot) const {
    return inputs_.words.at(profile_.status(slot.number)) & profile_.app->status_mask;
  }

  std::uint16_t countOf(double pressure) const {
    const double count =
        std::floor((pressure + profile_.atmosphere) / profile_.pascals + kHairOfACount);
    return static_cast<std::uint16_t>(
        std::clamp(count, 0.0, static_cast<double>(profile_.highest_count)));
  }

  double pressureOf(int place, std::uint16_t word) const {
    if (word == kNoReading) return std::numeric_limits<double>::quiet_NaN();
    const double pressure =
        static_cast<std::int16_t>(word) * profile_.pascals - profile_.atmosphere;
    if (pressure < kVacuum) {
      throw BadReply(basics::messageOf(
          tcp_.place(), ": register ", place, " of ", profile_.name, " reads ", pressure / 1e3,
          " kPa; expected no less than vacuum: check registers, count_pa and atmosphere_kpa of the "
          "profile"));
    }
    return pressure;
  }

  // No app and the pressure of the atmosphere, also in a device that counts from vacuum.
  void clearOutputs() {
    for (const Slot& slot : slots_) {
      for (int i = 0; i < profile_.outlets; ++i) {
        outputs_.words.at(profile_.setPoint(slot.number * profile_.outlets + i)) = countOf(0);
      }
    }
  }

  void send() {
    for (const ModbusRegisters::Run& run : outputs_.runs) send(run);
  }

  void send(const ModbusRegisters::Run& run) {
    const std::uint16_t* const words = outputs_.words.data() + run.first;
    check(modbus_write_registers(context(), run.first, run.size, words) == run.size,
          "does not accept set points");
  }

  void fetch() {
    const auto take =
        profile_.input_registers ? modbus_read_input_registers : modbus_read_registers;
    for (const ModbusRegisters::Run& run : inputs_.runs) {
      std::uint16_t* const words = inputs_.words.data() + run.first;
      check(take(context(), run.first, run.size, words) == run.size, "gives no readings");
    }
  }

  void check(bool done, const char* what) {
    if (done) return;
    const int error = errno;
    const std::string text =
        tcp_.place() + ": " + profile_.name + " " + what + ": " + modbus_strerror(error);
    if (isReply(error)) {
      modbus_flush(context());  // the rest of it would be taken for the next reply
      throw BadReply(text + "; check the registers of the profile, and unit_id");
    }
    if (error == ETIMEDOUT) {
      lost_ = true;
    } else {
      close();
    }
    throw LinkError(
        text + "; check that it is switched on, and that no other client holds its connections");
  }

  modbus_t* context() const {
    if (!context_ || lost_) throw LinkError(tcp_.place() + ": there is no link; connect first");
    return context_.get();
  }

  const ModbusProfile profile_;
  const std::vector<int> places_;
  std::vector<Slot> slots_;
  TcpLink tcp_;
  ModbusRegisters outputs_, inputs_;
  std::unique_ptr<modbus_t, Freer> context_;
  bool lost_ = false;  // no reply arrives, although the device may receive requests
};

std::unique_ptr<Driver> modbusTcpDriver(const ModbusConfig& config) {
  return std::make_unique<ModbusTcpDriver>(config);
}

}  // namespace helix_arm::regulator
