#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/calibration/contraction_fit.hpp"
#include "helix_arm/calibration/series_fit.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/arm_response.hpp"

/// Measurements that tell how actuators follow their pressures.
namespace helix_arm::procedures {

/// Readings in the order in which they were taken.
struct ResponseSeries {
  model::InputHistory history;  ///< measured pressures; without columns where none are known
  /// (rows x 1) free lengths, or (rows x 3) positions of the tip [m]; NaN where none was measured.
  Eigen::MatrixXd reading;
  std::vector<std::string> trials = {};        ///< names of the trials, in their order
  bool planar = false;                         ///< the positions have no z, which is 0 in `reading`
  std::vector<Eigen::Matrix3d> rotation = {};  ///< (rows) of the tip, in the frame of the positions

  bool empty() const { return history.rows() == 0; }
};

/// The free lengths of one muscle; columns pressure_kpa, length_m and, optionally, time_s and
/// trial.
/// @throws DocumentError if a column is missing, or the time falls within a trial.
ResponseSeries lengthSeriesOf(const io::DataSet& data);

/// Positions of one point of an arm, such as its tip, in any frame that does not move; columns
/// time_s, x_m, y_m and, optionally, pressure_1_kpa .., z_m, qx, qy, qz and qw (orientation), seen
/// (0: only the pressures of the row count) and trial.
/// @throws DocumentError as lengthSeriesOf(), or on a pressure beyond the last actuator or a
/// quaternion far from norm 1.
ResponseSeries tipSeriesOf(const io::DataSet& data, int actuators);

/// The same for a fit of the arm: without z where there is none.
estimation::TipSeries ofArm(const ResponseSeries& tips);

/// Prior knowledge of the arm of such a series, as its scene has it.
estimation::SeriesPrior priorOf(const io::Scene& scene);

/// Columns of such a data set besides the pressures: time_s, three positions, seen and trial.
inline constexpr std::size_t kTipSeriesColumns = 6;

/// The text of such a data set, to 0.1 us, 0.1 mPa and 0.1 um.
/// @param comment  initial comment line, without #.
std::string tipSeriesCsv(const ResponseSeries& tips, const std::string& comment);

/// Appends another file's series, which begins a new trial.
/// @throws DocumentError if only one of them has times, or pressures.
void append(const ResponseSeries& more, const std::string& file, ResponseSeries& to);

/// The free lengths against the effective pressures, in the same order.
std::vector<estimation::LengthSample> effectiveSamples(const ResponseSeries& lengths,
                                                       const model::Response& response);

/// A curve of effective pressures, continued in a straight line to the largest measured one. Plays
/// keep the effective pressure from reaching it, but a static computation takes pressures
/// themselves.
/// @param fit  with a curve; a quintic that has to be continued becomes a table.
estimation::ContractionFit continuedTo(double pressure, estimation::ContractionFit fit);

/// Joins measured pressures and measured tips of an arm in motion, by their times, to the series
/// that a response is fitted to.
///
/// There is a row at each tip, and rows without a tip (NaN) in between and while none comes, so
/// that the series knows the pressures at all times. Each has the mean of the pressures around its
/// time, which neither noise nor delay of single readings disturbs. Time is a number [s], the same
/// for both.
class SeriesRecord {
 public:
  static constexpr std::size_t kMostRows = 200'000;     ///< as many as a data set may have
  static constexpr std::size_t kMostCells = 4'000'000;  ///< the same
  static constexpr double kSpacing = 0.02;              ///< most between rows [s]
  static constexpr double kHalfWindow = 0.1;  ///< of the mean of pressures, before and after [s]
  static constexpr double kLatency = 5.0;     ///< how much later than pressures tips may come [s]
  static constexpr double kGap = 1.0;         ///< pressures missing for longer start a trial [s]

  /// @param actuators  number of pressures, >= 1.
  /// @throws std::invalid_argument naming the value and its rule.
  explicit SeriesRecord(int actuators);

  /// Measured pressures: (actuators) gauge [Pa]. A time before the last one starts a new trial.
  /// @throws std::invalid_argument on a wrong size.
  void measured(double time, const Eigen::VectorXd& pressure);
  /// Measured position of the tip, in a frame that does not move [m]. Tips that are not finite, not
  /// later than the one before or later than kLatency do not count.
  void seen(double time, const Eigen::Vector3d& tip);

  std::size_t rows() const { return times_.size(); }
  std::size_t tips() const { return tip_rows_; }  ///< rows with a tip
  /// Rows beyond what a data set may have.
  std::size_t leftOut() const { return left_out_; }
  /// All rows, with what still waits; goes on afterwards.
  ResponseSeries series() const;

 private:
  struct Reading {
    double time;
    Eigen::VectorXd pressure;
  };
  struct Tip {
    double time;
    Eigen::Vector3d position;
  };
  void advance(double until);
  void addRow(double time, const std::optional<Eigen::Vector3d>& tip);
  void startTrial();

  Eigen::Index actuators_;
  std::size_t most_rows_;
  std::deque<Reading> readings_;    // by ascending time
  std::deque<Tip> waiting_;         // for later pressures; by ascending time
  std::optional<double> last_row_;  // of this trial
  std::optional<double> last_tip_;
  bool starts_anew_ = true;  // the next row
  std::vector<double> times_;
  std::vector<bool> starts_;
  std::vector<double> pressures_, positions_;  // row by row
  std::size_t tip_rows_ = 0;
  std::size_t left_out_ = 0;
};

}  // namespace helix_arm::procedures
