#include "helix_arm/calibration/series_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "basics/least_squares.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"

namespace helix_arm::estimation {
namespace {

using model::Response;

constexpr Eigen::Index kMostRows = 5000;  // that are compared; between them the pressures count
constexpr Eigen::Index kLeastRows = 50;   // with a position
constexpr double kLeastMotion = 0.002, kMostMotion = 20.0;  // of the tip, RMS, of the arm's length
constexpr double kFirstNoise = 0.05;        // of the arm's length, before there are residuals
constexpr double kFirstCorrelation = 20.0;  // factor on variances, likewise
constexpr int kRounds = 3;                  // of noise and fit
constexpr int kFolds = 8, kBlocks = 5, kLeastTrials = 3;
constexpr double kSignificant = 2.0;  // standard errors
constexpr double kLeastGain = 0.02;   // of the error, for which a part is worth its numbers
constexpr double kSearching = 10.0,
                 kFound = 1.0;          // readings that count, per number: at first, at last
constexpr double kTakesPart = 0.1;      // of the largest range: an actuator that moves
constexpr int kKnots = 7;               // of a curve, at quantiles of the pressures
constexpr double kLeastKnotGap = 0.03;  // of its range
// Behind a lag [s] by more than a share of the range of pressures, an arm is in motion.
constexpr double kRestLag = 0.5, kInMotion = 0.02;
constexpr double kDifference = 1e-5;
constexpr double kLongestStep = 0.5;  // of a number z
constexpr double kLeastNoise = 1e-5;  // [m]
constexpr std::size_t kCoarse = 5;    // one row in so many for a choice of the base
// What a response begins with [s], [s], share of the range of pressures.
constexpr double kFirstLag = 0.5, kFirstSlowTime = 8.0, kFirstWeight = 0.3, kFirstReach = 0.05;
// Standard deviations: logs of a factor of a slope and from piece to piece, of times, logits.
constexpr double kSlopePrior = 1.1, kBendPrior = 0.5, kTimePrior = 2.0, kWeightPrior = 1.5;
constexpr double kGrowthPrior = 1.0;  // of the log of the ratio of two K_kappa
constexpr double kRadiusPrior = 0.2;  // of its log
constexpr double kBendLever = 0.5;    // motion of the tip by a bend of 1 rad, of the arm's length
constexpr double kBasePrior = 0.5;    // of its place, of the arm's length
// Bases whose errors are so near the least are fitted with a response; alike [rad], of the arm's
// length; what the scene's base is ahead, and what each length of the arm away counts: of the
// error.
constexpr double kRival = 2.0, kNearTurn = 0.3, kNearPlace = 0.2, kSceneBase = 0.05, kFarBase = 0.1;
constexpr std::size_t kMostRivals = 5;
// Largest errors of a base that count as known: of the arm's length, and [rad].
constexpr double kBaseLength = 0.05, kBaseTurn = 0.1;
constexpr basics::DescentRules kBrief{1e-2, 10.0, 1e6, 1e-3, 0.0, 12};
constexpr basics::DescentRules kWhole{1e-3, 10.0, 1e8, 1e-6, 0.0, 80};

enum class Kind {
  kKappa,
  kGrowth,
  kGamma,
  kTau,
  kEps,
  kScale,
  kStroke,
  kRest,
  kSlope,
  kRadius,
  kPhase,
  kBase,
  kRise,
  kFall,
  kSlowTime,
  kSlowWeight,
  kReach,
  kPlayWeight
};

bool isOfResponse(Kind kind) { return kind >= Kind::kRise; }
bool isWeight(Kind kind) { return kind == Kind::kSlowWeight || kind == Kind::kPlayWeight; }

// A number of the fit: z, 0 at first. Values that are > 0 are first * exp(z), weights logits, those
// of the base a right-hand motion.
struct Number {
  Kind kind;
  int of, piece;  // index of its actuator, curve or entry; of its piece
  std::string name, unit;
  double prior;          // standard deviation of z
  bool chained = false;  // of the difference from the number before it
};

// Which optional parts the model has.
struct Form {
  bool lag = false, slow = false, play = false, scales = false, strokes = false, growth = false;
};

// What the numbers stand for.
struct Decoded {
  statics::ArmModel model;
  std::vector<model::Contraction> contraction;  // (actuators)
  // Unless empty, the model has it with these curves, scales and strokes.
  model::StiffnessTable bending;
  Eigen::VectorXd scale, stroke;  // (actuators)
  Eigen::VectorXd radius, phase;  // (sections) factors, and turns [rad]
  lie::SE3 X_FB;
  std::optional<Response> response;  // absent: each actuator's own
  bool sound = true;                 // false: a length is not > 0, or a curve turns
};

// The curves of the actuators that move, with knots and lengths before the fit.
struct Curve {
  std::string name;
  std::vector<double> knots, lengths;
  bool free = false;
};

// A series in the form that fits need, with what is derived from pressures alone.
class Recording {
 public:
  // @param turn_weight  of orientations, if there are any [m/rad].
  Recording(const SeriesPrior& prior, const TipSeries& tips, Eigen::Index most_rows,
            double turn_weight)
      : series(tips), lever(tips.rotation.empty() ? 0.0 : turn_weight) {
    const model::Arm& arm = prior.model.arm();
    int trial = -1;
    std::vector<Eigen::Index> seen;
    std::vector<int> trial_of;
    for (Eigen::Index row = 0; row < series.history.rows(); ++row) {
      trial += series.history.starts_anew[static_cast<std::size_t>(row)] ? 1 : 0;
      trial_of.push_back(trial);
      if (series.position.row(row).allFinite()) seen.push_back(row);
    }
    trials = trial + 1;
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
    for (Eigen::Index i = 0; i < span.size(); ++i) {
      moves.push_back(range > 0 && span[i] >= kTakesPart * range);
    }
    addCurves(arm);
  }

  Eigen::Index rows() const { return measured.rows(); }
  // The columns of deviations: of positions [m], and of orientations times the lever [m].
  auto placesOf(const Eigen::MatrixXd& deviation) const {
    return deviation.leftCols(measured.cols());
  }
  auto turnsOf(const Eigen::MatrixXd& deviation) const {
    return deviation.rightCols(deviation.cols() - measured.cols());
  }

