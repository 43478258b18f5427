#include "regulator_io.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <system_error>
#include <utility>

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "helix_arm/basics/requirement.hpp"
#include "realtime.hpp"

namespace helix_arm::regulator {
namespace {

int openCounter() {
  const int counter = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  if (counter < 0) throw std::system_error(errno, std::generic_category(), "eventfd");
  return counter;
}

constexpr double kLinesAWatchdog = 4;  // at least, for a device with a watchdog

std::unique_ptr<Driver> requireDriver(std::unique_ptr<Driver> driver) {
  basics::require(driver != nullptr, "regulator I/O without a driver; expected one");
  return driver;
}

const IoRules& valid(const IoRules& rules, const Driver& driver) {
  rules.validate();
  const double longest = driver.watchdog() / kLinesAWatchdog;
  basics::require(rules.period <= longest, "the regulator vents by itself when no line comes for ",
                  driver.watchdog(), " s (watchdog_s of its profile), and one would come every ",
                  rules.period, " s; expected at most ", longest,
                  " s: raise the rate of the loop or, where the device waits longer, watchdog_s");
  return rules;
}

}  // namespace

double steadyNow() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

void IoRules::validate() const {
  constexpr char kCulprit[] = "regulator I/O";
  basics::requirePositive(kCulprit, {{"the period [s]", period},
                                     {"the timeout of orders [s]", order_timeout},
                                     {"the first back-off [s]", first_back_off}});
  basics::requireValue(std::isfinite(longest_back_off) && longest_back_off >= first_back_off,
                       kCulprit, "the longest back-off [s]", longest_back_off,
                       "at least the first");
  basics::requireValue(most_bad_replies >= 1, kCulprit, "the number of bad replies",
                       most_bad_replies, "at least 1");
  basics::requirePositive(kCulprit, "the pressure that is none [Pa]", vented_below);
  basics::requireNotNegative(kCulprit, "the time to vent [s]", vent_time);
}

RegulatorIo::RegulatorIo(std::unique_ptr<Driver> driver, int channels, const IoRules& rules)
    : driver_(requireDriver(std::move(driver))),
      rules_(valid(rules, *driver_)),
      orders_({control::ValveOrders(channels), 0}),
      readings_(Reading(channels)),
      wake_(openCounter()),
      back_off_(rules.first_back_off),
      thread_([this] { run(); }) {}

RegulatorIo::~RegulatorIo() {
  end();
  ::close(wake_);
}

bool RegulatorIo::end() {
  stop_ = true;
  eventfd_write(wake_, 1);
  if (thread_.joinable()) thread_.join();
  return vented_at_end_;
}

void RegulatorIo::order(const control::ValveOrders& orders, std::uint64_t breaks) {
  orders_.draft().valves = orders;
  orders_.draft().breaks = breaks;
  orders_.post();
  eventfd_write(wake_, 1);  // fails only after 2^64 unread orders
}

bool RegulatorIo::take(Reading& reading) {
  if (!readings_.fetch()) return false;
  reading = readings_.held();
  return true;
}

IoStatus RegulatorIo::status() const {
  const basics::MutexLock lock(error_mutex_);
  return {up_,     writes_,    reads_,      bad_replies_,     connections_,
          breaks_, own_vents_, last_error_, last_error_time_, last_read_time_};
}

void RegulatorIo::run() {
  scheduleRealtime(rules_.realtime_priority);
  while (!stop_) {
    if (!up_) {
      connect();
      continue;
    }
    try {
      exchange();
      bad_in_a_row_ = 0;
    } catch (const BadReply& error) {
      ++bad_replies_;
      if (++bad_in_a_row_ >= rules_.most_bad_replies) {
        disconnect(error);
      } else {
        note(error);
      }
    } catch (const std::exception& error) {
      disconnect(error);
    }
  }
  if (up_) {
    try {
      driver_->vent();
      vented_at_end_ = empties();
    } catch (const std::exception& error) {
      disconnect(error);
    }
  }
  if (connections_ == 0) vented_at_end_ = true;
  up_ = false;
  driver_->close();
}

void RegulatorIo::connect() {
  try {
    driver_->connect();
  } catch (const std::exception& error) {
    driver_->close();
    note(error);
    if (pause(back_off_)) back_off_ = std::min(2 * back_off_, rules_.longest_back_off);
    return;
  }
  back_off_ = rules_.first_back_off;
  bad_in_a_row_ = 0;
  vented_by_itself_ = true;
  last_read_ = kNever;
  ++connections_;
  up_ = true;
}

void RegulatorIo::disconnect(const std::exception& error) {
  ventUnheard();
  note(error);
  ++breaks_;
  up_ = false;
  // The order is repeated until the device must be empty or the link is lost.
  const double end = steadyNow() + rules_.vent_time;
  while (driver_->keepsAirOnClose() && steadyNow() < end && pause(rules_.first_back_off)) {
    ventUnheard();
  }
  driver_->close();
}

void RegulatorIo::ventUnheard() {
  try {
    driver_->vent();
  } catch (const std::exception&) {
    // The device may receive orders even if its answers are lost.
  }
}

void RegulatorIo::note(const std::exception& error) {
  const basics::MutexLock lock(error_mutex_);
  last_error_ = error.what();
  last_error_time_ = steadyNow();
}

bool RegulatorIo::empties() {
  const double end = steadyNow() + rules_.vent_time;
  Eigen::VectorXd newest = readings_.draft().pressures.pressure;
  newest.setConstant(std::numeric_limits<double>::quiet_NaN());
  for (;;) {
    Pressures& pressures = readings_.draft().pressures;
    pressures.pressure.setConstant(std::numeric_limits<double>::quiet_NaN());
    try {
      driver_->read(pressures);
    } catch (const BadReply& error) {
      note(error);
    }
    newest = pressures.pressure.array().isFinite().select(pressures.pressure, newest);
    if ((newest.array().abs() <= rules_.vented_below).all()) return true;
    if (steadyNow() >= end) return false;
    awaitWake(rules_.period);
  }
}

void RegulatorIo::exchange() {
  if (awaitOrder()) {
    last_order_ = steadyNow();
    vented_by_itself_ = false;
    driver_->write(orders_.held().valves);
    ++writes_;
  } else if (!vented_by_itself_ && steadyNow() - last_order_ >= rules_.order_timeout) {
    driver_->vent();
    vented_by_itself_ = true;
    ++own_vents_;
    ++breaks_;
  }
  const double now = steadyNow();
  if (now - last_read_ < rules_.period) return;
  last_read_ = now;
  Reading& reading = readings_.draft();
  reading.time = now;
  reading.pressures.pressure.setConstant(std::numeric_limits<double>::quiet_NaN());
  try {
    driver_->read(reading.pressures);
  } catch (const BadReply&) {
    readings_.post();  // the readings of other channels are valid
    throw;
  }
  readings_.post();
  last_read_time_ = now;
  ++reads_;
}

bool RegulatorIo::awaitOrder() {
  const double now = steadyNow();
  double until = last_read_ + rules_.period;
  if (!vented_by_itself_) until = std::min(until, last_order_ + rules_.order_timeout);
  awaitWake(std::clamp(until - now, 0.0, rules_.order_timeout));
  return orders_.fetch() && orders_.held().breaks == breaks_;
}

bool RegulatorIo::pause(double seconds) {
  const double end = steadyNow() + seconds;
  while (!stop_) {
    const double left = end - steadyNow();
    if (left <= 0) return true;
    awaitWake(left);
  }
  return false;
}

void RegulatorIo::awaitWake(double longest) {
  const auto nanoseconds = static_cast<long>(1e9 * longest);
  const timespec timeout{nanoseconds / 1000000000, nanoseconds % 1000000000};
  pollfd waited{wake_, POLLIN, 0};
  ppoll(&waited, 1, &timeout, nullptr);
  eventfd_t count = 0;
  eventfd_read(wake_, &count);
}

}  // namespace helix_arm::regulator
