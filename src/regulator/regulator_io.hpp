#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <exception>
#include <limits>
#include <memory>
#include <string>
#include <thread>

#include "basics/mutex.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/regulator/driver.hpp"

namespace helix_arm::regulator {

/// Passes the newest value from one thread to another. Neither waits for the other. Values that are
/// not fetched in time are lost.
template <class T>
class Mailbox {
 public:
  /// @param blank  gives all values their size; it is never fetched.
  explicit Mailbox(const T& blank) : values_{blank, blank, blank} {}

  /// For the sender: the value to post next.
  T& draft() { return values_[draft_]; }
  /// Posts the draft. The next draft holds an old value.
  void post() {
    draft_ = static_cast<std::uint8_t>(
        middle_.exchange(static_cast<std::uint8_t>(draft_ | kNew), std::memory_order_acq_rel) &
        kIndex);
  }

  /// For the receiver: takes the newest value posted since the last call. @return false if there is
  /// none.
  bool fetch() {
    if ((middle_.load(std::memory_order_relaxed) & kNew) == 0) return false;
    held_ = static_cast<std::uint8_t>(middle_.exchange(held_, std::memory_order_acq_rel) & kIndex);
    return true;
  }
  /// The last fetched value.
  const T& held() const { return values_[held_]; }

 private:
  static constexpr std::uint8_t kIndex = 3;
  static constexpr std::uint8_t kNew = 4;
  static_assert(std::atomic<std::uint8_t>::is_always_lock_free, "nobody waits");

  std::array<T, 3> values_;
  std::uint8_t draft_ = 0;               ///< index of the sender's value
  std::atomic<std::uint8_t> middle_{1};  ///< index of the value in between, and whether it is new
  std::uint8_t held_ = 2;                ///< index of the receiver's value
};

/// The steady clock of all times of the pressure path [s].
double steadyNow();

/// Rules for running a driver.
struct IoRules {
  double period = 0.01;  ///< minimum time between readings, > 0 [s]; orders are written immediately
  double order_timeout = 0.5;     ///< time without orders after which it vents, > 0 [s]
  double first_back_off = 0.05;   ///< first delay before reconnecting, > 0 [s]; doubles each time
  double longest_back_off = 1.0;  ///< longest delay before reconnecting, >= first_back_off [s]
  /// Number of bad replies in a row after which the link counts as lost, >= 1.
  int most_bad_replies = 5;
  double vented_below = 1.5e4;  ///< at the end, a reading within this counts as vented, > 0 [Pa]
  double vent_time = 3.0;       ///< longest wait for that, >= 0 [s]
  int realtime_priority = 0;    ///< of its thread, as for scheduleRealtime(), if allowed

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// State and counts of the I/O.
struct IoStatus {
  bool up = false;           ///< the link
  std::uint64_t writes = 0;  ///< orders that the device accepted
  std::uint64_t reads = 0;   ///< readings received
  std::uint64_t bad_replies = 0;
  std::uint64_t connections = 0;                                      ///< successful connections
  std::uint64_t breaks = 0;                                           ///< as breaks()
  std::uint64_t own_vents = 0;                                        ///< vents for lack of orders
  std::string last_error;                                             ///< empty: none
  double last_error_time = -std::numeric_limits<double>::infinity();  ///< of steadyNow() [s]
  double last_read_time = -std::numeric_limits<double>::infinity();   ///< of steadyNow() [s]
};

/// A reading and its time.
struct Reading {
  explicit Reading(int channels) : pressures(channels) {}

  Pressures pressures;
  double time = 0;  ///< time of the request to the device, as steadyNow() [s]
};

/// Runs a driver in its own thread: connects, reconnects after increasing delays, writes orders as
/// they come, reads, and vents by itself if no orders come.
///
/// Never blocks its caller: a device that hangs is noticed by the age of its readings.
class RegulatorIo {
 public:
  /// @throws std::invalid_argument if a rule is broken, the driver is null, or its device would
  /// vent by itself between two lines.
  RegulatorIo(std::unique_ptr<Driver> driver, int channels, const IoRules& rules);
  /// As end().
  ~RegulatorIo();
  RegulatorIo(const RegulatorIo&) = delete;
  RegulatorIo& operator=(const RegulatorIo&) = delete;

  /// Queues orders to be written as soon as the line is free; only the newest are kept. For one
  /// thread; neither waits nor allocates.
  ///
  /// @param breaks  value of breaks() on which the orders are based; orders from before the last
  /// break are not written.
  void order(const control::ValveOrders& orders, std::uint64_t breaks);
  /// Takes the newest reading since the last call. @return false if there is none. For one thread;
  /// neither waits nor allocates.
  bool take(Reading& reading);

  bool up() const { return up_; }  ///< the link
  /// Number of times the device vented without an order: the link dropped, or orders did not come.
  std::uint64_t breaks() const { return breaks_; }
  /// Does not wait for the device.
  IoStatus status() const;

  /// Vents if the device can be reached, waits until no pressure remains (some devices keep their
  /// air once the link is closed), closes the link, and does nothing from then on.
  /// @return whether the readings confirm that it is vented, or no order ever reached the device
  /// for lack of a link.
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
  bool pause(double seconds);      ///< false if it is to stop
  bool awaitOrder();               ///< false if there is none yet
  void awaitWake(double longest);  ///< waits for an order or the end, at most this long [s]

  const std::unique_ptr<Driver> driver_;
  const IoRules rules_;
  Mailbox<Order> orders_;
  Mailbox<Reading> readings_;
  const int wake_;  ///< event counter for orders and the end

  std::atomic<bool> stop_{false};
  std::atomic<bool> up_{false};
  std::atomic<bool> vented_at_end_{false};
  std::atomic<std::uint64_t> writes_{0}, reads_{0}, bad_replies_{0}, connections_{0}, breaks_{0},
      own_vents_{0};
  std::atomic<double> last_read_time_{kNever};
  mutable basics::Mutex error_mutex_;
  std::string last_error_ HELIX_ARM_GUARDED_BY(error_mutex_);
  double last_error_time_ HELIX_ARM_GUARDED_BY(error_mutex_) = kNever;

  // Used only by the thread.
  double back_off_;
  double last_order_ = kNever;  ///< time of the last order [s]
  double last_read_ = kNever;
  int bad_in_a_row_ = 0;
  bool vented_by_itself_ = true;

  std::thread thread_;
};

}  // namespace helix_arm::regulator
