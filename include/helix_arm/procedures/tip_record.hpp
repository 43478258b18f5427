#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <deque>
#include <iosfwd>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace helix_arm::procedures {

/// A quantity over time, of the last moments. At most kMost values are kept.
class TimeSeries {
 public:
  static constexpr std::size_t kMost = 4096;
  static constexpr double kReach = 0.25;  ///< longest gap that is bridged [s]
  static constexpr double kAhead = 0.05;  ///< the newest value holds for so long [s]

  /// One that is older than the newest starts anew, as does one of another size.
  void add(double time, const Eigen::VectorXd& value);
  /// Linear between the values before and after this time; nothing where they are farther apart
  /// than kReach, or there is none.
  std::optional<Eigen::VectorXd> between(double time) const;
  /// The last value at or before this time; nothing where it is older than a second.
  std::optional<Eigen::VectorXd> inForce(double time) const;
  /// Whether later values cannot change those at this time.
  bool covers(double time) const { return !values_.empty() && values_.back().first >= time; }

 private:
  std::deque<std::pair<double, Eigen::VectorXd>> values_;  ///< by ascending time
};

/// What a recorded run says of one picture. Tips are positions in one frame [m].
struct TipRow {
  double stamp;      ///< of the picture [s]
  double path_time;  ///< since the start of the path; negative on the way to its first point [s]
  Eigen::Vector3d wanted, measured;              ///< at the time of the picture
  std::optional<Eigen::Vector3d> predicted;      ///< by the corrected model
  double sd;                                     ///< of `predicted` along the error [m]
  std::string state;                             ///< of the loop
  std::optional<Eigen::Vector3d> model = {};     ///< by the scene alone
  std::optional<Eigen::VectorXd> command = {};   ///< (n) in force then, gauge [Pa]
  std::optional<Eigen::VectorXd> pressure = {};  ///< (n) measured, gauge [Pa]

  double error() const { return (measured - wanted).norm(); }  ///< [m]
};

/// Joins the pictures of a run with what other topics say of their times. Time is a number [s].
class TipRecord {
 public:
  static constexpr std::size_t kMostRows = 200'000;  ///< as many as a data set may have
  static constexpr std::size_t kMostWaiting = 256;   ///< rows for what has not come yet

  TimeSeries model, command, pressure;  ///< gets what comes, at its own time

  /// Adds a picture; its model and pressures are filled in once they have come.
  void add(TipRow row);
  /// Fills in what has come.
  void update();
  /// Whether a row still waits for something.
  bool isComplete() const { return waiting_.empty(); }
  /// Fills in the rest as far as it has come. @return all rows, by the order of their pictures.
  const std::vector<TipRow>& finish();
  /// Pictures beyond kMostRows.
  std::size_t leftOut() const { return left_out_; }

 private:
  void take();

  std::deque<TipRow> waiting_;
  std::vector<TipRow> rows_;
  std::size_t left_out_ = 0;
};

/// Root of the mean square of a tip's distances from the wanted one, and the largest [m].
struct TipError {
  double rms, max;
};
/// Which tip of a row.
enum class RecordedTip { kModel, kPredicted, kMeasured };
/// Position of that tip; nothing if it is unknown.
std::optional<Eigen::Vector3d> tipOf(const TipRow& row, RecordedTip tip);
/// Over the rows from the start of the path to its end [s]; nothing without a row.
std::optional<TipError> errorOf(const std::vector<TipRow>& rows, RecordedTip tip, double end);

/// Writes a header and one line per row: time_s (since the path's start), stamp_s, wanted_x_m ..,
/// model_x_m .., predicted_x_m .., measured_x_m .., error_m, predicted_sd_m, command_1_pa ..,
/// pressure_1_pa .., state. What is unknown is left empty.
/// @param actuators  number of pressures.
void writeCsv(const std::vector<TipRow>& rows, int actuators, std::ostream& out);

}  // namespace helix_arm::procedures
