#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <ostream>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

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

/// Faults of one channel's hardware.
enum class ChannelFault {
  kNone,
  kInletStuckOpen,
  kInletStuckShut,
  kOutletStuckOpen,
  kOutletStuckShut,
  kSensorOpen,             ///< the signal wire is off: the board's resistor pulls it to ground
  kSensorShortedToGround,  ///< or without its supply
  kSensorShortedToSupply,  ///< or without its ground
  kSensorBlocked,          ///< it keeps telling the pressure of the start of the fault
  kSensorDrifts,           ///< it tells ever less, down to 25 kPa too little
  kLeak,                   ///< a hole as wide as a tenth of the outlet
};

/// What drives one channel: mean levels of its pins over a step, 0 to 1.
struct ValveDrive {
  double inlet = 0, outlet = 0;
};

/// Muscles behind the valves of a board, and the sensors that look at them.
///
/// A supply valve fills or empties the manifold in front of all inlets. Every flow is first order:
/// dp/dt = x (p_from - p) / tau, where the opening x of a valve follows from its current, which
/// lags behind its drive. Inlet and supply valve are shut and the outlet is open without current.
class Pneumatics {
 public:
  struct Config {
    double supply = 5e5;          ///< gauge [Pa]
    double fill_time = 0.25;      ///< of a muscle through its inlet [s]
    double vent_time = 0.2;       ///< of a muscle through its outlet [s]
    double manifold_time = 0.02;  ///< both ways [s]
    double valve_time = 0.003;    ///< lag of a current [s]
  };

  /// @param proportional  whether the inlets are proportional valves, which begin to open at a
  ///     drive of 0.3; else they are solenoids.
  Pneumatics(int channels, const Config& config, bool proportional);

  /// @param drives  (channels).
  /// @param supply  mean level of the supply valve's pin, 0 to 1.
  void step(double dt, const std::vector<ValveDrive>& drives, double supply);

  /// At once, instead of what it had; two are faults of different parts.
  void fail(int channel, ChannelFault fault, ChannelFault another = ChannelFault::kNone);
  void setSupply(double pressure) { config_.supply = pressure; }

  double pressure(int channel) const { return channels_.at(channel).pressure; }  ///< gauge [Pa]
  /// Highest pressure of any muscle so far, or since forgetPeak() [Pa].
  double peak() const { return peak_; }
  void forgetPeak() { peak_ = 0; }
  /// Output of a channel's sensor as a share of its supply voltage: 0.1 to 0.9 for 0 to 700 kPa.
  double sensor(int channel) const;

 private:
  struct Channel {
    double pressure = 0;           // [Pa]
    double inlet = 0, outlet = 0;  // currents, 0 to 1
    std::array<ChannelFault, 2> faults{};
    double blocked_at = 0, drift = 0;  // [Pa]

    bool has(ChannelFault fault) const { return faults[0] == fault || faults[1] == fault; }
  };
  double opening(double current) const;

  Config config_;
  const bool proportional_;
  std::vector<Channel> channels_;
  double manifold_ = 0, supply_valve_ = 0, peak_ = 0;
};

/// Pins of a board, per channel.
struct BoardWiring {
  std::vector<ChipPin> inlets, outlets;
  std::vector<int> sensors;  ///< channels of the converter
  ChipPin supply, led;
};

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

/// For messages of tests.
inline void PrintTo(const BoardKind& kind, std::ostream* out) { *out << kind.name(); }

/// Every build of the firmware.
inline const BoardKind kBoardKinds[] = {{"atmega328p", "solenoid"},
                                        {"atmega328p", "proportional"},
                                        {"atmega2560", "solenoid"},
                                        {"atmega2560", "proportional"}};
/// Each chip and each kind of valve once.
inline const BoardKind kEachPart[] = {kBoardKinds[0], kBoardKinds[3]};
inline const BoardKind kSmallBoard = kBoardKinds[0];
/// A build for fewer channels than the chip has.
inline const BoardKind kFiveChannels = {"atmega2560", "solenoid", 5};
/// A build that refuses lines without a checksum from the start.
inline const BoardKind kChecksumRequired = {"atmega328p", "solenoid", 0, true};

inline std::string nameOfKind(const testing::TestParamInfo<BoardKind>& info) {
  return info.param.name();
}

/// A board that was started and told to vent: it takes set points.
class ReadyBoard : public SimulatedBoard {
 public:
  explicit ReadyBoard(const BoardKind& kind = kSmallBoard, const Pneumatics::Config& muscles = {})
      : SimulatedBoard(kind, muscles) {
    advance(0.05);
    ventAll();
  }

  std::string order(int channel, const std::string& what) {
    return ask("p" + std::to_string(channel) + "=" + what);
  }
  void orderAll(const std::string& what) {
    for (int i = 0; i < channels(); ++i) order(i, what);
  }
  void ventAll() { orderAll("vent"); }
  /// Repeats an order of all channels for so long [s], as a host does that is alive.
  void keep(const std::string& what, double duration) {
    const double end = time() + duration;
    while (time() < end) orderAll(what);
  }
};

}  // namespace helix_arm::test
