#include "helix_arm/calibration/series_fit.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "basics/least_squares.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "series_problem.hpp"

namespace helix_arm::estimation {
namespace {

constexpr Eigen::Index kMostRows = 5000;     // that are compared
constexpr std::size_t kMostChoosing = 1200;  // that choices of parts, and fits without a block, use
constexpr Eigen::Index kLeastRows = 50;      // with a position
constexpr double kReached = 0.9;             // of a curve's range of pressures, by the series
constexpr double kLeastMotion = 0.002, kMostMotion = 20.0;  // of the tip, RMS, of the arm's length
constexpr int kRounds = 3;                                  // of noise and fit
constexpr double kByChance = 0.02;
constexpr double kSignificant = 1.0;  // standard errors
constexpr double kLeastGain = 0.02;   // of the error, for which a part is worth its numbers
constexpr double kSearching = 10.0,
                 kFound = 1.0;        // readings that count, per number: at first, at last
constexpr double kDifference = 1e-5;  // of a number z
constexpr double kLeastNoise = 1e-5;  // [m]
constexpr std::size_t kCoarse = 5;    // one row in so many for a choice of the base
// Bases whose errors are so near the least are fitted with a response; alike [rad], of the arm's
// length; what the scene's base is ahead, and what each length of the arm away counts: of the
// error.
constexpr double kRival = 2.0, kNearTurn = 0.3, kNearPlace = 0.2, kSceneBase = 0.05, kFarBase = 0.1;
constexpr std::size_t kMostRivals = 5;
// Error of the arm whose actuators follow each other in the other sense, from which on it is named:
// of the scene's.
constexpr double kOther = 0.8;
constexpr char kOtherSense[] =
    "they show that the actuators follow each other around the arm in the other sense than in the "
    "scene: exchange two of its hoses or columns, or their places in the scene";
// Orientations take part that leave the positions as near as without them, by this factor and 1 %
// of the arm's length, and that the tip explains but for this part of their motion.
constexpr double kMostLoss = 1.5, kUsualError = 0.01, kMostUnexplained = 0.5;
// Largest errors of a base that count as known: of the arm's length, and [rad].
constexpr double kBaseLength = 0.05, kBaseTurn = 0.1;
constexpr basics::DescentRules kBrief{1e-2, 10.0, 1e6, 1e-3, 0.0, 12};
constexpr basics::DescentRules kWhole{1e-3, 10.0, 1e8, 1e-6, 0.0, 80};

bool carriesLoad(const SeriesPrior& prior) {
  return prior.model.load() && !prior.model.load()->empty();
}

// By how much Student's 95 % interval is wider than that of a known deviation (Abramowitz and
// Stegun, 26.7.5).
double student(double freedom) {
  return 1 + 1.21 / freedom + 1.44 / std::pow(freedom, 2) + 1.30 / std::pow(freedom, 3);
}

// A form of the model, fitted.
struct Fitted {
  SeriesForm form;
  std::shared_ptr<SeriesProblem> problem;
  SeriesEstimate at;
  // RMS error of each block that was left out, and that about the trials' offsets in it [m].
  Eigen::ArrayXd held_out, about;
  Eigen::MatrixXd without;  // (blocks x numbers) z without each block
};

// The fit in its steps, from a base that is chosen first.
class SeriesJob {
 public:
  SeriesJob(const SeriesPrior& prior, const SeriesRecording& recording,
            const SeriesOptions& options)
      : prior_(prior),
        recording_(recording),
        options_(options),
        X_FB_(prior.X_BF.inverse()),
        blocks_(recording.trial_at, recording.trials),
        few_(everyNth((recording.used.size() + kMostChoosing - 1) / kMostChoosing)) {
    if (options_.arm.fits(FitParameter::kBase)) chooseBase();
  }

