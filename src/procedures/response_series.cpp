#include "response_series.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "io/document/number.hpp"
#include "response/response_fit.hpp"

namespace helix_arm::procedures {
namespace {

// Pieces of the table in place of a quintic.
constexpr int kContinuedPieces = 24;
// A curve that ends closer to a pressure than this reaches it, relative to the pressure.
constexpr double kReached = 1e-6;

Eigen::VectorXd columnOf(const io::DataSet& data, const char* name) {
  const int column = data.find(name);
  if (column < 0) {
    throw io::DocumentError(data.path + " has no column " + name +
                            "; expected one, since the others are a series of readings");
  }
  return data.values.col(column);
}

// Names of every trial of a history: as the file names it, or by its number.
std::vector<std::string> trialNames(const io::DataSet& data, const model::InputHistory& history) {
  const int column = data.find("trial");
  std::vector<std::string> names;
  for (Eigen::Index row = 0; row < history.rows(); ++row) {
    if (!history.starts_anew[static_cast<std::size_t>(row)]) continue;
    const double value = column >= 0 ? data.values(row, column) : 1.0;
    names.push_back(data.trials.empty() ? io::formatNumber(value)
                                        : data.trials[static_cast<std::size_t>(value)]);
  }
  return names;
}

// Rotations of the tip; any where it was not seen.
std::vector<Eigen::Matrix3d> rotationsOf(const io::DataSet& data) {
  const Eigen::VectorXd x = columnOf(data, "qx"), y = columnOf(data, "qy"),
                        z = columnOf(data, "qz"), w = columnOf(data, "qw");
  const int seen = data.find("seen");
  std::vector<Eigen::Matrix3d> out(data.lines.size(), Eigen::Matrix3d::Identity());
  io::FaultList faults(data.path);
  for (Eigen::Index row = 0; row < x.size(); ++row) {
    if (seen >= 0 && data.values(row, seen) == 0) continue;
    const auto k = static_cast<std::size_t>(row);
    out[k] = io::rotationOf({w[row], x[row], y[row], z[row]}, data.lines[k], faults);
  }
  faults.throwIfAny();
  return out;
}

bool hasPressures(const io::DataSet& data) {
  return std::any_of(data.columns.begin(), data.columns.end(),
                     [](const std::string& name) { return name.compare(0, 9, "pressure_") == 0; });
}

}  // namespace

ResponseSeries lengthSeriesOf(const io::DataSet& data) {
  const Eigen::MatrixXd pressure = columnOf(data, "pressure_kpa") * io::pascals(1);
  return {io::historyOf(data, pressure), columnOf(data, "length_m"), {}};
}

ResponseSeries tipSeriesOf(const io::DataSet& data, int actuators) {
  const Eigen::Index rows = data.values.rows();
  model::InputHistory history = hasPressures(data) ? io::historyOf(data, actuators)
                                                   : io::historyOf(data, Eigen::MatrixXd(rows, 0));
  std::vector<std::string> trials = trialNames(data, history);
  ResponseSeries out{std::move(history), Eigen::MatrixXd::Zero(rows, 3), std::move(trials)};
  out.reading.col(0) = columnOf(data, "x_m");
  out.reading.col(1) = columnOf(data, "y_m");
  out.planar = data.find("z_m") < 0;
  if (!out.planar) out.reading.col(2) = columnOf(data, "z_m");
  if (data.find("qx") >= 0) out.rotation = rotationsOf(data);
  const int seen = data.find("seen");
  for (Eigen::Index row = 0; seen >= 0 && row < out.reading.rows(); ++row) {
    if (data.values(row, seen) == 0) {
      out.reading.row(row).setConstant(std::numeric_limits<double>::quiet_NaN());
    }
  }
  return out;
}

estimation::TipSeries ofArm(const ResponseSeries& tips) {
  return {tips.history, tips.reading.leftCols(tips.planar ? 2 : 3), tips.rotation};
}

estimation::SeriesPrior priorOf(const io::Scene& scene) {
  const io::MotionCapture& seen = scene.motion_capture;
  return {scene.model, seen.X_BF.value_or(scene.X_BF), seen.R_TM,
          seen.p_TM.value_or(Eigen::Vector3d::Zero()), seen.beam};
}

std::string tipSeriesCsv(const ResponseSeries& tips, const std::string& comment) {
  const auto rounded = [](double value) { return io::formatNumber(std::round(1e7 * value) / 1e7); };
  const model::InputHistory& history = tips.history;
  std::string text = "# " + comment + "\ntime_s";
  for (Eigen::Index i = 1; i <= history.input.cols(); ++i) {
    text += ",pressure_" + std::to_string(i) + "_kpa";
  }
  text += ",x_m,y_m,z_m,seen,trial\n";
  int trial = 0;
  for (Eigen::Index row = 0; row < history.rows(); ++row) {
    const auto k = static_cast<std::size_t>(row);
    trial += history.starts_anew[k] ? 1 : 0;
    text += rounded(history.time[k]);
    for (const double pressure : history.input.row(row)) {
      text += "," + rounded(io::kilopascals(pressure));
    }
    const bool seen = tips.reading.row(row).allFinite();
    for (const double position : tips.reading.row(row)) text += "," + rounded(seen ? position : 0);
    text += std::string(seen ? ",1," : ",0,") + std::to_string(trial) + "\n";
  }
  return text;
}

void append(const ResponseSeries& more, const std::string& file, ResponseSeries& to) {
  if (to.empty()) {
    to = more;
    return;
  }
  const auto require = [&file](bool same, bool lacks, const std::string& article,
                               const std::string& what, const char* expected) {
    if (same) return;
    throw io::DocumentError(
        file + (lacks ? " has no " + what + ", but" : " has " + article + what + ", unlike") +
        " the files of its kind before; expected " + expected + " in all of them or none");
  };
  const model::InputHistory& one = more.history;
  require(one.time.empty() == to.history.time.empty(), one.time.empty(), "a ", "column time_s",
          "times");
  require(one.input.cols() == to.history.input.cols(), one.input.cols() == 0, "", "pressures",
          "pressures");
  require(more.planar == to.planar, more.planar, "a ", "column z_m", "z_m");
  require(more.rotation.empty() == to.rotation.empty(), more.rotation.empty(), "a ", "column qx",
          "orientations");
  to.rotation.insert(to.rotation.end(), more.rotation.begin(), more.rotation.end());
  to.trials.insert(to.trials.end(), more.trials.begin(), more.trials.end());
  const Eigen::Index rows = to.history.rows() + one.rows();
  to.history.input.conservativeResize(rows, Eigen::NoChange);
  to.history.input.bottomRows(one.rows()) = one.input;
  to.reading.conservativeResize(rows, Eigen::NoChange);
  to.reading.bottomRows(one.rows()) = more.reading;
  to.history.time.insert(to.history.time.end(), one.time.begin(), one.time.end());
  to.history.starts_anew.insert(to.history.starts_anew.end(), one.starts_anew.begin(),
                                one.starts_anew.end());
}

std::vector<estimation::LengthSample> effectiveSamples(const ResponseSeries& lengths,
                                                       const model::Response& response) {
  const Eigen::VectorXd pressures = estimation::effectiveOf(lengths.history, 0, response);
  std::vector<estimation::LengthSample> samples;
  for (Eigen::Index row = 0; row < pressures.size(); ++row) {
    samples.push_back({pressures[row], lengths.reading(row, 0)});
  }
  return samples;
}

estimation::ContractionFit continuedTo(double pressure, estimation::ContractionFit fit) {
  const model::Range range = fit.curve->inputRange();
  if (range.upper >= pressure * (1 - kReached)) return fit;
  if (fit.kind == estimation::CurveKind::kQuintic) {
    for (int i = 0; i <= kContinuedPieces; ++i) {
      const double p = range.lower + (range.upper - range.lower) * i / kContinuedPieces;
      fit.pressures.push_back(p);
      fit.lengths.push_back(fit.curve->lengthInside(p));
    }
    fit.kind = estimation::CurveKind::kTable;
  }
  const double slope = fit.curve->slope(range.upper);
  fit.pressures.push_back(pressure);
  fit.lengths.push_back(fit.lengths.back() + slope * (pressure - range.upper));
  fit.curve = model::Contraction::table(fit.pressures, fit.lengths);
  return fit;
}

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
  // Tips come in their order: none before the last one is still to come.
  const double known = std::max(time - kLatency, last_tip_.value_or(time - kLatency));
  advance(std::min(known, time - kHalfWindow));
}

void SeriesRecord::seen(double time, const Eigen::Vector3d& tip) {
  const bool late = (last_tip_ && time <= *last_tip_) || (last_row_ && time <= *last_row_);
  if (late || !tip.allFinite()) return;
  last_tip_ = time;
  waiting_.push_back({time, tip});
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
      Eigen::Map<const Rows>(all.positions_.data(), rows, 3),
      {}};
}

}  // namespace helix_arm::procedures
