#include "series_recording.hpp"

#include <algorithm>
#include <cmath>

namespace helix_arm::estimation {
namespace {

constexpr double kTakesPart = 0.1;      // of the largest range: an actuator that moves
constexpr int kKnots = 7;               // of a curve, at quantiles of the pressures
constexpr double kLeastKnotGap = 0.03;  // of its range
// Behind a lag [s] by more than a share of the range of pressures, an arm is in motion.
constexpr double kRestLag = 0.5, kInMotion = 0.02;

}  // namespace

SeriesRecording::SeriesRecording(const model::Arm& arm, const TipSeries& tips,
                                 Eigen::Index most_rows, double turn_weight)
    : series(tips), lever(tips.rotation.empty() ? 0.0 : turn_weight) {
  std::vector<Eigen::Index> seen;
  std::vector<int> trial_of;
  for (Eigen::Index row = 0; row < series.history.rows(); ++row) {
    trials += series.history.starts_anew[static_cast<std::size_t>(row)] ? 1 : 0;
    trial_of.push_back(trials - 1);
    if (series.position.row(row).allFinite()) seen.push_back(row);
  }
  const auto stride = std::max<Eigen::Index>(
      1, (static_cast<Eigen::Index>(seen.size()) + most_rows - 1) / most_rows);
  for (std::size_t k = 0; k < seen.size(); k += static_cast<std::size_t>(stride)) {
    used.push_back(seen[k]);
    trial_at.push_back(trial_of[static_cast<std::size_t>(seen[k])]);
  }
  measured = series.position(used, Eigen::all);
  const Eigen::MatrixXd& p = series.history.input;
  if (p.rows() == 0) return;
  Eigen::VectorXd least = p.colwise().minCoeff(), most = p.colwise().maxCoeff();
  const Eigen::VectorXd span = arm.clamped(most) - arm.clamped(least);
  range = span.maxCoeff();
  for (const double one : span) moves_.push_back(range > 0 && one >= kTakesPart * range);
  addCurves(arm);
}

void SeriesRecording::addCurves(const model::Arm& arm) {
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const std::string& name = arm.actuator(i).curve;
    auto found = std::find_if(curves.begin(), curves.end(),
                              [&name](const Curve& one) { return one.name == name; });
    if (found == curves.end()) found = curves.insert(found, Curve{name, {}, {}});
    found->free |= moves_[static_cast<std::size_t>(i)];
    curve_of.push_back(static_cast<int>(found - curves.begin()));
  }
  for (std::size_t c = 0; c < curves.size(); ++c) setKnots(arm, static_cast<int>(c));
}

// Ends of the range, and quantiles of the pressures that are not close to each other.
void SeriesRecording::setKnots(const model::Arm& arm, int c) {
  std::vector<double> pressures;
  const model::Contraction* contraction = nullptr;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    if (curve_of[static_cast<std::size_t>(i)] != c) continue;
    if (contraction == nullptr) contraction = &arm.actuator(i).contraction;
    if (!moves_[static_cast<std::size_t>(i)]) continue;
    for (const double p : series.history.input.col(i)) pressures.push_back(p);
  }
  std::sort(pressures.begin(), pressures.end());
  const model::Range limits = contraction->inputRange();
  const double gap = kLeastKnotGap * (limits.upper - limits.lower);
  Curve& curve = curves[static_cast<std::size_t>(c)];
  curve.knots = {limits.lower};
  for (int k = 0; k < kKnots && !pressures.empty(); ++k) {
    const double p = pressures[(pressures.size() - 1) * static_cast<std::size_t>(k) / (kKnots - 1)];
    if (p > curve.knots.back() + gap && p < limits.upper - gap) curve.knots.push_back(p);
  }
  curve.knots.push_back(limits.upper);
  for (const double p : curve.knots) curve.lengths.push_back(contraction->length(p));
}

