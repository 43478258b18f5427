#include "body_recording.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "basics/text.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "io/data/body_table.hpp"

namespace helix_arm::procedures {
namespace {

constexpr double kLeastCorrelation = 0.4;  // of activities that belong together
constexpr double kLeastStep = 0.1;         // of the search [s]
constexpr int kMostSteps = 4000;           // of the search
constexpr double kLeastOverlap = 0.5;      // of the shorter recording

// Sum of the magnitudes of the changes in each interval of a grid, without its mean.
class Activity {
 public:
  Activity(const std::vector<double>& time, const Eigen::MatrixXd& values, double step)
      : begin_(time.front()), step_(step) {
    const auto cells = static_cast<Eigen::Index>((time.back() - begin_) / step) + 1;
    sums_ = Eigen::VectorXd::Zero(cells);
    for (std::size_t k = 1; k < time.size(); ++k) {
      const auto row = static_cast<Eigen::Index>(k);
      const double change = (values.row(row) - values.row(row - 1)).cwiseAbs().sum();
      const auto cell = static_cast<Eigen::Index>((time[k] - begin_) / step);
      if (std::isfinite(change)) sums_[std::min(cell, cells - 1)] += change;
    }
    sums_.array() -= sums_.mean();
  }

  // Correlation with another one on the same step, this one later by `lag`; nothing where they
  // hardly overlap.
  std::optional<double> correlation(const Activity& other, double lag) const {
    const auto shift =
        static_cast<Eigen::Index>(std::llround((begin_ + lag - other.begin_) / step_));
    const Eigen::Index first = std::max<Eigen::Index>(0, -shift);
    const Eigen::Index last = std::min(sums_.size(), other.sums_.size() - shift);
    const auto shorter = static_cast<double>(std::min(sums_.size(), other.sums_.size()));
    if (static_cast<double>(last - first) < kLeastOverlap * shorter) return std::nullopt;
    const auto a = sums_.segment(first, last - first);
    const auto b = other.sums_.segment(first + shift, last - first);
    return a.dot(b) / std::max(1e-300, a.norm() * b.norm());
  }

