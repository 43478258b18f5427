#include "helix_arm/estimation/calibration.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <utility>

#include "calibration_checks.hpp"
#include "calibration_problem.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/model/median.hpp"
#include "helix_arm/model/requirement.hpp"

namespace helix_arm::estimation {
namespace {

// Of its prior's variance, the captures must take this share from a parameter to identify it.
constexpr double kLeastGain = 0.75;
// The noise is found when a round changes it by less than this share; some rounds suffice.
constexpr double kNoiseSettled = 0.01;
constexpr int kMostRounds = 15;
// The expected noise counts as much as this many residuals.
constexpr double kNoisePrior = 1.0;
// Readings so many times farther off than expected are worth a warning.
constexpr double kNoisy = 3.0;
// Captures that add less than this share of what others do, or less than so little, say nothing
// new.
constexpr double kNothingNew = 0.02;
constexpr double kLeastGainNats = 1e-3;
// With fewer pressures leaving one out says nothing of how sure the rest is.
constexpr int kFewestPressures = 3;
// Levels of each actuator, of its range, at which captures are weighed.
constexpr double kLevels[] = {0.0, 0.5, 1.0};
// All combinations of levels of so many actuators, else one actuator at a time and pairs.
constexpr int kMostCombined = 4;

bool everyCapture(int) { return true; }

// Effective error of one kind of reading over comparisons: RMS of curvatures, median of the rest.
double errorOf(ReadingKind kind, const std::vector<Comparison>& comparisons) {
  std::vector<double> errors;
  double square = 0;
  for (const Comparison& one : comparisons) {
    errors.push_back(one.error);
    square += one.error * one.error;
  }
  if (errors.empty()) return 0;
  if (kind == ReadingKind::kCurvature)
    return std::sqrt(square / static_cast<double>(errors.size()));
  return model::medianOf(std::move(errors));
}

// What readings and priors say of the parameters but those of shapes, whatever the shapes are.
struct Statistics {
  Eigen::MatrixXd information, covariance;
  double data_parameters;  // of all free parameters, those that the readings determine
};

Statistics statisticsOf(const CalibrationProblem& problem, double noise_scale) {
  const Eigen::VectorXd prior = problem.priorInformation();
  Eigen::MatrixXd all = problem.information(noise_scale, everyCapture);
  all.diagonal() += prior;
  const auto count = static_cast<Eigen::Index>(problem.parameters().size());
  Statistics out;
  out.information = all.topLeftCorner(count, count);
  // The readings of a capture see no shape but its own: eliminate one after the other.
  struct Shape {
    Eigen::MatrixXd covariance, by_rest;  // given the rest, and how the rest moves it
    Eigen::Index first;
  };
  std::vector<Shape> shapes;
  Eigen::Index first = count;
  for (const int size : problem.shapeSizes()) {
    const Eigen::LLT<Eigen::MatrixXd> factors(all.block(first, first, size, size));
    const auto cross = all.block(first, 0, size, count);
    shapes.push_back(
        {factors.solve(Eigen::MatrixXd::Identity(size, size)), factors.solve(cross), first});
    out.information.noalias() -= cross.transpose() * shapes.back().by_rest;
    first += size;
  }
  out.covariance =
      Eigen::LLT<Eigen::MatrixXd>(out.information).solve(Eigen::MatrixXd::Identity(count, count));
  // Trace of covariance and readings' information: all that the priors do not determine.
  double held = out.covariance.diagonal().dot(prior.head(count));
  for (const Shape& shape : shapes) {
    const Eigen::VectorXd variances =
        shape.covariance.diagonal() +
        (shape.by_rest * out.covariance).cwiseProduct(shape.by_rest).rowwise().sum();
    held += variances.dot(prior.segment(shape.first, variances.size()));
  }
  out.data_parameters = static_cast<double>(all.rows()) - held;
  return out;
}

// The scale of the noise, of the expected one, that the residuals speak of.
double noiseScaleOf(const std::vector<Comparison>& comparisons, double data_parameters,
                    double scale) {
  double weighted = 0, freedom = 0;
  for (const Comparison& one : comparisons) {
    weighted += one.weight * one.square;
    freedom += one.weight * one.residuals;
  }
  const double prior = kNoisePrior / (scale * scale);
  const double variance =
      (prior + weighted) / (kNoisePrior + std::max(0.0, freedom - data_parameters));
  return scale * std::sqrt(variance);
}

// Solves for parameters and noise together.
struct Solution {
  bool converged = false;
  double noise_scale = 1;
};

// @param bias  in expected deviations: what residuals do not show.
Solution solveWithNoise(CalibrationProblem& problem, double bias) {
  Solution solution;
  // Placements that are not calibrated are off by far more than the noise: begin with what the
  // residuals are there, so that no reading is lost to the robust loss.
  std::vector<double> errors;
  for (const Comparison& one : problem.compare(1.0)) {
    if (std::isfinite(one.square)) errors.push_back(std::sqrt(one.square / one.residuals));
  }
  if (errors.empty()) return solution;
  solution.noise_scale = std::max(1.0, model::medianOf(std::move(errors)));
  for (int round = 0; round < kMostRounds; ++round) {
    solution.converged = problem.solve(solution.noise_scale, everyCapture);
    const double before = solution.noise_scale;
    const Statistics statistics = statisticsOf(problem, before);
    const double seen = noiseScaleOf(problem.compare(before), statistics.data_parameters, before);
    solution.noise_scale = std::hypot(seen, bias);
    if (std::abs(solution.noise_scale / before - 1) < kNoiseSettled) break;
  }
  return solution;
}

double standardErrorOf(const ParameterInfo& info, double value, double deviation) {
  return info.logarithmic ? std::abs(value) * deviation : deviation;
}

bool identified(const ParameterInfo& info, double variance) {
  return variance <= (1 - kLeastGain) * info.deviation * info.deviation;
}

class Calibrator {
 public:
  Calibrator(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options)
      : arms_(arms),
        options_(options),
        kind_(kindOf(firstReading(arms))),
        groups_(groupByPressure(arms)) {}

