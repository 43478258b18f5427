#pragma once

#include <memory>

#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/driver.hpp"

namespace helix_arm::regulator {

/// A regulator that is read and written by Modbus TCP, as its profile has it.
///
/// Set points are rounded down to whole counts, and never below 0 nor above the highest count; so
/// what is asked for is not exceeded. Slots of places that are not used are not written; of a slot
/// that is, all outlets are, with 0 where they have no channel.
///
/// In a device with apps, connect() acknowledges the faults of its slots and starts their apps at
/// set point 0. A slot closes where all its channels are to close; where some are, those vent.
///
/// After any LinkError all but vent() is refused until connect(). A reply that is late, cut short
/// or garbled to its end counts as a lost link; one that is complete but makes no sense as
/// BadReply.
class ModbusTcpDriver : public Driver {
 public:
  /// @throws std::invalid_argument when the profile breaks its rules, or slots are none, negative,
  /// repeated, or beyond the last register.
  explicit ModbusTcpDriver(const ModbusConfig& config);
  ~ModbusTcpDriver() override;

  /// Takes at most the profile's timeout to find and to reach the device (of a name with several
  /// addresses, for each), and twice its activation time.
  void connect() override;
  void ignoreOthers() noexcept override;
  /// @throws std::invalid_argument where the orders are not one a channel, or not finite.
  void write(const control::ValveOrders& orders) override;
  /// A register that reads kNoReading gives NaN; one below vacuum is a BadReply. A slot that was
  /// told to regulate and does not, although it had its activation time, is a LinkError: connecting
  /// again acknowledges what it suffers from.
  void read(Pressures& pressures) override;
  /// Of a device that does not answer every register is written all the same.
  void vent() override;
  /// Whether slots may be at work: without a link their apps end, valves closed.
  bool keepsAirOnClose() const noexcept override;
  void close() noexcept override;

 private:
  class Link;
  std::unique_ptr<Link> link_;
};

}  // namespace helix_arm::regulator
