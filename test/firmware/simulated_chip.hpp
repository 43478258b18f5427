#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace helix_arm::test {

/// A pin of the chip: port 'A' to 'L', bit 0 to 7.
struct ChipPin {
  char port = 'A';
  int bit = 0;
};

/// An AVR that runs a built ELF in simavr, without pace: time is its cycles.
class SimulatedChip {
 public:
  enum class Reset { kPowerOn, kPin, kBrownOut };
  /// Output of the sensor at a channel of the converter now, as a share of the reference, 0 to 1.
  using Sensor = std::function<double(int channel)>;

  /// In its reset state.
  /// @throws std::runtime_error naming the chip or ELF that is not to be had.
  SimulatedChip(const std::string& name, const std::string& elf, std::uint32_t frequency);
  ~SimulatedChip();
  SimulatedChip(const SimulatedChip&) = delete;
  SimulatedChip& operator=(const SimulatedChip&) = delete;

  void connect(Sensor sensor);

  /// Runs until at least this cycle, an instruction or a sleep longer at most.
  void runTo(std::uint64_t cycle);
  std::uint64_t cycle() const;  ///< since it was made
  void reset(Reset cause);
  /// The program is caught in an endless loop with interrupts off.
  void hang();
  int watchdogResets() const;
  /// That the ELF asks for: low, high, extended.
  std::array<std::uint8_t, 3> fuses() const;

  /// A byte at the pin of the UART; the program may only take them at the UART's own rate.
  void receive(std::uint8_t byte);
  /// Bytes that the program has sent since the last call.
  std::string takeSent();

  /// Level of a pin that the program drives; one that it does not drive is pulled down.
  bool level(ChipPin pin) const;
  /// Share of the time since the last call in which it was high, 0 to 1.
  double meanLevel(ChipPin pin);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace helix_arm::test