  SeriesFit run() const {
    SeriesFit out;
    if (!base_rule_.empty()) out.rules.push_back(base_rule_);
    Fitted best = withAllParts();
    dropParts(best, out);
    const std::vector<bool> all(few_.size(), true);
    if (few_ != all) {
      const Fitted whole = fitted(best.form, best.problem->named(best.at.z), all);
      best.problem = whole.problem;
      best.at = whole.at;
    }
    report(best, out);
    return out;
  }

  // Motion of the tip that a short fit finds.
  struct Motion {
    double error, turn_error;  // RMS of the positions about the trials' offsets [m], and [rad]
    Rotations R_FT;            // (used)
  };
  Motion motion() const {
    const Rough rough = roughFit(X_FB_, {});
    const SeriesProblem problem(prior_, recording_, options_, {}, X_FB_);
    const Eigen::MatrixXd about = recording_.aboutOffsets(problem.deviationAt(rough.z));
    const SeriesResidual residual = recording_.residualOf(about, about);
    return {residual.rms, residual.rms_turn, problem.rotationsAt(rough.z)};
  }

 private:
  // Whether K_kappa can depend on pressure, and does not yet.
  bool mayGrow() const {
    const model::Arm& arm = prior_.model.arm();
    bool out = options_.arm.fits(FitParameter::kKappa);
    for (int k = 0; k < arm.sectionCount(); ++k) {
      out &= arm.bending(k).empty() && arm.needForTables(k) == nullptr;
    }
    for (int i = 0; i < arm.actuatorCount(); ++i) out &= model::isPressure(arm.actuator(i).drive);
    return out;
  }

  std::vector<bool> everyNth(std::size_t n) const {
    std::vector<bool> out(recording_.used.size());
    for (std::size_t k = 0; k < out.size(); k += n) out[k] = true;
    return out;
  }

  // @param rows  (used) which take part.
  Fitted fitted(const SeriesForm& form, const std::map<std::string, double>& known,
                const std::vector<bool>& rows) const {
    Fitted out;
    out.form = form;
    out.problem = std::make_shared<SeriesProblem>(prior_, recording_, options_, form, X_FB_);
    SeriesProblem& problem = *out.problem;
    problem.take(rows);
    out.at = bestStart(problem, known);
    for (int round = 0; round < kRounds; ++round) {
      out.at = basics::descend(problem, problem.at(out.at.z), round == 0 ? kBrief : kWhole).at;
      const Eigen::MatrixXd about = recording_.aboutOffsets(problem.deviationAt(out.at.z));
      setVariance(about, round == 0 ? kSearching : kFound, problem);
    }
    out.at = problem.at(out.at.z);
    return out;
  }

  // Errors of the model repeat with the motion, so that residuals count as few
  // readings.
  void setVariance(const Eigen::MatrixXd& about, double readings_per_number,
                   SeriesProblem& problem) const {
    const double readings = readings_per_number * static_cast<double>(problem.size());
    problem.setVariance(
        varianceOf(about) *
        std::max(static_cast<double>(problem.rowsTaken() * about.cols()) / readings, 1.0));
  }
  static double varianceOf(const Eigen::MatrixXd& about) {
    return std::max(about.squaredNorm() / static_cast<double>(about.size()),
                    kLeastNoise * kLeastNoise);
  }

  // The best of several times for the new part of a form to start from.
  SeriesEstimate bestStart(const SeriesProblem& problem,
                           const std::map<std::string, double>& known) const {
    const Eigen::VectorXd z = problem.startFrom(known);
    SeriesEstimate best = problem.at(z);
    for (const double shift : {-2.0, -1.0, 1.0, 2.0}) {
      Eigen::VectorXd moved = z;
      for (Eigen::Index k = 0; k < z.size(); ++k) {
        const SeriesNumber& one = problem.numbers()[static_cast<std::size_t>(k)];
        const bool is_new = one.part == SeriesNumber::kResponse && known.count(one.name) == 0;
        if (is_new && one.law == SeriesNumber::kFactor) moved[k] += shift;
      }
      SeriesEstimate there = problem.at(moved);
      if (problem.cost(there) < problem.cost(best)) best = std::move(there);
    }
    return best;
  }

