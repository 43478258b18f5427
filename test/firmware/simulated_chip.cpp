#include "simulated_chip.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
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

}  // namespace helix_arm::test
