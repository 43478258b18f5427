#pragma once

#include <array>
#include <atomic>
#include <cstdint>

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

}  // namespace helix_arm::regulator