  // Fits without each block in turn.
  void leaveOut(Fitted& fit) const {
    fit.without.resize(blocks_.count, fit.at.z.size());
    fit.held_out.resize(blocks_.count);
    fit.about.resize(blocks_.count);
    SeriesProblem problem = *fit.problem;
    for (int block = 0; block < blocks_.count; ++block) {
      std::vector<bool> in, out;
      for (const int one : blocks_.of) {
        in.push_back(one != block && few_[in.size()]);
        out.push_back(one == block);
      }
      problem.take(in);
      const SeriesEstimate without = basics::descend(problem, problem.at(fit.at.z), kBrief).at;
      fit.without.row(block) = without.z;
      const Eigen::MatrixXd deviation = problem.deviationAt(without.z);
      fit.held_out[block] = rmsOf(recording_.placesOf(deviation), out);
      fit.about[block] = rmsOf(recording_.aboutOffsets(deviation, out), out);
    }
  }

  // The parts that were asked for, and their names.
  std::vector<std::pair<const char*, bool SeriesForm::*>> parts() const {
    std::vector<std::pair<const char*, bool SeriesForm::*>> out;
    if (options_.response) out.emplace_back("play", &SeriesForm::play);
    if (options_.arm.fits(FitParameter::kStrokeScaleEach))
      out.emplace_back("strokes", &SeriesForm::strokes);
    if (options_.arm.fits(FitParameter::kLengthScaleEach)) {
      out.emplace_back("length scales", &SeriesForm::scales);
    }
    if (options_.phases) out.emplace_back("phases", &SeriesForm::phases);
    if (recording_.lever > 0 && options_.arm.fits(FitParameter::kBase)) {
      out.emplace_back("place of the body", &SeriesForm::body);
    }
    if (mayGrow()) {
      out.emplace_back("K_kappa against pressure", &SeriesForm::growth);
      out.emplace_back("K_kappa against the others' pressure", &SeriesForm::others);
    }
    if (options_.response) {
      out.emplace_back("slow state", &SeriesForm::slow);
      out.emplace_back("lag", &SeriesForm::lag);
    }
    return out;
  }

  SeriesForm wholeForm() const {
    SeriesForm out;
    for (const auto& [name, part] : parts()) out.*part = part != &SeriesForm::growth;
    return out;
  }

  // With K_kappa against the pressure that predicts what is left out better.
  Fitted withAllParts() const {
    Fitted best = fitted(wholeForm(), {}, few_);
    leaveOut(best);
    if (!mayGrow()) return best;
    SeriesForm form = best.form;
    std::swap(form.growth, form.others);
    Fitted mean = fitted(form, {}, few_);
    leaveOut(mean);
    return mean.about.log().mean() < best.about.log().mean() ? mean : best;
  }

  // Drops each part without which what is left out is predicted as well, in proportion: how large a
  // block's errors are depends on how far the arm moves in it, and its offset is not what a part
  // explains. Parts are tried beside all others, since one can look like another: a lag that falls
  // slowly, say, like a bend that other chambers stiffen.
  void dropParts(Fitted& best, SeriesFit& out) const {
    for (const auto& [name, part] : parts()) {
      Choice& choice = out.choices.emplace_back();
      choice.part = name;
      if (!(best.form.*part)) continue;
      SeriesForm form = best.form;
      form.*part = false;
      Fitted without = fitted(form, best.problem->named(best.at.z), few_);
      leaveOut(without);
      const Eigen::ArrayXd gain = (without.about / best.about).log();
      const double whole = (without.held_out / best.held_out).log().sum();
      const auto n = static_cast<double>(gain.size());
      const double scatter =
          std::sqrt((gain - gain.mean()).square().sum() / std::max(n * (n - 1), 1.0));
      const bool is_sure = gain.mean() > kSignificant * scatter || improvesMost(gain);
      const double unit = std::sqrt(without.about.square().mean());
      choice.kept = gain.mean() > kLeastGain && is_sure && whole > 0;
      choice.gain = unit * gain.mean();
      choice.scatter = unit * scatter;
      if (!choice.kept) best = std::move(without);
    }
  }

