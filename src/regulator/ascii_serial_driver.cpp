#include <algorithm>
#include <cmath>
#include <exception>
#include <utility>

#include "basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/regulator/config.hpp"
#include "line_format.hpp"
#include "regulator_io.hpp"
#include "serial_port.hpp"

namespace helix_arm::regulator {
namespace {

constexpr const char* kCulprit = "ascii serial regulator";
// Margin for the watchdog of a device, whose clock and line may differ from ours.
constexpr double kWatchdogShare = 0.8;

double after(double seconds) { return steadyNow() + seconds; }

std::string milliseconds(double seconds) {
  return std::to_string(std::llround(seconds * 1e3)) + " ms";
}

// As a profile's device expects or sends it, without its terminator.
std::string sentLine(const SerialProfile& profile, const std::string& line) {
  return profile.checksum ? withChecksum(line) : line;
}

std::string receivedLine(const SerialProfile& profile, const std::string& line) {
  if (!profile.checksum) return line;
  std::optional<std::string> inner = withoutChecksum(line);
  if (inner) return std::move(*inner);
  throw BadReply("\"" + basics::quoted(line) +
                 "\", whose checksum is missing or wrong; check its "
                 "cable, and that the device sends one as checksum of the profile " +
                 profile.name + " says");
}

// Continues with the other items after an error, and throws the first one afterwards.
template <class Items, class Call>
void forEach(Items begin, Items end, const Call& call) {
  std::exception_ptr first;
  for (; begin != end; ++begin) {
    try {
      call(*begin);
    } catch (const std::runtime_error&) {
      if (!first) first = std::current_exception();
    }
  }
  if (first) std::rethrow_exception(first);
}

class AsciiSerialDriver : public Driver {
 public:
  AsciiSerialDriver(const SerialConfig& config, int channels)
      : profile_((config.profile.validate(), config.profile)),
        lines_(profile_),
        device_(config.device),
        count_(channels) {
    basics::requireValue(channels >= 1, kCulprit, "the number of channels", channels, "at least 1");
    basics::require(!device_.empty(), kCulprit,
                    ": device is empty; expected one such as /dev/ttyUSB0");
    const bool addressed = lines_.write->has("{address}");
    const std::vector<std::string>& addresses = config.addresses;
    if (addressed) {
      basics::requireValue(addresses.size() == static_cast<std::size_t>(channels), kCulprit,
                           "the number of addresses", addresses.size(),
                           "one per channel, " + std::to_string(channels));
    } else {
      basics::requireValue(addresses.empty(), kCulprit, "the number of addresses", addresses.size(),
                           "none: the profile's lines have no {address}");
      basics::require(channels == 1 || !profile_.one_by_one, kCulprit, ": there are ", channels,
                      " channels, but the profile's lines have no {address} to tell them apart");
    }
    for (std::size_t i = 0; i < addresses.size(); ++i) {
      const std::string& address = addresses[i];
      const bool word = !address.empty() && std::all_of(address.begin(), address.end(),
                                                        [](char c) { return c > ' ' && c <= '~'; });
      basics::require(word, kCulprit, ": address ", i, " is \"", basics::quoted(address),
                      "\"; expected a word without spaces");
      basics::require(std::find(addresses.begin(), addresses.end(), address) ==
                          addresses.begin() + static_cast<std::ptrdiff_t>(i),
                      kCulprit, ": address ", address, " is given twice; expected one per channel");
    }
    channels_.resize(profile_.one_by_one ? static_cast<std::size_t>(channels) : 1);
    for (std::size_t i = 0; addressed && i < channels_.size(); ++i) {
      channels_[i].address = addresses[i];
    }
  }

  void connect() override {
    port_.open(device_, profile_.baud);
    try {
      ready();
    } catch (const BadReply& error) {
      close();
      throw LinkError(error.what());
    } catch (...) {
      close();
      throw;
    }
  }

  void write(const control::ValveOrders& orders) override {
    const auto size = static_cast<std::size_t>(count_);
    basics::requireValue(orders.valve.size() == size && orders.set_point.size() == count_, kCulprit,
                         "the number of orders", orders.valve.size(), "one per channel");
    basics::require(orders.set_point.allFinite(), kCulprit,
                    ": a set point is not finite; expected pascals");
    if (!profile_.one_by_one) return writeTogether(orders);
    forEach(channels_.begin(), channels_.end(), [&](Channel& channel) {
      const auto i = &channel - channels_.data();
      writeChannel(channel, orders.valve[static_cast<std::size_t>(i)], orders.set_point[i]);
    });
  }

