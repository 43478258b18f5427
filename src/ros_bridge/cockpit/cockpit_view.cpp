#include "cockpit_view.hpp"

#include <algorithm>
#include <cmath>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kHighest = 1e12;  // a value beyond it does not scale the axis

double topOf(double largest, double least) {
  double top = least;
  for (int k = 0; top < largest && top < kHighest; ++k) top *= k % 3 == 1 ? 2.5 : 2.0;
  return top;
}

}  // namespace

StripHistory::StripHistory(double span, double period) : span_(span), period_(period) {
  basics::require(std::isfinite(span) && span > 0, "span is ", span, "; expected > 0 s");
  basics::require(std::isfinite(period) && period >= 0, "period is ", period, "; expected >= 0 s");
}

void StripHistory::add(double time, const std::vector<double>& pressures, double tip_error) {
  if (!std::isfinite(time)) return;
  if (!rows_.empty()) {
    const Row& last = rows_.back();
    if (time < last.time || last.pressures.size() != pressures.size()) {
      rows_.clear();
    } else if (time - last.time < period_) {
      return;
    }
  }
  rows_.push_back({time, pressures, tip_error});
  while (rows_.front().time < time - span_) rows_.pop_front();
}

double StripHistory::pressureTop(double least) const {
  double largest = 0;
  for (const Row& row : rows_) {
    for (const double pressure : row.pressures) {
      if (std::isfinite(pressure)) largest = std::max(largest, pressure);
    }
  }
  return topOf(largest, least);
}

double StripHistory::errorTop(double least) const {
  double largest = 0;
  for (const Row& row : rows_) {
    if (std::isfinite(row.tip_error)) largest = std::max(largest, row.tip_error);
  }
  return topOf(largest, least);
}

}  // namespace helix_arm::ros_bridge
