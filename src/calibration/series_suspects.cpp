#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <utility>

#include "basics/least_squares.hpp"
#include "fault_hypotheses.hpp"
#include "series_problem.hpp"

namespace helix_arm::estimation {
namespace {

constexpr double kLeastShare = 0.3;    // of what is beyond the cubic, that a hypothesis explains
constexpr double kPriceOfSize = 0.03;  // in that share, of a size that is chosen as well
constexpr std::size_t kMostNamed = 5;
constexpr Eigen::Index kFewRows = 400;  // show a mistake as well as all do
// Gains and offsets are tried of arms of so many channels, whose fits take some seconds. Smaller
// ones are not told from the errors of a model, which are the same in all rows.
constexpr int kMostChannels = 4;
constexpr double kLeastSize = 0.2;
constexpr basics::DescentRules kRough{1e-2, 10.0, 1e6, 1e-3, 0.0, 12};

// RMS error of a short fit, with orientations as lengths [m].
double roughError(const SeriesPrior& prior, const TipSeries& series, const SeriesOptions& options) {
  const SeriesRecording recording(prior.model.arm(), series, kFewRows, leverOf(prior, options));
  SeriesForm form;
  form.lag = options.response;
  SeriesProblem problem(prior, recording, options, form, prior.X_BF.inverse());
  const Eigen::VectorXd start = Eigen::VectorXd::Zero(problem.size());
  const SeriesEstimate found = basics::descend(problem, problem.at(start), kRough).at;
  const Eigen::MatrixXd deviation = problem.deviationAt(found.z);
  return std::sqrt(deviation.squaredNorm() / static_cast<double>(deviation.rows()));
}

// Mistakes in the positions, orientations and times of a recording.
std::vector<FaultHypothesis> recordingHypotheses(const TipSeries& series) {
  std::vector<FaultHypothesis> out;
  const auto add = [&out](const char* cause, const char* subject, const char* remedy,
                          const std::function<void(TipSeries&)>& correct) {
    out.push_back({cause, subject, always(remedy)});
    out.back().correct_recording = correct;
  };
  add("tip_mirrored", "the frame of the positions",
      "the frame is left-handed, or the muscles lie on the other side: turn the sign of one axis "
      "in the recording",
      [](TipSeries& one) {
        one.position.col(1) *= -1;
        for (Eigen::Matrix3d& R : one.rotation) R = mirrored(R, 1);
      });
  if (!series.rotation.empty()) {
    add("quaternion_order", "qx, qy, qz, qw",
        "the recording has w first: exchange the names of its columns", [](TipSeries& one) {
          for (Eigen::Matrix3d& R : one.rotation) R = withScalarFirst(R);
        });
  }
  if (!series.history.time.empty()) {
    add("time_unit", "time_s", "the times are in milliseconds: convert them to seconds",
        [](TipSeries& one) {
          for (double& time : one.history.time) time *= 1e-3;
        });
  }
  return out;
}

}  // namespace

std::vector<Suspect> suspectsOf(const SeriesPrior& prior, const TipSeries& series,
                                const SeriesOptions& options) {
  const double noise = cubicError(series), before = roughError(prior, series, options);
  const double excess = before * before - noise * noise;
  if (!(excess > 0)) return {};
  // By the share that they explain, less its price.
  std::multimap<double, Suspect, std::greater<>> ranked;
  const auto consider = [&](Suspect one, double error, double price) {
    one.explains = std::clamp((before * before - error * error) / excess, 0.0, 1.0);
    if (one.explains - price >= kLeastShare) ranked.emplace(one.explains - price, std::move(one));
  };
  std::vector<FaultHypothesis> hypotheses = pressureHypotheses(prior.model.arm());
  for (FaultHypothesis& one : recordingHypotheses(series)) hypotheses.push_back(std::move(one));
  for (const FaultHypothesis& one : hypotheses) {
    const bool searched = one.size.isSearched();
    if (searched && (one.of_all || prior.model.arm().actuatorCount() > kMostChannels)) continue;
    for (const double size : one.size.grid) {
      if (searched && std::abs(size - one.size.neutral) < kLeastSize) continue;
      TipSeries corrected = series;
      if (one.correct_pressures) one.correct_pressures(size, corrected.history.input);
      if (one.correct_recording) one.correct_recording(corrected);
      const double error = roughError(prior, corrected, options);
      consider({one.cause, one.subject, 0, *one.remedy(size, {}), {}, std::move(corrected)}, error,
               searched ? kPriceOfSize : 0);
    }
  }
  if (!options.arm.fits(FitParameter::kBase)) {
    SeriesOptions free = options;
    free.arm.fit.insert(FitParameter::kBase);
    const SeriesFit found = fitSeries(prior, series, free);
    if (found.failure.empty()) {
      consider({"frame_of_positions", "all positions", 0,
                "the positions are seen from another frame than the scene's: fit base as well"},
               found.rms, 0);
    }
  }
  std::vector<Suspect> out;
  for (auto& [rank, one] : ranked) {
    if (out.size() < kMostNamed) out.push_back(std::move(one));
  }
  return out;
}

}  // namespace helix_arm::estimation
