#include "helix_arm/tracking/arm_filter.hpp"

#include <Eigen/Cholesky>
#include <array>
#include <cmath>
#include <utility>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/tracking/mode_estimator.hpp"

namespace helix_arm::estimation {
namespace {

constexpr char kCulprit[] = "arm filter";
constexpr double kStiffnessStep = 1e-3;  // of logarithms, in central differences
// The error of a pressure persists for about half a second, which is fifteen pictures.
constexpr double kPressurePersistence = 15.0;
// The error due to a vibration persists for about ten pictures.
constexpr double kSwingPersistence = 10.0;
// Play of an actuator: by how much the variance of its effective pressure grows for each Pa by
// which its pressure changes [Pa]. Of small changes nothing may arrive.
constexpr double kPlay = 1000.0;
// That is a bound, so that play is no force. Usual are a smaller part of it and, of each change,
// what lags and vibrations that are not known keep away: of 20 kPa 1.4 kPa and 2.4 kPa.
constexpr double kUsualPlay = 100.0;  // [Pa]
constexpr double kUsualLate = 0.12;
constexpr double kFarthestTheta = 4.0;  // in standard deviations; beyond it the model is not linear
constexpr int kMostOutliers = 2;        // consecutive ones; a third one indicates a change
// Smallest pivot of a covariance that counts as positive, relative to its largest entry.
constexpr double kLeastPivot = 1e-13;
// Largest difference of opposite entries of a covariance, relative to the deviations.
constexpr double kAsymmetry = 1e-6;
// Deviations of measured twists [m, rad]. A fiftieth of the wavelength of light is below what any
// camera resolves, and would hold the filter to this one picture. Ten metres are the longest arm,
// and ten radians more than a turn: a picture that leaves a shape open by as much measures none,
// and the numbers of the update would soon overflow.
constexpr double kLeastDeviation = 1e-8, kMostDeviation = 10.0;

bool isPositiveDefinite(const Eigen::MatrixXd& matrix) {
  if (!(matrix.diagonal().minCoeff() > 0)) return false;
  // The factorisation reads one half of the matrix, the update uses both.
  const Eigen::VectorXd deviation = matrix.diagonal().cwiseSqrt();
  const Eigen::ArrayXXd bound = kAsymmetry * deviation * deviation.transpose();
  if (!((matrix - matrix.transpose()).array().abs() <= bound).all()) return false;
  const Eigen::LDLT<Eigen::MatrixXd> factors(matrix);
  return factors.info() == Eigen::Success &&
         factors.vectorD().minCoeff() > kLeastPivot * matrix.diagonal().maxCoeff();
}

constexpr int kMostLengthScales = 12;  // with more actuators, one per section
constexpr int kMostStrokes = 6;        // of an arm with more actuators they are not estimated

bool hasEntry(const model::Arm& arm, double model::Stiffness::*entry) {
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    if (arm.actuator(i).stiffness.*entry > 0) return true;
  }
  return false;
}

/// The parameters theta of an ArmFilter: logarithms of factors on an arm's stiffness ratios, on
/// K_eps under load, and on lengths: one per actuator, or one per section of an arm with many.
class ArmParameters {
 public:
  ArmParameters(const statics::ArmModel& model, const ArmFilterOptions& options) {
    using Of = statics::Correction;
    const model::Arm& arm = model.arm();
    const model::Stiffness& deviation = options.stiffness_deviation;
    std::vector<int> rows;  // of the options' correlation
    const auto add = [&](bool has, int row, const char* name, double sd, Factor factor) {
      if (!has) return;
      rows.push_back(row);
      stiffness_.push_back(factor);
      addNamed(name, sd);
    };
    add(hasEntry(arm, &model::Stiffness::gamma), 0, "K_gamma", deviation.gamma,
        [](Of& of) -> double& { return of.stiffness_factors.gamma; });
    add(hasEntry(arm, &model::Stiffness::kappa), 1, "K_kappa", deviation.kappa,
        [](Of& of) -> double& { return of.stiffness_factors.kappa; });
    add(hasEntry(arm, &model::Stiffness::tau), 2, "K_tau", deviation.tau,
        [](Of& of) -> double& { return of.stiffness_factors.tau; });
    add(statics::takesLoad(model.choice().setting.tier), 3, "K_eps", options.K_eps_deviation,
        [](Of& of) -> double& { return of.K_eps_factor; });
    correlation_ = options.stiffness_correlation(rows, rows);
    const int n = arm.actuatorCount();
    if (n <= kMostLengthScales) {
      for (int i = 0; i < n; ++i) {
        addLengths({i, i + 1}, "length of " + arm.actuator(i).name, options.length_deviation);
      }
    } else {
      for (int k = 0; k < arm.sectionCount(); ++k) {
        addLengths({arm.firstActuator(k), arm.firstActuator(k + 1)},
                   "lengths of section " + std::to_string(k + 1), options.length_deviation);
      }
    }
    const bool learns_strokes = n <= kMostStrokes && options.stroke_deviation > 0;
    for (int i = 0; learns_strokes && i < n; ++i) {
      addNamed("stroke of " + arm.actuator(i).name, options.stroke_deviation);
      rest_.push_back(arm.actuator(i).contraction.restLength());
    }
  }