  void read(Pressures& pressures) override {
    basics::requireValue(pressures.pressure.size() == count_, kCulprit, "the number of readings",
                         pressures.pressure.size(), "one per channel");
    pressures = Pressures(count_);
    std::exception_ptr error;
    try {
      if (lines_.read) {
        ask();
      } else {
        overhear();
      }
    } catch (const std::runtime_error&) {  // the readings of other channels are valid
      error = std::current_exception();
    }
    int i = 0;
    for (Channel& channel : channels_) {
      std::copy(channel.readings.begin(), channel.readings.end(), pressures.pressure.data() + i);
      channel.readings.clear();
      i += profile_.one_by_one ? 1 : count_;
    }
    if (supply_) pressures.supply = *supply_;
    supply_.reset();
    if (error) std::rethrow_exception(error);
  }

  void vent() override {
    forEach(channels_.begin(), channels_.end(), [this](Channel& channel) { ventChannel(channel); });
  }

  double watchdog() const noexcept override { return profile_.watchdog; }
  void close() noexcept override { port_.close(); }

 private:
  enum class State { kUnknown, kVented, kClosed, kRegulates };
  struct Channel {
    std::string address;
    State state = State::kUnknown;
    std::optional<double> sent;    // set point [device units]; absent unless it regulates
    std::optional<double> held;    // as last answered [device units]
    std::vector<double> readings;  // not yet returned by read() [Pa]
    double heard = 0;              // time of the last reading
  };

  void ready() {
    for (Channel& channel : channels_) {
      channel.state = State::kUnknown;
      channel.sent.reset();
      channel.held.reset();
      channel.readings.clear();
    }
    supply_.reset();
    lapsed_ = false;
    for (const LineFormat& line : lines_.start) {
      port_.send(sentLine(profile_, line.line("", {})) + profile_.terminator,
                 after(profile_.timeout));
    }
    if (lines_.read) awaitQuiet();
    last_line_ = steadyNow();
    if (lines_.unit_query) askUnits();
    vent();
    if (lines_.read) {
      ask();
    } else {
      awaitReading();
    }
  }

  // The echo of a set point has the device's unit, whichever that is. A device with another one, or
  // that does not answer, is vented, since 0 is no more than the atmosphere in every unit, and gets
  // no other set point.
  void askUnits() {
    try {
      for (Channel& channel : channels_) exchange(*lines_.unit_query, lines_.unit_reply, channel);
    } catch (const std::exception& error) {
      const std::string why = error.what();
      try {
        vent();
      } catch (const std::exception&) {
        // It answers in its unit; the fault that is told is the first one.
      }
      throw LinkError(why + ". Set the unit " + profile_.unit_word +
                      " on the device. If it has no such query, use a copy of its profile " +
                      profile_.name +
                      " without unit_query and unit_reply; nothing then checks its unit");
    }
  }

  // A late answer from before must not be taken for the first one of this connection.
  void awaitQuiet() {
    const double deadline = after(3 * profile_.timeout);
    double quiet = after(profile_.timeout);
    while (steadyNow() < quiet) {
      // Also waits for the rest of a line that has begun.
      const std::optional<std::string> line =
          port_.receiveLine(profile_.terminator, std::min(quiet, deadline));
      if (port_.discardInput() || line) quiet = after(profile_.timeout);
      if (steadyNow() >= deadline) {
        throw LinkError(device_ + " keeps sending, but its profile " + profile_.name +
                        " says that it only answers requests; switch off its streaming, or use "
                        "another profile");
      }
    }
  }

  void awaitReading() {
    const double deadline = after(3 * profile_.timeout);
    std::exception_ptr error;
    while (steadyNow() < deadline) {
      try {
        if (listen(deadline)) return;
      } catch (const BadReply&) {  // the first line may be incomplete
        error = std::current_exception();
      }
    }
    if (error) std::rethrow_exception(error);
    throw LinkError(device_ + " sends no readings within " + milliseconds(3 * profile_.timeout) +
                    "; check its power, its baud rate and the profile " + profile_.name);
  }

