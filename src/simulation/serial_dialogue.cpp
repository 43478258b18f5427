#include "serial_dialogue.hpp"

#include <algorithm>
#include <limits>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::simulation {
namespace {

using control::Valve;
using regulator::LineFields;
using regulator::LineFormat;

constexpr const char* kSerialDevice = "serial device";
constexpr double kPsi = 6894.757293168;

const SerialDeviceConfig& valid(const SerialDeviceConfig& config) {
  config.profile.validate();
  config.regulator.validate();
  basics::requireValue(config.channels >= 1, kSerialDevice, "the number of channels",
                       config.channels, "at least 1");
  const bool addressed = regulator::SerialLines(config.profile).write->has("{address}");
  basics::requireValue(
      config.addresses.size() == static_cast<std::size_t>(addressed ? config.channels : 0),
      kSerialDevice, "the number of addresses", config.addresses.size(),
      "one per channel if the profile has {address}, else none");
  basics::require(addressed || config.channels == 1 || !config.profile.one_by_one, kSerialDevice,
                  ": the profile has no {address} to distinguish channels");
  basics::requireValue(config.period > 0, kSerialDevice, "the period [s]", config.period,
                       "a value > 0");
  return config;
}

bool ventsByMode(const regulator::SerialLines& lines, bool one_by_one) {
  const std::string last = lines.vent.back().line("A", {{0.0}, {}, {}});
  return !one_by_one || !lines.write->match(last, "A", 1).has_value();
}

}  // namespace

SerialDialogue::SerialDialogue(const SerialDeviceConfig& config)
    : config_(valid(config)),
      lines_(config.profile),
      vents_by_mode_(ventsByMode(lines_, config.profile.one_by_one)),
      simulated_(config.channels, config.regulator),
      stuck_(Eigen::VectorXd::Zero(config.channels)) {
  restart();
}

void SerialDialogue::restart() {
  ventAll();
  speaks_ = lines_.start.empty();
  silence_ = 0;
}

// In force until the next set point.
void SerialDialogue::ventAll() {
  const auto channels = static_cast<std::size_t>(config_.channels);
  set_point_ = Eigen::VectorXd::Zero(config_.channels);
  valves_.assign(channels, Valve::kVent);
  held_.assign(channels, false);
  apply();
}

void SerialDialogue::step(double dt) {
  const double left = config_.profile.watchdog - silence_;
  silence_ += dt;
  if (left > 0 && dt >= left) {
    simulated_.step(left);
    dt -= left;
    ventAll();
  }
  simulated_.step(dt);
}

// A closed channel keeps its pressure.
void SerialDialogue::apply() {
  Eigen::VectorXd goal = Eigen::VectorXd::Zero(config_.channels);
  for (int i = 0; i < goal.size(); ++i) {
    const Valve valve = valves_[static_cast<std::size_t>(i)];
    if (valve == Valve::kRegulate) goal[i] = set_point_[i];
    if (valve == Valve::kClose) goal[i] = simulated_.pressure()[i];
  }
  simulated_.command(goal);
}

std::string SerialDialogue::readings(const LineFormat& format, int channel, DeviceFault fault) {
  const regulator::SerialProfile& profile = config_.profile;
  const bool one = profile.one_by_one;
  const bool wrong_unit = fault == DeviceFault::kWrongUnit;
  const double other = profile.pascals == kPsi ? 1e3 : kPsi;
  const auto number = [&](double pressure) {
    return wrong_unit ? (pressure + profile.atmosphere) / other : profile.fromPascals(pressure);
  };
  const Eigen::VectorXd pressures =
      fault == DeviceFault::kStuckValue ? stuck_ : simulated_.measure();
  LineFields fields;
  for (int i = one ? channel : 0; i < (one ? channel + 1 : config_.channels); ++i) {
    fields.pressures.push_back(fault == DeviceFault::kNanText
                                   ? std::numeric_limits<double>::quiet_NaN()
                                   : number(pressures[i]));
  }
  fields.set_point = number(set_point_[channel]);
  fields.supply = number(simulated_.supply());
  const std::string address = config_.addresses.empty()
                                  ? std::string()
                                  : config_.addresses[static_cast<std::size_t>(channel)];
  std::string line = format.line(address, fields);
  if (wrong_unit && format.has("{unit}")) {
    // The last occurrence is the unit: numbers contain no letters, and addresses come first.
    const std::size_t at = line.rfind(profile.unit_word);
    line.replace(at, profile.unit_word.size(), profile.unit_word == "psi" ? "kPa" : "psi");
  }
  return line;
}

