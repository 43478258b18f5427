#pragma once

#include <array>
#include <atomic>
#include <cstdint>

namespace helix_arm::regulator {

/// Hands the newest value from one thread to another; neither ever waits for the other, and what
/// was not fetched in time is lost.
template <class T>
class Mailbox {
 public:
  /// @param blank  what all values are as large as; it is never fetched.
  explicit Mailbox(const T& blank) : values_{blank, blank, blank} {}

  /// The sender's: what it posts next.
  T& draft() { return values_[draft_]; }
  /// Posts the draft; the next one holds something old.
  void post() {
    draft_ = static_cast<std::uint8_t>(
        middle_.exchange(static_cast<std::uint8_t>(draft_ | kNew), std::memory_order_acq_rel) &
        kIndex);
  }

  /// The receiver's: takes the newest value that was posted since the last call, if there is one.
  bool fetch() {
    if ((middle_.load(std::memory_order_relaxed) & kNew) == 0) return false;
    held_ = static_cast<std::uint8_t>(middle_.exchange(held_, std::memory_order_acq_rel) & kIndex);
    return true;
  }
  /// The value that was fetched last.
  const T& held() const { return values_[held_]; }

 private:
  static constexpr std::uint8_t kIndex = 3;
  static constexpr std::uint8_t kNew = 4;
  static_assert(std::atomic<std::uint8_t>::is_always_lock_free, "nobody waits");

  std::array<T, 3> values_;
  std::uint8_t draft_ = 0;               ///< of the sender
  std::atomic<std::uint8_t> middle_{1};  ///< index and whether it is new
  std::uint8_t held_ = 2;                ///< of the receiver
};

}  // namespace helix_arm::regulator