  // Sends a line and notes what the answer holds, if one is due.
  void exchange(const LineFormat& command, const std::optional<LineFormat>& reply, Channel& channel,
                const LineFields& values = {}) {
    const double deadline = after(profile_.timeout);
    if (lines_.read) port_.discardInput();
    const std::string line = command.line(channel.address, values);
    port_.send(sentLine(profile_, line) + profile_.terminator, deadline);
    noteSilence();
    last_line_ = steadyNow();
    if (!reply) return;
    const std::optional<std::string> answer = port_.receiveLine(profile_.terminator, deadline);
    if (!answer && !port_.unfinished().empty()) {
      throw BadReply(device_ + " sent an incomplete answer to \"" + line + "\": \"" +
                     basics::quoted(port_.unfinished()) + "\"");
    }
    if (!answer) {
      throw LinkError(
          device_ + " does not answer \"" + line + "\" within " + milliseconds(profile_.timeout) +
          "; check its power, its address, its baud rate and the profile " + profile_.name);
    }
    LineFields fields;
    try {
      fields = reply->parse(receivedLine(profile_, *answer), channel.address,
                            static_cast<std::size_t>(count_));
    } catch (const BadReply& error) {
      throw BadReply(device_ + " answers \"" + line + "\": " + error.what());
    }
    note(fields, channel);
  }

  // Remembered until all channels are vented, since the first line after a silence may be a vent.
  void noteSilence() {
    lapsed_ = lapsed_ || steadyNow() - last_line_ > kWatchdogShare * profile_.watchdog;
  }

  // A device that has vented by itself would jump to the set point of the next line.
  void requireWatched() {
    const bool vented = std::all_of(channels_.begin(), channels_.end(), [](const Channel& channel) {
      return channel.state == State::kVented;
    });
    if (vented) {
      lapsed_ = false;
      last_line_ = steadyNow();
    }
    noteSilence();
    if (!lapsed_) return;
    throw LinkError(device_ + " received no line for more than " +
                    milliseconds(kWatchdogShare * profile_.watchdog) +
                    ", and may have vented by itself (watchdog_s of its profile " + profile_.name +
                    "); reduce the load of this machine");
  }

  double reading(double number) const {
    const double pressure = profile_.toPascals(number);
    if (control::kPossibleReading.contains(pressure)) return pressure;
    throw BadReply(device_ + " reads " + std::to_string(pressure / 1e3) +
                   " kPa (gauge), which is impossible; check its sensor and its unit");
  }

  void checkSetPoint(double held, Channel& channel) const {
    const double before = std::exchange(channel.held, held).value_or(held);
    if (!channel.sent) return;
    const double left = std::abs(held - *channel.sent);
    // Devices round to their own digits. Larger differences mean a ramp, another unit, or another
    // client.
    const double tolerance =
        std::max(2 * std::pow(10.0, -profile_.decimals), 0.02 * std::abs(*channel.sent));
    if (left <= tolerance) return;
    const bool ramps = left < std::abs(before - *channel.sent);
    throw BadReply(device_ + " " + channel.address + " holds the set point " +
                   std::to_string(held) + ", but was sent " + std::to_string(*channel.sent) +
                   (ramps ? "; its set point moves there from " + std::to_string(before) +
                                ": it ramps set points; switch its ramp off, and check its range"
                          : "; check its unit, its range, that it does not ramp set points and "
                            "that it accepts them from the serial line"));
  }

  void note(const LineFields& fields, Channel& channel) {
    if (fields.supply) supply_ = reading(*fields.supply);
    if (fields.set_point) checkSetPoint(*fields.set_point, channel);
    if (fields.pressures.empty()) return;
    std::vector<double> readings;
    for (const double number : fields.pressures) readings.push_back(reading(number));
    channel.readings = std::move(readings);
    channel.heard = steadyNow();
  }

  double numberOf(double pressure) const {
    // Rounded down: the device never gets more than was ordered, but for floating-point error.
    const double scale = std::pow(10.0, profile_.decimals);
    return std::floor(profile_.fromPascals(pressure) * scale + 1e-6) / scale;
  }

  void exchangeAll(const std::vector<LineFormat>& commands, Channel& channel) {
    for (const LineFormat& command : commands) {
      exchange(command, lines_.vent_reply, channel);
    }
  }

  void ventChannel(Channel& channel) {
    const bool vented = channel.state == State::kVented;
    channel.sent.reset();
    channel.state = State::kUnknown;
    // If one line fails, the next one may still vent the device.
    forEach(vented ? lines_.vent.end() - 1 : lines_.vent.begin(), lines_.vent.end(),
            [&](const LineFormat& line) { exchange(line, lines_.vent_reply, channel); });
    channel.state = State::kVented;
  }

  void closeChannel(Channel& channel) {
    requireWatched();
    channel.sent.reset();
    channel.state = State::kUnknown;
    exchangeAll(lines_.close, channel);
    requireWatched();
    channel.state = State::kClosed;
  }