  // Effective pressures (used x actuators) within the limits.
  Eigen::MatrixXd effective(const model::Arm& arm, const std::optional<Response>& response) const {
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

  // (used) whether a pressure changes too fast for the arm to be at rest.
  std::vector<bool> inMotion(const model::Arm& arm) const {
    Response rest;
    rest.rise_time = rest.fall_time = kRestLag;
    const Eigen::MatrixXd behind = effective(arm, Response()) - effective(arm, rest);
    std::vector<bool> out;
    for (Eigen::Index k = 0; k < rows(); ++k) {
      out.push_back(behind.row(k).cwiseAbs().maxCoeff() > kInMotion * range);
    }
    return out;
  }

  const TipSeries& series;
  double lever;                    // [m/rad]; 0 without orientations
  std::vector<Eigen::Index> used;  // rows that are compared
  std::vector<int> trial_at;       // (used)
  Eigen::MatrixXd measured;        // (used x 2 or 3) positions
  int trials = 0;
  double range = 0.0;       // of the pressures [Pa]
  std::vector<bool> moves;  // (actuators)
  std::vector<Curve> curves;
  std::vector<int> curve_of;  // (actuators)

 private:
  void addCurves(const model::Arm& arm) {
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      const std::string& name = arm.actuator(i).curve;
      auto found = std::find_if(curves.begin(), curves.end(),
                                [&name](const Curve& one) { return one.name == name; });
      if (found == curves.end()) found = curves.insert(found, Curve{name, {}, {}});
      found->free |= moves[static_cast<std::size_t>(i)];
      curve_of.push_back(static_cast<int>(found - curves.begin()));
    }
    for (std::size_t c = 0; c < curves.size(); ++c) setKnots(arm, static_cast<int>(c));
  }

  // Ends of the range, and quantiles of the pressures that are not close to each other.
  void setKnots(const model::Arm& arm, int c) {
    std::vector<double> pressures;
    const model::Contraction* contraction = nullptr;
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      if (curve_of[static_cast<std::size_t>(i)] != c) continue;
      if (contraction == nullptr) contraction = &arm.actuator(i).contraction;
      if (!moves[static_cast<std::size_t>(i)]) continue;
      for (const double p : series.history.input.col(i)) pressures.push_back(p);
    }
    std::sort(pressures.begin(), pressures.end());
    const model::Range limits = contraction->inputRange();
    const double gap = kLeastKnotGap * (limits.upper - limits.lower);
    Curve& curve = curves[static_cast<std::size_t>(c)];
    curve.knots = {limits.lower};
    for (int k = 0; k < kKnots && !pressures.empty(); ++k) {
      const double p =
          pressures[(pressures.size() - 1) * static_cast<std::size_t>(k) / (kKnots - 1)];
      if (p > curve.knots.back() + gap && p < limits.upper - gap) curve.knots.push_back(p);
    }
    curve.knots.push_back(limits.upper);
    for (const double p : curve.knots) curve.lengths.push_back(contraction->length(p));
  }
};

// z with the residuals there, in expected standard deviations.
struct Estimate {
  Eigen::VectorXd z, residual;
};

// The least squares of one form of the model.
class SeriesProblem {
 public:
  SeriesProblem(const SeriesPrior& prior, const Recording& recording, const SeriesOptions& options,
                const Form& form, const lie::SE3& X_FB, std::optional<Response> first)
      : prior_(prior),
        recording_(recording),
        options_(options),
        X_FB_(X_FB),
        first_(std::move(first)) {
    addArm(form);
    if (form.lag) {
      add({Kind::kRise, 0, 0, "rise_time_constant", "s", kTimePrior});
      add({Kind::kFall, 0, 0, "fall_time_constant", "s", kTimePrior});
    }
    if (form.slow) {
      add({Kind::kSlowTime, 0, 0, "slow_time_constant", "s", kTimePrior});
      add({Kind::kSlowWeight, 0, 0, "slow_weight", "", kWeightPrior});
    }
    if (form.play) {
      add({Kind::kReach, 0, 0, "play_1", "Pa", kTimePrior});
      add({Kind::kPlayWeight, 0, 0, "play_weight_1", "", kWeightPrior});
    }
    takes_part_.assign(recording.used.size(), true);
  }

  const std::vector<Number>& numbers() const { return numbers_; }
  Eigen::Index size() const { return static_cast<Eigen::Index>(numbers_.size()); }

  // Rows that count, and the variance of a coordinate with its correlation in time [m^2].
  void take(std::vector<bool> rows) { takes_part_ = std::move(rows); }
  void setVariance(double variance) { variance_ = variance; }

  Estimate at(const Eigen::VectorXd& z) const {
    const Decoded now = decode(z);
    if (!now.sound) return {z, Eigen::VectorXd::Constant(1, std::nan(""))};
    return {z, whole(z, deviation(tips(now, effective(now), takes_part_), now.X_FB))};
  }
  // Model - measured (used x 2 or 3, and 3 of an orientation) [m].
  Eigen::MatrixXd deviationAt(const Eigen::VectorXd& z) const {
    const Decoded now = decode(z);
    return deviation(tips(now, effective(now), std::vector<bool>(takes_part_.size(), true)),
                     now.X_FB);
  }

  // Mean of the tips at the start, seen from the base [m].
  Eigen::Vector3d meanTip() const {
    const Decoded now = decode(Eigen::VectorXd::Zero(size()));
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const lie::SE3& one : tips(now, effective(now), takes_part_)) sum += one.translation;
    return sum / static_cast<double>(recording_.rows());
  }

  // Of basics::descend().
  double cost(const Estimate& one) const { return one.residual.squaredNorm(); }
  Estimate moved(const Estimate& from, const Eigen::VectorXd& step) const {
    return at(from.z + step.cwiseMax(-kLongestStep).cwiseMin(kLongestStep));
  }
  basics::DenseEquations linearise(const Estimate& one) const {
    const Eigen::MatrixXd J = jacobian(one);
    return {J.transpose() * J, J.transpose() * one.residual};
  }
  Eigen::MatrixXd covariance(const Estimate& one) const {
    const Eigen::MatrixXd J = jacobian(one);
    return (J.transpose() * J).ldlt().solve(Eigen::MatrixXd::Identity(size(), size()));
  }

  // The start, or another fit's numbers of the same names.
  Eigen::VectorXd startFrom(const std::map<std::string, double>& known) const {
    Eigen::VectorXd z = Eigen::VectorXd::Zero(size());
    for (Eigen::Index k = 0; k < size(); ++k) {
      const auto found = known.find(number(k).name);
      if (found != known.end()) z[k] = found->second;
    }
    return z;
  }
  std::map<std::string, double> named(const Eigen::VectorXd& z) const {
    std::map<std::string, double> out;
    for (Eigen::Index k = 0; k < size(); ++k) out[number(k).name] = z[k];
    return out;
  }

  Decoded unchanged() const {
    const model::Arm& arm = prior_.model.arm();
    const auto actuators = Eigen::VectorXd::Ones(arm.actuatorCount());
    return {prior_.model,
            {},
            {},
            actuators,
            actuators,
            Eigen::VectorXd::Ones(arm.sectionCount()),
            Eigen::VectorXd::Zero(arm.sectionCount()),
            X_FB_,
            first_};
  }