  Calibration run() {
    result_.error_unit = unitOf(kind_);
    if (const auto verdict = unfit(arms_, options_, kind_)) return refuse(*verdict);
    Selection selection = selectionOf(options_);
    if (selection.free_shapes) {
      selection.stiffness.clear();
      selection.length_scale = LengthScaling::kNone;
    }
    fit(selection);
    if (!solution_.converged) {
      return refuse({CalibrationStatus::kNotConverged,
                     "the search came to no end; check where the scene has camera and tags, and "
                     "that the captures are of this arm"});
    }
    report();
    if (outliers_ * 2 > static_cast<int>(comparisons_.size())) {
      return refuse({CalibrationStatus::kUnexplained,
                     text(outliers_, " of ", comparisons_.size(),
                          " readings do not fit, whatever the parameters; check where the scene "
                          "has camera and tags, and that the captures are of this arm")});
    }
    if (std::none_of(result_.parameters.begin(), result_.parameters.end(),
                     [](const Parameter& one) { return one.identifiable; })) {
      return refuse({CalibrationStatus::kNotIdentifiable,
                     "the captures say nothing of what was to be fitted; capture at pressures that "
                     "bend the arm farther, or fit other parameters"});
    }
    if (options_.held_out) leaveOut();
    if (!selection.free_shapes) weighCaptures();
    warn();
    result_.status = CalibrationStatus::kCalibrated;
    return std::move(result_);
  }

 private:
  Calibration refuse(const Verdict& verdict) {
    result_.status = verdict.status;
    result_.reason = verdict.reason;
    return std::move(result_);
  }

