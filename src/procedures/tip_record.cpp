#include "helix_arm/procedures/tip_record.hpp"

#include <algorithm>
#include <cmath>
#include <ostream>

#include "helix_arm/io/number.hpp"

namespace helix_arm::procedures {
namespace {

constexpr double kLongestHold = 1.0;  // of a command that is not repeated [s]

void writePosition(const std::optional<Eigen::Vector3d>& position, std::ostream& out) {
  for (int i = 0; i < 3; ++i) out << "," << (position ? io::formatNumber((*position)[i]) : "");
}

void writePressures(const std::optional<Eigen::VectorXd>& pressures, int actuators,
                    std::ostream& out) {
  const bool known = pressures && pressures->size() == actuators;
  for (int i = 0; i < actuators; ++i)
    out << "," << (known ? io::formatNumber((*pressures)[i]) : "");
}

}  // namespace

void TimeSeries::add(double time, const Eigen::VectorXd& value) {
  if (!values_.empty() &&
      (time < values_.back().first || value.size() != values_.back().second.size())) {
    values_.clear();
  }
  if (!values_.empty() && time == values_.back().first) values_.pop_back();
  values_.emplace_back(time, value);
  if (values_.size() > kMost) values_.pop_front();
}

std::optional<Eigen::VectorXd> TimeSeries::between(double time) const {
  const auto after = std::lower_bound(values_.begin(), values_.end(), time,
                                      [](const auto& entry, double t) { return entry.first < t; });
  if (after == values_.end()) {
    const bool holds = !values_.empty() && time - values_.back().first <= kAhead;
    return holds ? std::optional(values_.back().second) : std::nullopt;
  }
  if (after->first == time) return after->second;
  if (after == values_.begin()) return std::nullopt;
  const auto before = after - 1;
  const double gap = after->first - before->first;
  if (gap > kReach) return std::nullopt;
  const double part = (time - before->first) / gap;
  return Eigen::VectorXd((1 - part) * before->second + part * after->second);
}

std::optional<Eigen::VectorXd> TimeSeries::inForce(double time) const {
  const auto after = std::upper_bound(values_.begin(), values_.end(), time,
                                      [](double t, const auto& entry) { return t < entry.first; });
  if (after == values_.begin() || time - (after - 1)->first > kLongestHold) return std::nullopt;
  return (after - 1)->second;
}

void TipRecord::add(TipRow row) {
  if (rows_.size() + waiting_.size() >= kMostRows) {
    ++left_out_;
    return;
  }
  waiting_.push_back(std::move(row));
  if (waiting_.size() > kMostWaiting) take();
  update();
}

void TipRecord::update() {
  const auto isDue = [this](double time) {
    return model.covers(time) && command.covers(time) && pressure.covers(time);
  };
  while (!waiting_.empty() && isDue(waiting_.front().stamp)) take();
}

// The first one that waits, with what has come.
void TipRecord::take() {
  TipRow row = std::move(waiting_.front());
  waiting_.pop_front();
  if (const auto tip = model.between(row.stamp); tip && tip->size() == 3) {
    row.model = Eigen::Vector3d(*tip);
  }
  row.command = command.inForce(row.stamp);
  row.pressure = pressure.between(row.stamp);
  rows_.push_back(std::move(row));
}

const std::vector<TipRow>& TipRecord::finish() {
  while (!waiting_.empty()) take();
  return rows_;
}

std::optional<Eigen::Vector3d> tipOf(const TipRow& row, RecordedTip tip) {
  switch (tip) {
    case RecordedTip::kModel:
      return row.model;
    case RecordedTip::kPredicted:
      return row.predicted;
    case RecordedTip::kMeasured:
      break;
  }
  return row.measured;
}

std::optional<TipError> errorOf(const std::vector<TipRow>& rows, RecordedTip tip, double end) {
  double sum2 = 0.0, max = 0.0;
  std::size_t count = 0;
  for (const TipRow& row : rows) {
    const auto position = tipOf(row, tip);
    if (!position || row.path_time < 0 || row.path_time > end) continue;
    const double error = (*position - row.wanted).norm();
    sum2 += error * error;
    max = std::max(max, error);
    ++count;
  }
  if (count == 0) return std::nullopt;
  return TipError{std::sqrt(sum2 / static_cast<double>(count)), max};
}

void writeCsv(const std::vector<TipRow>& rows, int actuators, std::ostream& out) {
  out << "time_s,stamp_s";
  for (const char* tip : {"wanted", "model", "predicted", "measured"}) {
    for (const char axis : {'x', 'y', 'z'}) out << "," << tip << "_" << axis << "_m";
  }
  out << ",error_m,predicted_sd_m";
  for (const char* quantity : {"command", "pressure"}) {
    for (int i = 1; i <= actuators; ++i) out << "," << quantity << "_" << i << "_pa";
  }
  out << ",state\n";
  for (const TipRow& row : rows) {
    out << io::formatNumber(row.path_time) << "," << io::formatNumber(row.stamp);
    writePosition(row.wanted, out);
    writePosition(row.model, out);
    writePosition(row.predicted, out);
    writePosition(row.measured, out);
    out << "," << io::formatNumber(row.error()) << "," << io::formatNumber(row.sd);
    writePressures(row.command, actuators, out);
    writePressures(row.pressure, actuators, out);
    out << "," << row.state << "\n";
  }
}

}  // namespace helix_arm::procedures
