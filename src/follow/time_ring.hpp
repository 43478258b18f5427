#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

namespace helix_arm::follow {

/// Values by ascending time; the oldest of too many are forgotten. Does not allocate.
template <class Value, int kMost>
class TimeRing {
 public:
  void clear() { count_ = 0; }
  /// @param time  not before the last one, or everything earlier is forgotten.
  void add(double time, const Value& value) {
    if (count_ > 0 && time < at(0).time) clear();
    newest_ = (newest_ + 1) % kMost;
    Entry& entry = entries_[static_cast<std::size_t>(newest_)];
    entry.time = time;
    entry.value = value;
    if (count_ < kMost) ++count_;
  }
  /// The last value at or before a time; null if all are later. Valid until the next change.
  const Value* find(double time) const {
    for (int age = 0; age < count_; ++age) {
      if (at(age).time <= time) return &at(age).value;
    }
    return nullptr;
  }
  /// The same as a copy.
  std::optional<Value> before(double time) const {
    const Value* const found = find(time);
    return found != nullptr ? std::optional<Value>(*found) : std::nullopt;
  }

 private:
  struct Entry {
    double time;
    Value value;
  };
  const Entry& at(int age) const {
    return entries_[static_cast<std::size_t>((newest_ - age + kMost) % kMost)];
  }

  std::array<Entry, kMost> entries_ = {};
  int newest_ = -1;
  int count_ = 0;
};

}  // namespace helix_arm::follow
