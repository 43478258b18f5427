#pragma once

#include <cstdint>
#include <deque>
#include <random>
#include <string>
#include <vector>

#include "board_document.hpp"
#include "pneumatics.hpp"
#include "simulated_chip.hpp"

namespace helix_arm::test {

/// A build of firmware/: chip and kind of inlet valves.
struct BoardKind {
  std::string chip;       ///< "atmega328p" or "atmega2560"
  std::string valves;     ///< "solenoid" or "proportional"
  int fewer = 0;          ///< CHANNELS of the build; 0: all that the chip has
  bool checksum = false;  ///< CHECKSUM_REQUIRED of the build

  int channels() const { return fewer > 0 ? fewer : chip == "atmega328p" ? 3 : 8; }
  std::string name() const {
    return chip + "_" + valves + (fewer > 0 ? "_" + std::to_string(fewer) : "") +
           (checksum ? "_checksum" : "");
  }
};

/// The board as docs/board.md has it soldered: a chip that runs the built ELF, with valves, muscles
/// and sensors at its pins. Its only clock is the chip's: the same calls give the same results.
class SimulatedBoard {
 public:
  /// Powered up, at time 0.
  /// @throws std::runtime_error if the ELF cannot be loaded.
  explicit SimulatedBoard(const BoardKind& kind, const Pneumatics::Config& muscles = {});

  /// Lets time pass [s].
  void advance(double dt);
  double time() const;  ///< since the power came [s]

  /// Puts bytes on the line to the chip; they arrive one by one at the line's rate.
  void send(const std::string& bytes);
  /// Whether bytes are still on their way to the chip.
  bool isReceiving() const { return !to_chip_.empty(); }
  /// Bytes that the chip has sent since the last call.
  std::string receive() { return chip_.takeSent(); }
  /// Sends a line, lets 10 ms pass, and returns all that came back, without the last line end.
  std::string ask(const std::string& line);

  /// Supply of chip and sensors [V]. Below the level of the brown-out fuse the chip is in reset.
  void setVoltage(double volts);
  SimulatedChip& chip() { return chip_; }
  Pneumatics& air() { return air_; }

  int channels() const { return kind_.channels(); }
  double pressure(int channel) const { return air_.pressure(channel); }  ///< gauge [Pa]
  double highest() const;                                                ///< of them now [Pa]
  /// Whether the channel's pins let its air out and none in.
  bool vents(int channel) const;
  bool allVent() const;
  bool isSupplied() const;  ///< whether the supply valve has current
  bool isLit() const;       ///< the LED

 private:
  double sensor(int converter_channel);
  void stepAir();

  const BoardKind kind_;
  const BoardWiring wiring_;
  SimulatedChip chip_;
  Pneumatics air_;
  std::vector<ValveDrive> drives_;
  std::deque<std::uint8_t> to_chip_;
  std::uint64_t next_byte_ = 0, next_air_ = 0;  // [cycles]
  std::uint64_t off_time_ = 0;                  // in which the chip did not run [cycles]
  bool browned_out_ = false;
  std::mt19937 generator_{1};
  std::normal_distribution<double> noise_;
};

}  // namespace helix_arm::test
