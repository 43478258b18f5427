#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

#include "basics/median.hpp"
#include "calibration_fit.hpp"

namespace helix_arm::estimation {
namespace {

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
  return basics::medianOf(std::move(errors));
}

// One refit without each group, from the full solution.
struct Refits {
  ReadingKind kind;
  std::vector<Eigen::VectorXd> vectors = {};           // (groups) values of the parameters
  std::vector<std::vector<Comparison>> left_out = {};  // (groups) by the fit without it
  std::vector<model::Twists> shapes = {};              // (captures) by the fit without it
  bool complete = true;
};

// @param of  (captures) group of each.
Refits refit(const CalibrationFit& fit, const std::vector<int>& of, std::size_t groups) {
  CalibrationProblem& problem = *fit.problem;
  Refits refits{problem.kind()};
  refits.shapes.resize(problem.captures());
  const Eigen::VectorXd full = problem.numbers();
  for (int g = 0; g < static_cast<int>(groups); ++g) {
    refits.complete &=
        problem.solve(fit.noise_scale, [&](int capture) { return of[capture] != g; }).converged;
    refits.vectors.push_back(problem.blocks().vector());
    std::vector<Comparison> left_out;
    for (const Comparison& one : problem.compare(fit.noise_scale)) {
      if (of[one.capture] == g) left_out.push_back(one);
    }
    refits.left_out.push_back(std::move(left_out));
    for (int c = 0; c < problem.captures(); ++c) {
      if (of[c] == g) refits.shapes[c] = problem.shape(c).twists();
    }
    problem.setNumbers(full);
  }
  return refits;
}

HeldOut heldOut(const Refits& refits, const std::vector<std::string>& labels,
                const std::vector<Comparison>& in_sample) {
  HeldOut out;
  std::vector<Comparison> all;
  std::vector<std::vector<Comparison>> of_capture(refits.shapes.size());
  for (std::size_t g = 0; g < refits.left_out.size(); ++g) {
    out.groups.push_back({labels[g], errorOf(refits.kind, refits.left_out[g])});
    all.insert(all.end(), refits.left_out[g].begin(), refits.left_out[g].end());
    for (const Comparison& one : refits.left_out[g]) of_capture[one.capture].push_back(one);
  }
  for (const std::vector<Comparison>& one : of_capture)
    out.captures.push_back(errorOf(refits.kind, one));
  out.error = errorOf(refits.kind, all);
  out.in_sample = errorOf(refits.kind, in_sample);
  return out;
}

Jackknife jackknifeOf(const std::vector<ParameterInfo>& infos,
                      const std::vector<Eigen::VectorXd>& vectors) {
  Jackknife out;
  for (const ParameterInfo& info : infos) out.names.push_back(info.name);
  const auto groups = static_cast<Eigen::Index>(vectors.size());
  out.deviations.resize(groups, vectors.front().size());
  for (Eigen::Index g = 0; g < groups; ++g) {
    out.deviations.row(g) = vectors[static_cast<std::size_t>(g)].transpose();
  }
  const Eigen::RowVectorXd mean = out.deviations.colwise().mean();
  const auto count = static_cast<double>(groups);
  out.deviations = std::sqrt((count - 1) / count) * (out.deviations.rowwise() - mean).eval();
  return out;
}

// With smaller exponents, which two digits show as 0, a combination is one parameter.
constexpr double kPureExponent = 0.005;

// Errors of the logs of stiffness parameters that have one.
struct LogErrors {
  std::vector<ParameterInfo> infos;
  std::vector<double> logs;  // of the reported values
  Eigen::MatrixXd covariance;
  Eigen::MatrixXd spread;  // (any x parameters) see Jackknife::deviations
};

// Rows of jackknives, each under the columns of its parameters; those that it held vary by 0.
Eigen::MatrixXd stackedSpreads(const std::vector<Jackknife>& jackknives,
                               const std::vector<ParameterInfo>& infos) {
  Eigen::Index rows = 0;
  for (const Jackknife& one : jackknives) rows = std::max(rows, one.deviations.rows());
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(rows * static_cast<Eigen::Index>(jackknives.size()),
                                              static_cast<Eigen::Index>(infos.size()));
  Eigen::Index first = 0;
  for (const Jackknife& one : jackknives) {
    for (std::size_t i = 0; i < infos.size(); ++i) {
      const auto found = std::find(one.names.begin(), one.names.end(), infos[i].name);
      if (found == one.names.end()) continue;
      out.block(first, static_cast<Eigen::Index>(i), one.deviations.rows(), 1) =
          one.deviations.col(found - one.names.begin());
    }
    first += rows;
  }
  return out;
}

// Parameters that are correlated, directly or through others, as ascending indices.
std::vector<std::vector<int>> correlatedGroups(const Eigen::MatrixXd& covariance) {
  const int count = static_cast<int>(covariance.rows());
  std::vector<int> group(count);
  for (int i = 0; i < count; ++i) group[i] = i;
  for (int i = 0; i < count; ++i) {
    for (int j = 0; j < i; ++j) {
      const double product = std::sqrt(covariance(i, i) * covariance(j, j));
      if (!(std::abs(covariance(i, j)) >= kLeastCorrelation * product)) continue;
      const int from = group[i], to = group[j];
      std::replace(group.begin(), group.end(), from, to);
    }
  }
  std::vector<std::vector<int>> out;
  for (int label = 0; label < count; ++label) {
    std::vector<int> members;
    for (int i = 0; i < count; ++i) {
      if (group[i] == label) members.push_back(i);
    }
    if (members.size() > 1) out.push_back(std::move(members));
  }
  return out;
}

// @param powers  the largest first.
std::string nameOfPowers(const std::vector<Combination::Power>& powers) {
  std::string name;
  for (std::size_t i = 0; i < powers.size(); ++i) {
    if (i >= 2 && std::abs(powers[i].exponent) < kLeastExponent) break;
    char exponent[16];
    std::snprintf(exponent, sizeof exponent, "^%.2f", powers[i].exponent);
    name += (name.empty() ? "" : " ") + powers[i].parameter + exponent;
  }
  return name;
}

// @param axis  (members) unit vector.
Combination combinationAlong(const LogErrors& errors, const std::vector<int>& members,
                             const Eigen::VectorXd& axis) {
  Eigen::VectorXd direction = Eigen::VectorXd::Zero(errors.covariance.rows());
  direction(members) = axis;
  Eigen::Index largest = 0;
  direction.cwiseAbs().maxCoeff(&largest);
  if (direction[largest] < 0) direction = -direction;
  Combination out;
  double log = 0, prior = 0;
  for (const int i : members) {
    const ParameterInfo& info = errors.infos[static_cast<std::size_t>(i)];
    out.powers.push_back({info.name, direction[i]});
    log += direction[i] * errors.logs[static_cast<std::size_t>(i)];
    prior += std::pow(direction[i] * info.deviation, 2);
  }
  std::stable_sort(out.powers.begin(), out.powers.end(), [](const auto& a, const auto& b) {
    return std::abs(a.exponent) > std::abs(b.exponent);
  });
  out.name = nameOfPowers(out.powers);
  out.value = std::exp(log);
  double variance = direction.dot(errors.covariance * direction);
  if (errors.spread.rows() > 0) {
    // Along a valley, each fit without a pressure ends elsewhere: nothing is less known than
    // before.
    variance = std::max(variance, std::min(prior, (errors.spread * direction).squaredNorm()));
  }
  out.relative_error = std::sqrt(variance);
  ParameterInfo info = errors.infos[static_cast<std::size_t>(members.front())];
  info.deviation = std::sqrt(prior);
  out.identifiable = isIdentified(info, variance);
  return out;
}

// Combinations of one group; none if each of them is one parameter to two digits, or if the data
// determine none: then the parameters alone say more.
std::vector<Combination> combinationsAmong(const LogErrors& errors,
                                           const std::vector<int>& members) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> axes(errors.covariance(members, members));
  std::vector<Combination> out;
  bool mixed = false, known = false;
  for (Eigen::Index j = 0; j < axes.eigenvectors().cols(); ++j) {
    out.push_back(combinationAlong(errors, members, axes.eigenvectors().col(j)));
    mixed = mixed || std::abs(out.back().powers[1].exponent) >= kPureExponent;
    known = known || out.back().identifiable;
  }
  if (!mixed || !known) out.clear();
  return out;
}

}  // namespace

