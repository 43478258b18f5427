#include "simulated_board.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <optional>
#include <regex>
#include <stdexcept>
#include <utility>

#include <avr_adc.h>
#include <avr_extint.h>
#include <avr_ioport.h>
#include <avr_uart.h>
#include <sim_avr.h>
#include <sim_elf.h>

namespace helix_arm::test {
namespace {

constexpr std::uint32_t kMillivolts = 5000;  // of all references; sensors are shares of it
constexpr int kFullScale = 1023;             // [counts]
constexpr char kLoopForEver[] = "_exit";     // of the C library: interrupts off, a jump to itself
constexpr std::uint8_t kExternalInterrupts = 8;

// The time of a sleep passes at once.
void skipSleep(avr_t*, avr_cycle_count_t) {}

void require(bool holds, const std::string& fault) {
  if (!holds) throw std::runtime_error(fault);
}

constexpr double kSensorZero = 0.1, kSensorSpan = 0.8, kSensorRange = 7e5;  // ratiometric, [Pa]
constexpr double kProportionalFrom = 0.3;
constexpr double kDriftRate = 2.5e4, kDriftMost = 2.5e4;  // [Pa/s], [Pa]
constexpr double kLeakOpening = 0.1;                      // of the outlet's

// Exact for a constant drive.
void lag(double& value, double goal, double dt, double time) {
  value += -std::expm1(-dt / time) * (goal - value);
}

constexpr char kDocument[] = HELIX_ARM_SOURCE_DIR "/docs/board.md";

std::string lowered(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

ChipPin pinOf(const std::string& port, const std::string& bit) {
  return {port.front(), std::stoi(bit)};
}

// The wiring that docs/board.md gives a chip: what the tests solder is what a reader solders.
BoardWiring readWiring(const std::string& chip) {
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

constexpr std::uint32_t kFrequency = 16000000;  // [Hz]
constexpr std::uint64_t kAirStep = kFrequency / 4000;
// simavr counts a parity bit, which the line does not have: 11 bits of 8.5 us, not 10.
constexpr std::uint64_t kByteTime = 11 * 8 * 17;
constexpr double kNoise = 0.7 / 1024;     // standard deviation of a conversion, of full scale
constexpr double kBrownOutVoltage = 4.3;  // of the fuses, whose value firmware_fault_test checks

}  // namespace

struct SimulatedChip::State {
  struct Pin {
    State* chip = nullptr;
    int bit = 0;
    bool driven = false, high = false;
    std::uint64_t since = 0, counted_from = 0, high_for = 0;  // [cycles]

    void count() {
      const std::uint64_t now = chip->avr->cycle;
      if (driven && high) high_for += now - since;
      since = now;
    }
  };

  avr_t* avr = nullptr;
  void (*reset_core)(avr_t*) = nullptr;
  std::uint32_t loop_for_ever = 0;
  Sensor sensor = [](int) { return 0.0; };
  std::string sent;
  std::map<std::pair<char, int>, Pin> pins;
  int watchdog_resets = 0;
  bool is_reset = false;  // since the last instruction

  ~State() {
    if (avr == nullptr) return;
    avr_terminate(avr);
    std::free(avr);
  }

  Pin& pin(ChipPin which) {
    const auto [at, fresh] = pins.try_emplace({which.port, which.bit});
    Pin& pin = at->second;
    if (!fresh) return pin;
    pin.chip = this;
    pin.bit = which.bit;
    pin.since = pin.counted_from = avr->cycle;
    avr_irq_t* irqs = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(which.port), 0);
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
  // simavr gives no notice of the pins that a reset frees.
  void freePins() {
    for (auto& [which, pin] : pins) {
      pin.count();
      pin.driven = pin.high = false;
    }
  }
  // Else every second cycle looks at external interrupts, which the program does not use.
  void leaveExternalInterrupts() {
    for (std::uint8_t i = 0; i < kExternalInterrupts; ++i) {
      avr_extint_set_strict_lvl_trig(avr, i, 0);
    }
    is_reset = false;
  }

  void load(const std::string& name, const std::string& elf, std::uint32_t frequency) {
    elf_firmware_t firmware{};
    require(elf_read_firmware(elf.c_str(), &firmware) == 0,
            elf + " cannot be read; build it with make -C firmware");
    avr = avr_make_mcu_by_name(name.c_str());
    require(avr != nullptr, "simavr has no chip " + name);
    avr_init(avr);
    avr->frequency = frequency;
    avr->vcc = avr->avcc = avr->aref = kMillivolts;
    avr->sleep = skipSleep;
    avr_load_firmware(avr, &firmware);
    for (std::uint32_t i = 0; i < firmware.symbolcount; ++i) {
      if (std::strcmp(firmware.symbol[i]->symbol, kLoopForEver) == 0) {
        loop_for_ever = firmware.symbol[i]->addr;
      }
      std::free(firmware.symbol[i]);
    }
    std::free(firmware.symbol);
    std::free(firmware.flash);
    std::free(firmware.fuse);
    require(loop_for_ever != 0, elf + " has no symbol " + kLoopForEver);
  }

  void listen() {
    std::uint32_t quiet = 0;  // it neither prints nor waits
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &quiet);
    avr_irq_register_notify(
        avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT),
        [](avr_irq_t*, std::uint32_t value, void* of) {
          static_cast<State*>(of)->sent += static_cast<char>(value);
        },
        this);
    avr_irq_register_notify(
        avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER),
        [](avr_irq_t*, std::uint32_t value, void* of) { static_cast<State*>(of)->convert(value); },
        this);
    avr->custom.data = this;
    reset_core = avr->reset;
    avr->reset = [](avr_t* core) {
      auto* of = static_cast<State*>(core->custom.data);
      ++of->watchdog_resets;  // those from outside are taken off again
      of->is_reset = true;
      of->freePins();
      of->reset_core(core);
    };
  }