  int count() const { return static_cast<int>(names_.size()); }
  /// First those on the stiffness, then length scales, then strokes of all actuators or none.
  int stiffnessCount() const { return static_cast<int>(stiffness_.size()); }
  int strokesBegin() const { return stiffnessCount() + static_cast<int>(spans_.size()); }
  int strokeCount() const { return static_cast<int>(rest_.size()); }
  const std::vector<std::string>& names() const { return names_; }
  const Eigen::VectorXd& deviations() const { return deviations_; }
  /// (stiffnessCount())^2; length scales are not correlated with anything.
  const Eigen::MatrixXd& stiffnessCorrelation() const { return correlation_; }
  /// First actuator of a length scale, and the first one after it.
  struct Span {
    int begin, end;
  };
  Span actuatorsOf(int parameter) const {
    return spans_[static_cast<std::size_t>(parameter - stiffnessCount())];
  }

  /// Sets the factors of a correction; its offset stays.
  void apply(const Eigen::VectorXd& theta, statics::Correction& correction) const {
    for (int j = 0; j < strokesBegin(); ++j) {
      const double factor = std::exp(theta[j]);
      if (j >= stiffnessCount()) {
        const Span span = actuatorsOf(j);
        correction.length_scale.segment(span.begin, span.end - span.begin).setConstant(factor);
        continue;
      }
      stiffness_[static_cast<std::size_t>(j)](correction) = factor;
    }
    for (int i = 0; i < strokeCount(); ++i) {
      const double stroke = std::exp(theta[strokesBegin() + i]),
                   length = correction.length_scale[i];
      correction.length_scale[i] = length * stroke;
      correction.length_shift[i] = length * (1 - stroke) * rest_[static_cast<std::size_t>(i)];
    }
  }

 private:
  using Factor = double& (*)(statics::Correction&);

  void addLengths(Span span, const std::string& name, double deviation) {
    spans_.push_back(span);
    addNamed(name, deviation);
  }

  void addNamed(const std::string& name, double deviation) {
    names_.push_back(name);
    deviations_.conservativeResize(count());
    deviations_[count() - 1] = deviation;
  }

  std::vector<Factor> stiffness_;
  std::vector<Span> spans_;
  std::vector<double> rest_;  // lengths of the actuators with a stroke [m]
  std::vector<std::string> names_;
  Eigen::VectorXd deviations_;
  Eigen::MatrixXd correlation_;
};

}  // namespace