  // Holds, one after the other, what the captures do not identify.
  void fit(const Selection& wanted) {
    Selection selection = wanted;
    for (;;) {
      problem_ = std::make_unique<CalibrationProblem>(arms_, options_, selection);
      solution_ = solveWithNoise(*problem_, kind_ == ReadingKind::kCorners
                                                ? options_.corner_floor / options_.corner_noise
                                                : 0.0);
      statistics_ = statisticsOf(*problem_, solution_.noise_scale);
      const std::vector<ParameterInfo>& infos = problem_->parameters();
      int worst = -1;
      double most = 0;
      for (std::size_t i = 0; i < infos.size(); ++i) {
        const double variance = statistics_.covariance(i, i);
        if (i >= selection.stiffness.size() || identified(infos[i], variance)) continue;
        const double share = variance / (infos[i].deviation * infos[i].deviation);
        if (worst < 0 || share > most) {
          worst = static_cast<int>(i);
          most = share;
        }
      }
      if (worst < 0) break;
      const ParameterInfo& info = infos[worst];
      const double value = info.initial,
                   deviation = std::sqrt(statistics_.covariance(worst, worst));
      held_.push_back({info.name, info.unit, value, value,
                       standardErrorOf(info, info.reference, deviation), false});
      if (infos.size() == 1) break;
      selection.stiffness.erase(selection.stiffness.begin() + worst);
    }
    for (std::size_t i = 0; i < problem_->parameters().size(); ++i) {
      identified_.push_back(identified(problem_->parameters()[i], statistics_.covariance(i, i)));
    }
    addUncertaintyOfHeld(wanted);
  }

  // What is not fitted is known no better than before, and the rest was fitted as if it were right.
  void addUncertaintyOfHeld(Selection wanted) {
    const bool corners = kind_ == ReadingKind::kCorners;
    if (arms_.size() == 1 && (corners || kind_ == ReadingKind::kPoses)) wanted.tags = true;
    wanted.bleed |= corners && arms_.size() == 1;
    CalibrationProblem all(arms_, options_, wanted);
    Values& values = all.values();
    const Values& fitted = problem_->values();
    std::vector<int> fitted_columns, held_columns;
    const std::vector<ParameterInfo>& infos = all.parameters();
    const std::vector<ParameterInfo>& known = problem_->parameters();
    const Eigen::VectorXd at = problem_->vector();
    for (std::size_t i = 0; i < infos.size(); ++i) {
      const auto same_name = [&](const ParameterInfo& one) { return one.name == infos[i].name; };
      const auto found = std::find_if(known.begin(), known.end(), same_name);
      (found == known.end() ? held_columns : fitted_columns).push_back(static_cast<int>(i));
      if (found == known.end() || i >= wanted.stiffness.size()) continue;
      values.stiffness[static_cast<Eigen::Index>(i)] = at[found - known.begin()];
    }
    if (fitted.length_scale.size() > 0) values.length_scale = fitted.length_scale;
    values.base = fitted.base;
    values.bleed = fitted.bleed;
    values.tags = fitted.tags;
    for (std::size_t i = 0; i < fitted.shapes.size(); ++i) values.shapes[i] = fitted.shapes[i];
    if (held_columns.empty()) return;
    const Eigen::MatrixXd H = statisticsOf(all, solution_.noise_scale).information;
    const Eigen::MatrixXd cross = H(fitted_columns, held_columns);
    const Eigen::MatrixXd shift = statistics_.covariance * cross;
    Eigen::VectorXd prior(held_columns.size());
    for (std::size_t i = 0; i < held_columns.size(); ++i) {
      prior[static_cast<Eigen::Index>(i)] = std::pow(infos[held_columns[i]].deviation, 2);
    }
    statistics_.covariance += shift * prior.asDiagonal() * shift.transpose();
  }