  Decoded decode(const Eigen::VectorXd& z) const {
    Decoded out = unchanged();
    model::Stiffness factors{1, 1, 1};
    double K_eps = 1;
    std::vector<std::vector<double>> lengths;
    for (const Curve& curve : recording_.curves) lengths.push_back(curve.lengths);
    lie::Vector6 motion = lie::Vector6::Zero();
    for (Eigen::Index k = 0; k < size(); ++k) {
      const Number& one = number(k);
      const double factor = std::exp(z[k]);
      switch (one.kind) {
        case Kind::kKappa:
          factors.kappa *= factor;
          break;
        case Kind::kGrowth:
          factors.kappa *= std::min(factor, 1.0);  // the least one
          out.bending = growing(factor);
          break;
        case Kind::kGamma:
          factors.gamma = factor;
          break;
        case Kind::kTau:
          factors.tau = factor;
          break;
        case Kind::kEps:
          K_eps = factor;
          break;
        case Kind::kScale:
          if (one.of < 0)
            out.scale.setConstant(factor);
          else
            out.scale[one.of] = factor;
          break;
        case Kind::kStroke:
          out.stroke[one.of] = factor;
          break;
        case Kind::kRest:
        case Kind::kSlope:
          setLength(one, factor, lengths[static_cast<std::size_t>(one.of)]);
          break;
        case Kind::kRadius:
          out.radius[one.of] = factor;
          break;
        case Kind::kPhase:
          out.phase[one.of] = z[k];
          break;
        case Kind::kBase:
          motion[one.of] = z[k];
          break;
        default:
          setResponse(one.kind, z[k], *out.response);
      }
    }
    out.model = prior_.model.scaledStiffness(factors, K_eps);
    out.X_FB = X_FB_ * lie::SE3::exp(motion);
    setContractions(lengths, out);
    if (out.sound && changesModel(out)) setModel(out);
    return out;
  }

  // Value of a number as it is reported; those of curves and the base have none of their own.
  double valueOf(const Number& one, const Decoded& now) const {
    const model::Stiffness& stiffness = now.model.arm().actuator(0).stiffness;
    switch (one.kind) {
      case Kind::kKappa:
        return stiffness.kappa;
      case Kind::kGrowth:
        return now.bending.factor.back() / now.bending.factor.front();
      case Kind::kGamma:
        return stiffness.gamma;
      case Kind::kTau:
        return stiffness.tau;
      case Kind::kEps:
        return now.model.load()->K_eps.front();
      case Kind::kScale:
        return now.scale[std::max(one.of, 0)];
      case Kind::kStroke:
        return now.stroke[one.of];
      case Kind::kRadius:
        return now.radius[one.of];
      case Kind::kPhase:
        return now.phase[one.of];
      case Kind::kBase:
        return (prior_.X_BF * now.X_FB).log()[one.of];
      case Kind::kRise:
        return now.response->rise_time;
      case Kind::kFall:
        return now.response->fall_time;
      case Kind::kSlowTime:
        return now.response->slow_time;
      case Kind::kSlowWeight:
        return now.response->slow_weight;
      case Kind::kReach:
        return now.response->plays[0].reach;
      case Kind::kPlayWeight:
        return now.response->plays[0].weight;
      case Kind::kRest:
      case Kind::kSlope:
        break;
    }
    return std::numeric_limits<double>::quiet_NaN();
  }

 private:
  const Number& number(Eigen::Index k) const { return numbers_[static_cast<std::size_t>(k)]; }
  void add(Number one) { numbers_.push_back(std::move(one)); }

  void addArm(const Form& form) {
    const CalibrationOptions& arm = options_.arm;
    const double stiff = arm.stiffness_prior;
    if (arm.K_kappa) add({Kind::kKappa, 0, 0, "K_kappa", "m^2", stiff});
    if (form.growth) add({Kind::kGrowth, 0, 0, "K_kappa_growth", "", kGrowthPrior});
    if (arm.K_gamma) add({Kind::kGamma, 0, 0, "K_gamma", "", stiff});
    if (arm.K_tau) add({Kind::kTau, 0, 0, "K_tau", "m^2", stiff});
    if (arm.K_eps) add({Kind::kEps, 0, 0, "K_eps", "N", stiff});
    if (arm.length_scale == LengthScaling::kCommon) {
      add({Kind::kScale, -1, 0, "length_scale", "", arm.length_scale_prior});
    }
    for (int i = 0; form.scales && i < prior_.model.arm().actuatorCount(); ++i) {
      add({Kind::kScale, i, 0, "length_scale_" + std::to_string(i + 1), "",
           arm.length_scale_prior});
    }
    for (int i = 0; form.strokes && i < prior_.model.arm().actuatorCount(); ++i) {
      add({Kind::kStroke, i, 0, "stroke_scale_" + std::to_string(i + 1), "",
           arm.stroke_scale_prior});
    }
    for (std::size_t c = 0; arm.contraction && c < recording_.curves.size(); ++c) addCurve(c);
    for (int k = 0; k < prior_.model.arm().sectionCount(); ++k) {
      const std::string number = "_" + std::to_string(k + 1);
      if (options_.ring_radius)
        add({Kind::kRadius, k, 0, "ring_radius" + number, "", kRadiusPrior});
      if (options_.ring_phase && (k > 0 || !arm.base || recording_.lever > 0)) {
        add({Kind::kPhase, k, 0, "ring_phase" + number, "rad", arm.base_prior.rotation});
      }
    }
    static const char* const kEntries[] = {"x", "y", "z", "rx", "ry", "rz"};
    for (int i = 0; arm.base && i < 6; ++i) {
      const bool turn = i >= 3;
      add({Kind::kBase, i, 0, std::string("base_") + kEntries[i], turn ? "rad" : "m",
           turn ? arm.base_prior.rotation : kBasePrior * prior_.model.arm().restLength()});
    }
  }
  void addCurve(std::size_t c) {
    const Curve& curve = recording_.curves[c];
    if (!curve.free) return;
    const int of = static_cast<int>(c);
    add({Kind::kRest, of, 0, curve.name + " at rest", "", options_.arm.length_scale_prior});
    for (int j = 1; j < static_cast<int>(curve.knots.size()); ++j) {
      add({Kind::kSlope, of, j, curve.name + " slope " + std::to_string(j), "",
           j == 1 ? kSlopePrior : kBendPrior, j > 1});
    }
  }

