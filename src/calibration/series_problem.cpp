#include "series_problem.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "helix_arm/statics/stiffness_by_input.hpp"

namespace helix_arm::estimation {
namespace {

using model::Response;

constexpr double kBendLever = 0.5;      // motion of the tip by a bend of 1 rad, of the arm's length
constexpr double kTakesPart = 0.1;      // of the largest range: an actuator that moves
constexpr int kKnots = 7;               // of a curve, at quantiles of the pressures
constexpr double kLeastKnotGap = 0.03;  // of its range
// Behind a lag [s] by more than a share of the range of pressures, an arm is in motion.
constexpr double kRestLag = 0.5, kInMotion = 0.02;

constexpr int kLeastTrials = 5, kMostBlocks = 8, kParts = 10;

constexpr double kFirstNoise = 0.05;        // of the arm's length, before there are residuals
constexpr double kFirstCorrelation = 20.0;  // factor on variances, likewise
// Start of a response [s], [s], share of the range of pressures.
constexpr double kFirstLag = 0.5, kFirstSlowTime = 8.0, kFirstReach = 0.05, kFirstWeight = 0.3;
constexpr double kDifference = 1e-5;
constexpr double kLongestStep = 0.5;  // of a number z
// Standard deviations: logs of a factor of a slope and from piece to piece, of times, logits.
constexpr double kSlopePrior = 1.1, kBendPrior = 0.5, kTimePrior = 2.0, kWeightPrior = 1.5;
constexpr double kGrowthPrior = 1.0;      // of the log of the ratio of two K_kappa
constexpr double kOthersPrior = 2.5;      // likewise: a chamber alone may hardly resist
constexpr double kRadiusPrior = 0.2;      // of its log
constexpr double kPhasePrior = 0.5;       // of an actuator in its ring [rad]
constexpr double kBasePrior = 0.5;        // of its place, of the arm's length
constexpr double kBodyPlacePrior = 0.25;  // of the arm's length
constexpr double kBodyPrior = M_PI;       // of its rotation: none is known [rad]
constexpr double kBeamPrior = 0.1;        // of its direction, against x of the tip [rad]

bool readsPressures(const statics::ArmModel& model) {
  return statics::readsInputs(model.arm(), model.load() ? &*model.load() : nullptr);
}

double entryAt(const SeriesNumber& number, double z) {
  if (number.law == SeriesNumber::kItself) return z;
  if (number.law == SeriesNumber::kFactor) return number.start * std::exp(z);
  const double odds = number.start / (number.most - number.start) * std::exp(z);
  return number.most * odds / (1 + odds);
}

// Strictly monotone, and > 0.
bool isCurve(const std::vector<double>& lengths) {
  const bool rises = lengths.back() > lengths.front();
  for (std::size_t j = 0; j < lengths.size(); ++j) {
    const bool follows =
        j == 0 || (rises ? lengths[j] > lengths[j - 1] : lengths[j] < lengths[j - 1]);
    if (!(lengths[j] > 0) || !follows) return false;
  }
  return true;
}

// K_kappa that is linear from one end of all limits to the other.
// @param ratio  of its values there.
model::BendingTable growing(const model::Arm& arm, double ratio,
                            model::BendingTable::Argument argument) {
  model::Range all = arm.actuator(0).limits;
  for (int i = 1; i < arm.actuatorCount(); ++i) {
    all.lower = std::min(all.lower, arm.actuator(i).limits.lower);
    all.upper = std::max(all.upper, arm.actuator(i).limits.upper);
  }
  return {{{all.lower, all.upper}, {std::max(1 / ratio, 1.0), std::max(ratio, 1.0)}}, argument};
}

// The model of the fitted rings and curves: its K_kappa follows from pressures, not from lengths
// alone.
void setModel(SeriesModel& out) {
  const model::Arm& arm = out.model.arm();
  std::vector<model::Section> sections(static_cast<std::size_t>(arm.sectionCount()));
  for (int k = 0; k < arm.sectionCount(); ++k) {
    Eigen::Matrix3d turn;
    const auto move = [&](lie::SE3& X) {
      X.rotation = turn * X.rotation;
      X.translation = turn * X.translation;
      X.translation.tail<2>() *= out.radius[k];
    };
    model::Section& section = sections[static_cast<std::size_t>(k)];
    section.plate = arm.plate(k);
    section.bending = out.bending.empty() ? arm.bending(k) : out.bending;
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      model::Actuator& actuator = section.actuators.emplace_back(arm.actuator(i));
      turn = Eigen::AngleAxisd(out.phase[k] + out.own_phase[i], Eigen::Vector3d::UnitX());
      move(actuator.X_O);
      for (lie::SE3& X : actuator.taper) move(X);
      actuator.contraction =
          out.contraction[static_cast<std::size_t>(i)].scaledBy(out.scale[i], out.stroke[i]);
    }
  }
  const statics::TierSetting setting = out.model.choice().setting;
  const bool planar = setting.tier == statics::Tier::kPlanar && !out.bending.empty();
  out.model =
      statics::ArmModel(model::Arm(std::move(sections), arm.tool()), std::nullopt, out.model.load(),
                        planar ? statics::TierSetting{statics::Tier::kLinear, 0} : setting);
}

// (used) tips seen from the base, of the rows that are asked for; empty: all.
std::vector<lie::SE3> tipsOf(const SeriesModel& now, const Eigen::MatrixXd& effective,
                             const std::vector<bool>& rows) {
  std::vector<lie::SE3> out(static_cast<std::size_t>(effective.rows()));
  Eigen::VectorXd lengths(effective.cols());
  for (Eigen::Index row = 0; row < effective.rows(); ++row) {
    const auto k = static_cast<std::size_t>(row);
    if (!rows.empty() && !rows[k]) continue;
    for (Eigen::Index i = 0; i < lengths.size(); ++i) {
      const model::Contraction& curve = now.contraction[static_cast<std::size_t>(i)];
      lengths[i] = now.scale[i] *
                   (curve.restLength() + now.stroke[i] * curve.changeInside(effective(row, i)));
    }
    const statics::Tip tip = readsPressures(now.model)
                                 ? now.model.tip(Eigen::VectorXd(effective.row(row).transpose()))
                                 : now.model.tipOfLengths(lengths);
    out[k] = tip.tip;
    if (!tip.converged()) out[k].translation.setConstant(std::nan(""));
  }
  return out;
}

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

// Ends of the range, and pressures that are equally far apart by the mean of their quantile and
// their place in the range: knots where the readings are, and none far from the next.
void SeriesRecording::setKnots(const model::Arm& arm, int c) {
  std::vector<double> pressures;
  const model::Contraction* contraction = nullptr;
  model::Range limits{};
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    if (curve_of[static_cast<std::size_t>(i)] != c) continue;
    const model::Range& own = arm.actuator(i).limits;
    limits = contraction == nullptr ? own
                                    : model::Range{std::min(limits.lower, own.lower),
                                                   std::max(limits.upper, own.upper)};
    contraction = &arm.actuator(i).contraction;
    if (!moves_[static_cast<std::size_t>(i)]) continue;
    for (const double p : series.history.input.col(i)) pressures.push_back(p);
  }
  std::sort(pressures.begin(), pressures.end());
  const double whole = limits.upper - limits.lower, gap = kLeastKnotGap * whole;
  Curve& curve = curves[static_cast<std::size_t>(c)];
  curve.knots = {limits.lower};
  const auto count = static_cast<double>(std::max<std::size_t>(pressures.size(), 2) - 1);
  // The pressure whose mean of quantile and place is the given one.
  const auto at = [&](double mean) {
    double lower = limits.lower, upper = limits.upper;
    for (int halving = 0; halving < 30; ++halving) {
      const double p = 0.5 * (lower + upper);
      const auto below = std::lower_bound(pressures.begin(), pressures.end(), p);
      const double quantile = static_cast<double>(below - pressures.begin()) / count;
      (0.5 * (quantile + (p - limits.lower) / whole) < mean ? lower : upper) = p;
    }
    return lower;
  };
  for (int k = 0; k < kKnots && !pressures.empty(); ++k) {
    const double p = at((k + 0.5) / kKnots);
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

double leverOf(const SeriesPrior& prior, const SeriesOptions& options) {
  const CalibrationOptions& arm = options.arm;
  return arm.rotation_noise > 0 ? arm.position_noise / arm.rotation_noise
                                : kBendLever * prior.model.arm().restLength();
}

Eigen::Vector3d SeriesPlaces::pointOf(const lie::SE3& X_FT) const {
  if (!beam) return X_FT * p_TM;
  const Eigen::Vector3d along =
      X_FT.rotation *
      (Eigen::AngleAxisd((*beam)[0], Eigen::Vector3d::UnitY()) *
       (Eigen::AngleAxisd((*beam)[1], Eigen::Vector3d::UnitZ()) * Eigen::Vector3d::UnitX()));
  const double distance = -X_FT.translation.z() / along.z();
  if (!(distance > 0)) return Eigen::Vector3d::Constant(std::nan(""));
  return X_FT.translation + distance * along;
}

Eigen::MatrixXd SeriesRecording::deviation(const std::vector<lie::SE3>& tips,
                                           const SeriesPlaces& places) const {
  const Eigen::Index axes = measured.cols();
  Eigen::MatrixXd out(rows(), axes + (lever > 0 ? 3 : 0));
  for (Eigen::Index row = 0; row < rows(); ++row) {
    const auto k = static_cast<std::size_t>(row);
    const lie::SE3 X_FT = places.X_FB * tips[k];
    out.row(row).head(axes) = places.pointOf(X_FT).head(axes).transpose() - measured.row(row);
    if (lever == 0) continue;
    const Eigen::Matrix3d& seen = series.rotation[static_cast<std::size_t>(used[k])];
    out.row(row).tail<3>() = lever * rotationVector(seen.transpose() * X_FT.rotation * places.R_TM);
  }
  return out;
}

Rotations SeriesRecording::rotations() const {
  Rotations out;
  for (const Eigen::Index row : used) out.push_back(series.rotation[static_cast<std::size_t>(row)]);
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
    if (!rows.empty() && !rows[static_cast<std::size_t>(k)]) continue;
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

Blocks::Blocks(const std::vector<int>& trial_at, int trials) {
  const bool by_trial = trials >= kLeastTrials;
  count = by_trial ? std::min(trials, kMostBlocks) : kParts;
  for (std::size_t k = 0; k < trial_at.size(); ++k) {
    of.push_back(by_trial
                     ? trial_at[k] % count
                     : static_cast<int>(k * static_cast<std::size_t>(count) / trial_at.size()));
  }
}

double rmsOf(const Eigen::MatrixXd& deviation, const std::vector<bool>& rows) {
  double sum = 0, count = 0;
  for (Eigen::Index k = 0; k < deviation.rows(); ++k) {
    if (!rows.empty() && !rows[static_cast<std::size_t>(k)]) continue;
    sum += deviation.row(k).squaredNorm();
    ++count;
  }
  return std::sqrt(sum / count);
}

SeriesProblem::SeriesProblem(const SeriesPrior& prior, const SeriesRecording& recording,
                             const SeriesOptions& options, const SeriesForm& form,
                             const lie::SE3& X_FB)
    : prior_(prior),
      recording_(recording),
      options_(options),
      form_(form),
      places_{X_FB, prior.R_TM.value_or(Eigen::Matrix3d::Identity()), prior.p_TM, prior.beam},
      takes_part_(recording.used.size(), true),
      variance_(kFirstCorrelation * std::pow(kFirstNoise * prior.model.arm().restLength(), 2)) {
  addArm();
  addCurves();
  addRings();
  if (options.arm.fits(FitParameter::kBase)) addBase();
  addResponse();
  if (recording.lever > 0 && !prior.R_TM) addBody();
  for (int i = 0; form_.body && i < 3; ++i) {
    addPlace(
        std::string("body_") + "xyz"[i], "m", kBodyPlacePrior * prior.model.arm().restLength(),
        "place of the body and the shape at rest",
        [i](SeriesModel& m) -> double& { return m.shift[i]; },
        [i](const SeriesModel& m) { return m.places.p_TM[i]; });
  }
  if (options.arm.fits(FitParameter::kBase) && prior.beam) addBeam();
}

void SeriesProblem::addPlace(const std::string& name, const char* unit, double prior,
                             const char* untold, const std::function<double&(SeriesModel&)>& entry,
                             const std::function<double(const SeriesModel&)>& reported) {
  add({SeriesNumber::kPlace, SeriesNumber::kItself, name, unit, prior, entry, untold});
  numbers_.back().reported = reported;
}

void SeriesProblem::addArm() {
  const CalibrationOptions& arm = options_.arm;
  const model::Stiffness& first = prior_.model.arm().actuator(0).stiffness;
  const auto factor = [this](const std::string& name, const char* unit, double prior, auto entry,
                             const char* untold = nullptr, double unit_value = 1.0) {
    add({SeriesNumber::kArm, SeriesNumber::kFactor, name, unit, prior, entry, untold, unit_value});
  };
  const auto stiffness = [&](const char* name, const char* unit, double model::Stiffness::*of,
                             const char* untold = nullptr) {
    const auto entry = [of](SeriesModel& m) -> double& { return m.stiffness.*of; };
    factor(name, unit, arm.stiffness_prior, entry, untold, first.*of);
  };
  const auto each = [&](const char* name, int count, double prior, Eigen::VectorXd SeriesModel::*of,
                        const char* untold) {
    for (int i = 0; i < count; ++i) {
      const auto entry = [of, i](SeriesModel& m) -> double& { return (m.*of)[i]; };
      factor(name + std::to_string(i + 1), "", prior, entry, untold);
    }
  };
  if (arm.fits(FitParameter::kKappa)) stiffness("K_kappa", "m^2", &model::Stiffness::kappa);
  if (form_.grows()) {
    factor("K_kappa_growth", "", form_.others ? kOthersPrior : kGrowthPrior, &SeriesModel::growth);
  }
  if (arm.fits(FitParameter::kGamma)) {
    stiffness("K_gamma", "", &model::Stiffness::gamma,
              "shear stiffness of actuators along the arm, which nothing shows");
  }
  if (arm.fits(FitParameter::kTau)) stiffness("K_tau", "m^2", &model::Stiffness::tau);
  if (arm.fits(FitParameter::kEps)) {
    factor("K_eps", "N", arm.stiffness_prior, &SeriesModel::K_eps, nullptr,
           prior_.model.load()->K_eps.front());
  }
  const char* const scales = "length scales of actuators that hardly move, and bend at rest";
  if (arm.fits(FitParameter::kLengthScale)) {
    factor("length_scale", "", arm.length_scale_prior, &SeriesModel::common_scale, scales);
  }
  const int actuators = prior_.model.arm().actuatorCount();
  each("length_scale_", form_.scales ? actuators : 0, arm.length_scale_prior, &SeriesModel::scale,
       scales);
  each("stroke_scale_", form_.strokes ? actuators : 0, arm.stroke_scale_prior, &SeriesModel::stroke,
       "the strokes of all actuators, slope of their curve and stiffness");
  each("ring_radius_", options_.ring_radius ? prior_.model.arm().sectionCount() : 0, kRadiusPrior,
       &SeriesModel::radius,
       "radius of a ring, strokes and bending stiffness, which bend the arm alike");
}

void SeriesProblem::addCurves() {
  for (std::size_t c = 0;
       options_.arm.fits(FitParameter::kContraction) && c < recording_.curves.size(); ++c) {
    const SeriesRecording::Curve& curve = recording_.curves[c];
    for (std::size_t j = 0; curve.free && j < curve.knots.size(); ++j) {
      const double prior = j == 0   ? options_.arm.length_scale_prior
                           : j == 1 ? kSlopePrior
                                    : kBendPrior;
      add({SeriesNumber::kCurve, SeriesNumber::kFactor, curve.name + " " + std::to_string(j), "",
           prior, [c, j](SeriesModel& m) -> double& { return m.pieces[c][j]; }, nullptr, 1.0, 1.0,
           0, j > 1});
    }
  }
}

void SeriesProblem::addRings() {
  const CalibrationOptions& arm = options_.arm;
  for (int k = 0; options_.ring_phase && k < prior_.model.arm().sectionCount(); ++k) {
    const bool told = recording_.lever > 0 && prior_.R_TM;
    if (k == 0 && arm.fits(FitParameter::kBase) && !told) continue;  // the base has it
    add({SeriesNumber::kArm, SeriesNumber::kItself, "ring_phase_" + std::to_string(k + 1), "rad",
         arm.base_prior.rotation, [k](SeriesModel& m) -> double& { return m.phase[k]; },
         "phase of a ring, of which only actuators that move tell"});
  }
  if (form_.phases) addPhases();
}

void SeriesProblem::addBase() {
  for (int i = 0; i < 6; ++i) {
    const bool turn = i >= 3;
    addPlace(
        std::string(turn ? "base_r" : "base_") + "xyz"[i % 3], turn ? "rad" : "m",
        turn ? options_.arm.base_prior.rotation : kBasePrior * prior_.model.arm().restLength(),
        i == 3 ? "a turn of the base about the arm's axis and the directions of its actuators"
               : "pose of the base, bend and length of the arm at rest",
        [i](SeriesModel& m) -> double& { return m.motion[i]; },
        [i, &prior = prior_](const SeriesModel& m) {
          return (prior.X_BF * m.places.X_FB).log()[i];
        });
  }
}

// Angles of the actuators that move, but for the first one of each section, which the ring's phase
// has.
void SeriesProblem::addPhases() {
  const model::Arm& arm = prior_.model.arm();
  for (int k = 0; k < arm.sectionCount(); ++k) {
    bool is_first = true;
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      if (!recording_.moves(i)) continue;
      if (!std::exchange(is_first, false)) {
        add({SeriesNumber::kArm, SeriesNumber::kItself, "phase_" + std::to_string(i + 1), "rad",
             kPhasePrior, [i](SeriesModel& m) -> double& { return m.own_phase[i]; },
             "angle of an actuator and scales of the others"});
      }
    }
  }
}

// The start of the rotation between tip and body is the mean that the motion shows.
void SeriesProblem::addBody() {
  places_.R_TM = meanBody(rotationsAt(Eigen::VectorXd::Zero(size())), recording_.rotations());
  for (int i = 0; i < 3; ++i) {
    addPlace(
        std::string("body_r") + "xyz"[i], "rad", kBodyPrior, nullptr,
        [i](SeriesModel& m) -> double& { return m.turn[i]; },
        [i](const SeriesModel& m) { return rotationVector(m.places.R_TM)[i]; });
  }
}

void SeriesProblem::addBeam() {
  for (int i = 0; i < 2; ++i) {
    addPlace(
        std::string("beam_r") + "yz"[i], "rad", kBeamPrior,
        "direction of the beam and pose of the base",
        [i](SeriesModel& m) -> double& { return m.beam[i]; },
        [i](const SeriesModel& m) { return (*m.places.beam)[i]; });
  }
}

void SeriesProblem::addResponse() {
  const auto number = [this](const char* name, const char* unit, double start, double most,
                             auto entry) {
    const auto law = most > 0 ? SeriesNumber::kShare : SeriesNumber::kFactor;
    add({SeriesNumber::kResponse, law, name, unit, most > 0 ? kWeightPrior : kTimePrior,
         [entry](SeriesModel& m) -> double& { return std::invoke(entry, *m.response); }, nullptr,
         1.0, start, most});
  };
  if (form_.lag) {
    number("rise_time_constant", "s", kFirstLag, 0, &Response::rise_time);
    number("fall_time_constant", "s", kFirstLag, 0, &Response::fall_time);
  }
  if (form_.slow) {
    number("slow_time_constant", "s", kFirstSlowTime, 0, &Response::slow_time);
    number("slow_weight", "", kFirstWeight, Response::kMostWeight, &Response::slow_weight);
  }
  if (form_.play) {
    number(
        "play_1", "Pa", kFirstReach * recording_.range, 0,
        [](auto& r) -> auto& { return r.plays[0].reach; });
    number(
        "play_weight_1", "", kFirstWeight, 1.0, [](auto& r) -> auto& { return r.plays[0].weight; });
  }
}

Eigen::VectorXd SeriesProblem::startFrom(const std::map<std::string, double>& known) const {
  Eigen::VectorXd z = Eigen::VectorXd::Zero(size());
  for (std::size_t k = 0; k < numbers_.size(); ++k) {
    const auto found = known.find(numbers_[k].name);
    if (found != known.end()) z[static_cast<Eigen::Index>(k)] = found->second;
  }
  return z;
}

std::map<std::string, double> SeriesProblem::named(const Eigen::VectorXd& z) const {
  std::map<std::string, double> out;
  for (std::size_t k = 0; k < numbers_.size(); ++k) {
    out[numbers_[k].name] = z[static_cast<Eigen::Index>(k)];
  }
  return out;
}

SeriesModel SeriesProblem::decode(const Eigen::VectorXd& z) const {
  const model::Arm& arm = prior_.model.arm();
  SeriesModel out{prior_.model};
  out.scale = out.stroke = Eigen::VectorXd::Ones(arm.actuatorCount());
  out.radius = Eigen::VectorXd::Ones(arm.sectionCount());
  out.phase = Eigen::VectorXd::Zero(arm.sectionCount());
  out.own_phase = Eigen::VectorXd::Zero(arm.actuatorCount());
  for (const SeriesRecording::Curve& one : recording_.curves) {
    out.pieces.emplace_back(one.knots.size(), 1.0);
  }
  if (options_.response) out.response.emplace().play_count = form_.play ? 1 : 0;
  for (std::size_t k = 0; k < numbers_.size(); ++k) {
    numbers_[k].entry(out) = entryAt(numbers_[k], z[static_cast<Eigen::Index>(k)]);
  }
  out.scale *= out.common_scale;
  if (form_.play)
    out.response->plays[0].weight *= Response::kMostWeight - out.response->slow_weight;
  if (form_.grows()) {
    using Argument = model::BendingTable::Argument;
    out.stiffness.kappa *= std::min(out.growth, 1.0);  // the least one
    out.bending = growing(arm, out.growth, form_.others ? Argument::kOthers : Argument::kMean);
  }
  out.model = prior_.model.scaledStiffness(out.stiffness, out.K_eps);
  out.places = places_;
  out.places.X_FB = places_.X_FB * lie::SE3::exp(out.motion);
  out.places.R_TM = places_.R_TM * rotationOf(out.turn);
  out.places.p_TM = places_.p_TM + out.shift;
  if (out.places.beam) *out.places.beam += out.beam;
  setContractions(out);
  const bool changed = options_.ring_radius || options_.ring_phase || form_.phases ||
                       form_.grows() || readsPressures(prior_.model);
  if (out.sound && changed) setModel(out);
  return out;
}

void SeriesProblem::setContractions(SeriesModel& out) const {
  const model::Arm& arm = prior_.model.arm();
  out.lengths.resize(recording_.curves.size());
  std::vector<std::optional<model::Contraction>> fitted(out.lengths.size());
  for (std::size_t c = 0; c < fitted.size(); ++c) {
    const SeriesRecording::Curve& curve = recording_.curves[c];
    if (!options_.arm.fits(FitParameter::kContraction) || !curve.free) continue;
    std::vector<double>& lengths = out.lengths[c];
    for (std::size_t j = 0; j < curve.knots.size(); ++j) {
      const double before = j == 0 ? 0.0 : curve.lengths[j - 1];
      lengths.push_back((j == 0 ? 0.0 : lengths.back()) +
                        out.pieces[c][j] * (curve.lengths[j] - before));
    }
    out.sound &= isCurve(lengths);
    if (!out.sound) return;
    fitted[c] = model::Contraction::table(curve.knots, lengths);
  }
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const auto c = static_cast<std::size_t>(recording_.curve_of[static_cast<std::size_t>(i)]);
    out.contraction.push_back(fitted[c].value_or(arm.actuator(i).contraction));
    const double rest = out.contraction.back().restLength();
    out.sound &= rest + out.stroke[i] * (out.contraction.back().lengthRange().lower - rest) > 0;
  }
}

SeriesEstimate SeriesProblem::at(const Eigen::VectorXd& z) const {
  const SeriesModel now = decode(z);
  if (!now.sound) return {z, Eigen::VectorXd::Constant(1, std::nan(""))};
  const std::vector<lie::SE3> tips = tipsOf(now, effective(now), takes_part_);
  return {z, whole(z, recording_.deviation(tips, now.places))};
}

Eigen::MatrixXd SeriesProblem::deviationAt(const Eigen::VectorXd& z) const {
  const SeriesModel now = decode(z);
  return recording_.deviation(tipsOf(now, effective(now), {}), now.places);
}

Rotations SeriesProblem::rotationsAt(const Eigen::VectorXd& z) const {
  const SeriesModel now = decode(z);
  Rotations out;
  for (const lie::SE3& tip : tipsOf(now, effective(now), {})) {
    out.push_back(now.places.X_FB.rotation * tip.rotation);
  }
  return out;
}

std::optional<lie::SE3> SeriesProblem::baseWith(const Eigen::Matrix3d& axes) const {
  const SeriesModel now = decode(Eigen::VectorXd::Zero(size()));
  const std::vector<lie::SE3> tips = tipsOf(now, effective(now), takes_part_);
  SeriesPlaces places = now.places;
  places.X_FB = {axes, Eigen::Vector3d::Zero()};
  const auto meanOf = [&](const auto& of) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const lie::SE3& tip : tips) sum += of(tip);
    return Eigen::Vector3d(sum / static_cast<double>(tips.size()));
  };
  if (places.beam) {
    const auto height = [](const lie::SE3& X_FB) {
      return [X_FB](const lie::SE3& tip) { return Eigen::Vector3d(X_FB * tip.translation); };
    };
    places.X_FB.translation.z() =
        meanOf(height(now.places.X_FB)).z() - meanOf(height(places.X_FB)).z();
  }
  const Eigen::Vector3d seen =
      meanOf([&places](const lie::SE3& tip) { return places.pointOf(places.X_FB * tip); });
  if (!seen.allFinite()) return std::nullopt;
  Eigen::Vector3d measured = Eigen::Vector3d::Zero();
  measured.head(recording_.measured.cols()) = recording_.measured.colwise().mean().transpose();
  places.X_FB.translation += measured - seen;
  return places.X_FB;
}

