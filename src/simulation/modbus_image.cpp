#include "modbus_image.hpp"

#include <algorithm>
#include <cmath>
#include <new>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/regulator/regulator_io.hpp"

namespace helix_arm::simulation {
namespace {

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

ModbusImage::ModbusImage(const ModbusDeviceConfig& config)
    : profile_(config.profile),
      rules_(config.regulator),
      activation_time_(config.activation_time),
      slots_(static_cast<std::size_t>(slotsOf(config))),
      regulator_(slots() * profile_.outlets, rules_),
      time_(regulator::steadyNow()),
      map_(newMap(profile_, slots()), modbus_mapping_free) {
  restart();
}

void ModbusImage::restart() {
  for (Slot& slot : slots_) slot.app = App::kNotReady;
  clear();
  regulator_ = regulator::SimulatedRegulator(slots() * profile_.outlets, rules_);
  follows_ = regulator_.pressure();
  stuck_.assign(static_cast<std::size_t>(follows_.size()), 0);
}

void ModbusImage::loseLink() {
  if (!profile_.app) return;
  clear();
  for (Slot& slot : slots_) {
    if (slot.app != App::kNotReady) slot.app = App::kReady;
  }
  regulate();
}

void ModbusImage::clear() {
  std::fill_n(map_->tab_registers, map_->nb_registers, std::uint16_t{0});
}

void ModbusImage::jam(int slot, bool jammed) {
  Slot& changed = slots_.at(static_cast<std::size_t>(slot));
  changed.jammed = jammed;
  if (jammed) changed.app = App::kNotReady;
  regulate();
}

std::uint16_t& ModbusImage::output(int number) const {
  return map_->tab_registers[number - map_->start_registers];
}

std::uint16_t& ModbusImage::input(int number) const {
  return profile_.input_registers ? map_->tab_input_registers[number - map_->start_input_registers]
                                  : output(number);
}

bool ModbusImage::allows(int function, int first, int count) const {
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
  const bool writes =
      function == MODBUS_FC_WRITE_SINGLE_REGISTER || function == MODBUS_FC_WRITE_MULTIPLE_REGISTERS;
  for (int number = first; number < first + count; ++number) {
    const bool input = isInput(number), output = isOutput(number);
    const bool allowed = (reads_inputs && input && profile_.input_registers) ||
                         (reads_holding && (output || (input && !profile_.input_registers))) ||
                         (writes && output);
    if (!allowed) return false;
  }
  return count > 0;
}

void ModbusImage::catchUp(double now) {
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

void ModbusImage::measure(DeviceFault fault) {
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

void ModbusImage::stick() {
  measure(DeviceFault::kNone);
  for (std::size_t i = 0; i < stuck_.size(); ++i) {
    stuck_[i] = input(profile_.reading(static_cast<int>(i)));
  }
}

void ModbusImage::obey(double now) {
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

void ModbusImage::regulate() {
  for (int place = 0; place < follows_.size(); ++place) {
    const bool runs = !profile_.app ||
                      slots_[static_cast<std::size_t>(profile_.slot(place))].app == App::kRunning;
    follows_[place] =
        runs ? count(place) * profile_.pascals - profile_.atmosphere : regulator_.pressure()[place];
  }
  regulator_.command(follows_);
}

Eigen::VectorXd ModbusImage::setPoint() const {
  Eigen::VectorXd set_point(follows_.size());
  for (int place = 0; place < set_point.size(); ++place) {
    set_point[place] = count(place) * profile_.pascals - profile_.atmosphere;
  }
  return set_point;
}

std::vector<control::Valve> ModbusImage::valves() const {
  std::vector<control::Valve> valves;
  for (int place = 0; place < follows_.size(); ++place) {
    const bool runs = !profile_.app ||
                      slots_[static_cast<std::size_t>(profile_.slot(place))].app == App::kRunning;
    const bool vents = count(place) * profile_.pascals <= profile_.atmosphere;
    valves.push_back(!runs   ? control::Valve::kClose
                     : vents ? control::Valve::kVent
                             : control::Valve::kRegulate);
  }
  return valves;
}

}  // namespace helix_arm::simulation
