#pragma once

#include <atomic>
#include <cstdint>
#include <exception>
#include <limits>
#include <memory>
#include <string>
#include <thread>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/control/valve_orders.hpp"
#include "helix_arm/regulator/driver.hpp"
#include "helix_arm/regulator/mailbox.hpp"

namespace helix_arm::regulator {

/// Seconds of the steady clock that all times of the pressure path are of.
double steadyNow();

/// How a driver is run.
struct IoRules {
  double period =
      0.01;  ///< readings are at least so far apart, > 0 [s]; orders are written at once
  double order_timeout = 0.5;     ///< without orders for so long it vents by itself, > 0 [s]
  double first_back_off = 0.05;   ///< before the link is tried again, > 0 [s]; doubles each time
  double longest_back_off = 1.0;  ///< >= first_back_off [s]
  int most_bad_replies = 5;       ///< in a row, >= 1, until the link counts as no good
  double vented_below = 1.5e4;    ///< at the end: a reading within this is no pressure, > 0 [Pa]
  double vent_time = 3.0;         ///< and is waited for so long, >= 0 [s]
  int realtime_priority = 0;      ///< of its thread, as scheduleRealtime() where that is allowed

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// How the I/O has gone.
struct IoStatus {
  bool up = false;           ///< the link
  std::uint64_t writes = 0;  ///< orders that the device took
  std::uint64_t reads = 0;   ///< readings that it gave
  std::uint64_t bad_replies = 0;
  std::uint64_t connections = 0;                                      ///< that came about
  std::uint64_t breaks = 0;                                           ///< as breaks()
  std::uint64_t own_vents = 0;                                        ///< for want of orders
  std::string last_error;                                             ///< empty: none
  double last_error_time = -std::numeric_limits<double>::infinity();  ///< of steadyNow() [s]
  double last_read_time = -std::numeric_limits<double>::infinity();   ///< of steadyNow() [s]
};

/// What was read, and when.
struct Reading {
  explicit Reading(int channels) : pressures(channels) {}

  Pressures pressures;
  double time = 0;  ///< of steadyNow(), when the device was asked [s]
};

/// Runs a driver in a thread of its own: connects, and connects again after a growing pause; writes
/// orders as they come, reads, and vents by itself when no orders come.
///
/// Whoever gives orders is never held up: a device that hangs is seen by its readings growing old.
class RegulatorIo {
 public:
  /// @throws std::invalid_argument when a rule is broken, there is no driver, or its device would
  /// vent by itself between two lines.
  RegulatorIo(std::unique_ptr<Driver> driver, int channels, const IoRules& rules);
  /// As end().
  ~RegulatorIo();
  RegulatorIo(const RegulatorIo&) = delete;
  RegulatorIo& operator=(const RegulatorIo&) = delete;

  /// To be written as soon as the line is free, the newest alone. Of one thread; neither waits nor
  /// allocates.
  ///
  /// @param breaks  that the orders know of: those from before the last one are not written.
  void order(const control::ValveOrders& orders, std::uint64_t breaks);
  /// The newest reading since the last call; false when none has come. As order().
  bool take(Reading& reading);

  bool up() const { return up_; }  ///< the link
  /// How often the device has been vented behind the back of whoever gives orders: the link
  /// dropped, or orders did not come.
  std::uint64_t breaks() const { return breaks_; }
  /// Waits for no device.
  IoStatus status() const;

  /// Vents, where the device can be reached, waits until no pressure stands, since some devices
  /// keep their air once the link is gone, closes the link, and does nothing from then on.
  /// @return whether the device has read so, or nothing was ever ordered of it for want of a link.
  bool end();

 private:
  struct Order {
    control::ValveOrders valves;
    std::uint64_t breaks;
  };
  static constexpr double kNever = -std::numeric_limits<double>::infinity();

  void run();
  void connect();
  void exchange();
  void disconnect(const std::exception& error);
  void ventUnheard();
  bool empties();
  void note(const std::exception& error);
  bool pause(double seconds);      ///< false when it is to stop
  bool awaitOrder();               ///< false when there is none yet
  void awaitWake(double longest);  ///< an order or the end, for so long at most [s]

  const std::unique_ptr<Driver> driver_;
  const IoRules rules_;
  Mailbox<Order> orders_;
  Mailbox<Reading> readings_;
  const int wake_;  ///< event counter of orders, and of the end

  std::atomic<bool> stop_{false};
  std::atomic<bool> up_{false};
  std::atomic<bool> vented_at_end_{false};
  std::atomic<std::uint64_t> writes_{0}, reads_{0}, bad_replies_{0}, connections_{0}, breaks_{0},
      own_vents_{0};
  std::atomic<double> last_read_time_{kNever};
  mutable basics::Mutex error_mutex_;
  std::string last_error_ HELIX_ARM_GUARDED_BY(error_mutex_);
  double last_error_time_ HELIX_ARM_GUARDED_BY(error_mutex_) = kNever;

  // Of the thread alone.
  double back_off_;
  double last_order_ = kNever;  ///< when the last one came [s]
  double last_read_ = kNever;
  int bad_in_a_row_ = 0;
  bool vented_by_itself_ = true;

  std::thread thread_;
};

}  // namespace helix_arm::regulator
