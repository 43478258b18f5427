#include "cross_validation.hpp"

#include <cmath>
#include <string>
#include <utility>

#include "calibration_fit.hpp"
#include "helix_arm/basics/median.hpp"

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

// Groups of captures to leave out in turn.
struct Folds {
  std::vector<int> of;              // (captures)
  std::vector<std::string> labels;  // (groups)
};

Folds foldsOf(const Groups& groups) {
  Folds folds{groups.of, {}};
  for (const Eigen::VectorXd& pressure : groups.pressure) {
    folds.labels.push_back(pressureText(pressure));
  }
  return folds;
}

Folds foldsOf(const std::vector<ArmCaptures>& arms) {
  Folds folds;
  for (std::size_t a = 0; a < arms.size(); ++a) {
    folds.of.insert(folds.of.end(), arms[a].captures.size(), static_cast<int>(a));
    folds.labels.push_back(arms[a].name);
  }
  return folds;
}

// One refit without each group, from the full solution.
struct Refits {
  std::vector<Eigen::VectorXd> vectors;           // (groups) values of the parameters
  std::vector<std::vector<Comparison>> left_out;  // (groups) by the fit without it
  std::vector<model::Twists> shapes;              // (captures) by the fit without it
  bool complete = true;
};

Refits refit(CalibrationProblem& problem, double noise_scale, const Folds& folds) {
  Refits refits;
  refits.shapes.resize(problem.captures());
  const Values full = problem.values();
  for (int g = 0; g < static_cast<int>(folds.labels.size()); ++g) {
    refits.complete &=
        problem.solve(noise_scale, [&](int capture) { return folds.of[capture] != g; }).converged;
    refits.vectors.push_back(problem.vector());
    std::vector<Comparison> left_out;
    for (const Comparison& one : problem.compare(noise_scale)) {
      if (folds.of[one.capture] == g) left_out.push_back(one);
    }
    refits.left_out.push_back(std::move(left_out));
    for (int c = 0; c < problem.captures(); ++c) {
      if (folds.of[c] == g) refits.shapes[c] = problem.shape(c).twists();
    }
    problem.values() = full;
  }
  return refits;
}

HeldOut heldOut(ReadingKind kind, const Refits& refits, const std::vector<std::string>& labels,
                const std::vector<Comparison>& in_sample) {
  HeldOut out;
  std::vector<Comparison> all;
  std::vector<std::vector<Comparison>> of_capture(refits.shapes.size());
  for (std::size_t g = 0; g < refits.left_out.size(); ++g) {
    out.groups.push_back({labels[g], errorOf(kind, refits.left_out[g])});
    all.insert(all.end(), refits.left_out[g].begin(), refits.left_out[g].end());
    for (const Comparison& one : refits.left_out[g]) of_capture[one.capture].push_back(one);
  }
  for (const std::vector<Comparison>& one : of_capture) out.captures.push_back(errorOf(kind, one));
  out.error = errorOf(kind, all);
  out.in_sample = errorOf(kind, in_sample);
  return out;
}

Eigen::VectorXd jackknifeVariance(const std::vector<Eigen::VectorXd>& vectors) {
  const int groups = static_cast<int>(vectors.size());
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(vectors.front().size());
  for (const Eigen::VectorXd& vector : vectors) mean += vector / groups;
  Eigen::VectorXd variance = Eigen::VectorXd::Zero(mean.size());
  for (const Eigen::VectorXd& vector : vectors) {
    variance += (vector - mean).array().square().matrix() * (groups - 1) / groups;
  }
  return variance;
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

}  // namespace

CrossValidation crossValidate(const std::vector<ArmCaptures>& arms, const Groups& groups,
                              ReadingKind kind, CalibrationProblem& problem, double noise_scale,
                              const std::vector<Comparison>& in_sample) {
  const Folds pressures = foldsOf(groups);
  Refits refits = refit(problem, noise_scale, pressures);
  CrossValidation out;
  out.by_pressure = heldOut(kind, refits, pressures.labels, in_sample);
  out.shapes = std::move(refits.shapes);
  out.complete = refits.complete;
  out.variance = jackknifeVariance(refits.vectors);
  out.jackknife = jackknifeOf(problem.parameters(), refits.vectors);
  if (arms.size() < 2) return out;
  const Folds by_arm = foldsOf(arms);
  out.by_arm = heldOut(kind, refit(problem, noise_scale, by_arm), by_arm.labels, in_sample);
  return out;
}

}  // namespace helix_arm::estimation
