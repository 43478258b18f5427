#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

#include "basics/least_squares.hpp"
#include "basics/median.hpp"
#include "basics/pi.hpp"
#include "calibration_fit.hpp"
#include "calibration_problem.hpp"
#include "fault_hypotheses.hpp"
#include "series_problem.hpp"

namespace helix_arm::estimation {
namespace {

// The numbers below were chosen on the simulated arms of docs/suspects.txt.

// A fit whose mean square is below this is as good as its noise.
constexpr double kAsNoise = 1.1;
// Share of the readings that may be wrong detections: the mean square is that of the others.
constexpr double kWrong = 0.1;
// Deviations beyond those of a sound arm that no good fit has.
constexpr double kFar = 5.0;
constexpr double kNoFit = 1e4;  // mean square of captures that cannot be fitted at all

// Errors that a hypothesis has to explain.
struct Demands {
  double left_near, left_far;  // most of the mean square that it leaves, as noise or beyond: on an
                               // arm that deviates in many ways every freedom explains some of it
  double explained;            // least share of what is beyond the noise
  double gain;                 // least gain of the log likelihood, which is more than by chance
};
constexpr Demands kInside{0.91, 0.5, 0.3, 12.0};
// Captures whose pressures are outside the limits are wrong, however little that shows.
constexpr Demands kOutside{1.1, 1.1, 0.2, -std::numeric_limits<double>::infinity()};

// A number that is fitted has to pay for itself: of two hypotheses that explain as much, the
// simpler one comes first.
constexpr double kPriceOfNumber = 0.03;
constexpr std::size_t kMostNamed = 5;
// All hypotheses are tried with so many captures of corners, beyond one per actuator, and the best
// of them with all.
constexpr std::size_t kFewCaptures = 6, kFinalists = 12;
constexpr int kMostIterations = 30;  // a fit that takes more is no good fit
// A base that is off by less than this is as a tape measure leaves it [m, rad].
constexpr BasePrior kTapedBase{0.006, 0.015};
constexpr double kMostBorderShift = 4.0;  // in standard deviations of its prior

// For noise alone, the mean square of the readings without the largest tenth, each of so many
// residuals (chi-square, within 1 %).
double trimmedSquare(int residuals) { return 1 - 0.38 * std::pow(residuals, -0.55); }

// How well readings fit.
struct Quality {
  double square;  // mean, in expected variances, without the share that may be wrong: 1 for noise
  int residuals;  // in all
  lie::SE3 base = {};               // from where the scene has it
  double usual = 1;                 // mean square of a sound arm; not of a rough fit
  double border_shift = 0;          // [m]
  double tag_turn = 0;              // of the placement that is turned farthest [rad]
  std::map<int, double> tags = {};  // of the first arm: median squares, by the index in the layout
};

// Takes all pressures as within their limits. @return how far beyond these the farthest was [Pa].
double clampPressures(std::vector<ArmCaptures>& arms) {
  double farthest = 0;
  for (ArmCaptures& arm : arms) {
    for (Capture& capture : arm.captures) {
      if (capture.pressure.size() != arm.arm.actuatorCount()) continue;
      const Eigen::VectorXd inside = arm.arm.clamped(capture.pressure);
      farthest = std::max(farthest, (inside - capture.pressure).cwiseAbs().maxCoeff());
      capture.pressure = inside;
    }
  }
  return farthest;
}

// Some captures of corners of each arm, evenly spaced; all others.
std::vector<ArmCaptures> fewOf(std::vector<ArmCaptures> arms) {
  if (kindOf(arms) != ReadingKind::kCorners) return arms;
  for (ArmCaptures& arm : arms) {
    const std::size_t count = arm.captures.size();
    const std::size_t few =
        std::min(count, kFewCaptures + static_cast<std::size_t>(arm.arm.actuatorCount()));
    for (std::size_t k = 0; k < few; ++k) arm.captures[k] = arm.captures[k * count / few];
    arm.captures.resize(few, arm.captures.front());
  }
  return arms;
}

Quality qualityOf(CalibrationProblem& problem) {
  Quality out{0.0, 0, problem.base()};
  std::vector<double> squares;
  std::map<int, std::vector<double>> by_tag;
  for (const Comparison& reading : problem.compare(1.0, false)) {
    squares.push_back(reading.square / reading.residuals / trimmedSquare(reading.residuals));
    out.residuals += reading.residuals;
    const bool of_tag = reading.tag >= 0 && problem.armOf(reading.capture) == 0;
    if (of_tag) by_tag[reading.tag].push_back(squares.back());
  }
  std::sort(squares.begin(), squares.end());
  squares.resize(squares.size() - static_cast<std::size_t>(kWrong * squares.size()));
  out.square =
      std::accumulate(squares.begin(), squares.end(), 0.0) / static_cast<double>(squares.size());
  for (auto& [tag, all] : by_tag) out.tags[tag] = basics::medianOf(std::move(all));
  out.border_shift = problem.blocks().borderShift();
  for (const ParameterBlocks::Block& one : problem.blocks().all()) {
    if (one.kind != ParameterBlock::kTag) continue;
    const lie::Vector6 moved = problem.blocks().motionOf(one.kind, one.of);
    out.tag_turn = std::max(out.tag_turn, moved.tail<3>().norm());
  }
  return out;
}

// A hypothesis of some size, and what its fit leaves.
struct Explanation {
  const FaultHypothesis* hypothesis;
  double size, left;  // mean square
  double price = 1;   // factor on it

