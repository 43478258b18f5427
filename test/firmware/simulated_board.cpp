#include "simulated_board.hpp"

#include <algorithm>

namespace helix_arm::test {
namespace {

constexpr std::uint32_t kFrequency = 16000000;  // [Hz]
constexpr std::uint64_t kAirStep = kFrequency / 4000;
// simavr counts a parity bit, which the line does not have: 11 bits of 8.5 us, not 10.
constexpr std::uint64_t kByteTime = 11 * 8 * 17;
constexpr double kNoise = 0.7 / 1024;     // standard deviation of a conversion, of full scale
constexpr double kBrownOutVoltage = 4.3;  // of the fuses, whose value firmware_fault_test checks

}  // namespace

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
