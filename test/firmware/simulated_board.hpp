#pragma once

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <fstream>
#include <functional>
#include <map>
#include <optional>
#include <ostream>
#include <random>
#include <regex>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <avr_adc.h>
#include <avr_extint.h>
#include <avr_ioport.h>
#include <avr_uart.h>
#include <gtest/gtest.h>
#include <sim_avr.h>
#include <sim_elf.h>

#include "support/test_size.hpp"

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
  SimulatedChip(const std::string& name, const std::string& elf, std::uint32_t frequency) {
    load(name, elf, frequency);
    listen();
    reset(Reset::kPowerOn);
  }
  ~SimulatedChip() {
    if (avr_ == nullptr) return;
    avr_terminate(avr_);
    std::free(avr_);
  }
  SimulatedChip(const SimulatedChip&) = delete;
  SimulatedChip& operator=(const SimulatedChip&) = delete;

  void connect(Sensor output) { sensor_ = std::move(output); }

  /// Runs until at least this cycle, an instruction or a sleep longer at most.
  void runTo(std::uint64_t cycle) {
    while (avr_->cycle < cycle) {
      if (is_reset_) leaveExternalInterrupts();
      const int state = avr_run(avr_);
      if (state != cpu_Running && state != cpu_Sleeping) {
        throw std::runtime_error("the program has crashed at " + std::to_string(avr_->pc));
      }
    }
  }
  std::uint64_t cycle() const { return avr_->cycle; }  ///< since it was made
  void reset(Reset cause) {
    avr_reset(avr_);
    --watchdog_resets_;
    const auto& flags = avr_->reset_flags;
    avr_regbit_set(avr_, cause == Reset::kPowerOn ? flags.porf
                         : cause == Reset::kPin   ? flags.extrf
                                                  : flags.borf);
  }
  /// The program is caught in an endless loop with interrupts off.
  void hang() {
    avr_->pc = loop_for_ever_;
    avr_->state = cpu_Running;
  }
  int watchdogResets() const { return watchdog_resets_; }
  /// That the ELF asks for: low, high, extended.
  std::array<std::uint8_t, 3> fuses() const {
    return {avr_->fuse[AVR_FUSE_LOW], avr_->fuse[AVR_FUSE_HIGH], avr_->fuse[AVR_FUSE_EXT]};
  }

  /// A byte at the pin of the UART; the program may only take them at the UART's own rate.
  void receive(std::uint8_t byte) {
    avr_raise_irq(avr_io_getirq(avr_, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT), byte);
  }
  /// Bytes that the program has sent since the last call.
  std::string takeSent() { return std::exchange(sent_, {}); }

  /// Level of a pin that the program drives; one that it does not drive is pulled down.
  bool level(ChipPin which) const { return pin(which).high; }
  /// Share of the time since the last call in which it was high, 0 to 1.
  double meanLevel(ChipPin which) {
    Pin& of = pin(which);
    of.count();
    const std::uint64_t time = of.since - std::exchange(of.counted_from, of.since);
    const std::uint64_t high = std::exchange(of.high_for, 0);
    if (time == 0) return of.driven && of.high ? 1 : 0;
    return static_cast<double>(high) / static_cast<double>(time);
  }

 private:
  static constexpr std::uint32_t kMillivolts = 5000;  // of all references; sensors are shares of it
  static constexpr int kFullScale = 1023;             // [counts]
  // Of the C library: interrupts off, a jump to itself.
  static constexpr char kLoopForEver[] = "_exit";
  static constexpr std::uint8_t kExternalInterrupts = 8;

  static void require(bool holds, const std::string& fault) {
    if (!holds) throw std::runtime_error(fault);
  }

  struct Pin {
    const SimulatedChip* chip = nullptr;
    int bit = 0;
    bool driven = false, high = false;
    std::uint64_t since = 0, counted_from = 0, high_for = 0;  // [cycles]

    void count() {
      const std::uint64_t now = chip->avr_->cycle;
      if (driven && high) high_for += now - since;
      since = now;
    }
  };

  avr_t* avr_ = nullptr;
  void (*reset_core_)(avr_t*) = nullptr;
  std::uint32_t loop_for_ever_ = 0;
  Sensor sensor_ = [](int) { return 0.0; };
  std::string sent_;
  mutable std::map<std::pair<char, int>, Pin> pins_;
  int watchdog_resets_ = 0;
  bool is_reset_ = false;  // since the last instruction

  Pin& pin(ChipPin which) const {
    const auto [at, fresh] = pins_.try_emplace({which.port, which.bit});
    Pin& pin = at->second;
    if (!fresh) return pin;
    pin.chip = this;
    pin.bit = which.bit;
    pin.since = pin.counted_from = avr_->cycle;
    avr_irq_t* irqs = avr_io_getirq(avr_, AVR_IOCTL_IOPORT_GETIRQ(which.port), 0);
    // A level that is the same as before a reset is news all the same.
    for (avr_irq_t* irq : {irqs + which.bit, irqs + IOPORT_IRQ_DIRECTION_ALL}) {
      avr_irq_set_flags(irq,
                        static_cast<std::uint8_t>(avr_irq_get_flags(irq) & ~IRQ_FLAG_FILTERED));
    }
    avr_irq_register_notify(
        irqs + which.bit,
        [](avr_irq_t*, std::uint32_t value, void* of) {
          auto* changed = static_cast<Pin*>(of);
          changed->count();
          changed->high = (value & 0xFF) != 0;
        },
        &pin);
    avr_irq_register_notify(
        irqs + IOPORT_IRQ_DIRECTION_ALL,
        [](avr_irq_t*, std::uint32_t outputs, void* of) {
          auto* changed = static_cast<Pin*>(of);
          changed->count();
          changed->driven = (outputs >> changed->bit & 1) != 0;
        },
        &pin);
    return pin;
  }
  // simavr gives no notice of the pins_ that a reset frees.
  void freePins() {
    for (auto& [which, pin] : pins_) {
      pin.count();
      pin.driven = pin.high = false;
    }
  }
  // Else every second cycle looks at external interrupts, which the program does not use.
  void leaveExternalInterrupts() {
    for (std::uint8_t i = 0; i < kExternalInterrupts; ++i) {
      avr_extint_set_strict_lvl_trig(avr_, i, 0);
    }
    is_reset_ = false;
  }

  void load(const std::string& name, const std::string& elf, std::uint32_t frequency) {
    elf_firmware_t firmware{};
    require(elf_read_firmware(elf.c_str(), &firmware) == 0,
            elf + " cannot be read; build it with make -C firmware");
    avr_ = avr_make_mcu_by_name(name.c_str());
    require(avr_ != nullptr, "simavr has no chip " + name);
    avr_init(avr_);
    avr_->frequency = frequency;
    avr_->vcc = avr_->avcc = avr_->aref = kMillivolts;
    avr_->sleep = [](avr_t*, avr_cycle_count_t) {};  // the time of a sleep passes at once
    avr_load_firmware(avr_, &firmware);
    for (std::uint32_t i = 0; i < firmware.symbolcount; ++i) {
      if (std::strcmp(firmware.symbol[i]->symbol, kLoopForEver) == 0) {
        loop_for_ever_ = firmware.symbol[i]->addr;
      }
      std::free(firmware.symbol[i]);
    }
    std::free(firmware.symbol);
    std::free(firmware.flash);
    std::free(firmware.fuse);
    require(loop_for_ever_ != 0, elf + " has no symbol " + kLoopForEver);
  }

  void listen() {
    std::uint32_t quiet = 0;  // it neither prints nor waits
    avr_ioctl(avr_, AVR_IOCTL_UART_SET_FLAGS('0'), &quiet);
    avr_irq_register_notify(
        avr_io_getirq(avr_, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT),
        [](avr_irq_t*, std::uint32_t value, void* of) {
          static_cast<SimulatedChip*>(of)->sent_ += static_cast<char>(value);
        },
        this);
    avr_irq_register_notify(
        avr_io_getirq(avr_, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER),
        [](avr_irq_t*, std::uint32_t value, void* of) {
          static_cast<SimulatedChip*>(of)->convert(value);
        },
        this);
    avr_->custom.data = this;
    reset_core_ = avr_->reset;
    avr_->reset = [](avr_t* core) {
      auto* of = static_cast<SimulatedChip*>(core->custom.data);
      ++of->watchdog_resets_;  // those from outside are taken off again
      of->is_reset_ = true;
      of->freePins();
      of->reset_core_(core);
    };
  }

  // The converter of simavr takes millivolts; these give the count that the chip would have.
  void convert(std::uint32_t trigger) {
    avr_adc_mux_t mux{};
    std::memcpy(&mux, &trigger, sizeof trigger);
    const double share = std::clamp(sensor_(static_cast<int>(mux.src)), 0.0, 1.0);
    const auto count = std::min(kFullScale, static_cast<int>(share * (kFullScale + 1)));
    const auto millivolts = (static_cast<std::uint32_t>(count) * kMillivolts + kFullScale - 1) /
                            static_cast<std::uint32_t>(kFullScale);
    avr_raise_irq(avr_io_getirq(avr_, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + mux.src), millivolts);
  }
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
  Pneumatics(int channels, const Config& config, bool proportional)
      : config_(config),
        proportional_(proportional),
        channels_(static_cast<std::size_t>(channels)) {}

  /// @param drives  (channels).
  /// @param supply  mean level of the supply valve's pin, 0 to 1.
  void step(double dt, const std::vector<ValveDrive>& drives, double supply) {
    lag(supply_valve_, supply, dt, config_.valve_time);
    lag(manifold_, supply_valve_ * config_.supply, dt, config_.manifold_time);
    for (std::size_t i = 0; i < channels_.size(); ++i) {
      Channel& channel = channels_[i];
      lag(channel.inlet, drives[i].inlet, dt, config_.valve_time);
      lag(channel.outlet, drives[i].outlet, dt, config_.valve_time);
      double inlet = opening(channel.inlet), outlet = 1 - channel.outlet;
      if (channel.has(ChannelFault::kInletStuckOpen)) inlet = 1;
      if (channel.has(ChannelFault::kInletStuckShut)) inlet = 0;
      if (channel.has(ChannelFault::kOutletStuckOpen)) outlet = 1;
      if (channel.has(ChannelFault::kOutletStuckShut)) outlet = 0;
      if (channel.has(ChannelFault::kLeak)) outlet += kLeakOpening;
      if (channel.has(ChannelFault::kSensorDrifts)) {
        channel.drift = std::min(channel.drift + kDriftRate * dt, kDriftMost);
      }
      channel.pressure += dt * (inlet * (manifold_ - channel.pressure) / config_.fill_time -
                                outlet * channel.pressure / config_.vent_time);
      peak_ = std::max(peak_, channel.pressure);
    }
  }

  /// At once, instead of what it had; two are faults of different parts.
  void fail(int channel, ChannelFault fault, ChannelFault another = ChannelFault::kNone) {
    Channel& of = channels_.at(channel);
    of.faults = {fault, another};
    of.blocked_at = of.pressure;
    of.drift = 0;
  }
  void setSupply(double pressure) { config_.supply = pressure; }

  double pressure(int channel) const { return channels_.at(channel).pressure; }  ///< gauge [Pa]
  /// Highest pressure of any muscle so far, or since forgetPeak() [Pa].
  double peak() const { return peak_; }
  void forgetPeak() { peak_ = 0; }
  /// Output of a channel's sensor as a share of its supply voltage: 0.1 to 0.9 for 0 to 700 kPa.
  double sensor(int channel) const {
    const Channel& of = channels_.at(channel);
    for (const ChannelFault fault : of.faults) {
      if (fault == ChannelFault::kSensorOpen || fault == ChannelFault::kSensorShortedToGround)
        return 0;
      if (fault == ChannelFault::kSensorShortedToSupply) return 1;
    }
    const double told = of.has(ChannelFault::kSensorBlocked) ? of.blocked_at : of.pressure;
    return kSensorZero + kSensorSpan * (told - of.drift) / kSensorRange;
  }

 private:
  static constexpr double kSensorZero = 0.1, kSensorSpan = 0.8;  // ratiometric
  static constexpr double kSensorRange = 7e5;                    // [Pa]
  static constexpr double kProportionalFrom = 0.3;
  static constexpr double kDriftRate = 2.5e4, kDriftMost = 2.5e4;  // [Pa/s], [Pa]
  static constexpr double kLeakOpening = 0.1;                      // of the outlet's

  struct Channel {
    double pressure = 0;           // [Pa]
    double inlet = 0, outlet = 0;  // currents, 0 to 1
    std::array<ChannelFault, 2> faults{};
    double blocked_at = 0, drift = 0;  // [Pa]

    bool has(ChannelFault fault) const { return faults[0] == fault || faults[1] == fault; }
  };
  // Exact for a constant drive.
  static void lag(double& value, double goal, double dt, double time) {
    value += -std::expm1(-dt / time) * (goal - value);
  }
  double opening(double current) const {
    if (!proportional_) return current;
    return std::max(0.0, (current - kProportionalFrom) / (1 - kProportionalFrom));
  }

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
  explicit SimulatedBoard(const BoardKind& kind, const Pneumatics::Config& muscles = {})
      : kind_(kind),
        wiring_(readWiring(kind.chip)),
        chip_(kind.chip, HELIX_ARM_FIRMWARE_DIR "/board_" + kind.name() + ".elf", kFrequency),
        air_(kind.channels(), muscles, kind.valves == "proportional"),
        drives_(static_cast<std::size_t>(kind.channels())) {
    chip_.connect([this](int channel) { return sensor(channel); });
    isLit();  // a pin is watched from the first look on
  }

  /// Lets time pass [s].
  void advance(double dt) {
    const auto end = chip_.cycle() + off_time_ + static_cast<std::uint64_t>(dt * kFrequency);
    for (;;) {
      const std::uint64_t now = chip_.cycle() + off_time_;
      if (now >= next_air_) {
        stepAir();
        next_air_ += kAirStep;
      }
      if (!to_chip_.empty() && now >= next_byte_) {
        if (!browned_out_) chip_.receive(to_chip_.front());
        to_chip_.pop_front();
        next_byte_ = std::max(next_byte_ + kByteTime, now);
      }
      if (now >= end) return;
      std::uint64_t next = std::min(end, next_air_);
      if (!to_chip_.empty()) next = std::min(next, next_byte_);
      if (browned_out_) {
        off_time_ += std::max(next, now + 1) - now;
      } else {
        chip_.runTo(next - off_time_);
      }
    }
  }
  /// Since the power came [s].
  double time() const { return static_cast<double>(chip_.cycle() + off_time_) / kFrequency; }

  /// Puts bytes on the line to the chip; they arrive one by one at the line's rate.
  void send(const std::string& bytes) {
    if (to_chip_.empty()) next_byte_ = chip_.cycle() + off_time_;
    to_chip_.insert(to_chip_.end(), bytes.begin(), bytes.end());
  }
  /// Whether bytes are still on their way to the chip.
  bool isReceiving() const { return !to_chip_.empty(); }
  /// Bytes that the chip has sent since the last call.
  std::string receive() { return chip_.takeSent(); }
  /// Sends a line, lets 10 ms pass, and returns all that came back, without the last line end.
  std::string ask(const std::string& line) {
    receive();
    send(line + "\n");
    while (isReceiving()) advance(0.001);
    advance(0.01);
    std::string answer = receive();
    if (!answer.empty() && answer.back() == '\n') answer.pop_back();
    return answer;
  }

  /// Supply of chip and sensors [V]. Below the level of the brown-out fuse the chip is in reset.
  void setVoltage(double volts) {
    const bool low = volts < kBrownOutVoltage;
    if (low == browned_out_) return;
    chip_.reset(SimulatedChip::Reset::kBrownOut);
    browned_out_ = low;
  }
  SimulatedChip& chip() { return chip_; }
  Pneumatics& air() { return air_; }

  int channels() const { return kind_.channels(); }
  double pressure(int channel) const { return air_.pressure(channel); }  ///< gauge [Pa]
  /// Of them now [Pa].
  double highest() const {
    double highest = 0;
    for (int i = 0; i < channels(); ++i) highest = std::max(highest, pressure(i));
    return highest;
  }
  /// Whether the channel's pins let its air out and none in.
  bool vents(int channel) const {
    const auto i = static_cast<std::size_t>(channel);
    return !chip_.level(wiring_.inlets.at(i)) && !chip_.level(wiring_.outlets.at(i));
  }
  bool allVent() const {
    for (int i = 0; i < channels(); ++i) {
      if (!vents(i)) return false;
    }
    return true;
  }
  /// Whether the supply valve has current.
  bool isSupplied() const { return chip_.level(wiring_.supply); }
  /// The LED.
  bool isLit() const { return chip_.level(wiring_.led); }

 private:
  static constexpr char kDocument[] = HELIX_ARM_SOURCE_DIR "/docs/board.md";
  static constexpr std::uint32_t kFrequency = 16000000;  // [Hz]
  static constexpr std::uint64_t kAirStep = kFrequency / 4000;
  // simavr counts a parity bit, which the line does not have: 11 bits of 8.5 us, not 10.
  static constexpr std::uint64_t kByteTime = 11 * 8 * 17;
  static constexpr double kNoise = 0.7 / 1024;  // standard deviation of a conversion, of full scale
  static constexpr double kBrownOutVoltage =
      4.3;  // of the fuses, whose value firmware_fault_test checks

  static std::string lowered(std::string text) {
    std::transform(text.begin(), text.end(), text.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return text;
  }

  static ChipPin pinOf(const std::string& port, const std::string& bit) {
    return {port.front(), std::stoi(bit)};
  }

  // The wiring that docs/board.md gives a chip: what the tests solder is what a reader solders.
  static BoardWiring readWiring(const std::string& chip) {
    const std::regex row(
        R"(\| (\d) \| P([A-L])([0-7]) \(D\d+\) \| P([A-L])([0-7]) \(D\d+\) \| P[CF]\d \(A(\d)\) \|.*)");
    const std::regex others(R"(Supply valve: P([A-L])([0-7]) .*LED: P([A-L])([0-7]) .*)");
    std::ifstream document(kDocument);
    BoardWiring wiring;
    std::optional<ChipPin> supply;
    bool in_section = false;
    for (std::string line; std::getline(document, line);) {
      if (line.rfind('#', 0) == 0) in_section = lowered(line).find(chip) != std::string::npos;
      std::smatch match;
      if (in_section && std::regex_match(line, match, row)) {
        if (std::stoul(match[1]) != wiring.inlets.size()) {
          throw std::runtime_error(std::string(kDocument) + ": channel " + match[1].str() + " of " +
                                   chip + " is out of order");
        }
        wiring.inlets.push_back(pinOf(match[2], match[3]));
        wiring.outlets.push_back(pinOf(match[4], match[5]));
        wiring.sensors.push_back(std::stoi(match[6]));
      } else if (in_section && std::regex_match(line, match, others)) {
        supply = pinOf(match[1], match[2]);
        wiring.led = pinOf(match[3], match[4]);
      }
    }
    if (wiring.inlets.empty() || !supply) {
      throw std::runtime_error(std::string(kDocument) +
                               " has no table of pins, or no supply valve and LED, of " + chip);
    }
    wiring.supply = *supply;
    return wiring;
  }

  // A pin without a sensor is pulled to ground.
  double sensor(int converter_channel) {
    for (int i = 0; i < channels(); ++i) {
      if (wiring_.sensors.at(static_cast<std::size_t>(i)) == converter_channel) {
        return air_.sensor(i) + kNoise * noise_(generator_);
      }
    }
    return 0;
  }
  void stepAir() {
    for (std::size_t i = 0; i < drives_.size(); ++i) {
      drives_[i] = {chip_.meanLevel(wiring_.inlets.at(i)), chip_.meanLevel(wiring_.outlets.at(i))};
    }
    air_.step(static_cast<double>(kAirStep) / kFrequency, drives_, chip_.meanLevel(wiring_.supply));
  }

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

/// Each chip and each kind of valve once.
inline const BoardKind kEachPart[] = {{"atmega328p", "solenoid"}, {"atmega2560", "proportional"}};
/// Every build in full size, by default each part once.
inline std::vector<BoardKind> drawnBoards() {
  std::vector<BoardKind> out(kEachPart, kEachPart + 2);
  if (isFullSize())
    out.insert(out.end(), {{"atmega328p", "proportional"}, {"atmega2560", "solenoid"}});
  return out;
}
inline const BoardKind kSmallBoard = kEachPart[0];
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