  double cost() const { return price * left; }
};

// Tries fault hypotheses on captures with fits of a request.
class Diagnosis {
 public:
  Diagnosis(const std::vector<ArmCaptures>& read, const CalibrationOptions& options,
            const std::function<bool()>& stop)
      : read_(read), few_(fewOf(read)), asked_(options), options_(options), stop_(stop) {
    options_.errors = options_.held_out = false;
  }

  // Best first.
  // @param outside  whether pressures are far beyond their limits.
  std::vector<Suspect> suspects(bool outside) {
    const auto fitted = [this] { return fit({read_, options_}, Effort::kFull, true); };
    const std::optional<Quality> given = fitted();
    // Data that cannot be fitted for another reason than its pressures has no suspects.
    if (!given && !outside) return {};
    inside_ = given && !outside;
    before_ = given.value_or(Quality{kNoFit, static_cast<int>(kNoFit)});
    // A wrong tag size is taken up by the border shift, and a tag that is glued otherwise by its
    // placement, as far as they are fitted.
    const bool placed = asked_.fits(FitParameter::kTags) &&
                        (before_.square > kFar * kFar || before_.tag_turn > 0.25 * basics::kPi);
    if (placed || std::abs(before_.border_shift) > kMostBorderShift * asked_.border_shift_prior) {
      options_.fit.erase(FitParameter::kBorderShift);
      if (placed) options_.fit.erase(FitParameter::kTags);
      if (placed && asked_.free_shapes) options_.fit.insert(FitParameter::kBase);
      before_ = fitted().value_or(before_);
    }
    std::vector<Suspect> out;
    if (!inside_ || before_.square >= kAsNoise) out = named(ranked(hypotheses()));
    return out.empty() ? turnedAlone() : out;
  }

 private:
  // All captures are fitted, or a few until their noise is known.
  enum class Effort { kFull, kRough };

  bool stopped() const { return stop_ && stop_(); }
  double farSquare() const { return kFar * kFar * before_.usual; }

  std::vector<FaultHypothesis> hypotheses() const {
    const ArmCaptures& arm = read_.front();
    std::vector<FaultHypothesis> out = rigHypotheses(arm, asked_, kindOf(read_));
    // Shapes that are free follow any pressures.
    if (asked_.free_shapes) return out;
    const std::vector<FaultHypothesis> pressures = pressureHypotheses(arm.arm);
    out.insert(out.end(), pressures.begin(), pressures.end());
    return out;
  }

  CalibrationInput without(const FaultHypothesis& hypothesis, double size, Effort effort) const {
    CalibrationInput out{effort == Effort::kFull ? read_ : few_, options_};
    if (hypothesis.correct_captures) hypothesis.correct_captures(size, out);
    if (hypothesis.correct_scene) hypothesis.correct_scene(size, out);
    for (Capture& capture : out.arms.front().captures) {
      if (!hypothesis.correct_pressures) break;
      Eigen::MatrixXd row = capture.pressure.transpose();
      hypothesis.correct_pressures(size, row);
      capture.pressure = row.transpose();
    }
    return out;
  }