CrossValidation crossValidate(const CalibrationFit& fit, const Groups& groups,
                              const std::vector<Comparison>& in_sample) {
  const CalibrationProblem& problem = *fit.problem;
  const std::vector<ArmCaptures>& arms = problem.arms();
  std::vector<std::string> labels;
  for (const Eigen::VectorXd& one : groups.pressure) labels.push_back(pressureText(one));
  Refits refits = refit(fit, groups.of, labels.size());
  CrossValidation out;
  out.by_pressure = heldOut(refits, labels, in_sample);
  out.shapes = std::move(refits.shapes);
  out.complete = refits.complete;
  out.jackknife = jackknifeOf(problem.parameters(), refits.vectors);
  if (arms.size() < 2) return out;
  std::vector<int> arm_of;
  for (int c = 0; c < problem.captures(); ++c) arm_of.push_back(problem.armOf(c));
  labels.clear();
  for (const ArmCaptures& arm : arms) labels.push_back(arm.name);
  out.by_arm = heldOut(refit(fit, arm_of, arms.size()), labels, in_sample);
  return out;
}

std::vector<Combination> combinationsOf(const CalibrationFit& fit,
                                        const std::vector<Parameter>& reported,
                                        const std::vector<Jackknife>& left_out) {
  if (!fit.asked.problem || fit.asked.problem->stiffnessEntries().size() < 2) return {};
  const Eigen::MatrixXd covariance = stiffnessErrors(fit);
  LogErrors errors;
  std::vector<int> kept;
  for (int i = 0; i < static_cast<int>(covariance.rows()); ++i) {
    const ParameterInfo& info = fit.asked.problem->parameters()[static_cast<std::size_t>(i)];
    const auto found =
        std::find_if(reported.begin(), reported.end(),
                     [&info](const Parameter& one) { return one.name == info.name; });
    // A stiffness that is absent from the scene and was held is 0: it has no logarithm.
    if (found == reported.end() || !(found->value > 0)) continue;
    kept.push_back(i);
    errors.infos.push_back(info);
    errors.logs.push_back(std::log(found->value));
  }
  errors.covariance = covariance(kept, kept);
  errors.spread = stackedSpreads(left_out, errors.infos);
  std::vector<Combination> out;
  for (const std::vector<int>& members : correlatedGroups(errors.covariance)) {
    const std::vector<Combination> more = combinationsAmong(errors, members);
    out.insert(out.end(), more.begin(), more.end());
  }
  std::stable_sort(out.begin(), out.end(), [](const Combination& a, const Combination& b) {
    return a.relative_error < b.relative_error;
  });
  return out;
}

}  // namespace helix_arm::estimation