SeriesEstimate SeriesProblem::moved(const SeriesEstimate& from, const Eigen::VectorXd& step) const {
  return at(from.z + step.cwiseMax(-kLongestStep).cwiseMin(kLongestStep));
}

basics::DenseEquations SeriesProblem::linearise(const SeriesEstimate& one) const {
  const Eigen::MatrixXd J = jacobian(one);
  return {J.transpose() * J, J.transpose() * one.residual};
}

Eigen::MatrixXd SeriesProblem::covariance(const SeriesEstimate& one) const {
  return linearise(one).hessian.ldlt().solve(Eigen::MatrixXd::Identity(size(), size()));
}

// Deviations about the trials' offsets, which are eliminated under their prior, and the prior.
Eigen::VectorXd SeriesProblem::whole(const Eigen::VectorXd& z, Eigen::MatrixXd deviation) const {
  const double offset = options_.rest_offset * options_.rest_offset;
  const std::vector<int>& trial = recording_.trial_at;
  for (std::size_t begin = 0, end; begin < trial.size(); begin = end) {
    double count = 0;
    Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(deviation.cols());
    for (end = begin; end < trial.size() && trial[end] == trial[begin]; ++end) {
      auto row = deviation.row(static_cast<Eigen::Index>(end));
      if (!takes_part_[end]) {
        row.setZero();
        continue;
      }
      sum += row;
      ++count;
    }
    if (count == 0 || offset == 0) continue;
    const Eigen::RowVectorXd taken =
        sum / count * (1 - std::sqrt(variance_ / (count * offset + variance_)));
    for (std::size_t k = begin; k < end; ++k) {
      if (takes_part_[k]) deviation.row(static_cast<Eigen::Index>(k)) -= taken;
    }
  }
  Eigen::VectorXd out(deviation.size() + size());
  out.head(deviation.size()) = deviation.reshaped() / std::sqrt(variance_);
  for (Eigen::Index k = 0; k < size(); ++k) {
    const SeriesNumber& one = numbers_[static_cast<std::size_t>(k)];
    out[deviation.size() + k] = (z[k] - (one.chained ? z[k - 1] : 0)) / one.prior;
  }
  return out;
}

Eigen::MatrixXd SeriesProblem::jacobian(const SeriesEstimate& one) const {
  Eigen::MatrixXd J(one.residual.size(), size());
  const SeriesModel here = decode(one.z);
  const Eigen::MatrixXd pressures = effective(here);
  const std::vector<lie::SE3> tips_here = tipsOf(here, pressures, takes_part_);
  for (Eigen::Index k = 0; k < size(); ++k) {
    Eigen::VectorXd z = one.z;
    z[k] += kDifference;
    const SeriesModel now = decode(z);
    const SeriesNumber& number = numbers_[static_cast<std::size_t>(k)];
    const std::vector<lie::SE3> moved =
        number.part == SeriesNumber::kPlace
            ? tips_here
            : tipsOf(now, number.part == SeriesNumber::kResponse ? effective(now) : pressures,
                     takes_part_);
    J.col(k) = (whole(z, recording_.deviation(moved, now.places)) - one.residual) / kDifference;
  }
  return J;
}

}  // namespace helix_arm::estimation
