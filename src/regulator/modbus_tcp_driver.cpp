#include "helix_arm/regulator/modbus_tcp_driver.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <exception>
#include <iomanip>
#include <limits>
#include <set>
#include <sstream>
#include <thread>
#include <utility>
#include <vector>

#include <unistd.h>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "modbus/modbus.h"
#include "modbus_registers.hpp"
#include "tcp_link.hpp"

namespace helix_arm::regulator {
namespace {

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

std::string hex(int word) {
  std::ostringstream text;
  text << "0x" << std::hex << std::setw(4) << std::setfill('0') << word;
  return text.str();
}

}  // namespace

class ModbusTcpDriver::Link {
 public:
  explicit Link(const ModbusConfig& config)
      : profile_(config.profile),
        places_(config.slots),
        tcp_(config.host, config.port),
        outputs_(outputsOf(config), MODBUS_MAX_WRITE_REGISTERS),
        inputs_(inputsOf(config), MODBUS_MAX_READ_REGISTERS) {
    for (const int slot : slotsOf(config)) slots_.push_back({slot, 0, 0.0});
  }
  ~Link() { close(); }

  void connect();
  void write(const control::ValveOrders& orders);
  void read(Pressures& pressures);
  void vent();
  bool keepsAirOnClose() const noexcept { return profile_.app && context_; }
  void ignoreOthers() noexcept { tcp_.ignoreOthers(); }
  void close() noexcept {
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
  void open();
  void command(Slot& slot, int word);
  void commandAll(int word);
  void awaitStatus(int status, const char* purpose);
  int statusOf(const Slot& slot) const {
    return inputs_.at(profile_.status(slot.number)) & profile_.app->status_mask;
  }
  std::uint16_t countOf(double pressure) const;
  double pressureOf(int place, std::uint16_t word) const;
  void clearOutputs();
  void send();
  void send(const ModbusRegisters::Run& run);
  void fetch();
  void check(bool done, const char* what);
  modbus_t* context() const;

  const ModbusProfile profile_;
  const std::vector<int> places_;
  std::vector<Slot> slots_;
  TcpLink tcp_;
  ModbusRegisters outputs_, inputs_;
  std::unique_ptr<modbus_t, Freer> context_;
  bool lost_ = false;  // no reply arrives, although the device may receive requests
};

modbus_t* ModbusTcpDriver::Link::context() const {
  if (!context_ || lost_) throw LinkError(tcp_.place() + ": there is no link; connect first");
  return context_.get();
}

void ModbusTcpDriver::Link::open() {
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

void ModbusTcpDriver::Link::connect() {
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

void ModbusTcpDriver::Link::command(Slot& slot, int word) {
  outputs_.at(profile_.command(slot.number)) = static_cast<std::uint16_t>(word);
  if (slot.command == word) return;
  slot.command = word;
  slot.since = steadyNow();
}

void ModbusTcpDriver::Link::commandAll(int word) {
  for (Slot& slot : slots_) command(slot, word);
}

void ModbusTcpDriver::Link::awaitStatus(int status, const char* purpose) {
  const double end = steadyNow() + profile_.app->activation_time;
  for (;;) {
    fetch();
    const auto late = std::find_if(slots_.begin(), slots_.end(),
                                   [&](const Slot& slot) { return statusOf(slot) != status; });
    if (late == slots_.end()) return;
    if (steadyNow() >= end) {
      std::ostringstream text;
      text << tcp_.place() << ": slot " << late->number << " of " << profile_.name << " does not "
           << purpose << " within " << profile_.app->activation_time << " s: its status is "
           << hex(statusOf(*late)) << ", expected " << hex(status)
           << "; check that the slot exists and has no fault or lock";
      throw LinkError(text.str());
    }
    std::this_thread::sleep_for(kBetweenLooks);
  }
}

std::uint16_t ModbusTcpDriver::Link::countOf(double pressure) const {
  const double count =
      std::floor((pressure + profile_.atmosphere) / profile_.pascals + kHairOfACount);
  return static_cast<std::uint16_t>(
      std::clamp(count, 0.0, static_cast<double>(profile_.highest_count)));
}

double ModbusTcpDriver::Link::pressureOf(int place, std::uint16_t word) const {
  if (word == kNoReading) return std::numeric_limits<double>::quiet_NaN();
  const double pressure = static_cast<std::int16_t>(word) * profile_.pascals - profile_.atmosphere;
  if (pressure < kVacuum) {
    std::ostringstream text;
    text << tcp_.place() << ": register " << place << " of " << profile_.name << " reads "
         << pressure / 1e3 << " kPa; expected no less than vacuum: check registers, count_pa and "
         << "atmosphere_kpa of the profile";
    throw BadReply(text.str());
  }
  return pressure;
}

// No app and the pressure of the atmosphere, also in a device that counts from vacuum.
void ModbusTcpDriver::Link::clearOutputs() {
  outputs_.clear();
  for (const Slot& slot : slots_) {
    for (int i = 0; i < profile_.outlets; ++i) {
      outputs_.at(profile_.setPoint(slot.number * profile_.outlets + i)) = countOf(0);
    }
  }
}

void ModbusTcpDriver::Link::write(const control::ValveOrders& orders) {
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
      outputs_.at(profile_.setPoint(places_[i])) =
          countOf(orders.set_point[static_cast<Eigen::Index>(i)]);
    }
    if (profile_.app) command(slot, closes ? profile_.app->off : profile_.app->regulate);
  }
  send();
}

void ModbusTcpDriver::Link::vent() {
  bool lost = std::exchange(lost_, false);
  context();
  clearOutputs();
  if (profile_.app) commandAll(profile_.app->regulate);
  std::exception_ptr error;
  for (const ModbusRegisters::Run& run : outputs_.runs()) {
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

void ModbusTcpDriver::Link::read(Pressures& pressures) {
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
    pressures.pressure[static_cast<Eigen::Index>(i)] = pressureOf(place, inputs_.at(place));
  }
  if (profile_.supply) {
    pressures.supply = pressureOf(*profile_.supply, inputs_.at(*profile_.supply));
  }
}

void ModbusTcpDriver::Link::send() {
  for (const ModbusRegisters::Run& run : outputs_.runs()) send(run);
}

void ModbusTcpDriver::Link::send(const ModbusRegisters::Run& run) {
  const auto size = static_cast<int>(run.words.size());
  check(modbus_write_registers(context(), run.first, size, run.words.data()) == size,
        "does not accept set points");
}

void ModbusTcpDriver::Link::fetch() {
  for (ModbusRegisters::Run& run : inputs_.runs()) {
    const auto size = static_cast<int>(run.words.size());
    const auto take =
        profile_.input_registers ? modbus_read_input_registers : modbus_read_registers;
    check(take(context(), run.first, size, run.words.data()) == size, "gives no readings");
  }
}

void ModbusTcpDriver::Link::check(bool done, const char* what) {
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
  throw LinkError(text +
                  "; check that it is switched on, and that no other client holds its connections");
}

ModbusTcpDriver::ModbusTcpDriver(const ModbusConfig& config)
    : link_(std::make_unique<Link>(valid(config))) {}

ModbusTcpDriver::~ModbusTcpDriver() = default;

void ModbusTcpDriver::connect() { link_->connect(); }
void ModbusTcpDriver::write(const control::ValveOrders& orders) { link_->write(orders); }
void ModbusTcpDriver::read(Pressures& pressures) { link_->read(pressures); }
void ModbusTcpDriver::vent() { link_->vent(); }
void ModbusTcpDriver::ignoreOthers() noexcept { link_->ignoreOthers(); }

bool ModbusTcpDriver::keepsAirOnClose() const noexcept { return link_->keepsAirOnClose(); }
void ModbusTcpDriver::close() noexcept { link_->close(); }

}  // namespace helix_arm::regulator
