#include <algorithm>

#include "emulation.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "regulator/line_format.hpp"

namespace helix_arm::simulation {
namespace {

using control::Valve;
using regulator::kPsi;
using regulator::LineFormat;

constexpr const char* kSerialDevice = "serial device";

int channelsOf(const regulator::SerialConfig& regulator, const EmulatedDeviceConfig& config) {
  const regulator::SerialProfile& profile = regulator.profile;
  profile.validate();
  config.valves.validate();
  basics::requireValue(config.channels >= 1, kSerialDevice, "the number of channels",
                       config.channels, "at least 1");
  const bool addressed = regulator::SerialLines(profile).write->has("{address}");
  basics::requireValue(
      regulator.addresses.size() == static_cast<std::size_t>(addressed ? config.channels : 0),
      kSerialDevice, "the number of addresses", regulator.addresses.size(),
      "one per channel if the profile has {address}, else none");
  basics::require(addressed || config.channels == 1 || !profile.one_by_one, kSerialDevice,
                  ": the profile has no {address} to distinguish channels");
  basics::requireValue(config.period > 0, kSerialDevice, "the period [s]", config.period,
                       "a value > 0");
  return config.channels;
}

bool ventsByMode(const regulator::SerialLines& lines, bool one_by_one) {
  const std::string last = lines.vent.back().line("A", {{0.0}, {}, {}});
  return !one_by_one || !lines.write->match(last, "A", 1).has_value();
}

class SerialEmulation : public Emulation {
 public:
  SerialEmulation(const regulator::SerialConfig& regulator, const EmulatedDeviceConfig& config)
      : Emulation(channelsOf(regulator, config), config.valves,
                  {regulator.profile.timeout, regulator.profile.terminator,
                   regulator.profile.read.empty() ? config.period
                                                  : std::numeric_limits<double>::infinity(),
                   config.seed}),
        profile_(regulator.profile),
        addresses_(regulator.addresses),
        count_(config.channels),
        lines_(profile_),
        vents_by_mode_(ventsByMode(lines_, profile_.one_by_one)),
        link_(regulator.device) {
    SerialEmulation::restart();
    SerialEmulation::open();
  }

  Eigen::VectorXd setPoint() const override { return set_point_; }
  std::vector<Valve> valves() const override { return valves_; }
  std::string path() const override { return link_.path().empty() ? path_ : link_.path(); }

 private:
  bool open() override {
    PseudoTerminal fresh;
    link_.pointTo(fresh.path());
    path_ = fresh.path();
    clients_.clear();
    clients_.push_back({std::move(fresh)});
    return true;
  }

  std::optional<std::string> next(std::string& input) const override {
    const std::size_t end = input.find(timing_.terminator);
    if (end == std::string::npos) return std::nullopt;
    std::string line = input.substr(0, end);
    input.erase(0, end + timing_.terminator.size());
    return line;
  }

  void step(double dt) override {
    const double left = profile_.watchdog - silence_;
    silence_ += dt;
    if (left > 0 && dt >= left) {
      regulator_.step(left);
      dt -= left;
      ventAll();
    }
    regulator_.step(dt);
  }

  Outcome take(const std::string& line) override {
    if (!profile_.checksum) return takeText(line);
    const std::optional<std::string> text = regulator::withoutChecksum(line);
    Outcome outcome = text ? takeText(*text) : refusal();
    if (outcome.answer) outcome.answer = regulator::withChecksum(*outcome.answer);
    return outcome;
  }

  std::optional<std::string> unasked() override {
    if (lines_.read || !speaks_) return std::nullopt;
    const std::string line = readingsOf(*lines_.reply, 0);
    return profile_.checksum ? regulator::withChecksum(line) : line;
  }

  void restart() override {
    ventAll();
    speaks_ = lines_.start.empty();
    silence_ = 0;
  }

  // Unit of the device's numbers, in both directions [Pa].
  double unit() const {
    if (fault_ != DeviceFault::kWrongUnit) return profile_.pascals;
    return profile_.pascals == kPsi ? 1e3 : kPsi;
  }

  std::string readingsOf(const LineFormat& format, int channel) {
    const auto number = [this](double pressure) {
      return (pressure + profile_.atmosphere) / unit();
    };
    const Eigen::VectorXd pressures = readings();
    regulator::LineFields fields;
    for (int i = firstOf(channel); i < endOf(channel); ++i) {
      fields.pressures.push_back(number(pressures[i]));
    }
    fields.set_point = number(set_point_[channel]);
    fields.supply = number(regulator_.supply());
    std::string line = format.line(addressOf(channel), fields);
    if (fault_ == DeviceFault::kWrongUnit && format.has("{unit}")) {
      // The last occurrence is the unit: numbers contain no letters, and addresses come first.
      const std::size_t at = line.rfind(profile_.unit_word);
      line.replace(at, profile_.unit_word.size(), unit() == kPsi ? "psi" : "kPa");
    }
    return line;
  }