  // The converter of simavr takes millivolts; these give the count that the chip would have.
  void convert(std::uint32_t trigger) {
    avr_adc_mux_t mux{};
    std::memcpy(&mux, &trigger, sizeof trigger);
    const double share = std::clamp(sensor(static_cast<int>(mux.src)), 0.0, 1.0);
    const auto count = std::min(kFullScale, static_cast<int>(share * (kFullScale + 1)));
    const auto millivolts = (static_cast<std::uint32_t>(count) * kMillivolts + kFullScale - 1) /
                            static_cast<std::uint32_t>(kFullScale);
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + mux.src), millivolts);
  }
};

SimulatedChip::SimulatedChip(const std::string& name, const std::string& elf,
                             std::uint32_t frequency)
    : state_(std::make_unique<State>()) {
  state_->load(name, elf, frequency);
  state_->listen();
  reset(Reset::kPowerOn);
}
SimulatedChip::~SimulatedChip() = default;

void SimulatedChip::connect(Sensor sensor) { state_->sensor = std::move(sensor); }

void SimulatedChip::runTo(std::uint64_t cycle) {
  avr_t* avr = state_->avr;
  while (avr->cycle < cycle) {
    if (state_->is_reset) state_->leaveExternalInterrupts();
    const int state = avr_run(avr);
    if (state != cpu_Running && state != cpu_Sleeping) {
      throw std::runtime_error("the program has crashed at " + std::to_string(avr->pc));
    }
  }
}

std::uint64_t SimulatedChip::cycle() const { return state_->avr->cycle; }

void SimulatedChip::reset(Reset cause) {
  avr_t* avr = state_->avr;
  avr_reset(avr);
  --state_->watchdog_resets;
  const auto& flags = avr->reset_flags;
  avr_regbit_set(avr, cause == Reset::kPowerOn ? flags.porf
                      : cause == Reset::kPin   ? flags.extrf
                                               : flags.borf);
}

void SimulatedChip::hang() {
  state_->avr->pc = state_->loop_for_ever;
  state_->avr->state = cpu_Running;
}

int SimulatedChip::watchdogResets() const { return state_->watchdog_resets; }

std::array<std::uint8_t, 3> SimulatedChip::fuses() const {
  const std::uint8_t* fuse = state_->avr->fuse;
  return {fuse[AVR_FUSE_LOW], fuse[AVR_FUSE_HIGH], fuse[AVR_FUSE_EXT]};
}

void SimulatedChip::receive(std::uint8_t byte) {
  avr_raise_irq(avr_io_getirq(state_->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT), byte);
}

std::string SimulatedChip::takeSent() { return std::exchange(state_->sent, {}); }

bool SimulatedChip::level(ChipPin pin) const { return state_->pin(pin).high; }

double SimulatedChip::meanLevel(ChipPin which) {
  State::Pin& pin = state_->pin(which);
  pin.count();
  const std::uint64_t time = pin.since - std::exchange(pin.counted_from, pin.since);
  const std::uint64_t high = std::exchange(pin.high_for, 0);
  if (time == 0) return pin.driven && pin.high ? 1 : 0;
  return static_cast<double>(high) / static_cast<double>(time);
}