void ArmFilterOptions::validate() const {
  basics::requireNotNegative(kCulprit,
                             {{"the hysteresis", hysteresis}, {"the creep [s^-1/2]", creep}});
  basics::requirePositive(kCulprit, {{"the bias of v [m]", bias_translation},
                                     {"the bias of w [rad]", bias_rotation},
                                     {"the settling time [s]", settling_time},
                                     {"the deviation of K_gamma", stiffness_deviation.gamma},
                                     {"the deviation of K_tau", stiffness_deviation.tau},
                                     {"the deviation of K_kappa", stiffness_deviation.kappa},
                                     {"the deviation of K_eps", K_eps_deviation},
                                     {"the deviation of lengths", length_deviation}});
  basics::requireNotNegative(kCulprit, "the deviation of strokes", stroke_deviation);
  basics::require(
      (stiffness_correlation.diagonal().array() == 1).all() &&
          isPositiveDefinite(stiffness_correlation),
      kCulprit,
      ": the correlation of the stiffness is not symmetric and positive definite with 1 on its "
      "diagonal");
}

const char* nameOf(ObservationFault fault) {
  static constexpr std::array<const char*, kObservationFaultCount> kNames = {
      "none",       "future",       "not_newer",   "too_old",    "wrong_size",
      "not_finite", "not_positive", "implausible", "unbalanced", "outlier"};
  return kNames[static_cast<std::size_t>(fault)];
}

double outlierLimit(int degrees) {
  // Wilson and Hilferty's approximation.
  const double d = degrees;
  const double root = 1 - 2 / (9 * d) + 3.72 * std::sqrt(2 / (9 * d));
  return d * root * root * root;
}

struct ArmFilter::Workspace {
  Workspace(const statics::ArmModel& given, const ArmFilterOptions& given_options)
      : options((given_options.validate(), given_options)),
        parameters(given, options),
        arm(given.arm()),
        model(given),
        probe(given),
        correction(arm) {
    for (int k = 0; k < arm.sectionCount(); ++k) {
      for (int row = 0; row < 6; ++row) {
        if (options.planar && (row == 2 || row == 3 || row == 4)) continue;
        rows.push_back(6 * k + row);
      }
    }
    const auto size = static_cast<Eigen::Index>(rows.size());
    bias_deviation.resize(size);
    for (Eigen::Index i = 0; i < size; ++i) {
      bias_deviation[i] = rows[static_cast<std::size_t>(i)] % 6 < 3 ? options.bias_translation
                                                                    : options.bias_rotation;
    }
    scale.resize(parameters.count() + size);
    scale << parameters.deviations(), bias_deviation;
    start();
  }

  void start() {
    state.mean = Eigen::VectorXd::Zero(scale.size());
    state.covariance = scale.cwiseAbs2().asDiagonal();
    const Eigen::Index stiffness = parameters.stiffnessCount();
    const Eigen::VectorXd deviation = scale.head(stiffness);
    state.covariance.topLeftCorner(stiffness, stiffness) =
        deviation.asDiagonal() * parameters.stiffnessCorrelation() * deviation.asDiagonal();
    last_time.reset();
    step.reset();
    outliers = 0;
    followCorrection();
  }

  Eigen::Index biasCount() const { return bias_deviation.size(); }
  Eigen::VectorXd theta() const { return state.mean.head(parameters.count()); }

  Eigen::VectorXd pick(const model::Twists& twists) const { return twists.reshaped()(rows); }

  std::optional<Eigen::VectorXd> twistsAt(const statics::CorrectedModel& of,
                                          const Eigen::VectorXd& lengths) const {
    const auto shape = of.shape(lengths);
    if (!shape) return std::nullopt;
    return pick(shape->twists());
  }

  Eigen::VectorXd lengthsAt(const Eigen::VectorXd& pressure) const {
    return arm.lengths(arm.clamped(pressure));
  }

