#pragma once

#include <cstddef>
#include <deque>
#include <vector>

namespace helix_arm::ros_bridge {

/// The last seconds of some values, for a strip chart. NaN where a value was unknown.
class StripHistory {
 public:
  struct Row {
    double time;                    ///< [s]
    std::vector<double> pressures;  ///< gauge [Pa]
    double tip_error;               ///< [m]
  };

  /// @param span    time that is kept, > 0 [s].
  /// @param period  rows that come sooner after the last one are left out, >= 0 [s].
  /// @throws std::invalid_argument naming the value and its rule.
  StripHistory(double span, double period);

  /// A time before the last one, or another number of pressures, begins anew.
  void add(double time, const std::vector<double>& pressures, double tip_error);
  void clear() { rows_.clear(); }

  const std::deque<Row>& rows() const { return rows_; }
  double span() const { return span_; }
  double newest() const { return rows_.empty() ? 0.0 : rows_.back().time; }
  /// Upper end of the axes: the smallest of 1, 2, 5, 10, 20, .. times `least` that holds all
  /// values.
  double pressureTop(double least) const;
  double errorTop(double least) const;

 private:
  double span_, period_;
  std::deque<Row> rows_;
};

}  // namespace helix_arm::ros_bridge