  // Sign test: that so many blocks improve by chance is less likely than kByChance. Unlike the
  // scatter, it does not mind blocks that improve much more than others.
  static bool improvesMost(const Eigen::ArrayXd& gain) {
    const auto blocks = static_cast<int>(gain.size());
    double ways = 1, as_many = 0;  // of k that do not improve
    for (int k = 0; k <= (gain <= 0).count(); ++k) {
      as_many += ways;
      ways *= static_cast<double>(blocks - k) / (k + 1);
    }
    return as_many < kByChance * std::pow(2.0, blocks);
  }

  // A fit to few of the rows, from a base.
  struct Rough {
    lie::SE3 start, X_FB;
    double error;  // RMS about the trials' offsets [m]
    Eigen::VectorXd z;
  };
  Rough roughFit(const lie::SE3& X_FB, const SeriesForm& form) const {
    SeriesProblem problem(prior_, recording_, options_, form, X_FB);
    const std::vector<bool> few = everyNth(kCoarse);
    problem.take(few);
    SeriesEstimate found = basics::descend(problem, bestStart(problem, {}), kBrief).at;
    Eigen::MatrixXd about = recording_.aboutOffsets(problem.deviationAt(found.z));
    if (form.lag) {
      setVariance(about, kSearching, problem);
      found = basics::descend(problem, problem.at(found.z), kBrief).at;
      about = recording_.aboutOffsets(problem.deviationAt(found.z));
    }
    return {X_FB, problem.decode(found.z).places.X_FB, rmsOf(about, few), found.z};
  }

  // The scene's base, or one that the motion tells: frames of motion capture have any axes. What a
  // response explains can hide which one is right, so those that come near are fitted with one; of
  // those that fit alike, the nearest to the scene's is taken.
  void chooseBase() {
    const SeriesProblem problem(prior_, recording_, options_, {}, X_FB_);
    std::vector<Rough> found;
    for (const Eigen::Matrix3d& axes : axisTurns()) {
      if (const auto X_FB = problem.baseWith(axes)) found.push_back(roughFit(*X_FB, {}));
    }
    std::sort(found.begin(), found.end(),
              [](const Rough& a, const Rough& b) { return a.error < b.error; });
    std::vector<Rough> rivals{roughFit(X_FB_, {})};
    const double least = std::min(found.front().error, rivals.front().error);
    for (const Rough& one : found) {
      const bool known = std::any_of(rivals.begin(), rivals.end(),
                                     [&](const Rough& other) { return isNear(one, other); });
      if (!known && rivals.size() <= kMostRivals && one.error < kRival * least) {
        rivals.push_back(one);
      }
    }
    const SeriesForm form = wholeForm();
    for (Rough& one : rivals) one = roughFit(one.start, form);
    takeBase(rivals);
  }

  void takeBase(const std::vector<Rough>& rivals) {
    const double length = prior_.model.arm().restLength();
    const auto scoreOf = [&](const Rough& one) {
      const Eigen::Vector3d moved = one.X_FB.translation - X_FB_.translation;
      return std::log(one.error) + kFarBase * moved.norm() / length;
    };
    const auto best =
        std::min_element(rivals.begin(), rivals.end(),
                         [&](const Rough& a, const Rough& b) { return scoreOf(a) < scoreOf(b); });
    if (scoreOf(rivals.front()) <= scoreOf(*best) + kSceneBase) return;
    X_FB_ = best->start;
    const double turned = (prior_.X_BF * X_FB_).log().tail<3>().norm();
    base_rule_ = basics::messageOf(
        "base: the frame of the positions is turned by about ", std::round(turned * 180 / M_PI),
        " deg against that of the scene: found from the motion, to within an exchange of the axes "
        "that fits as well");
  }