  std::optional<Linearisation> linearise(const Eigen::VectorXd& pressure) {
    const Eigen::VectorXd lengths = lengthsAt(pressure);
    auto twists = twistsAt(model, lengths);
    if (!twists) return std::nullopt;
    Linearisation out{
        std::move(*twists), Eigen::MatrixXd::Zero(biasCount(), parameters.count()), {}, {}};
    statics::Correction moved(arm);
    for (int j = 0; j < parameters.stiffnessCount(); ++j) {
      Eigen::VectorXd ends[2];
      for (const int side : {0, 1}) {
        Eigen::VectorXd at = theta();
        at[j] += side == 0 ? -kStiffnessStep : kStiffnessStep;
        parameters.apply(at, moved);
        probe.set(moved);
        const auto end = twistsAt(probe, lengths);
        if (!end) return std::nullopt;
        ends[side] = *end;
      }
      out.by_theta.col(j) = (ends[1] - ends[0]) / (2 * kStiffnessStep);
    }
    Eigen::MatrixXd by_lengths;
    model.twistsByLengths(lengths, by_lengths);
    const Eigen::MatrixXd picked = by_lengths(rows, Eigen::all);
    const Eigen::VectorXd shift =
        model.correction().length_shift.cwiseQuotient(model.correction().length_scale);
    for (int j = parameters.stiffnessCount(); j < parameters.strokesBegin(); ++j) {
      const ArmParameters::Span span = parameters.actuatorsOf(j);
      for (int i = span.begin; i < span.end; ++i) {
        out.by_theta.col(j) += picked.col(i) * (lengths[i] + shift[i]);
      }
    }
    for (int i = 0; i < parameters.strokeCount(); ++i) {
      out.by_theta.col(parameters.strokesBegin() + i) =
          picked.col(i) * (lengths[i] - arm.actuator(i).contraction.restLength());
    }
    out.by_pressure = out.by_lengths = picked;
    const Eigen::VectorXd inside = arm.clamped(pressure);
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      out.by_pressure.col(i) *= arm.actuator(i).contraction.slopeInside(inside[i]);
    }
    return out;
  }

  ObservationFault check(const Input& input) const {
    const int n = arm.actuatorCount(), size = 6 * arm.sectionCount();
    if (input.pressure.size() != n || input.variance.size() != n ||
        input.twists.cols() != arm.sectionCount() || input.covariance.rows() != size ||
        input.covariance.cols() != size) {
      return ObservationFault::kWrongSize;
    }
    if (!std::isfinite(input.time) || !input.pressure.allFinite() || !input.variance.allFinite() ||
        !input.twists.allFinite() || !input.covariance.allFinite()) {
      return ObservationFault::kNotFinite;
    }
    if (last_time && input.time <= *last_time) return ObservationFault::kNotNewer;
    const Eigen::MatrixXd covariance = pickedCovariance(input.covariance);
    if (!isPositiveDefinite(covariance)) return ObservationFault::kNotPositive;
    const bool plausible = covariance.diagonal().minCoeff() >= kLeastDeviation * kLeastDeviation &&
                           covariance.diagonal().maxCoeff() <= kMostDeviation * kMostDeviation;
    if (!plausible) return ObservationFault::kImplausible;
    return ObservationFault::kNone;
  }

  Eigen::MatrixXd pickedCovariance(const Eigen::MatrixXd& covariance) const {
    return covariance(rows, rows);
  }

  Eigen::MatrixXd biasGrowth(const Eigen::VectorXd& motion, double dt) const {
    const Eigen::VectorXd variance = bias_deviation.cwiseAbs2();
    const double size2 =
        motion.cwiseQuotient(bias_deviation).squaredNorm() / static_cast<double>(biasCount());
    Eigen::MatrixXd out = options.hysteresis * options.hysteresis * motion * motion.transpose();
    out.diagonal() +=
        (options.hysteresis * options.hysteresis * size2 + options.creep * options.creep * dt) *
        variance;
    return out;
  }

  // Growth by play of the covariance of b while the delayed pressures go this share of their way.
  Eigen::MatrixXd playGrowth(const Eigen::MatrixXd& by_pressure, const Eigen::VectorXd& pressure,
                             double share) {
    if (!last_time) smooth = pressure;
    const Eigen::VectorXd change = share * (pressure - smooth);
    smooth += change;
    return kPlay * by_pressure * change.cwiseAbs().asDiagonal() * by_pressure.transpose();
  }

  Eigen::MatrixXd jacobian() const {
    Eigen::MatrixXd H(biasCount(), scale.size());
    H << step->model.by_theta, Eigen::MatrixXd::Identity(biasCount(), biasCount());
    return H;
  }

  // If theta within its bounds does not explain the arm (or the camera), the bias takes the rest.
  void learn(const Gaussian::Measurement& measurement) {
    Gaussian next = state;
    next.update(measurement);
    const Eigen::VectorXd theta = next.mean.head(parameters.count());
    if ((theta.array().abs() <= kFarthestTheta * parameters.deviations().array()).all()) {
      state = std::move(next);
    } else {
      state.update(measurement, parameters.count());
    }
  }

  // Limits theta to where the model is linear; the bias takes the rest.
  Gaussian withinReason(Gaussian given) const {
    const Eigen::VectorXd bound = kFarthestTheta * parameters.deviations();
    const Eigen::VectorXd theta = given.mean.head(parameters.count());
    const Eigen::VectorXd kept = theta.cwiseMax(-bound).cwiseMin(bound);
    given.mean.head(parameters.count()) = kept;
    if (step) given.mean.tail(biasCount()) += step->model.by_theta * (theta - kept);
    return given;
  }

  void followCorrection() {
    parameters.apply(theta(), correction);
    correction.offset.setZero();
    model.set(correction);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      correction.offset(rows[i] % 6, rows[i] / 6) =
          state.mean[parameters.count() + static_cast<Eigen::Index>(i)];
    }
  }

  const ArmFilterOptions options;
  const ArmParameters parameters;
  const model::Arm arm;
  statics::CorrectedModel model;  // with the factors of theta and no offset
  statics::CorrectedModel probe;  // for differences
  statics::Correction correction;
  std::vector<int> rows;
  Eigen::VectorXd bias_deviation;
  Eigen::VectorXd scale;  // of the entries of the state
  Gaussian state;
  std::optional<double> last_time;
  Eigen::VectorXd last_lengths;
  Eigen::VectorXd smooth;   // pressures, delayed by the settling time (n) [Pa]
  Eigen::VectorXd settled;  // twists of the model, delayed by the settling time
  std::optional<Step> step;
  int outliers = 0;  // consecutive
};