  // Nothing if no fit is possible.
  // @param clamp  whether pressures far beyond the limits are taken as at them, or refused.
  std::optional<Quality> fit(CalibrationInput input, Effort effort, bool clamp) const {
    if (stopped()) return std::nullopt;
    if (clampPressures(input.arms) > kBeyondLimit && !clamp) return std::nullopt;
    const std::vector<ArmCaptures>& read = input.arms;
    if (unsound(read) || unfit(read, input.options)) return std::nullopt;
    const bool one_rig = read.size() == 1 && isMet(FitNeed::kTags, kindOf(read));
    if (effort == Effort::kFull && one_rig && !input.options.fits(FitParameter::kBase)) {
      CalibrationOptions near = input.options;
      near.fit.insert(FitParameter::kBase);
      const std::optional<Quality> found = fit(read, near, effort);
      if (found && found->base.translation.norm() < kTapedBase.translation &&
          turnOf(found->base) < kTapedBase.rotation) {
        return found;
      }
    }
    return fit(read, input.options, effort);
  }

  static std::optional<Quality> fit(const std::vector<ArmCaptures>& read,
                                    CalibrationOptions options, Effort effort) {
    options.max_iterations = std::min(options.max_iterations, kMostIterations);
    CalibrationProblem problem(read, options);
    solveWithNoise(problem, 0, effort == Effort::kRough);
    Quality out = qualityOf(problem);
    if (!std::isfinite(out.square)) return std::nullopt;
    if (effort == Effort::kFull) out.usual = std::pow(usualScale(problem), 2);
    return out;
  }

  // Nothing if it cannot be fitted.
  std::optional<Explanation> tried(const FaultHypothesis& hypothesis, double size,
                                   Effort effort) const {
    const bool searched = hypothesis.size.isSearched();
    const std::optional<Quality> found = fit(without(hypothesis, size, effort), effort, searched);
    if (!found) return std::nullopt;
    // A base that is fitted pays for its motion, too.
    const double move = found->base.translation.norm() / kMovedBase.translation;
    const double turn = turnOf(found->base) / kMovedBase.rotation;
    const double numbers =
        hypothesis.freed + (searched ? 1 : 0) + 0.5 * (move * move + turn * turn);
    return Explanation{&hypothesis, size, found->square, 1 + kPriceOfNumber * numbers};
  }

  // At its best size, roughly.
  std::optional<Explanation> best(const FaultHypothesis& hypothesis) const {
    std::map<double, Explanation> known;
    const auto at = [&](double size) {
      if (const auto one = tried(hypothesis, size, Effort::kRough)) known.emplace(size, *one);
    };
    const auto least = [&] {
      return std::min_element(known.begin(), known.end(), [](const auto& a, const auto& b) {
        return a.second.left < b.second.left;
      });
    };
    for (const double size : hypothesis.size.grid) at(size);
    if (known.empty()) return std::nullopt;
    // The bracket of the best one is halved from both sides.
    constexpr int kHalvings = 5;
    for (int round = 0; round < kHalvings && hypothesis.size.isSearched(); ++round) {
      const auto here = least();
      if (here != known.begin()) at(0.5 * (here->first + std::prev(here)->first));
      if (std::next(here) != known.end()) at(0.5 * (here->first + std::next(here)->first));
    }
    return least()->second;
  }

  // Those that explain most, the best first: all roughly, then the best of them fully.
  std::vector<Explanation> ranked(const std::vector<FaultHypothesis>& hypotheses) const {
    std::vector<Explanation> found, out;
    const auto sort = [](std::vector<Explanation>& all) {
      std::stable_sort(all.begin(), all.end(),
                       [](const auto& a, const auto& b) { return a.cost() < b.cost(); });
    };
    for (const FaultHypothesis& hypothesis : hypotheses) {
      if (const auto one = best(hypothesis)) found.push_back(*one);
    }
    sort(found);
    for (const Explanation& one : found) {
      if (out.size() == kFinalists) break;
      const auto whole = tried(*one.hypothesis, one.size, Effort::kFull);
      if (whole) out.push_back(*whole);
    }
    sort(out);
    return out;
  }

  // @param found  the best first.
  std::vector<Suspect> named(const std::vector<Explanation>& found) const {
    std::vector<Suspect> out;
    double least = inside_ ? before_.square : 0.0;
    for (const Explanation& one : found) {
      if (stopped()) return {};
      if (out.size() == kMostNamed) break;
      if (std::optional<Suspect> suspect = named(one)) {
        least = std::min(least, one.left);
        out.push_back(std::move(*suspect));
      }
    }
    // No single mistake brings the readings near to this arm.
    if (least > farSquare()) {
      out.insert(out.begin(), {"other_arm", "all captures", 0.0,
                               "no single mistake explains them: check that captures and scene "
                               "are of the same arm, and look for several mistakes"});
      if (out.size() > kMostNamed) out.pop_back();
    }
    return out;
  }

