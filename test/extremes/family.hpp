#pragma once

#include <cstdio>
#include <string>
#include <utility>

#include <gtest/gtest.h>

namespace helix_arm::test {

/// One row of the table of extremes: many cases of one kind, of which the worst is printed.
class Family {
 public:
  /// @param bound  of the error, in the unit that it names.
  Family(std::string range, double bound, std::string unit)
      : range_(std::move(range)), bound_(bound), unit_(std::move(unit)) {}
  Family(const Family&) = delete;
  Family& operator=(const Family&) = delete;
  /// Prints the line. A family without a case proves nothing.
  ~Family() {
    std::printf("%-52s %6d cases   worst %8.2g of %8.2g %-22s %s\n", range_.c_str(), cases_, worst_,
                bound_, unit_.c_str(), place_.c_str());
    EXPECT_GT(cases_, 0) << range_;
  }

  /// @param place  names the case.
  void add(double error, const std::string& place) {
    ++cases_;
    EXPECT_LE(error, bound_) << range_ << ": " << place;
    if (error > worst_ || !(error == error)) {
      worst_ = error;
      place_ = place;
    }
  }
  int cases() const { return cases_; }

 private:
  std::string range_;
  double bound_;
  std::string unit_;
  int cases_ = 0;
  double worst_ = 0.0;
  std::string place_;
};

/// printf into a string.
template <class... Values>
std::string text(const char* format, Values... values) {
  char out[200];
  std::snprintf(out, sizeof out, format, values...);
  return out;
}

}  // namespace helix_arm::test