ArmFilter::ArmFilter(const statics::ArmModel& model, const ArmFilterOptions& options)
    : work_(std::make_unique<Workspace>(model, options)) {}
ArmFilter::~ArmFilter() = default;
ArmFilter::ArmFilter(ArmFilter&&) noexcept = default;
ArmFilter& ArmFilter::operator=(ArmFilter&&) noexcept = default;

ObservationFault ArmFilter::check(const Input& input) const { return work_->check(input); }

Observation ArmFilter::see(const Input& input) {
  Workspace& w = *work_;
  Observation out{check(input), 0.0};
  if (!out.accepted()) return out;
  auto model = w.linearise(input.pressure);
  const auto before = w.last_time ? w.twistsAt(w.model, w.last_lengths) : std::nullopt;
  if (!model) return {ObservationFault::kUnbalanced, 0.0};

  Step step;
  step.dt = w.last_time ? input.time - *w.last_time : 0.0;
  step.theta = w.theta();
  step.measured = w.pick(input.twists);
  const Eigen::VectorXd motion =
      before ? model->twists - *before : Eigen::VectorXd::Zero(w.biasCount()).eval();
  step.bias_growth = w.biasGrowth(motion, step.dt);
  const double share = -std::expm1(-step.dt / w.options.settling_time);
  step.play_growth = w.playGrowth(model->by_pressure, input.pressure, share);
  if (!w.last_time) w.settled = model->twists;
  w.settled += share * (model->twists - w.settled);
  step.swing = model->twists - w.settled;
  const Eigen::MatrixXd by_pressure =
      model->by_pressure * input.variance.asDiagonal() * model->by_pressure.transpose();
  const Eigen::MatrixXd by_swing = step.swing * step.swing.transpose();
  step.picture_noise = w.pickedCovariance(input.covariance) + by_pressure + by_swing;
  step.noise = step.picture_noise + (kPressurePersistence - 1) * by_pressure +
               (kSwingPersistence - 1) * by_swing;
  step.model = std::move(*model);
  w.last_time = input.time;
  w.last_lengths = w.lengthsAt(input.pressure);
  w.step = std::move(step);

  const Eigen::Index d = w.biasCount();
  w.state.covariance.bottomRightCorner(d, d) += w.step->bias_growth;
  const Gaussian::Measurement measurement{w.step->measured - w.step->model.twists -
                                              w.state.mean.tail(d) -
                                              w.step->model.by_theta * (w.theta() - w.step->theta),
                                          w.jacobian(), w.step->noise};
  out.distance2 = w.state.distance2(measurement);
  if (out.distance2 > outlierLimit(static_cast<int>(d)) && w.outliers < kMostOutliers) {
    ++w.outliers;
    out.fault = ObservationFault::kOutlier;
    return out;
  }
  w.outliers = 0;
  w.learn(measurement);
  w.followCorrection();
  return out;
}