SerialDialogue::Outcome SerialDialogue::takeOf(const std::string& line, int channel,
                                               DeviceFault fault) {
  const bool one = config_.profile.one_by_one;
  const std::string address = config_.addresses.empty()
                                  ? std::string()
                                  : config_.addresses[static_cast<std::size_t>(channel)];
  const auto count = static_cast<std::size_t>(config_.channels);
  const auto isAny = [&](const std::vector<LineFormat>& formats) {
    return std::any_of(formats.begin(), formats.end(),
                       [&](const LineFormat& f) { return f.match(line, address, count); });
  };
  const auto isLast = [&](const std::vector<LineFormat>& formats) {
    return !formats.empty() && formats.back().match(line, address, count);
  };
  const int first = one ? channel : 0;
  const int end = one ? channel + 1 : config_.channels;
  const auto answer = [&](const std::optional<LineFormat>& format, bool sets) {
    apply();
    Outcome outcome{true, sets, std::nullopt};
    if (format) outcome.answer = readings(*format, channel, fault);
    return outcome;
  };
  const auto turn = [&](Valve valve, bool hold) {
    for (int i = first; i < end; ++i) {
      valves_[static_cast<std::size_t>(i)] = valve;
      held_[static_cast<std::size_t>(i)] = hold && !lines_.resume.empty();
    }
  };

  if (lines_.read && lines_.read->match(line, address, count)) return answer(lines_.reply, false);
  if (isLast(lines_.vent) && (vents_by_mode_ || !held_[static_cast<std::size_t>(channel)])) {
    turn(Valve::kVent, vents_by_mode_);
    set_point_.segment(first, end - first).setZero();
    return answer(lines_.vent_reply, false);
  }
  if (isLast(lines_.resume)) {
    for (int i = first; i < end; ++i) {
      const auto k = static_cast<std::size_t>(i);
      if (held_[k]) valves_[k] = Valve::kRegulate;
      held_[k] = false;
    }
    return answer(lines_.vent_reply, false);
  }
  if (isLast(lines_.close)) {
    turn(Valve::kClose, true);
    return answer(lines_.vent_reply, false);
  }
  if (const std::optional<LineFields> fields = lines_.write->match(line, address, count)) {
    for (int i = first; i < end; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const double number = fields->pressures[static_cast<std::size_t>(i - first)];
      set_point_[i] = std::clamp(config_.profile.toPascals(number), 0.0, 1e7);
      if (!held_[k]) valves_[k] = Valve::kRegulate;
    }
    return answer(lines_.write_reply, true);
  }
  if (isAny(lines_.vent) || isAny(lines_.resume) || isAny(lines_.close)) {
    return answer(lines_.vent_reply, false);
  }
  return {};
}

SerialDialogue::Outcome SerialDialogue::take(const std::string& line, DeviceFault fault) {
  if (!config_.profile.checksum) return takeText(line, fault);
  const std::optional<std::string> text = regulator::withoutChecksum(line);
  Outcome outcome = text ? takeText(*text, fault) : refusal();
  if (outcome.answer) outcome.answer = regulator::withChecksum(*outcome.answer);
  return outcome;
}

SerialDialogue::Outcome SerialDialogue::refusal() const {
  return {false, false, lines_.read ? std::optional<std::string>("?") : std::nullopt};
}

SerialDialogue::Outcome SerialDialogue::takeText(const std::string& line, DeviceFault fault) {
  silence_ = 0;
  for (std::size_t i = 0; i < lines_.start.size(); ++i) {
    if (!lines_.start[i].match(line, "", 0)) continue;
    speaks_ = speaks_ || i + 1 == lines_.start.size();
    return {true, false, std::nullopt};
  }
  const int talkers = config_.profile.one_by_one ? config_.channels : 1;
  for (int channel = 0; channel < talkers; ++channel) {
    Outcome outcome = takeOf(line, channel, fault);
    if (outcome.understood) return outcome;
  }
  return refusal();
}

std::optional<std::string> SerialDialogue::unasked(DeviceFault fault) {
  if (lines_.read || !speaks_) return std::nullopt;
  const std::string line = readings(*lines_.reply, 0, fault);
  return config_.profile.checksum ? regulator::withChecksum(line) : line;
}

}  // namespace helix_arm::simulation