  void report() {
    const std::vector<ParameterInfo>& infos = problem_->parameters();
    const Eigen::VectorXd values = problem_->vector();
    std::set<std::string> gone;
    for (const Parameter& one : held_) gone.insert(one.name);
    for (std::size_t i = 0; i < infos.size(); ++i) {
      if (gone.count(infos[i].name) > 0) continue;
      const double variance = statistics_.covariance(i, i);
      const double value =
          infos[i].logarithmic ? infos[i].reference * std::exp(values[i]) : values[i];
      result_.parameters.push_back({infos[i].name, infos[i].unit, infos[i].initial, value,
                                    standardErrorOf(infos[i], value, std::sqrt(variance)),
                                    identified_[i]});
    }
    const int fitted = static_cast<int>(result_.parameters.size());
    result_.parameters.insert(result_.parameters.end(), held_.begin(), held_.end());
    const int all = static_cast<int>(result_.parameters.size());
    result_.correlation.setZero(all, all);
    for (int i = 0; i < fitted; ++i) {
      for (int j = 0; j < fitted; ++j) {
        result_.correlation(i, j) =
            statistics_.covariance(i, j) /
            std::sqrt(statistics_.covariance(i, i) * statistics_.covariance(j, j));
      }
    }
    const Selection& selection = problem_->selection();
    if (!selection.stiffness.empty()) result_.stiffness = problem_->stiffness();
    result_.K_eps = problem_->K_eps();
    result_.length_scale = problem_->lengthScale();
    result_.X_B0B = problem_->base();
    result_.layout = problem_->layout();
    result_.bleed = problem_->values().bleed;
    for (int c = 0; c < problem_->captures(); ++c) {
      result_.curves.push_back(problem_->shape(c));
      result_.shapes.push_back(result_.curves.back().twists());
    }
    comparisons_ = problem_->compare(solution_.noise_scale);
    reportCaptures();
  }

  bool isOutlier(const Comparison& one) const {
    return one.square > options_.robust_scale * options_.robust_scale * one.residuals;
  }

  void reportCaptures() {
    struct Sum {
      double square = 0;
      int fitting = 0, outliers = 0;
      std::vector<int> tags;
    };
    std::vector<Sum> sums(problem_->captures());
    Sum total;
    for (const Comparison& one : comparisons_) {
      Sum& sum = sums[one.capture];
      if (isOutlier(one)) {
        ++sum.outliers;
        ++outliers_;
        if (one.tag >= 0) {
          sum.tags.push_back(arms_[problem_->armOf(one.capture)].layout.tags[one.tag].id);
        }
        continue;
      }
      for (Sum* each : {&sum, &total}) {
        each->square += one.error * one.error;
        ++each->fitting;
      }
    }
    result_.rms = total.fitting > 0 ? std::sqrt(total.square / total.fitting) : 0;
    int index = 0;
    for (std::size_t a = 0; a < arms_.size(); ++a) {
      for (const Capture& capture : arms_[a].captures) {
        Sum& sum = sums[index++];
        std::sort(sum.tags.begin(), sum.tags.end());
        result_.captures.push_back({static_cast<int>(a), capture.number,
                                    sum.fitting > 0 ? std::sqrt(sum.square / sum.fitting) : 0.0,
                                    std::move(sum.tags), sum.outliers > sum.fitting, 0.0});
      }
    }
  }

  // One refit without each group of captures, from the full solution.
  struct Refits {
    std::vector<Eigen::VectorXd> vectors;
    std::vector<std::vector<Comparison>> left_out;
    std::vector<model::Twists> shapes;  // (captures) by the fit without it
    bool complete = true;
  };

  Refits refit(const std::vector<int>& group_of, int groups) {
    Refits refits;
    refits.shapes.resize(problem_->captures());
    const Values full = problem_->values();
    const auto restore = [&] {
      // In place: the least squares holds on to where the values are.
      Values& values = problem_->values();
      values.stiffness = full.stiffness;
      values.length_scale = full.length_scale;
      values.base = full.base;
      values.bleed = full.bleed;
      std::copy(full.tags.begin(), full.tags.end(), values.tags.begin());
      for (std::size_t i = 0; i < full.shapes.size(); ++i) values.shapes[i] = full.shapes[i];
    };
    for (int g = 0; g < groups; ++g) {
      refits.complete &= problem_->solve(solution_.noise_scale,
                                         [&](int capture) { return group_of[capture] != g; });
      refits.vectors.push_back(problem_->vector());
      std::vector<Comparison> left_out;
      for (const Comparison& one : problem_->compare(solution_.noise_scale)) {
        if (group_of[one.capture] == g) left_out.push_back(one);
      }
      refits.left_out.push_back(std::move(left_out));
      for (int c = 0; c < problem_->captures(); ++c) {
        if (group_of[c] == g) refits.shapes[c] = problem_->shape(c).twists();
      }
      restore();
    }
    return refits;
  }