 private:
  double begin_, step_;
  Eigen::VectorXd sums_;
};

TimedPressures timedPressuresOf(const io::Scene& scene, const std::string& path) {
  const io::DataSet data = io::loadDataSet(path);
  io::requireColumns(data, {"time_s"}, "time_s, pressure_1_kpa ..: the pressures of the recording");
  const Eigen::VectorXd time = data.values.col(data.find("time_s"));
  TimedPressures out{{time.begin(), time.end()}, io::pressuresOf(data, scene.arm.actuatorCount())};
  if (!std::is_sorted(out.time.begin(), out.time.end())) {
    throw io::DocumentError(path + " has times that fall; expected one recording");
  }
  return out;
}

double offsetOf(const io::BodyTable& table, const TimedPressures& pressures,
                const std::string& path, std::vector<std::string>& notes) {
  const auto bodies = static_cast<Eigen::Index>(table.poses.front().size());
  Eigen::MatrixXd places(static_cast<Eigen::Index>(table.time.size()), 3 * bodies);
  for (Eigen::Index k = 0; k < places.rows(); ++k) {
    for (Eigen::Index i = 0; i < bodies; ++i) {
      const auto& pose = table.poses[static_cast<std::size_t>(k)][static_cast<std::size_t>(i)];
      auto place = places.row(k).segment<3>(3 * i);
      if (pose) {
        place = pose->translation.transpose();
      } else {  // no motion while it is lost
        place = k > 0 ? Eigen::RowVector3d(places.row(k - 1).segment<3>(3 * i))
                      : Eigen::RowVector3d(Eigen::RowVector3d::Zero());
      }
    }
  }
  const ClockLag lag = lagBetween(pressures.time, pressures.values, table.time, places);
  if (lag.correlation < kLeastCorrelation) {
    throw io::DocumentError(
        path + basics::format(" moves at no time as the pressures change (correlation %.2f); "
                              "expected pressures of the same motion, or --offset-s",
                              lag.correlation));
  }
  notes.push_back(basics::format(
      "the pressures are %.2f s %s the bodies of %s (correlation %.2f): --offset-s %.2f",
      std::abs(lag.seconds), lag.seconds > 0 ? "before" : "after", path.c_str(), lag.correlation,
      lag.seconds));
  return lag.seconds;
}

io::DataSet tableOf(const io::Scene& scene, const std::vector<Sample>& samples) {
  io::DataSet out;
  out.columns = {"capture", "time_s", "tag", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"};
  const auto actuators = static_cast<Eigen::Index>(scene.arm.actuatorCount());
  for (Eigen::Index i = 1; i <= actuators; ++i) {
    out.columns.push_back("pressure_" + std::to_string(i) + "_pa");
  }
  std::vector<Eigen::RowVectorXd> rows;
  for (std::size_t k = 0; k < samples.size(); ++k) {
    for (const TagObservation& body : samples[k].tags) {
      const lie::SE3 X = body.X_FM();
      Eigen::RowVectorXd row(10 + actuators);
      row << static_cast<double>(k + 1), samples[k].time, body.id, X.translation.transpose(),
          Eigen::Quaterniond(X.rotation).coeffs().transpose(),
          scene.arm.clamped(samples[k].pressure).transpose();
      rows.push_back(row);
    }
  }
  out.values.resize(static_cast<Eigen::Index>(rows.size()), 10 + actuators);
  for (std::size_t k = 0; k < rows.size(); ++k) {
    out.values.row(static_cast<Eigen::Index>(k)) = rows[k];
    out.lines.push_back(static_cast<int>(k) + 1);
  }
  return out;
}

}  // namespace

std::vector<Sample> samplesAtRest(const io::Scene& scene, const io::BodyTable& table,
                                  const std::string& path, const TimedPressures& own,
                                  const RecordedPressures& recorded, const SettleRules& rules,
                                  std::vector<std::string>& notes) {
  const TimedPressures pressures =
      recorded.path.empty() ? own : timedPressuresOf(scene, recorded.path);
  const double offset =
      recorded.offset ? *recorded.offset : offsetOf(table, pressures, path, notes);
  SettleWatch watch(scene.arm, rules);
  std::vector<Sample> out, standing;
  std::string reason = "no pressure was read";
  std::size_t next = 0;
  for (std::size_t k = 0; k < table.time.size(); ++k) {
    const double time = table.time[k];
    for (; next < pressures.time.size() && pressures.time[next] + offset <= time; ++next) {
      watch.measured(pressures.time[next] + offset,
                     pressures.values.row(static_cast<Eigen::Index>(next)));
    }
    std::vector<TagObservation> bodies;
    for (std::size_t i = 0; i < table.poses[k].size(); ++i) {
      if (const auto& pose = table.poses[k][i]) {
        bodies.push_back(TagObservation::ofBody(static_cast<int>(i), *pose));
      }
    }
    watch.seen(time, std::move(bodies));
    const Settling settling = watch.at(time);
    if (!settling.settled()) {
      reason = settling.reason;
      continue;
    }
    // Noise may end a rest for a moment; one at the same pressures goes on.
    const Eigen::VectorXd& pressure = settling.last->pressure;
    const bool same =
        standing.empty() ||
        (standing.front().pressure - pressure).cwiseAbs().maxCoeff() < 2 * rules.pressure_tolerance;
    if (!same) {
      out.push_back(medianOf(standing));
      standing.clear();
    }
    standing.push_back(*settling.last);
  }
  if (!standing.empty()) out.push_back(medianOf(standing));
  if (out.empty()) {
    throw io::DocumentError(path + ": the arm is never at rest in it; at its end, " + reason);
  }
  return out;
}

ClockLag lagBetween(const std::vector<double>& from, const Eigen::MatrixXd& of_from,
                    const std::vector<double>& to, const Eigen::MatrixXd& of_to) {
  const double length_from = from.back() - from.front(), length_to = to.back() - to.front();
  const double lowest = to.front() - from.front() - length_from,
               highest = to.front() - from.front() + length_to;
  const double step = std::max(kLeastStep, (highest - lowest) / kMostSteps);
  const Activity one(from, of_from, step), other(to, of_to, step);
  ClockLag best{0.5 * (lowest + highest), -1.0};
  for (double lag = lowest; lag <= highest; lag += step) {
    const auto value = one.correlation(other, lag);
    if (value && *value > best.correlation) best = {lag, *value};
  }
  return best;
}

io::DataSet measurementsOf(const io::Scene& scene, const std::string& path,
                           const RecordedPressures& pressures, std::vector<std::string>& notes) {
  if (!scene.hasBodies() || !io::isBodyTable(path)) return io::loadDataSet(path);
  std::vector<std::string> names;
  for (const estimation::TagPlacement& body : scene.tags->tags) names.push_back(body.name);
  const io::BodyTable table = io::loadBodyTable(path, names);
  const TimedPressures own =
      pressures.path.empty() ? timedPressuresOf(scene, path) : TimedPressures{};
  io::DataSet out = tableOf(scene, samplesAtRest(scene, table, path, own, pressures, {}, notes));
  out.path = path;
  out.sha256 = table.sha256;
  return out;
}

}  // namespace helix_arm::procedures
