#include "helix_arm/regulator/config.hpp"

#include <sstream>

#include "drivers.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"

namespace helix_arm::regulator {
namespace {

template <class... Cases>
struct Overloaded : Cases... {
  using Cases::operator()...;
};
template <class... Cases>
Overloaded(Cases...) -> Overloaded<Cases...>;

template <class Item>
std::string listOf(const std::string& what, const std::vector<Item>& items) {
  std::ostringstream out;
  out << what;
  for (std::size_t i = 0; i < items.size(); ++i) out << (i == 0 ? " " : ", ") << items[i];
  return out.str();
}

}  // namespace

std::string describe(const Config& config) {
  return std::visit(
      Overloaded{[](const SimulatedRegulatorConfig&) { return std::string("simulated"); },
                 [](const SerialConfig& serial) {
                   return "ascii_serial " + serial.profile.name + " at " + serial.device;
                 },
                 [](const ModbusConfig& modbus) {
                   return "modbus_tcp " + modbus.profile.name + " at " + modbus.host + ":" +
                          std::to_string(modbus.port);
                 }},
      config);
}

std::string describeChannels(const Config& config) {
  return std::visit(
      Overloaded{[](const SimulatedRegulatorConfig&) { return std::string(); },
                 [](const SerialConfig& serial) { return listOf("addresses", serial.addresses); },
                 [](const ModbusConfig& modbus) { return listOf("slots", modbus.slots); }},
      config);
}

std::string addressOf(const Config& config, int channel) {
  const auto i = static_cast<std::size_t>(channel);
  return std::visit(
      Overloaded{[=](const SimulatedRegulatorConfig&) { return std::to_string(channel); },
                 [=](const SerialConfig& serial) {
                   return i < serial.addresses.size() ? serial.addresses[i]
                                                      : std::to_string(channel);
                 },
                 [=](const ModbusConfig& modbus) { return std::to_string(modbus.slots[i]); }},
      config);
}

bool isHardware(const Config& config) {
  return !std::holds_alternative<SimulatedRegulatorConfig>(config);
}

bool closesValves(const Config& config) {
  return std::visit(
      Overloaded{[](const SimulatedRegulatorConfig&) { return true; },
                 [](const SerialConfig& serial) { return !serial.profile.close.empty(); },
                 [](const ModbusConfig& modbus) { return modbus.profile.app.has_value(); }},
      config);
}

std::unique_ptr<Driver> makeDriver(const Config& config, int channels) {
  const auto checked = [channels](std::unique_ptr<Driver> driver, std::size_t configured) {
    basics::require(configured == static_cast<std::size_t>(channels), "a regulator of ", configured,
                    " channels for ", channels, " actuators; expected one channel per actuator");
    return driver;
  };
  return std::visit(
      Overloaded{[&](const SimulatedRegulatorConfig& simulated) -> std::unique_ptr<Driver> {
                   return std::make_unique<SimulatedDriver>(channels, simulated);
                 },
                 [&](const SerialConfig& serial) -> std::unique_ptr<Driver> {
                   return asciiSerialDriver(serial, channels);
                 },
                 [&](const ModbusConfig& modbus) -> std::unique_ptr<Driver> {
                   return checked(modbusTcpDriver(modbus), modbus.slots.size());
                 }},
      config);
}

}  // namespace helix_arm::regulator