  HeldOut heldOut(const Refits& refits, const std::vector<std::string>& labels) const {
    HeldOut out;
    std::vector<Comparison> all;
    for (std::size_t g = 0; g < refits.left_out.size(); ++g) {
      out.groups.push_back({labels[g], errorOf(kind_, refits.left_out[g])});
      all.insert(all.end(), refits.left_out[g].begin(), refits.left_out[g].end());
    }
    out.error = errorOf(kind_, all);
    out.in_sample = errorOf(kind_, comparisons_);
    return out;
  }

  void leaveOut() {
    const int groups = static_cast<int>(groups_.pressure.size());
    // Shapes of their own predict nothing.
    if (problem_->selection().free_shapes) return;
    const Refits by_pressure = refit(groups_.of, groups);
    std::vector<std::string> labels;
    for (const Eigen::VectorXd& pressure : groups_.pressure)
      labels.push_back(pressureText(pressure));
    result_.by_pressure = heldOut(by_pressure, labels);
    result_.held_out_shapes = by_pressure.shapes;
    if (!by_pressure.complete) {
      result_.warnings.push_back(
          "some of the fits without one pressure came to no end: held-out errors are of where they "
          "stopped");
    }
    raiseErrors(by_pressure);
    if (arms_.size() < 2) return;
    std::vector<int> arm_of;
    labels.clear();
    for (std::size_t a = 0; a < arms_.size(); ++a) {
      arm_of.insert(arm_of.end(), arms_[a].captures.size(), static_cast<int>(a));
      labels.push_back(arms_[a].name);
    }
    result_.by_arm = heldOut(refit(arm_of, static_cast<int>(arms_.size())), labels);
  }

  // The jackknife sees what the noise of single readings does not: a model that is wrong in its own
  // way at each pressure.
  void raiseErrors(const Refits& refits) {
    const int groups = static_cast<int>(refits.vectors.size());
    if (groups < kFewestPressures) return;
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(refits.vectors.front().size());
    for (const Eigen::VectorXd& vector : refits.vectors) mean += vector / groups;
    Eigen::VectorXd variance = Eigen::VectorXd::Zero(mean.size());
    for (const Eigen::VectorXd& vector : refits.vectors) {
      variance += (vector - mean).array().square().matrix() * (groups - 1) / groups;
    }
    const std::vector<ParameterInfo>& infos = problem_->parameters();
    for (Parameter& one : result_.parameters) {
      for (std::size_t i = 0; i < infos.size(); ++i) {
        if (infos[i].name != one.name || !one.identifiable) continue;
        one.standard_error = std::max(one.standard_error,
                                      standardErrorOf(infos[i], one.value, std::sqrt(variance[i])));
      }
    }
  }

  // Columns of what the shape depends on; of everything where that is not fitted.
  std::vector<int> shapeColumns() const {
    std::vector<int> columns;
    const std::vector<ParameterInfo>& infos = problem_->parameters();
    for (std::size_t i = 0; i < infos.size(); ++i) {
      if (infos[i].about_shape) columns.push_back(static_cast<int>(i));
    }
    if (columns.empty()) {
      columns.resize(infos.size());
      std::iota(columns.begin(), columns.end(), 0);
    }
    return columns;
  }