  Outcome takeText(const std::string& line) {
    silence_ = 0;
    for (std::size_t i = 0; i < lines_.start.size(); ++i) {
      if (!lines_.start[i].match(line, "", 0)) continue;
      speaks_ = speaks_ || i + 1 == lines_.start.size();
      return {true};
    }
    const int talkers = profile_.one_by_one ? count_ : 1;
    for (int channel = 0; channel < talkers; ++channel) {
      Outcome outcome = takeOf(line, channel);
      if (outcome.taken) return outcome;
    }
    return refusal();
  }

  // Empty if the profile's lines have no {address}.
  std::string addressOf(int channel) const {
    return addresses_.empty() ? std::string() : addresses_[channel];
  }
  // The channels that a line to one of them concerns.
  int firstOf(int channel) const { return profile_.one_by_one ? channel : 0; }
  int endOf(int channel) const { return profile_.one_by_one ? channel + 1 : count_; }

  void turn(int channel, Valve valve, bool hold) {
    for (int i = firstOf(channel); i < endOf(channel); ++i) {
      valves_[i] = valve;
      held_[i] = hold && !lines_.resume.empty();
    }
  }

  Outcome takeOf(const std::string& line, int channel) {
    const std::string address = addressOf(channel);
    const auto count = static_cast<std::size_t>(count_);
    const auto is = [&](const LineFormat& f) { return f.match(line, address, count).has_value(); };
    const auto isAny = [&](const std::vector<LineFormat>& formats) {
      return std::any_of(formats.begin(), formats.end(), is);
    };
    const auto isLast = [&](const std::vector<LineFormat>& formats) {
      return !formats.empty() && is(formats.back());
    };
    const int first = firstOf(channel), end = endOf(channel);
    const std::optional<LineFormat>* reply = &lines_.vent_reply;
    bool sets = false;
    if (lines_.unit_query && is(*lines_.unit_query)) {
      reply = &lines_.unit_reply;
    } else if (lines_.read && is(*lines_.read)) {
      reply = &lines_.reply;
    } else if (isLast(lines_.vent) && (vents_by_mode_ || !held_[channel])) {
      turn(channel, Valve::kVent, vents_by_mode_);
      set_point_.segment(first, end - first).setZero();
    } else if (isLast(lines_.resume)) {
      for (int i = first; i < end; ++i) {
        if (held_[i]) valves_[i] = Valve::kRegulate;
        held_[i] = false;
      }
    } else if (isLast(lines_.close)) {
      turn(channel, Valve::kClose, true);
    } else if (const auto fields = lines_.write->match(line, address, count)) {
      for (int i = first; i < end; ++i) {
        const double number = fields->pressures[i - first];
        set_point_[i] = std::clamp(number * unit() - profile_.atmosphere, 0.0, 1e7);
        if (!held_[i]) valves_[i] = Valve::kRegulate;
      }
      reply = &lines_.write_reply;
      sets = true;
    } else if (!isAny(lines_.vent) && !isAny(lines_.resume) && !isAny(lines_.close)) {
      return {};
    }
    apply();
    Outcome outcome{true, sets};
    if (*reply) outcome.answer = readingsOf(**reply, channel);
    return outcome;
  }

  // Outcome of a line that is not understood.
  Outcome refusal() const {
    return {false, false, lines_.read ? std::optional<std::string>("?") : std::nullopt};
  }

  // A closed channel keeps its pressure.
  void apply() {
    Eigen::VectorXd goal = Eigen::VectorXd::Zero(count_);
    for (int i = 0; i < goal.size(); ++i) {
      const Valve valve = valves_[i];
      if (valve == Valve::kRegulate) goal[i] = set_point_[i];
      if (valve == Valve::kClose) goal[i] = regulator_.pressure()[i];
    }
    regulator_.command(goal);
  }

  // In force until the next set point.
  void ventAll() {
    const auto channels = static_cast<std::size_t>(count_);
    set_point_ = Eigen::VectorXd::Zero(count_);
    valves_.assign(channels, Valve::kVent);
    held_.assign(channels, false);
    apply();
  }

  const regulator::SerialProfile profile_;
  const std::vector<std::string> addresses_;  // (channels), or none
  const int count_;                           // channels
  const regulator::SerialLines lines_;
  const bool vents_by_mode_;  // by a line that is not a set point
  DeviceLink link_;
  std::string path_;  // of the terminal
  Eigen::VectorXd set_point_;
  std::vector<Valve> valves_;
  std::vector<bool> held_;  // (channels) until a resume line
  bool speaks_ = false;
  double silence_ = 0;  // time since the last line [s]
};

}  // namespace

std::unique_ptr<Emulation> emulate(const regulator::SerialConfig& regulator,
                                   const EmulatedDeviceConfig& config) {
  return std::make_unique<SerialEmulation>(regulator, config);
}

}  // namespace helix_arm::simulation