  void regulate(Channel& channel, const LineFields& values) {
    requireWatched();
    const bool regulated = channel.state == State::kRegulates;
    channel.state = State::kUnknown;
    exchange(*lines_.write, lines_.write_reply, channel, values);
    requireWatched();
    if (!regulated) exchangeAll(lines_.resume, channel);
    channel.state = State::kRegulates;
  }

  void writeChannel(Channel& channel, control::Valve valve, double set_point) {
    if (valve == control::Valve::kRegulate) {
      channel.sent = numberOf(set_point);
      regulate(channel, {{*channel.sent}, {}, {}});
    } else if (valve == control::Valve::kClose && !lines_.close.empty()) {
      closeChannel(channel);
    } else {
      ventChannel(channel);
    }
  }

  void writeTogether(const control::ValveOrders& orders) {
    Channel& all = channels_.front();
    const bool regulates = std::find(orders.valve.begin(), orders.valve.end(),
                                     control::Valve::kRegulate) != orders.valve.end();
    if (!regulates) return ventChannel(all);
    LineFields values;
    for (std::size_t i = 0; i < orders.valve.size(); ++i) {
      const bool vented = orders.valve[i] != control::Valve::kRegulate;
      values.pressures.push_back(numberOf(vented ? 0.0 : orders.set_point[static_cast<int>(i)]));
    }
    regulate(all, values);
  }

  // Reads the lines that arrived, the first until the deadline. @return whether one is a reading.
  bool listen(double deadline) {
    const auto channels = static_cast<std::size_t>(count_);
    bool heard = false;
    std::exception_ptr error;
    for (std::optional<std::string> line = port_.receiveLine(profile_.terminator, deadline); line;
         line = port_.receiveLine(profile_.terminator, 0)) {
      if (line->find_first_not_of("\r\n \t") == std::string::npos) continue;
      try {
        const std::string text = receivedLine(profile_, *line);
        const auto fits = [&](const LineFormat& format) {
          return format.match(text, "", channels).has_value();
        };
        if (std::any_of(lines_.skip.begin(), lines_.skip.end(), fits)) continue;
        const bool supply = lines_.supply_line && fits(*lines_.supply_line);
        const LineFormat& format = supply ? *lines_.supply_line : *lines_.reply;
        note(format.parse(text, "", channels), channels_.front());
        heard = heard || !supply;
      } catch (const BadReply& fault) {
        error = std::make_exception_ptr(BadReply(device_ + " sends " + fault.what()));
      }
    }
    if (!heard && error) std::rethrow_exception(error);
    return heard;
  }

  void ask() {
    // Readings in answers to a write are valid only for this time.
    const double oldest = steadyNow() - profile_.timeout;
    forEach(channels_.begin(), channels_.end(), [&](Channel& channel) {
      if (channel.heard > oldest && !channel.readings.empty()) return;
      channel.readings.clear();
      requireWatched();
      exchange(*lines_.read, lines_.reply, channel);
    });
  }

  void overhear() {
    if (listen(0)) return;
    const Channel& all = channels_.front();
    if (!all.readings.empty() || steadyNow() < all.heard + profile_.timeout) return;
    if (!port_.unfinished().empty()) {
      throw BadReply(device_ + " has not completed a line for " + milliseconds(profile_.timeout) +
                     ": \"" + basics::quoted(port_.unfinished()) + "\"");
    }
    throw LinkError(device_ + " has sent no reading for " + milliseconds(profile_.timeout) +
                    "; check its power and the profile " + profile_.name);
  }

  SerialProfile profile_;
  SerialLines lines_;
  std::string device_;
  int count_;                      // channels
  std::vector<Channel> channels_;  // a single one if one line serves all channels
  std::optional<double> supply_;   // not yet returned by read() [Pa]
  SerialPort port_;
  double last_line_ = 0;  // when it was sent [s]
  bool lapsed_ = false;   // the device's watchdog may have expired since it vented
};

}  // namespace

DeviceFacts SerialConfig::facts() const {
  DeviceFacts facts{kKind, profile.name, device};
  facts.channel_word = "addresses";
  facts.channels = addresses;
  facts.closes_valves = !profile.close.empty();
  facts.most_channels = profile.channels;
  facts.highest_pressure = profile.highestPressure();
  facts.watchdog = profile.watchdog;
  return facts;
}

std::unique_ptr<Driver> SerialConfig::makeDriver(int channels) const {
  return std::make_unique<AsciiSerialDriver>(*this, channels);
}

}  // namespace helix_arm::regulator