Eigen::MatrixXd SeriesRecording::effective(const model::Arm& arm,
                                           const std::optional<model::Response>& response) const {
  model::ArmResponse states(arm, response);
  Eigen::MatrixXd out(rows(), arm.actuatorCount());
  std::size_t next = 0;
  for (Eigen::Index row = 0; row < series.history.rows() && next < used.size(); ++row) {
    states.follow(series.history, row);
    if (row != used[next]) continue;
    out.row(static_cast<Eigen::Index>(next++)) = arm.clamped(states.effective());
  }
  return out;
}

std::vector<bool> SeriesRecording::inMotion(const model::Arm& arm) const {
  model::Response rest;
  rest.rise_time = rest.fall_time = kRestLag;
  const Eigen::MatrixXd behind = effective(arm, model::Response()) - effective(arm, rest);
  std::vector<bool> out;
  for (Eigen::Index k = 0; k < rows(); ++k) {
    out.push_back(behind.row(k).cwiseAbs().maxCoeff() > kInMotion * range);
  }
  return out;
}

Eigen::MatrixXd SeriesRecording::deviation(const std::vector<lie::SE3>& tips,
                                           const lie::SE3& X_FB) const {
  const Eigen::Index axes = measured.cols();
  Eigen::MatrixXd out(rows(), axes + (lever > 0 ? 3 : 0));
  for (Eigen::Index row = 0; row < rows(); ++row) {
    const auto k = static_cast<std::size_t>(row);
    const lie::SE3 X_FT = X_FB * tips[k];
    out.row(row).head(axes) = X_FT.translation.head(axes).transpose() - measured.row(row);
    if (lever == 0) continue;
    const Eigen::Matrix3d& seen = series.rotation[static_cast<std::size_t>(used[k])];
    const lie::SE3 turn{seen.transpose() * X_FT.rotation, Eigen::Vector3d::Zero()};
    out.row(row).tail<3>() = lever * turn.log().tail<3>();
  }
  return out;
}

Eigen::MatrixXd SeriesRecording::aboutOffsets(Eigen::MatrixXd deviation,
                                              const std::vector<bool>& counts) const {
  for (int trial = 0; trial < trials; ++trial) {
    std::vector<Eigen::Index> own;
    for (Eigen::Index k = 0; k < deviation.rows(); ++k) {
      const auto row = static_cast<std::size_t>(k);
      if (trial_at[row] == trial && (counts.empty() || counts[row])) own.push_back(k);
    }
    if (own.empty()) continue;
    const Eigen::RowVectorXd mean = deviation(own, Eigen::all).colwise().mean();
    for (const Eigen::Index k : own) deviation.row(k) -= mean;
  }
  return deviation;
}

SeriesResidual SeriesRecording::residualOf(const Eigen::MatrixXd& deviation,
                                           const Eigen::MatrixXd& about,
                                           const std::vector<bool>& rows) const {
  SeriesResidual out;
  const Eigen::MatrixXd places = placesOf(deviation);
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(places.cols());
  for (Eigen::Index k = 0; k < places.rows(); ++k) {
    if (!rows[static_cast<std::size_t>(k)]) continue;
    ++out.rows;
    sum += places.row(k);
    out.worst = std::max(out.worst, places.row(k).norm());
  }
  out.offset = (sum / std::max(out.rows, 1)).transpose();
  out.rms = rmsOf(places, rows);
  out.rms_about_offset = rmsOf(placesOf(about), rows);
  out.rms_turn = lever > 0 ? rmsOf(deviation.rightCols<3>(), rows) / lever : std::nan("");
  return out;
}

double rmsOf(const Eigen::MatrixXd& deviation, const std::vector<bool>& rows) {
  double sum = 0, count = 0;
  for (Eigen::Index k = 0; k < deviation.rows(); ++k) {
    if (!rows[static_cast<std::size_t>(k)]) continue;
    sum += deviation.row(k).squaredNorm();
    ++count;
  }
  return std::sqrt(sum / count);
}

}  // namespace helix_arm::estimation
