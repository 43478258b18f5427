#include "helix_arm/regulator/config.hpp"

#include "helix_arm/basics/requirement.hpp"
#include "tcp_link.hpp"

namespace helix_arm::regulator {
namespace {

template <class... Cases>
struct Overloaded : Cases... {
  using Cases::operator()...;
};

// What the case of the regulator's kind returns.
template <class... Cases>
auto choose(const Config& config, Cases... cases) {
  return std::visit(Overloaded<Cases...>{cases...}, config);
}

template <class Item>
std::string listOf(std::string what, const std::vector<Item>& items) {
  const char* between = " ";
  for (const Item& item : items) {
    what += basics::messageOf(between, item);
    between = ", ";
  }
  return what;
}

}  // namespace

std::string describe(const Config& config) {
  return choose(
      config, [](const SimulatedRegulatorConfig&) { return std::string("simulated"); },
      [](const SerialConfig& serial) {
        return "ascii_serial " + serial.profile.name + " at " + serial.device;
      },
      [](const ModbusConfig& modbus) {
        return "modbus_tcp " + modbus.profile.name + " at " + modbus.host + ":" +
               std::to_string(modbus.port);
      });
}

std::string describeChannels(const Config& config) {
  return choose(
      config, [](const SimulatedRegulatorConfig&) { return std::string(); },
      [](const SerialConfig& serial) { return listOf("addresses", serial.addresses); },
      [](const ModbusConfig& modbus) { return listOf("slots", modbus.slots); });
}

std::string addressOf(const Config& config, int channel) {
  const auto i = static_cast<std::size_t>(channel);
  const std::string number = std::to_string(channel);
  return choose(
      config, [&](const SimulatedRegulatorConfig&) { return number; },
      [&](const SerialConfig& serial) {
        return i < serial.addresses.size() ? serial.addresses[i] : number;
      },
      [=](const ModbusConfig& modbus) { return std::to_string(modbus.slots[i]); });
}

bool isHardware(const Config& config) {
  return !std::holds_alternative<SimulatedRegulatorConfig>(config);
}

bool closesValves(const Config& config) {
  return choose(
      config, [](const SimulatedRegulatorConfig&) { return true; },
      [](const SerialConfig& serial) { return !serial.profile.close.empty(); },
      [](const ModbusConfig& modbus) { return modbus.profile.app.has_value(); });
}

std::unique_ptr<Driver> makeDriver(const Config& config, int channels) {
  return choose(
      config,
      [=](const SimulatedRegulatorConfig& simulated) {
        return simulatedDriver(simulated, channels);
      },
      [=](const SerialConfig& serial) { return asciiSerialDriver(serial, channels); },
      [=](const ModbusConfig& modbus) {
        auto driver = modbusTcpDriver(modbus);
        const std::size_t slots = modbus.slots.size();
        basics::require(slots == static_cast<std::size_t>(channels), "a regulator of ", slots,
                        " channels for ", channels,
                        " actuators; expected one channel per actuator");
        return driver;
      });
}

}  // namespace helix_arm::regulator
