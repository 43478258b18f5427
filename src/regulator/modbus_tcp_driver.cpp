#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <exception>
#include <limits>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include <unistd.h>

#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/regulator/config.hpp"
#include "modbus/modbus.h"
#include "regulator_io.hpp"
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

std::string hex(int word) { return basics::format("0x%04x", word); }

}  // namespace

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
        // and an ended app keeps the air in. If no reply is understood, nothing else is sent.
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

void ModbusProfile::validate() const {
  const std::string culprit = "profile " + name;
  const auto require = [&](bool holds, const char* what, const auto& value, const auto& rule) {
    basics::requireValue(holds, culprit.c_str(), what, value, rule);
  };
  const auto within = [&](const char* what, double value, double lowest, double highest) {
    basics::require(value >= lowest && value <= highest, culprit, ": ", what, " is ", value,
                    "; expected ", lowest, " to ", highest);
  };
  within("unit_id", unit_id, 0, 255);
  within("count_pa", pascals, 1e-3, 1e6);
  within("atmosphere_kpa", atmosphere / 1e3, 0, 200);
  within("highest_count", highest_count, 1, 32767);
  within("outlets", outlets, 1, 64);
  if (channels) within("channels", *channels, 1, 1024);
  within("outputs.first", output_base, 0, kHighestRegister);
  within("outputs.stride", output_stride, 1, 1024);
  within("outputs.pressure", output_pressure, 0, output_stride - 1);
  within("inputs.first", input_base, 0, kHighestRegister);
  within("inputs.stride", input_stride, 1, 1024);
  within("inputs.pressure", input_pressure, 0, input_stride - 1);
  require(output_pressure + outlets <= output_stride, "outlets", outlets,
          "as many as set points fit into outputs.stride");
  require(input_pressure + outlets <= input_stride, "outlets", outlets,
          "as many as readings fit into inputs.stride");
  if (supply) within("supply", *supply, 0, kHighestRegister);
  within("timeout_s", timeout, 1e-3, 10);
  if (!app) return;
  within("app.command", app->command, 0, output_stride - 1);
  within("app.status", app->status, 0, input_stride - 1);
  const auto apart = [this](int word, int first) {
    return word < first || word >= first + outlets;
  };
  require(apart(app->command, output_pressure), "app.command", app->command,
          "a register other than the set point's");
  require(apart(app->status, input_pressure), "app.status", app->status,
          "a register other than the reading's");
  within("app.regulate", app->regulate, 0, kHighestRegister);
  within("app.off", app->off, 0, kHighestRegister);
  within("app.acknowledge", app->acknowledge, 0, kHighestRegister);
  within("app.status_mask", app->status_mask, 1, kHighestRegister);
  const auto masked = [this](int word) { return word >= 0 && (word & app->status_mask) == word; };
  require(masked(app->ready), "app.ready", app->ready, "only bits of app.status_mask");
  require(masked(app->running), "app.running", app->running, "only bits of app.status_mask");
  require(app->running != app->ready, "app.running", app->running, "another word than ready");
  require(app->off != app->regulate, "app.off", app->off, "another word than regulate");
  within("app.activation_time_s", app->activation_time, 0.01, 60);
}

DeviceFacts ModbusConfig::facts() const {
  DeviceFacts facts{kKind, profile.name, host + ":" + std::to_string(port), host};
  facts.channel_word = "slots";
  for (const int slot : slots) facts.channels.push_back(std::to_string(slot));
  facts.places = slots;
  facts.closes_valves = profile.app.has_value();
  facts.most_channels = profile.channels;
  facts.highest_pressure = profile.highestPressure();
  return facts;
}

std::unique_ptr<Driver> ModbusConfig::makeDriver(int channels) const {
  auto driver = std::make_unique<ModbusTcpDriver>(*this);
  basics::require(slots.size() == static_cast<std::size_t>(channels), "a regulator of ",
                  slots.size(), " channels for ", channels,
                  " actuators; expected one channel per actuator");
  return driver;
}

}  // namespace helix_arm::regulator
