#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace helix_arm::test {

/// Counts of times between a microsecond and a hundred seconds, to 2 %: of fixed size, however many
/// they are.
class LatencyHistogram {
 public:
  void add(double seconds) {
    const double bin = std::log(std::max(seconds, kLeast) / kLeast) / std::log(kStep);
    ++counts_[std::min(static_cast<std::size_t>(bin), counts_.size() - 1)];
    ++total_;
    most_ = std::max(most_, seconds);
  }
  void add(const LatencyHistogram& other) {
    for (std::size_t i = 0; i < counts_.size(); ++i) counts_[i] += other.counts_[i];
    total_ += other.total_;
    most_ = std::max(most_, other.most_);
  }

  std::uint64_t total() const { return total_; }
  double most() const { return most_; }  ///< [s]
  /// The time that a share of them does not exceed; 0 where there are none [s].
  double quantile(double share) const {
    std::uint64_t left = static_cast<std::uint64_t>(std::ceil(share * static_cast<double>(total_)));
    for (std::size_t i = 0; i < counts_.size(); ++i) {
      if (counts_[i] >= left && total_ > 0) {
        return std::min(most_, kLeast * std::pow(kStep, static_cast<double>(i + 1)));
      }
      left -= counts_[i];
    }
    return most_;
  }

 private:
  static constexpr double kLeast = 1e-6, kStep = 1.02;

  std::array<std::uint64_t, 931> counts_{};
  std::uint64_t total_ = 0;
  double most_ = 0;
};

}  // namespace helix_arm::test