void ArmFilter::reset() { work_->start(); }

void ArmFilter::forgetTime() {
  work_->last_time.reset();
  work_->outliers = 0;
}

void ArmFilter::setState(const Gaussian& state) {
  work_->state = work_->withinReason(state);
  work_->followCorrection();
}

int ArmFilter::parameterCount() const { return work_->parameters.count(); }
const std::vector<std::string>& ArmFilter::parameterNames() const {
  return work_->parameters.names();
}
Eigen::VectorXd ArmFilter::parameterPrior() const { return work_->parameters.deviations(); }
const std::vector<int>& ArmFilter::rows() const { return work_->rows; }
const Gaussian& ArmFilter::state() const { return work_->state; }
statics::Correction ArmFilter::correction() const { return work_->correction; }
Eigen::VectorXd ArmFilter::changeVariance(const Eigen::VectorXd& pressure) const {
  if (!work_->last_time) return Eigen::VectorXd::Zero(pressure.size());
  const Eigen::VectorXd change = pressure - work_->smooth;
  return kUsualPlay * change.cwiseAbs() + kUsualLate * kUsualLate * change.cwiseAbs2();
}
const Eigen::VectorXd& ArmFilter::biasDeviation() const { return work_->bias_deviation; }
const std::optional<ArmFilter::Step>& ArmFilter::lastStep() const { return work_->step; }

std::optional<model::Shape> ArmFilter::shape(const Eigen::VectorXd& pressure) const {
  work_->probe.set(work_->correction);
  return work_->probe.shape(work_->lengthsAt(pressure));
}

std::optional<ArmFilter::Linearisation> ArmFilter::linearise(
    const Eigen::VectorXd& pressure) const {
  return work_->linearise(pressure);
}

Eigen::MatrixXd ArmFilter::twistCovariance(double elapsed) const {
  const Workspace& w = *work_;
  const Eigen::Index d = w.biasCount();
  Eigen::MatrixXd P = w.state.covariance;
  P.bottomRightCorner(d, d) += w.biasGrowth(Eigen::VectorXd::Zero(d), elapsed);
  Eigen::MatrixXd picked = P.bottomRightCorner(d, d);
  if (w.step) {
    const Eigen::MatrixXd H = w.jacobian();
    picked = H * P * H.transpose();
  }
  const Eigen::Index size = 6 * w.arm.sectionCount();
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(size, size);
  out(w.rows, w.rows) = picked;
  return out;
}

}  // namespace helix_arm::estimation