  // Of one curve; the numbers come in the order of the knots.
  static void setLength(const Number& one, double factor, std::vector<double>& lengths) {
    const auto j = static_cast<std::size_t>(one.piece);
    const double change =
        j == 0 ? lengths[0] * (factor - 1) : (lengths[j] - lengths[j - 1]) * (factor - 1);
    for (std::size_t m = j; m < lengths.size(); ++m) lengths[m] += change;
  }

  static void setResponse(Kind kind, double z, Response& response) {
    const double factor = std::exp(z);
    const auto share = [z](double first, double most) {
      const double odds = first / (most - first) * std::exp(z);
      return most * odds / (1 + odds);
    };
    switch (kind) {
      case Kind::kRise:
        response.rise_time *= factor;
        break;
      case Kind::kFall:
        response.fall_time *= factor;
        break;
      case Kind::kSlowTime:
        response.slow_time *= factor;
        break;
      case Kind::kSlowWeight:
        response.slow_weight = share(response.slow_weight, Response::kMostWeight);
        break;
      case Kind::kReach:
        response.plays[0].reach *= factor;
        break;
      case Kind::kPlayWeight:
        response.plays[0].weight =
            share(kFirstWeight, 1.0) * (Response::kMostWeight - response.slow_weight);
        break;
      default:
        break;
    }
  }