  bool isNear(const Rough& a, const Rough& b) const {
    const lie::SE3 between = a.X_FB.inverse() * b.X_FB;
    return between.log().tail<3>().norm() < kNearTurn &&
           between.translation.norm() < kNearPlace * prior_.model.arm().restLength();
  }

  void report(const Fitted& fit, SeriesFit& out) const {
    const SeriesProblem& problem = *fit.problem;
    const SeriesModel now = problem.decode(fit.at.z);
    reportNumbers(fit, now, out);
    const CalibrationOptions& arm = options_.arm;
    if (arm.fits(FitParameter::kKappa) || arm.fits(FitParameter::kGamma) ||
        arm.fits(FitParameter::kTau)) {
      out.stiffness = now.model.arm().actuator(0).stiffness;
    }
    if (!now.bending.empty()) out.bending = now.bending;
    if (arm.fits(FitParameter::kEps)) out.K_eps = now.model.load()->K_eps.front();
    if (!carriesLoad(prior_)) {
      out.rules.push_back(
          "K_eps: the arm of the series carries no load, so that the data cannot tell how far a "
          "load moves it; fit K_eps to a series with a load before predictions with one");
    }
    if (arm.fits(FitParameter::kLengthScale) || arm.fits(FitParameter::kLengthScaleEach)) {
      out.length_scale = now.scale;
    }
    if (arm.fits(FitParameter::kStrokeScaleEach)) out.stroke_scale = now.stroke;
    if (options_.ring_radius) out.ring_radius = now.radius;
    if (options_.ring_phase || fit.form.phases) out.ring_phase = phasesOf(now);
    if (recording_.lever > 0 && arm.rotation_noise == 0) {
      out.rules.push_back(basics::messageOf(
          "orientation: 1 deg counts as ", 1e3 * recording_.lever * M_PI / 180,
          " mm of the tip, by ",
          "which it moves as the arm bends; the scene's vision.tag_rotation_noise_deg beside "
          "tag_position_noise_m states another weight"));
    }
    if (options_.ring_phase && arm.fits(FitParameter::kBase) &&
        !(recording_.lever > 0 && prior_.R_TM)) {
      out.rules.push_back(
          "ring_phase_1: a turn of the base about the arm's axis moves the tip alike; the base has "
          "it");
    }
    out.X_BF = now.places.X_FB.inverse();
    if (recording_.lever > 0) out.R_TM = now.places.R_TM;
    if (fit.form.body) out.p_TM = now.places.p_TM;
    out.beam = now.places.beam;
    if (now.response) out.response = *now.response;
    const Eigen::MatrixXd deviation = problem.deviationAt(fit.at.z);
    const SeriesResidual residual =
        recording_.residualOf(deviation, recording_.aboutOffsets(deviation));
    out.rms = residual.rms;
    out.rms_about_offset = residual.rms_about_offset;
    out.rms_turn = residual.rms_turn;
    reportCurves(now, out);
    out.held_out_rms = std::sqrt(fit.held_out.square().mean());
    out.baseline_rms = cubicError(recording_.series);
    out.baseline_held_out_rms = cubicHeldOutError(recording_.series);
  }

  void reportCurves(const SeriesModel& now, SeriesFit& out) const {
    for (std::size_t c = 0; c < now.lengths.size(); ++c) {
      if (now.lengths[c].empty()) continue;
      ContractionFit& table =
          out.curves.emplace_back(recording_.curves[c].name, ContractionFit()).second;
      table.kind = CurveKind::kTable;
      table.pressures = recording_.curves[c].knots;
      table.lengths = now.lengths[c];
      table.curve = model::Contraction::table(table.pressures, table.lengths);
      table.rms = out.rms;
    }
  }

