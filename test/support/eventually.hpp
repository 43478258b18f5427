#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <string>
#include <thread>

namespace helix_arm::test {

/// Waits for a condition; false when it does not come to hold within the deadline [s].
template <class Condition>
bool eventually(const Condition& condition, double deadline = 20.0) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(deadline);
  while (!condition()) {
    if (std::chrono::steady_clock::now() >= end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

/// How late the turns of a thread end that sleeps most of the time and works a little in each turn.
///
/// A thread that only sleeps is woken in time on any machine, so that its lateness tells nothing.
struct Turns {
  static constexpr double kWork = 0.005;  ///< of the processor, in a turn [s]
  static constexpr double kLate =
      0.045;  ///< that its work takes too long, at a tenth of a processor [s]
  static constexpr double kOften = 0.1;  ///< share of late turns on a machine that starves
  static constexpr double kTooLate = 1;  ///< of a single turn on such a machine [s]

  int count = 0, late = 0;
  double latest = 0;  ///< [s]

  void add(double lateness) {
    ++count;
    late += lateness > kLate ? 1 : 0;
    latest = std::max(latest, lateness);
  }
  /// Says that the machine starved; empty if it did not.
  std::string verdict() const {
    if (latest <= kTooLate && late <= kOften * count) return "";
    char text[200];
    std::snprintf(
        text, sizeof text,
        "the machine starved: a thread of the test came %.2f s late at most, and more than "
        "%.3f s late in %d %% of its %d turns; repeat the test alone before you search for "
        "a defect",
        latest, kLate, 100 * late / count, count);
    return text;
  }
};

/// Counts such turns in a thread of its own, for as long as it exists.
class StarvationWatch {
 public:
  StarvationWatch() : thread_([this] { run(); }) {}
  ~StarvationWatch() { turns(); }
  StarvationWatch(const StarvationWatch&) = delete;
  StarvationWatch& operator=(const StarvationWatch&) = delete;

  /// Ends the count.
  Turns turns() {
    ended_ = true;
    if (thread_.joinable()) thread_.join();
    return turns_;
  }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kSleep{100};

  static double seconds(Clock::duration duration) {
    return std::chrono::duration<double>(duration).count();
  }
  static double processorTime() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  }
  void run() {
    do {
      const Clock::time_point begin = Clock::now();
      std::this_thread::sleep_for(kSleep);
      const double end = processorTime() + Turns::kWork;
      while (processorTime() < end) {
      }
      turns_.add(seconds(Clock::now() - begin - kSleep) - Turns::kWork);
    } while (!ended_);
  }

  Turns turns_;  // of the thread, until it has ended
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

}  // namespace helix_arm::test