Pneumatics::Pneumatics(int channels, const Config& config, bool proportional)
    : config_(config), proportional_(proportional), channels_(static_cast<std::size_t>(channels)) {}

double Pneumatics::opening(double current) const {
  if (!proportional_) return current;
  return std::max(0.0, (current - kProportionalFrom) / (1 - kProportionalFrom));
}

void Pneumatics::step(double dt, const std::vector<ValveDrive>& drives, double supply) {
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

void Pneumatics::fail(int channel, ChannelFault fault, ChannelFault another) {
  Channel& of = channels_.at(channel);
  of.faults = {fault, another};
  of.blocked_at = of.pressure;
  of.drift = 0;
}

double Pneumatics::sensor(int channel) const {
  const Channel& of = channels_.at(channel);
  for (const ChannelFault fault : of.faults) {
    if (fault == ChannelFault::kSensorOpen || fault == ChannelFault::kSensorShortedToGround)
      return 0;
    if (fault == ChannelFault::kSensorShortedToSupply) return 1;
  }
  const double told = of.has(ChannelFault::kSensorBlocked) ? of.blocked_at : of.pressure;
  return kSensorZero + kSensorSpan * (told - of.drift) / kSensorRange;
}

SimulatedBoard::SimulatedBoard(const BoardKind& kind, const Pneumatics::Config& muscles)
    : kind_(kind),
      wiring_(readWiring(kind.chip)),
      chip_(kind.chip, HELIX_ARM_FIRMWARE_DIR "/board_" + kind.name() + ".elf", kFrequency),
      air_(kind.channels(), muscles, kind.valves == "proportional"),
      drives_(static_cast<std::size_t>(kind.channels())) {
  chip_.connect([this](int channel) { return sensor(channel); });
  isLit();  // a pin is watched from the first look on
}

// A pin without a sensor is pulled to ground.
double SimulatedBoard::sensor(int converter_channel) {
  for (int i = 0; i < channels(); ++i) {
    if (wiring_.sensors.at(static_cast<std::size_t>(i)) == converter_channel) {
      return air_.sensor(i) + kNoise * noise_(generator_);
    }
  }
  return 0;
}

void SimulatedBoard::stepAir() {
  for (std::size_t i = 0; i < drives_.size(); ++i) {
    drives_[i] = {chip_.meanLevel(wiring_.inlets.at(i)), chip_.meanLevel(wiring_.outlets.at(i))};
  }
  air_.step(static_cast<double>(kAirStep) / kFrequency, drives_, chip_.meanLevel(wiring_.supply));
}

void SimulatedBoard::advance(double dt) {
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

double SimulatedBoard::time() const {
  return static_cast<double>(chip_.cycle() + off_time_) / kFrequency;
}

void SimulatedBoard::send(const std::string& bytes) {
  if (to_chip_.empty()) next_byte_ = chip_.cycle() + off_time_;
  to_chip_.insert(to_chip_.end(), bytes.begin(), bytes.end());
}

std::string SimulatedBoard::ask(const std::string& line) {
  receive();
  send(line + "\n");
  while (isReceiving()) advance(0.001);
  advance(0.01);
  std::string answer = receive();
  if (!answer.empty() && answer.back() == '\n') answer.pop_back();
  return answer;
}

void SimulatedBoard::setVoltage(double volts) {
  const bool low = volts < kBrownOutVoltage;
  if (low == browned_out_) return;
  chip_.reset(SimulatedChip::Reset::kBrownOut);
  browned_out_ = low;
}

double SimulatedBoard::highest() const {
  double highest = 0;
  for (int i = 0; i < channels(); ++i) highest = std::max(highest, pressure(i));
  return highest;
}

bool SimulatedBoard::vents(int channel) const {
  const auto i = static_cast<std::size_t>(channel);
  return !chip_.level(wiring_.inlets.at(i)) && !chip_.level(wiring_.outlets.at(i));
}

bool SimulatedBoard::allVent() const {
  for (int i = 0; i < channels(); ++i) {
    if (!vents(i)) return false;
  }
  return true;
}

bool SimulatedBoard::isSupplied() const { return chip_.level(wiring_.supply); }

bool SimulatedBoard::isLit() const { return chip_.level(wiring_.led); }

}  // namespace helix_arm::test