  // (actuators) turn of each about the arm [rad].
  static Eigen::VectorXd phasesOf(const SeriesModel& now) {
    const model::Arm& arm = now.model.arm();
    Eigen::VectorXd out = now.own_phase;
    for (int k = 0; k < arm.sectionCount(); ++k) {
      const int first = arm.firstActuator(k);
      out.segment(first, arm.firstActuator(k + 1) - first).array() += now.phase[k];
    }
    return out;
  }

  void reportNumbers(const Fitted& fit, const SeriesModel& now, SeriesFit& out) const {
    SeriesProblem problem = *fit.problem;
    const SeriesModel before = problem.decode(Eigen::VectorXd::Zero(problem.size()));
    const Eigen::MatrixXd residuals = recording_.aboutOffsets(problem.deviationAt(fit.at.z));
    problem.setVariance(varianceOf(residuals) *
                        basics::correlationFactor(residuals, recording_.trial_at));
    const Eigen::VectorXd noise = problem.covariance(problem.at(fit.at.z)).diagonal().cwiseSqrt();
    const double blocks = static_cast<double>(fit.without.rows());
    const Eigen::MatrixXd about = fit.without.rowwise() - fit.without.colwise().mean();
    const Eigen::VectorXd left_out =
        student(blocks - 1) *
        (about.colwise().squaredNorm() * (blocks - 1) / blocks).cwiseSqrt().transpose();
    for (Eigen::Index k = 0; k < problem.size(); ++k) {
      const SeriesNumber& one = problem.numbers()[static_cast<std::size_t>(k)];
      if (one.part == SeriesNumber::kCurve) continue;
      const bool is_itself = one.law == SeriesNumber::kItself;
      const double value = problem.valueOf(k, now);
      Eigen::VectorXd z = fit.at.z;
      z[k] += kDifference;
      const double slope =
          is_itself ? 1.0 : (problem.valueOf(k, problem.decode(z)) - value) / kDifference;
      const double deviation = std::max(noise[k], left_out[k]);
      const double error = std::abs(slope) * deviation;
      const double most = !is_itself        ? kLargestRelativeError * std::abs(value)
                          : one.unit == "m" ? kBaseLength * prior_.model.arm().restLength()
                                            : kBaseTurn;
      const bool is_known = deviation <= one.prior / 2 && error <= most;
      const double initial = is_itself ? 0.0 : problem.valueOf(k, before);
      out.parameters.push_back({one.name, one.unit, initial, value, error, is_known});
      if (is_known || one.untold == nullptr) continue;
      out.rules.push_back(one.name + ": the data cannot tell " + one.untold +
                          "; held near its start by its prior");
    }
    if (options_.arm.fits(FitParameter::kContraction) && recording_.lever == 0) {
      out.rules.push_back(
          "contraction: an actuator lengthens or shortens under pressure as in the scene, since an "
          "arm of the other kind, turned by half a turn, moves alike");
    }
  }