  void setContractions(const std::vector<std::vector<double>>& lengths, Decoded& out) const {
    const model::Arm& arm = prior_.model.arm();
    std::vector<std::optional<model::Contraction>> fitted(lengths.size());
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      const auto c = static_cast<std::size_t>(recording_.curve_of[static_cast<std::size_t>(i)]);
      const Curve& curve = recording_.curves[c];
      const bool is_fitted = options_.arm.contraction && curve.free;
      if (is_fitted && !isCurve(lengths[c])) {
        out.sound = false;
        return;
      }
      if (is_fitted && !fitted[c]) {
        fitted[c] = model::Contraction::table(curve.knots, lengths[c]);
      }
      out.contraction.push_back(is_fitted ? *fitted[c] : arm.actuator(i).contraction);
      const double rest = out.contraction.back().restLength();
      out.sound &= rest + out.stroke[i] * (out.contraction.back().lengthRange().lower - rest) > 0;
    }
  }

  // K_kappa that is linear from one end of all limits to the other.
  // @param ratio  of its values there.
  model::StiffnessTable growing(double ratio) const {
    const model::Arm& arm = prior_.model.arm();
    model::Range all = arm.actuator(0).limits;
    for (int i = 1; i < arm.actuatorCount(); ++i) {
      all.lower = std::min(all.lower, arm.actuator(i).limits.lower);
      all.upper = std::max(all.upper, arm.actuator(i).limits.upper);
    }
    return {{all.lower, all.upper}, {std::max(1 / ratio, 1.0), std::max(ratio, 1.0)}};
  }

  // The model of the fitted rings and curves: its K_kappa follows from pressures, not from lengths
  // alone.
  static void setModel(Decoded& out) {
    const model::Arm& arm = out.model.arm();
    std::vector<model::Section> sections(static_cast<std::size_t>(arm.sectionCount()));
    for (int k = 0; k < arm.sectionCount(); ++k) {
      const Eigen::Matrix3d turn =
          Eigen::AngleAxisd(out.phase[k], Eigen::Vector3d::UnitX()).toRotationMatrix();
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
        move(actuator.X_O);
        for (lie::SE3& X : actuator.taper) move(X);
        actuator.contraction =
            out.contraction[static_cast<std::size_t>(i)].scaledBy(out.scale[i], out.stroke[i]);
      }
    }
    const statics::TierSetting setting = out.model.choice().setting;
    const bool planar = setting.tier == statics::Tier::kPlanar && !out.bending.empty();
    out.model = statics::ArmModel(
        model::Arm(std::move(sections), arm.tool()), std::nullopt, out.model.load(),
        planar ? statics::TierSetting{statics::Tier::kLinear, 0} : setting);
  }

  // Strictly monotone, and > 0.
  static bool isCurve(const std::vector<double>& lengths) {
    const bool rises = lengths.back() > lengths.front();
    for (std::size_t j = 0; j < lengths.size(); ++j) {
      const bool follows =
          j == 0 || (rises ? lengths[j] > lengths[j - 1] : lengths[j] < lengths[j - 1]);
      if (!(lengths[j] > 0) || !follows) return false;
    }
    return true;
  }

  Eigen::MatrixXd effective(const Decoded& now) const {
    return recording_.effective(prior_.model.arm(), now.response);
  }

  // Beyond stiffness, which the model scales, and lengths, which tips() takes.
  bool changesModel(const Decoded& now) const {
    return options_.ring_radius || options_.ring_phase || !now.bending.empty() ||
           readsPressures(prior_.model);
  }

  static bool readsPressures(const statics::ArmModel& model) {
    return statics::readsInputs(model.arm(), model.load() ? &*model.load() : nullptr);
  }

  // (used) tips seen from the base, of the rows that are asked for.
  static std::vector<lie::SE3> tips(const Decoded& now, const Eigen::MatrixXd& effective,
                                    const std::vector<bool>& rows) {
    std::vector<lie::SE3> out(rows.size());
    Eigen::VectorXd lengths(effective.cols());
    for (Eigen::Index row = 0; row < effective.rows(); ++row) {
      const auto k = static_cast<std::size_t>(row);
      if (!rows[k]) continue;
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

  Eigen::MatrixXd deviation(const std::vector<lie::SE3>& tips, const lie::SE3& X_FB) const {
    const Eigen::Index axes = recording_.measured.cols(), turns = recording_.lever > 0 ? 3 : 0;
    Eigen::MatrixXd out(recording_.rows(), axes + turns);
    for (Eigen::Index row = 0; row < out.rows(); ++row) {
      const lie::SE3 X_FT = X_FB * tips[static_cast<std::size_t>(row)];
      out.row(row).head(axes) =
          X_FT.translation.head(axes).transpose() - recording_.measured.row(row);
      if (turns == 0) continue;
      const Eigen::Matrix3d& seen =
          recording_.series.rotation[static_cast<std::size_t>(recording_.used[row])];
      const lie::SE3 turn{seen.transpose() * X_FT.rotation, Eigen::Vector3d::Zero()};
      out.row(row).tail<3>() = recording_.lever * turn.log().tail<3>();
    }
    return out;
  }

  // Deviations about the trials' offsets, which are eliminated under their prior, and the prior.
  Eigen::VectorXd whole(const Eigen::VectorXd& z, Eigen::MatrixXd deviation) const {
    const double offset = options_.rest_offset * options_.rest_offset;
    for (Eigen::Index begin = 0, end; begin < deviation.rows(); begin = end) {
      double count = 0;
      Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(deviation.cols());
      for (end = begin; end < deviation.rows() && sameTrial(begin, end); ++end) {
        if (!takes_part_[static_cast<std::size_t>(end)]) {
          deviation.row(end).setZero();
          continue;
        }
        sum += deviation.row(end);
        ++count;
      }
      if (count == 0 || offset == 0) continue;
      const Eigen::RowVectorXd taken =
          sum / count * (1 - std::sqrt(variance_ / (count * offset + variance_)));
      for (Eigen::Index row = begin; row < end; ++row) {
        if (takes_part_[static_cast<std::size_t>(row)]) deviation.row(row) -= taken;
      }
    }
    Eigen::VectorXd out(deviation.size() + size());
    out.head(deviation.size()) =
        Eigen::Map<const Eigen::VectorXd>(deviation.data(), deviation.size()) /
        std::sqrt(variance_);
    for (Eigen::Index k = 0; k < size(); ++k) {
      out[deviation.size() + k] = (z[k] - (number(k).chained ? z[k - 1] : 0)) / number(k).prior;
    }
    return out;
  }
  bool sameTrial(Eigen::Index a, Eigen::Index b) const {
    return recording_.trial_at[static_cast<std::size_t>(a)] ==
           recording_.trial_at[static_cast<std::size_t>(b)];
  }

  Eigen::MatrixXd jacobian(const Estimate& one) const {
    Eigen::MatrixXd J(one.residual.size(), size());
    const Decoded here = decode(one.z);
    const Eigen::MatrixXd pressures = effective(here);
    const std::vector<lie::SE3> tips_here = tips(here, pressures, takes_part_);
    for (Eigen::Index k = 0; k < size(); ++k) {
      Eigen::VectorXd z = one.z;
      z[k] += kDifference;
      const Decoded now = decode(z);
      const Kind kind = number(k).kind;
      const std::vector<lie::SE3> moved =
          kind == Kind::kBase
              ? tips_here
              : tips(now, isOfResponse(kind) ? effective(now) : pressures, takes_part_);
      J.col(k) = (whole(z, deviation(moved, now.X_FB)) - one.residual) / kDifference;
    }
    return J;
  }

  const SeriesPrior& prior_;
  const Recording& recording_;
  const SeriesOptions& options_;
  lie::SE3 X_FB_;
  std::optional<Response> first_;
  std::vector<Number> numbers_;
  std::vector<bool> takes_part_;
  double variance_ = kFirstCorrelation * std::pow(kFirstNoise * prior_.model.arm().restLength(), 2);
};

// Root mean square of the distances of some rows; NaN of none.
double rmsOf(const Eigen::MatrixXd& deviation, const std::vector<bool>& rows) {
  double sum = 0, count = 0;
  for (Eigen::Index k = 0; k < deviation.rows(); ++k) {
    if (!rows[static_cast<std::size_t>(k)]) continue;
    sum += deviation.row(k).squaredNorm();
    ++count;
  }
  return std::sqrt(sum / count);
}

// With the mean of each trial taken off, over the rows that count.
Eigen::MatrixXd aboutOffsets(const Recording& recording, Eigen::MatrixXd deviation,
                             const std::vector<bool>& counts) {
  for (int trial = 0; trial < recording.trials; ++trial) {
    std::vector<Eigen::Index> rows;
    for (Eigen::Index k = 0; k < deviation.rows(); ++k) {
      const auto row = static_cast<std::size_t>(k);
      if (counts[row] && recording.trial_at[row] == trial) rows.push_back(k);
    }
    if (rows.empty()) continue;
    const Eigen::RowVectorXd mean = deviation(rows, Eigen::all).colwise().mean();
    for (const Eigen::Index k : rows) deviation.row(k) -= mean;
  }
  return deviation;
}
Eigen::MatrixXd aboutOffsets(const Recording& recording, const Eigen::MatrixXd& deviation) {
  return aboutOffsets(recording, deviation, std::vector<bool>(recording.used.size(), true));
}

// @param whole, about  deviations, and those about the trials' offsets.
SeriesResidual residualOf(const Recording& recording, const Eigen::MatrixXd& whole,
                          const Eigen::MatrixXd& about, const std::vector<bool>& rows) {
  SeriesResidual out;
  const Eigen::MatrixXd deviation = recording.placesOf(whole);
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(deviation.cols());
  for (Eigen::Index k = 0; k < deviation.rows(); ++k) {
    if (!rows[static_cast<std::size_t>(k)]) continue;
    ++out.rows;
    sum += deviation.row(k);
    out.worst = std::max(out.worst, deviation.row(k).norm());
  }
  out.offset = (sum / std::max(out.rows, 1)).transpose();
  out.rms = rmsOf(deviation, rows);
  out.rms_about_offset = rmsOf(recording.placesOf(about), rows);
  const bool turns = recording.lever > 0;
  out.rms_turn = turns ? rmsOf(recording.turnsOf(whole), rows) / recording.lever : std::nan("");
  return out;
}

// Factor by which residuals that are correlated in time raise a variance, >= 1: 1 + 2 sum rho_k of
// the correlations at k rows, as long as they are > 0.
double correlationFactor(const Recording& recording, const Eigen::MatrixXd& deviation) {
  const double square = deviation.squaredNorm();
  double factor = 1.0;
  for (Eigen::Index lag = 1; lag < deviation.rows() && square > 0; ++lag) {
    double product = 0;
    for (Eigen::Index k = lag; k < deviation.rows(); ++k) {
      const auto row = static_cast<std::size_t>(k), before = static_cast<std::size_t>(k - lag);
      if (recording.trial_at[row] != recording.trial_at[before]) continue;
      product += deviation.row(k).dot(deviation.row(k - lag));
    }
    if (product <= 0) break;
    factor += 2 * product / square;
  }
  return factor;
}

bool carriesLoad(const SeriesPrior& prior) {
  return prior.model.load() && !prior.model.load()->empty();
}

// A form of the model, fitted.
struct Fitted {
  Form form;
  std::shared_ptr<SeriesProblem> problem;
  Estimate at;
  // RMS error of each block that was left out, and that about the trials' offsets in it [m].
  Eigen::ArrayXd held_out, about;
  Eigen::MatrixXd without;  // (blocks x numbers) z without each block
};

// The fit in its steps.
class SeriesJob {
 public:
  SeriesJob(const SeriesPrior& prior, const Recording& recording, const SeriesOptions& options)
      : prior_(prior), recording_(recording), options_(options), X_FB_(prior.X_BF.inverse()) {
    setBlocks();
  }

  SeriesFit run() {
    SeriesFit out;
    if (options_.response) first_ = Response();
    if (options_.arm.base) chooseBase(out);
    Fitted best = fitted({}, {});
    leaveOut(best);
    if (options_.response) considerResponse(best, out);
    if (options_.arm.length_scale == LengthScaling::kEach) {
      consider("length scales", &Form::scales, best, out);
    }
    if (options_.arm.stroke_scale) consider("strokes", &Form::strokes, best, out);
    if (mayGrow()) consider("K_kappa against pressure", &Form::growth, best, out);
    report(best, out);
    return out;
  }

 private:
  // Trials, or groups of them; of fewer than three, parts of the series.
  void setBlocks() {
    const auto rows = recording_.used.size();
    blocks_ = std::min(recording_.trials, kFolds);
    for (std::size_t k = 0; k < rows; ++k) {
      block_of_.push_back(recording_.trial_at[k] % std::max(blocks_, 1));
    }
    if (recording_.trials >= kLeastTrials) return;
    blocks_ = kBlocks;
    for (std::size_t k = 0; k < rows; ++k) {
      block_of_[k] = static_cast<int>(k * static_cast<std::size_t>(blocks_) / rows);
    }
  }

  // Whether K_kappa can depend on pressure, and does not yet.
  bool mayGrow() const {
    const model::Arm& arm = prior_.model.arm();
    bool out = options_.arm.K_kappa;
    for (int k = 0; k < arm.sectionCount(); ++k) {
      out &= arm.bending(k).empty() && arm.needForTables(k) == nullptr;
    }
    for (int i = 0; i < arm.actuatorCount(); ++i) out &= model::isPressure(arm.actuator(i).drive);
    return out;
  }

  // What a form begins with, beyond what another fit knows.
  std::optional<Response> startOf(const Form& form) const {
    if (!first_) return first_;
    Response response = *first_;
    if (form.lag) response.rise_time = response.fall_time = kFirstLag;
    if (form.slow) {
      response.slow_time = kFirstSlowTime;
      response.slow_weight = kFirstWeight;
    }
    if (form.play) {
      response.play_count = 1;
      response.plays[0] = {recording_.range * kFirstReach, kFirstWeight};
    }
    return response;
  }

  Fitted fitted(const Form& form, const std::map<std::string, double>& known) const {
    Fitted out{
        form,
        std::make_shared<SeriesProblem>(prior_, recording_, options_, form, X_FB_, startOf(form)),
        {},
        {},
        {},
        {}};
    SeriesProblem& problem = *out.problem;
    out.at = bestStart(problem, known);
    for (int round = 0; round < kRounds; ++round) {
      out.at = basics::descend(problem, problem.at(out.at.z), round == 0 ? kBrief : kWhole).at;
      const Eigen::MatrixXd about = aboutOffsets(recording_, problem.deviationAt(out.at.z));
      setVariance(about, round == 0 ? kSearching : kFound, problem);
    }
    out.at = problem.at(out.at.z);
    return out;
  }

  // What the model cannot describe repeats with the motion, so that residuals count as few
  // readings.
  void setVariance(const Eigen::MatrixXd& about, double readings_per_number,
                   SeriesProblem& problem) const {
    const double readings = readings_per_number * static_cast<double>(problem.size());
    problem.setVariance(varianceOf(about) *
                        std::max(static_cast<double>(about.size()) / readings, 1.0));
  }
  static double varianceOf(const Eigen::MatrixXd& about) {
    return std::max(about.squaredNorm() / static_cast<double>(about.size()),
                    kLeastNoise * kLeastNoise);
  }

  // Of several times for what is new in a form, the best to start from.
  Estimate bestStart(const SeriesProblem& problem,
                     const std::map<std::string, double>& known) const {
    const Eigen::VectorXd z = problem.startFrom(known);
    Estimate best = problem.at(z);
    for (const double shift : {-2.0, -1.0, 1.0, 2.0}) {
      Eigen::VectorXd moved = z;
      for (Eigen::Index k = 0; k < z.size(); ++k) {
        const Number& one = problem.numbers()[static_cast<std::size_t>(k)];
        const bool is_new = isOfResponse(one.kind) && known.count(one.name) == 0;
        if (is_new && !isWeight(one.kind)) moved[k] += shift;
      }
      Estimate there = problem.at(moved);
      if (problem.cost(there) < problem.cost(best)) best = std::move(there);
    }
    return best;
  }

  // Fits without each block in turn.
  void leaveOut(Fitted& fit) const {
    fit.without.resize(blocks_, fit.at.z.size());
    fit.held_out.resize(blocks_);
    fit.about.resize(blocks_);
    SeriesProblem problem = *fit.problem;
    for (int block = 0; block < blocks_; ++block) {
      std::vector<bool> in, out;
      for (const int one : block_of_) {
        in.push_back(one != block);
        out.push_back(one == block);
      }
      problem.take(in);
      const Estimate without = basics::descend(problem, problem.at(fit.at.z), kBrief).at;
      fit.without.row(block) = without.z;
      const Eigen::MatrixXd deviation = problem.deviationAt(without.z);
      fit.held_out[block] = rmsOf(recording_.placesOf(deviation), out);
      fit.about[block] = rmsOf(aboutOffsets(recording_, deviation, out), out);
    }
  }

  // Adds a part where it predicts what is left out better, in proportion: how large a block's
  // errors are depends on how far the arm moves in it, and its offset is not what a part explains.
  // @return whether it was added.
  bool consider(const char* name, bool Form::*part, Fitted& best, SeriesFit& out) const {
    Form form = best.form;
    form.*part = true;
    Fitted with = fitted(form, best.problem->named(best.at.z));
    leaveOut(with);
    const Eigen::ArrayXd gain = (best.about / with.about).log();
    const double whole = (best.held_out / with.held_out).log().sum();
    const auto n = static_cast<double>(gain.size());
    const double scatter =
        std::sqrt((gain - gain.mean()).square().sum() / std::max(n * (n - 1), 1.0));
    const bool kept = gain.mean() > std::max(kSignificant * scatter, kLeastGain) && whole > 0;
    const double unit = std::sqrt(best.about.square().mean());
    const Choice choice{name, kept, unit * gain.mean(), unit * scatter};
    const auto before = std::find_if(out.choices.begin(), out.choices.end(),
                                     [name](const Choice& one) { return one.part == name; });
    if (before == out.choices.end()) {
      out.choices.push_back(choice);
    } else {
      *before = choice;
    }
    if (kept) best = std::move(with);
    return kept;
  }

  // Those of the response, and once more what was left out before another part was added.
  void considerResponse(Fitted& best, SeriesFit& out) const {
    const std::pair<const char*, bool Form::*> parts[] = {
        {"lag", &Form::lag}, {"slow state", &Form::slow}, {"play", &Form::play}};
    const char* last = nullptr;
    for (const auto& [name, part] : parts) last = consider(name, part, best, out) ? name : last;
    for (const auto& [name, part] : parts) {
      if (last == nullptr || name == last) return;
      if (!(best.form.*part)) consider(name, part, best, out);
    }
  }

  // A fit to few of the rows, from a base.
  struct Rough {
    lie::SE3 start, X_FB;
    double error;  // RMS about the trials' offsets [m]
  };
  Rough roughFit(const lie::SE3& X_FB, const Form& form) const {
    SeriesProblem problem(prior_, recording_, options_, form, X_FB, startOf(form));
    std::vector<bool> few(recording_.used.size());
    for (std::size_t k = 0; k < few.size(); k += kCoarse) few[k] = true;
    problem.take(few);
    Estimate found = basics::descend(problem, bestStart(problem, {}), kBrief).at;
    Eigen::MatrixXd about = aboutOffsets(recording_, problem.deviationAt(found.z));
    if (form.lag) {
      setVariance(about, kSearching, problem);
      found = basics::descend(problem, problem.at(found.z), kBrief).at;
      about = aboutOffsets(recording_, problem.deviationAt(found.z));
    }
    return {X_FB, problem.decode(found.z).X_FB, rmsOf(about, few)};
  }

  // The scene's base, or one that the motion tells: frames of motion capture have any axes. What a
  // response explains can hide which one is right, so those that come near are fitted with one; of
  // those that fit alike, the nearest to the scene's is taken.
  void chooseBase(SeriesFit& out) {
    const Eigen::Vector3d tip =
        SeriesProblem(prior_, recording_, options_, {}, {}, first_).meanTip();
    Eigen::Vector3d seen = Eigen::Vector3d::Zero();
    seen.head(recording_.measured.cols()) = recording_.measured.colwise().mean().transpose();
    std::vector<Rough> found;
    for (const Eigen::Matrix3d& turn : quarterTurns()) {
      found.push_back(roughFit({turn, seen - turn * tip}, {}));
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
    Form form;
    form.lag = form.slow = options_.response;
    for (Rough& one : rivals) one = roughFit(one.start, form);
    takeBase(rivals, out);
  }

  void takeBase(const std::vector<Rough>& rivals, SeriesFit& out) {
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
    out.rules.push_back(basics::messageOf(
        "base: the frame of the positions is turned by about ", std::round(turned * 180 / M_PI),
        " deg against that of the scene: found from the motion, to within an exchange of the axes "
        "that fits as well"));
  }

  bool isNear(const Rough& a, const Rough& b) const {
    const lie::SE3 between = a.X_FB.inverse() * b.X_FB;
    return between.log().tail<3>().norm() < kNearTurn &&
           between.translation.norm() < kNearPlace * prior_.model.arm().restLength();
  }

  // The 24 rotations that exchange axes.
  static std::vector<Eigen::Matrix3d> quarterTurns() {
    std::vector<Eigen::Matrix3d> out;
    for (int a = 0; a < 3; ++a) {
      for (int b = 0; b < 3; ++b) {
        for (int signs = 0; a != b && signs < 4; ++signs) {
          Eigen::Matrix3d turn = Eigen::Matrix3d::Zero();
          turn(a, 0) = signs % 2 == 0 ? 1 : -1;
          turn(b, 1) = signs / 2 == 0 ? 1 : -1;
          turn.col(2) = turn.col(0).cross(turn.col(1));
          out.push_back(turn);
        }
      }
    }
    return out;
  }

  void report(const Fitted& fit, SeriesFit& out) const {
    const SeriesProblem& problem = *fit.problem;
    const Decoded now = problem.decode(fit.at.z);
    reportNumbers(fit, now, out);
    const CalibrationOptions& arm = options_.arm;
    if (arm.K_kappa || arm.K_gamma || arm.K_tau) {
      out.stiffness = now.model.arm().actuator(0).stiffness;
    }
    if (!now.bending.empty()) out.bending = now.bending;
    if (arm.K_eps) out.K_eps = now.model.load()->K_eps.front();
    if (!carriesLoad(prior_)) {
      out.rules.push_back(
          "K_eps: the arm of the series carries no load, so that the data cannot tell how far a "
          "load moves it; fit K_eps to a series with a load before predictions with one");
    }
    if (arm.length_scale != LengthScaling::kNone) out.length_scale = now.scale;
    if (arm.stroke_scale) out.stroke_scale = now.stroke;
    if (options_.ring_radius) out.ring_radius = now.radius;
    if (options_.ring_phase) out.ring_phase = now.phase;
    if (recording_.lever > 0 && arm.rotation_noise == 0) {
      out.rules.push_back(basics::messageOf(
          "orientation: 1 deg counts as ", 1e3 * recording_.lever * M_PI / 180,
          " mm of the tip, by ",
          "which it moves as the arm bends; the scene's vision.tag_rotation_noise_deg beside "
          "tag_position_noise_m states another weight"));
    }
    if (options_.ring_phase && arm.base && recording_.lever == 0) {
      out.rules.push_back(
          "ring_phase_1: a turn of the base about the arm's axis moves the tip alike; the base has "
          "it");
    }
    for (std::size_t c = 0; arm.contraction && c < recording_.curves.size(); ++c) {
      const Curve& curve = recording_.curves[c];
      if (!curve.free) continue;
      FittedCurve shown{curve.name, curve.knots, {}};
      const auto i =
          std::find(recording_.curve_of.begin(), recording_.curve_of.end(), static_cast<int>(c)) -
          recording_.curve_of.begin();
      for (const double p : curve.knots) {
        shown.length.push_back(now.contraction[static_cast<std::size_t>(i)].length(p));
      }
      out.curves.push_back(std::move(shown));
    }
    out.X_BF = now.X_FB.inverse();
    if (now.response) out.response = *now.response;
    const Eigen::MatrixXd deviation = problem.deviationAt(fit.at.z);
    const std::vector<bool> all(recording_.used.size(), true);
    const SeriesResidual residual =
        residualOf(recording_, deviation, aboutOffsets(recording_, deviation), all);
    out.rms = residual.rms;
    out.rms_about_offset = residual.rms_about_offset;
    out.rms_turn = residual.rms_turn;
    out.held_out_rms = std::sqrt(fit.held_out.square().mean());
  }

  void reportNumbers(const Fitted& fit, const Decoded& now, SeriesFit& out) const {
    SeriesProblem problem = *fit.problem;
    const Decoded before = problem.decode(Eigen::VectorXd::Zero(problem.size()));
    const Eigen::MatrixXd residuals = aboutOffsets(recording_, problem.deviationAt(fit.at.z));
    problem.setVariance(varianceOf(residuals) * correlationFactor(recording_, residuals));
    const Eigen::VectorXd noise = problem.covariance(problem.at(fit.at.z)).diagonal().cwiseSqrt();
    const double blocks = static_cast<double>(fit.without.rows());
    const Eigen::MatrixXd about = fit.without.rowwise() - fit.without.colwise().mean();
    const Eigen::VectorXd left_out =
        (about.colwise().squaredNorm() * (blocks - 1) / blocks).cwiseSqrt().transpose();
    for (Eigen::Index k = 0; k < problem.size(); ++k) {
      const Number& one = problem.numbers()[static_cast<std::size_t>(k)];
      const double value = problem.valueOf(one, now);
      if (std::isnan(value)) continue;
      Eigen::VectorXd z = fit.at.z;
      z[k] += kDifference;
      const bool turn = one.kind == Kind::kBase || one.kind == Kind::kPhase;
      const double slope =
          turn ? 1.0 : (problem.valueOf(one, problem.decode(z)) - value) / kDifference;
      const double deviation = std::max(noise[k], left_out[k]);
      const double error = std::abs(slope) * deviation;
      const double initial = turn ? 0.0 : problem.valueOf(one, before);
      out.parameters.push_back(
          {one.name, one.unit, initial, value, error, isKnown(one, value, deviation, error)});
      if (!out.parameters.back().identifiable) noteUnknown(one, out);
    }
    if (options_.arm.contraction && recording_.lever == 0) {
      out.rules.push_back(
          "contraction: an actuator lengthens or shortens under pressure as in the scene, since an "
          "arm of the other kind, turned by half a turn, moves alike");
    }
  }

  bool isKnown(const Number& one, double value, double deviation, double error) const {
    if (deviation > one.prior / 2) return false;
    if (one.kind == Kind::kPhase) return error <= kBaseTurn;
    if (one.kind != Kind::kBase) return error <= kLargestRelativeError * std::abs(value);
    return error <= (one.of < 3 ? kBaseLength * prior_.model.arm().restLength() : kBaseTurn);
  }

  static void noteUnknown(const Number& one, SeriesFit& out) {
    const char* held = nullptr;
    if (one.kind == Kind::kBase && one.of == 3) {
      held = "a turn of the base about the arm's axis and the directions of its actuators";
    } else if (one.kind == Kind::kBase) {
      held = "pose of the base, bend and length of the arm at rest";
    } else if (one.kind == Kind::kRadius) {
      held = "radius of a ring, strokes and bending stiffness, which bend the arm alike";
    } else if (one.kind == Kind::kPhase) {
      held = "phase of a ring, of which only actuators that move tell";
    } else if (one.kind == Kind::kScale) {
      held = "length scales of actuators that hardly move, and bend at rest";
    } else if (one.kind == Kind::kStroke) {
      held = "the strokes of all actuators, slope of their curve and stiffness";
    } else if (one.kind == Kind::kGamma) {
      held = "shear stiffness of actuators along the arm, which nothing shows";
    }
    if (held == nullptr) return;
    out.rules.push_back(one.name + ": the data cannot tell " + held +
                        "; held near its start by its prior");
  }

  const SeriesPrior& prior_;
  const Recording& recording_;
  const SeriesOptions& options_;
  lie::SE3 X_FB_;
  std::optional<Response> first_;
  int blocks_ = 0;
  std::vector<int> block_of_;  // (used)
};

// Why nothing can be fitted; empty if it can.
std::string faultOf(const SeriesPrior& prior, const Recording& recording,
                    const SeriesOptions& options) {
  if (options.arm.K_eps && !carriesLoad(prior)) {
    return "K_eps shows under a load alone, but the scene has none; expected one with a load, or a "
           "fit without K_eps";
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
  const double length = prior.model.arm().restLength();
  const Eigen::MatrixXd about = recording.measured.rowwise() - recording.measured.colwise().mean();
  const double motion = std::sqrt(about.squaredNorm() / static_cast<double>(about.rows()));
  if (motion < kLeastMotion * length || motion > kMostMotion * length) {
    return basics::messageOf("the positions vary by ", 1e3 * motion, " mm (RMS) about their mean; ",
                             "expected ", 1e3 * kLeastMotion * length, " to ",
                             1e3 * kMostMotion * length, " mm for an arm of ", 1e3 * length,
                             " mm: check that they are of its tip, and in metres");
  }
  return {};
}

}  // namespace

SeriesFit fitSeries(const SeriesPrior& prior, const TipSeries& series,
                    const SeriesOptions& options) {
  SeriesFit refused;
  const CalibrationOptions& arm = options.arm;
  const double lever = arm.rotation_noise > 0 ? arm.position_noise / arm.rotation_noise
                                              : kBendLever * prior.model.arm().restLength();
  Recording recording(prior, series, kMostRows, lever);
  for (Curve& one : recording.curves)
    one.free &= options.curve.empty() || one.name == options.curve;
  refused.failure = faultOf(prior, recording, options);
  if (!refused.failure.empty()) return refused;
  return SeriesJob(prior, recording, options).run();
}

SeriesComparison compareSeries(const SeriesPrior& arm, const TipSeries& series) {
  const Recording recording(arm, series, series.history.rows(), 1.0);
  SeriesOptions none;
  none.arm.K_kappa = none.arm.K_gamma = false;
  const SeriesProblem problem(arm, recording, none, {}, arm.X_BF.inverse(), std::nullopt);
  SeriesComparison out;
  out.rows = recording.used;
  const Eigen::MatrixXd deviation = problem.deviationAt(Eigen::VectorXd());
  const Eigen::MatrixXd about = aboutOffsets(recording, deviation);
  out.deviation = recording.placesOf(deviation);
  const std::vector<bool> moving = recording.inMotion(arm.model.arm());
  for (int trial = 0; trial < recording.trials; ++trial) {
    std::vector<bool> own, still, in_motion;
    for (std::size_t k = 0; k < recording.used.size(); ++k) {
      own.push_back(recording.trial_at[k] == trial);
      still.push_back(own.back() && !moving[k]);
      in_motion.push_back(own.back() && moving[k]);
    }
    out.trials.push_back(residualOf(recording, deviation, about, own));
    out.trials.back().rms_at_rest = rmsOf(out.deviation, still);
    out.trials.back().rms_in_motion = rmsOf(out.deviation, in_motion);
  }
  out.all = residualOf(recording, deviation, about, std::vector<bool>(recording.used.size(), true));
  std::vector<bool> still = moving;
  still.flip();
  out.all.rms_at_rest = rmsOf(out.deviation, still);
  out.all.rms_in_motion = rmsOf(out.deviation, moving);
  return out;
}

}  // namespace helix_arm::estimation
