#include "helix_arm/procedures/series_record.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::procedures {
namespace {

// Bounds if stamps hardly advance.
constexpr std::size_t kMostWaitingReadings = 1 << 13;
constexpr std::size_t kMostWaitingTips = 1 << 8;

}  // namespace

SeriesRecord::SeriesRecord(int actuators) : actuators_(actuators) {
  basics::requireValue(actuators >= 1, "a series", "number of actuators", actuators,
                       "at least one");
  const std::size_t columns = static_cast<std::size_t>(actuators) + kTipSeriesColumns;
  most_rows_ = std::min(kMostRows, kMostCells / columns);
}

void SeriesRecord::startTrial() {
  advance(std::numeric_limits<double>::infinity());
  readings_.clear();
  waiting_.clear();
  last_row_.reset();
  last_tip_.reset();
  starts_anew_ = true;
}

void SeriesRecord::measured(double time, const Eigen::VectorXd& pressure) {
  basics::require(pressure.size() == actuators_, pressure.size(), " pressures for ", actuators_,
                  " actuators; expected one each");
  if (!pressure.allFinite()) return;
  if (!readings_.empty()) {
    const double step = time - readings_.back().time;
    if (step < 0 || step > kGap) startTrial();
    if (step == 0) readings_.pop_back();
  }
  readings_.push_back({time, pressure});
  if (readings_.size() > kMostWaitingReadings) readings_.pop_front();
  // Tips come in their order: none before the last one is still to come.
  const double known = std::max(time - kLatency, last_tip_.value_or(time - kLatency));
  advance(std::min(known, time - kHalfWindow));
}

void SeriesRecord::seen(double time, const Eigen::Vector3d& tip) {
  const bool late = (last_tip_ && time <= *last_tip_) || (last_row_ && time <= *last_row_);
  if (late || !tip.allFinite()) return;
  last_tip_ = time;
  waiting_.push_back({time, tip});
  if (waiting_.size() > kMostWaitingTips) waiting_.pop_front();
  if (!readings_.empty()) advance(std::min(time, readings_.back().time - kHalfWindow));
}

// Adds the rows up to a time.
void SeriesRecord::advance(double until) {
  if (readings_.empty()) return;
  const double end = std::min(until, readings_.back().time);
  for (;;) {
    const double fill = last_row_ ? *last_row_ + kSpacing : readings_.front().time;
    const bool at_tip = !waiting_.empty() && waiting_.front().time <= fill;
    const double next = at_tip ? waiting_.front().time : fill;
    if (next > end) break;
    addRow(next, at_tip ? std::optional(waiting_.front().position) : std::nullopt);
    if (at_tip) waiting_.pop_front();
  }
  const double oldest = last_row_.value_or(-std::numeric_limits<double>::infinity()) - kHalfWindow;
  while (readings_.size() > 1 && readings_.front().time < oldest) readings_.pop_front();
}

void SeriesRecord::addRow(double time, const std::optional<Eigen::Vector3d>& tip) {
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(actuators_);
  int count = 0;
  for (const Reading& reading : readings_) {
    if (std::abs(reading.time - time) > kHalfWindow) continue;
    sum += reading.pressure;
    ++count;
  }
  if (!last_row_ && count == 0) return;
  last_row_ = time;
  if (count == 0) return;
  if (times_.size() >= most_rows_) {
    ++left_out_;
    return;
  }
  times_.push_back(time);
  starts_.push_back(starts_anew_);
  starts_anew_ = false;
  for (const double pressure : sum) pressures_.push_back(pressure / count);
  for (int i = 0; i < 3; ++i) {
    positions_.push_back(tip ? (*tip)[i] : std::numeric_limits<double>::quiet_NaN());
  }
  tip_rows_ += tip.has_value();
}

ResponseSeries SeriesRecord::series() const {
  SeriesRecord all = *this;
  all.advance(std::numeric_limits<double>::infinity());
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto rows = static_cast<Eigen::Index>(all.times_.size());
  return {
      {Eigen::Map<const Rows>(all.pressures_.data(), rows, actuators_), all.times_, all.starts_},
      Eigen::Map<const Rows>(all.positions_.data(), rows, 3)};
}

}  // namespace helix_arm::procedures