  const SeriesPrior& prior_;
  const SeriesRecording& recording_;
  const SeriesOptions& options_;
  lie::SE3 X_FB_;                // where fits start
  std::string base_rule_;        // of a base that is not the scene's
  const Blocks blocks_;          // of the used rows
  const std::vector<bool> few_;  // (used) that choices use
};

// Why a curve cannot be fitted: beyond the pressures of the series it would be a guess.
std::string beyondSeries(const model::Arm& arm, const SeriesRecording& recording) {
  for (std::size_t c = 0; c < recording.curves.size(); ++c) {
    if (!recording.curves[c].free) continue;
    double most = 0.0;
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      if (recording.curve_of[static_cast<std::size_t>(i)] != static_cast<int>(c)) continue;
      most = std::max(most, recording.series.history.input.col(i).maxCoeff());
    }
    const double upper = recording.curves[c].knots.back();
    if (most >= kReached * upper) continue;
    return basics::messageOf(
        "contraction ", recording.curves[c].name, " reaches ", 1e-3 * upper,
        " kPa, but the series ", std::round(1e-2 * most) / 10,
        " kPa: beyond it the curve would be a guess; record up to the limit, or "
        "lower max_pressure_kpa of the scene to what was measured");
  }
  return "";
}

// Why nothing can be fitted; empty if it can.
std::string faultOf(const SeriesPrior& prior, const SeriesRecording& recording,
                    const SeriesOptions& options) {
  if (options.arm.fits(FitParameter::kEps) && !carriesLoad(prior)) {
    return "K_eps shows under a load alone, but the scene has none; expected one with a load, or a "
           "fit without K_eps";
  }
  if (prior.beam && (recording.measured.cols() != 2 || !recording.series.rotation.empty())) {
    return "the dot of a beam (motion_capture.beam_deg) lies in the x-y plane of its frame; "
           "expected x_m and y_m alone, without z_m and orientations";
  }
  const model::InputHistory& history = recording.series.history;
  if (history.time.empty()) return "the series has no times; expected a column time_s";
  if (recording.rows() < kLeastRows) {
    return basics::messageOf("the series holds ", recording.rows(),
                             " positions; expected at least ", kLeastRows);
  }
  double duration = 0;
  for (std::size_t row = 1; row < history.time.size(); ++row) {
    if (!history.starts_anew[row]) duration += history.time[row] - history.time[row - 1];
  }
  if (!(duration > 0)) return "time_s does not rise within a trial; expected seconds";
  if (recording.range == 0) {
    const model::Range limits = prior.model.arm().actuator(0).limits;
    return basics::messageOf(
        "the series holds no two pressures that differ within the limits of the scene, ",
        1e-3 * limits.lower, " to ", 1e-3 * limits.upper,
        " kPa of the first actuator; check the unit of the pressures, and move one at least");
  }
  if (options.arm.fits(FitParameter::kContraction)) {
    if (std::string fault = beyondSeries(prior.model.arm(), recording); !fault.empty())
      return fault;
  }
  const double length = prior.model.arm().restLength();
  const Eigen::MatrixXd about = recording.measured.rowwise() - recording.measured.colwise().mean();
  const double motion = std::sqrt(about.squaredNorm() / static_cast<double>(about.rows()));
  if (motion < kLeastMotion * length || motion > kMostMotion * length) {
    return basics::messageOf("the positions vary by ", 1e3 * motion, " mm (RMS) about their mean; ",
                             "expected ", 1e3 * kLeastMotion * length, " to ",
                             1e3 * kMostMotion * length, " mm for an arm of ", 1e3 * length,
                             " mm: check that they are of its tip, and in metres",
                             motion > kMostMotion * length ? ", not millimetres" : "");
  }
  return {};
}

// The arm whose actuators follow each other around it in the other sense.
SeriesPrior mirrored(const SeriesPrior& prior) {
  const model::Arm& arm = prior.model.arm();
  const Eigen::Matrix3d mirror = Eigen::Vector3d(1, 1, -1).asDiagonal();
  std::vector<model::Section> sections(static_cast<std::size_t>(arm.sectionCount()));
  for (int k = 0; k < arm.sectionCount(); ++k) {
    model::Section& section = sections[static_cast<std::size_t>(k)];
    section.plate = arm.plate(k);
    section.bending = arm.bending(k);
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      model::Actuator& actuator = section.actuators.emplace_back(arm.actuator(i));
      actuator.taper.push_back(actuator.X_O);
      for (lie::SE3& X : actuator.taper) {
        X = {mirror * X.rotation * mirror, mirror * X.translation};
      }
      actuator.X_O = actuator.taper.back();
      actuator.taper.pop_back();
    }
  }
  return {statics::ArmModel(model::Arm(std::move(sections), arm.tool()), std::nullopt,
                            prior.model.load(), prior.model.choice().setting),
          prior.X_BF, prior.R_TM, prior.p_TM, prior.beam};
}

bool isPlanar(const SeriesPrior& prior) {
  return prior.model.choice().setting.tier == statics::Tier::kPlanar;
}