  // Half the log determinant of the covariance of these columns.
  static double entropyOf(const Eigen::MatrixXd& information, const std::vector<int>& columns) {
    const Eigen::LLT<Eigen::MatrixXd> factors(information);
    if (factors.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
    const Eigen::Index size = information.rows();
    Eigen::MatrixXd units = Eigen::MatrixXd::Zero(size, static_cast<Eigen::Index>(columns.size()));
    for (std::size_t i = 0; i < columns.size(); ++i) units(columns[i], i) = 1;
    const Eigen::MatrixXd solved = factors.solve(units);
    Eigen::MatrixXd covariance(columns.size(), columns.size());
    for (std::size_t i = 0; i < columns.size(); ++i) covariance.row(i) = solved.row(columns[i]);
    const Eigen::LLT<Eigen::MatrixXd> root(covariance);
    return root.matrixLLT().diagonal().array().log().sum();
  }

  void weighCaptures() {
    const std::vector<int> columns = shapeColumns();
    const double entropy = entropyOf(statistics_.information, columns);
    const int groups = static_cast<int>(groups_.pressure.size());
    double total = 0;
    for (int g = 0; g < groups; ++g) {
      const Eigen::MatrixXd own = problem_->information(
          solution_.noise_scale, [this, g](int capture) { return groups_.of[capture] == g; });
      gains_.push_back(entropyOf(statistics_.information - own, columns) - entropy);
      total += gains_.back();
    }
    least_gain_ = std::max(kLeastGainNats, kNothingNew * total / groups);
    for (int c = 0; c < problem_->captures(); ++c) result_.captures[c].gain = gains_[groups_.of[c]];
    suggest(columns);
  }

  std::vector<Eigen::VectorXd> candidates() const {
    const model::Arm& arm = arms_.front().arm;
    const int n = arm.actuatorCount();
    std::vector<Eigen::VectorXd> out;
    const auto at = [&arm](int i, double level) {
      const model::Range& limits = arm.actuator(i).limits;
      return limits.lower + level * (limits.upper - limits.lower);
    };
    if (n <= kMostCombined) {
      std::vector<std::size_t> digits(n, 0);
      for (;;) {
        Eigen::VectorXd pressure(n);
        for (int i = 0; i < n; ++i) pressure[i] = at(i, kLevels[digits[i]]);
        out.push_back(pressure);
        int i = 0;
        while (i < n && ++digits[i] == std::size(kLevels)) digits[i++] = 0;
        if (i == n) return out;
      }
    }
    for (int i = 0; i < n; ++i) {
      for (int j = i; j < n; ++j) {
        for (const double level : kLevels) {
          Eigen::VectorXd pressure = arm.inputAt(0);
          pressure[i] = at(i, level);
          pressure[j] = at(j, level);
          out.push_back(pressure);
        }
      }
    }
    return out;
  }

  // Greedy: each next pressure given the ones before it.
  void suggest(const std::vector<int>& columns) {
    Eigen::MatrixXd information = statistics_.information;
    const std::vector<Eigen::VectorXd> all = candidates();
    std::vector<Eigen::MatrixXd> says;
    std::vector<bool> taken(all.size(), false);
    for (const Eigen::VectorXd& pressure : all) {
      says.push_back(problem_->expectedInformation(pressure, solution_.noise_scale));
    }
    for (int count = 0; count < options_.next_pressures; ++count) {
      double least = std::numeric_limits<double>::infinity();
      std::size_t best = all.size();
      for (std::size_t i = 0; i < all.size(); ++i) {
        if (taken[i]) continue;
        const double entropy = entropyOf(information + says[i], columns);
        if (entropy < least) {
          least = entropy;
          best = i;
        }
      }
      if (best == all.size()) return;
      result_.next_pressures.push_back(all[best]);
      taken[best] = true;
      information += says[best];
    }
  }

  void warn() {
    std::vector<std::string>& warnings = result_.warnings;
    const std::size_t pressures = groups_.pressure.size();
    if (pressures < kFewestPressures) {
      warnings.push_back(text("there are captures at ", pressures,
                              " pressures only: standard errors are of the noise alone"));
    }
    for (const Parameter& one : held_) {
      warnings.push_back(text("the captures do not determine ", one.name, ": it stays at ",
                              one.initial, one.unit.empty() ? "" : " ", one.unit));
    }
    std::string outliers, idle;
    for (const CaptureResidual& one : result_.captures) {
      if (!one.outlier) continue;
      outliers += (outliers.empty() ? "" : ", ") +
                  (arms_.size() > 1 ? arms_[one.arm].name + " " : std::string()) +
                  std::to_string(one.number);
    }
    for (std::size_t g = 0; g < gains_.size(); ++g) {
      if (gains_[g] > least_gain_) continue;
      idle += (idle.empty() ? "" : "; ") + pressureText(groups_.pressure[g]);
    }
    if (!outliers.empty()) {
      warnings.push_back("captures that do not fit the others: " + outliers);
    }
    if (!idle.empty()) {
      warnings.push_back("captures at these pressures say nothing new: " + idle +
                         "; captures at the pressures suggested would say more");
    }
    if (solution_.noise_scale > kNoisy) {
      warnings.push_back(text("readings are ", std::round(10 * solution_.noise_scale) / 10,
                              " times as far off as their noise: something that is not fitted is "
                              "wrong, and standard errors are raised in proportion"));
    }
  }

  const std::vector<ArmCaptures>& arms_;
  const CalibrationOptions& options_;
  const ReadingKind kind_;
  const Groups groups_;
  std::unique_ptr<CalibrationProblem> problem_;
  Solution solution_;
  Statistics statistics_;
  std::vector<double> gains_;  // (groups) [nats]
  double least_gain_ = 0;
  std::vector<bool> identified_;  // (parameters of the problem)
  std::vector<Parameter> held_;
  std::vector<Comparison> comparisons_;
  int outliers_ = 0;
  Calibration result_;
};

}  // namespace

bool ArmCaptures::isLoaded() const { return load && !load->empty() && model::takesLoad(tier.tier); }

void CalibrationOptions::validate() const {
  const auto positive = [](const char* what, double value) {
    model::requireValue(std::isfinite(value) && value > 0, "calibration", what, value,
                        "a finite value > 0");
  };
  positive("the curvature noise", curvature_noise);
  positive("the corner noise", corner_noise);
  positive("the position noise", position_noise);
  const auto not_negative = [](const char* what, double value) {
    model::requireValue(std::isfinite(value) && value >= 0, "calibration", what, value,
                        "a finite value >= 0");
  };
  not_negative("the rotation noise", rotation_noise);
  not_negative("the floor of the corners' noise", corner_floor);
  positive("the robust scale", robust_scale);
  positive("the prior of the stiffness", stiffness_prior);
  positive("the prior of the length scale", length_scale_prior);
  positive("the base's prior of translation", base_prior.translation);
  positive("the base's prior of rotation", base_prior.rotation);
  positive("the tags' prior of translation", tag_prior.translation);
  positive("the tags' prior of rotation", tag_prior.rotation);
  positive("the prior of the bleed", bleed_prior);
  positive("the model's prior of translation", model_prior.translation);
  positive("the model's prior of rotation", model_prior.rotation);
  model::requireValue(next_pressures >= 0 && next_pressures <= 100, "calibration",
                      "the number of next pressures", next_pressures, "0 to 100");
  model::requireValue(max_iterations >= 1, "calibration", "the number of iterations",
                      max_iterations, "at least 1");
}

const char* nameOf(CalibrationStatus status) {
  switch (status) {
    case CalibrationStatus::kCalibrated:
      return "calibrated";
    case CalibrationStatus::kNoCaptures:
      return "no_captures";
    case CalibrationStatus::kOnePressure:
      return "one_pressure";
    case CalibrationStatus::kBadData:
      return "bad_data";
    case CalibrationStatus::kNothingToFit:
      return "nothing_to_fit";
    case CalibrationStatus::kNotIdentifiable:
      return "not_identifiable";
    case CalibrationStatus::kUnexplained:
      return "unexplained";
    case CalibrationStatus::kNotConverged:
      break;
  }
  return "not_converged";
}

Calibration calibrate(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options) {
  options.validate();
  const std::vector<ArmCaptures> read = withReadings(arms);
  if (const auto verdict = unsound(read)) {
    Calibration refused;
    refused.status = verdict->status;
    refused.reason = verdict->reason;
    return refused;
  }
  return Calibrator(read, options).run();
}

}  // namespace helix_arm::estimation