  // Tags that are turned alone, which the mean square leaves out: no capture fits them until they
  // are.
  std::vector<Suspect> turnedAlone() const {
    constexpr std::size_t kMost = 3;
    std::vector<int> odd;
    for (const auto& [tag, square] : before_.tags) {
      if (square > farSquare()) odd.push_back(tag);
    }
    if (odd.size() > kMost) return {};
    std::vector<Suspect> out;
    for (const int tag : odd) {
      for (const FaultHypothesis& turn : turnHypotheses(tag, read_.front().layout)) {
        const std::optional<Quality> after =
            fit(without(turn, 0, Effort::kFull), Effort::kFull, false);
        if (!after || after->tags.at(tag) > farSquare()) continue;
        const double before = before_.tags.at(tag), left = after->tags.at(tag);
        const double explains = (before - left) / (before - std::min(1.0, left));
        if (auto suspect = shown(turn, 0, explains)) out.push_back(std::move(*suspect));
      }
    }
    return out;
  }

  // Nothing if it explains too little, or is too small for a mistake.
  std::optional<Suspect> named(const Explanation& one) const {
    const FaultSize& size = one.hypothesis->size;
    if (std::abs(one.size - size.neutral) < size.least) return std::nullopt;
    const Demands& demands = inside_ ? kInside : kOutside;
    const double left = one.cost() / before_.square;
    const double gain = -0.5 * before_.residuals * std::log(left);
    const double most = one.left < kAsNoise ? demands.left_near : demands.left_far;
    if (left > most || gain < demands.gain) return std::nullopt;
    const double beyond = before_.square - std::min(1.0, one.left);
    const double explains = beyond > 0 ? (before_.square - one.left) / beyond : 0;
    if (explains < demands.explained) return std::nullopt;
    return shown(*one.hypothesis, one.size, explains);
  }

  // The suspect of a hypothesis that explains so much; nothing if its calibration shows no mistake.
  std::optional<Suspect> shown(const FaultHypothesis& hypothesis, double size,
                               double explains) const {
    CalibrationInput corrected = without(hypothesis, size, Effort::kFull);
    clampPressures(corrected.arms);
    const Calibration fit = calibrate(corrected.arms, corrected.options);
    if (fit.shapes.empty()) return std::nullopt;  // refused
    const std::optional<std::string> remedy = hypothesis.remedy(size, fit);
    if (!remedy) return std::nullopt;
    const ArmCaptures& arm = read_.front();
    Suspect out{hypothesis.cause, hypothesis.subject, explains, *remedy};
    if (out.where.empty()) out.where = arm.arm.actuator(oddMuscle(fit.length_scale)).name;
    if (hypothesis.correct_tags) {
      out.layout = arm.layout;
      hypothesis.correct_tags(size, *out.layout);
    }
    if (!hypothesis.correct_scene) out.corrected = std::move(corrected.arms);
    return out;
  }

  const std::vector<ArmCaptures>& read_;
  std::vector<ArmCaptures> few_;
  CalibrationOptions asked_, options_;  // the second of the fits
  std::function<bool()> stop_;
  bool inside_ = false;        // all pressures are within their limits
  Quality before_{kNoFit, 0};  // of the readings as they are
};

// ---- Recorded motions ----

constexpr double kLeastShare = 0.3;     // of what is beyond the cubic, that a hypothesis explains
constexpr double kPriceOfSize = 0.03;   // in that share, of a size that is chosen as well
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

bool isCertain(const std::vector<Suspect>& suspects, double noise) {
  constexpr double kCertain = 0.9, kCertainFar = 0.5;
  const double least = noise > kFarNoise ? kCertainFar : kCertain;
  return std::any_of(suspects.begin(), suspects.end(),
                     [least](const Suspect& one) { return one.explains >= least; });
}

std::vector<Suspect> suspectsOf(const std::vector<ArmCaptures>& arms,
                                const CalibrationOptions& options,
                                const std::function<bool()>& stop) {
  if (arms.empty() || arms.front().captures.empty()) return {};
  std::vector<ArmCaptures> clamped = arms;
  const bool outside = clampPressures(clamped) > kBeyondLimit;
  if (unsound(clamped)) return {};
  return Diagnosis(arms, options, stop).suspects(outside);
}

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