// Mistake that orientations look like if they contradict the positions; empty if both are of one
// tip.
// @param free  the motion by positions alone. @param both  with orientations.
std::string contradictionOf(const SeriesPrior& prior, const SeriesRecording& recording,
                            const SeriesOptions& options, const SeriesJob::Motion& free,
                            const SeriesJob::Motion& both) {
  const double usual = std::hypot(free.error, kUsualError * prior.model.arm().restLength());
  const Rotations seen = recording.rotations();
  const auto isOne = [&](const SeriesJob::Motion& motion) {
    return motion.error <= kMostLoss * usual &&
           motion.turn_error <= kMostUnexplained * spreadOf(seen);
  };
  const auto explains = [&](const SeriesPrior& arm) {
    return isOne(SeriesJob(arm, recording, options).motion());
  };
  if (isOne(both)) return {};
  SeriesPrior unturned = prior;
  unturned.R_TM.reset();
  if (prior.R_TM && explains(unturned)) {
    return "their body is turned otherwise than motion_capture.body_rpy_deg of the scene says; "
           "remove that key to find its rotation anew";
  }
  if (!isPlanar(prior) && explains(mirrored(prior))) return kOtherSense;
  return faultOfOrientations(free.R_FT, seen);
}

}  // namespace

SeriesFit fitSeries(const SeriesPrior& prior, const TipSeries& series,
                    const SeriesOptions& options) {
  SeriesFit refused;
  SeriesRecording recording(prior.model.arm(), series, kMostRows, leverOf(prior, options));
  for (SeriesRecording::Curve& one : recording.curves)
    one.free &= options.curve.empty() || one.name == options.curve;
  refused.failure = faultOf(prior, recording, options);
  if (!refused.failure.empty()) return refused;
  SeriesRecording alone = recording;
  alone.lever = 0;
  const SeriesJob positions(prior, alone, options);
  if (recording.lever == 0) {
    SeriesFit out = positions.run();
    if (isPlanar(prior) || !options.arm.fits(FitParameter::kBase)) return out;
    const SeriesPrior mirror = mirrored(prior);
    if (SeriesJob(mirror, alone, options).motion().error < kOther * positions.motion().error)
      out.order_fault = kOtherSense;
    return out;
  }
  const SeriesJob poses(prior, recording, options);
  const std::string fault =
      contradictionOf(prior, recording, options, positions.motion(), poses.motion());
  SeriesFit out = (fault.empty() ? poses : positions).run();
  out.orientation_fault = fault;
  return out;
}

SeriesComparison compareSeries(const SeriesPrior& arm, const TipSeries& series) {
  const SeriesRecording recording(arm.model.arm(), series, series.history.rows(), 1.0);
  SeriesOptions none;
  none.arm.fit.clear();
  const SeriesProblem problem(arm, recording, none, {}, arm.X_BF.inverse());
  SeriesComparison out;
  out.rows = recording.used;
  const Eigen::MatrixXd deviation = problem.deviationAt(Eigen::VectorXd::Zero(problem.size()));
  const Eigen::MatrixXd about = recording.aboutOffsets(deviation);
  out.deviation = recording.placesOf(deviation);
  const std::vector<bool> moving = recording.inMotion(arm.model.arm());
  const auto of = [&](std::optional<int> trial) {
    std::vector<bool> own, still, in_motion;
    for (std::size_t k = 0; k < moving.size(); ++k) {
      own.push_back(!trial || recording.trial_at[k] == *trial);
      still.push_back(own.back() && !moving[k]);
      in_motion.push_back(own.back() && moving[k]);
    }
    SeriesResidual one = recording.residualOf(deviation, about, own);
    one.rms_at_rest = rmsOf(out.deviation, still);
    one.rms_in_motion = rmsOf(out.deviation, in_motion);
    return one;
  };
  for (int trial = 0; trial < recording.trials; ++trial) out.trials.push_back(of(trial));
  out.all = of(std::nullopt);
  out.baseline_rms = cubicHeldOutError(series);
  return out;
}

}  // namespace helix_arm::estimation
