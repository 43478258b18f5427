#include "helix_arm/calibration/contraction_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "basics/median.hpp"
#include "calibration_checks.hpp"

namespace helix_arm::estimation {
namespace {

// Enough for the curves of braided muscles; more would follow the noise of single readings.
constexpr int kMostKnots = 7;

// Second derivatives at the knots by the lengths there; 0 at both ends.
Eigen::MatrixXd bendsOf(const std::vector<double>& knots) {
  const auto n = static_cast<Eigen::Index>(knots.size());
  Eigen::MatrixXd left = Eigen::MatrixXd::Identity(n, n), right = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index i = 1; i + 1 < n; ++i) {
    const double before = knots[i] - knots[i - 1], after = knots[i + 1] - knots[i];
    left.row(i).segment<3>(i - 1) << before / 6, (before + after) / 3, after / 6;
    right.row(i).segment<3>(i - 1) << 1 / before, -1 / before - 1 / after, 1 / after;
  }
  // The bend at the first knot is 0, so that its column does not count; the others are symmetric.
  left.col(0).tail(n - 1).setZero();
  return left.llt().solve(right);
}

std::vector<double> quantilesOf(const std::vector<double>& pressures) {
  const std::size_t count = std::min<std::size_t>(kMostKnots, pressures.size());
  std::vector<double> knots;
  for (std::size_t k = 0; k < count; ++k) {
    const double place =
        static_cast<double>(k * (pressures.size() - 1)) / static_cast<double>(count - 1);
    const auto below = std::min(static_cast<std::size_t>(place), pressures.size() - 2);
    const double share = place - static_cast<double>(below);
    knots.push_back((1 - share) * pressures[below] + share * pressures[below + 1]);
  }
  return knots;
}

// A smaller change of the pressure, relative to the largest one, is noise of the regulator and
// starts no new branch.
constexpr double kLeastMove = 0.01;

// 1 if the pressure had risen before the sample, -1 if it had fallen, 0 before its first change.
std::vector<int> arrivals(const std::vector<double>& pressure, double least_move) {
  std::vector<int> out(pressure.size(), 0);
  for (std::size_t i = 1, last = 0; i < pressure.size(); ++i) {
    const double move = pressure[i] - pressure[last];
    out[i] = out[i - 1];
    if (std::abs(move) <= least_move) continue;
    out[i] = move > 0 ? 1 : -1;
    last = i;
  }
  return out;
}

/// The branches that a sample is on, see Branch.
struct Branches {
  bool rising, falling;
};

std::vector<Branches> branchesOf(const std::vector<LengthSample>& samples) {
  std::vector<double> pressure;
  for (const LengthSample& sample : samples) pressure.push_back(sample.pressure);
  if (pressure.empty()) return {};
  const double least_move = kLeastMove * *std::max_element(pressure.begin(), pressure.end());
  const std::vector<int> before = arrivals(pressure, least_move);
  std::reverse(pressure.begin(), pressure.end());
  std::vector<int> after = arrivals(pressure, least_move);  // in reverse order, a rise is a fall
  std::reverse(after.begin(), after.end());
  std::vector<Branches> out;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    out.push_back({before[i] > 0 || after[i] < 0, before[i] < 0 || after[i] > 0});
  }
  return out;
}

// Shortest and longest free length of a muscle, as scenes have them [m].
constexpr double kShortest = 1e-6, kLongest = 10.0;

// The unit in which a length that is too long for metres would be a usual one; empty if there is
// none.
std::string unitOfLength(double length) {
  const auto isUsual = [](double metres) { return metres > 0.02 && metres < 2.0; };
  return isUsual(1e-3 * length)
             ? ", such as " + messageOf(1e-3 * length) + " if it is in millimetres"
         : isUsual(1e-2 * length)
             ? ", such as " + messageOf(1e-2 * length) + " if it is in centimetres"
             : "";
}

constexpr int kCoefficients = 6;
// Largest first pressure of a quintic, relative to the largest pressure.
constexpr double kNearZero = 0.05;
// Smallest slope of a curve, relative to the mean slope; it keeps the curve invertible.
constexpr double kLeastSlope = 1e-3;
// Minimum significance of the trend, in standard errors of its slope.
constexpr double kLeastTrend = 2.0;
// Pressures closer than this, relative to the largest one, are the same value written with other
// digits.
constexpr double kSameKnot = 1e-6;
constexpr int kSlopeChecks = 1001;
// A piecewise cubic through so many points between two knots is the spline to 0.01 mm.
constexpr int kPointsPerKnot = 4;
// If pressures are closer than this, rounding exceeds the effect of the sixth coefficient.
constexpr double kRankThreshold = 1e-8;

using Coefficients = Eigen::Matrix<double, kCoefficients, 1>;
using Matrix6 = Eigen::Matrix<double, kCoefficients, kCoefficients>;

ContractionFit failed(std::string reason) {
  ContractionFit fit;
  fit.reason = std::move(reason);
  return fit;
}

std::string shortestReason(double length) {
  return messageOf("the best curve has a length of ", length,
                   " m; expected lengths > 0: correct the samples");
}

// Why the first faulty sample is refused; empty if all are sound.
std::string faultOf(const std::vector<LengthSample>& samples) {
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto [pressure, length] = samples[i];
    const std::string at = messageOf("sample ", i + 1, ": the ");
    if (!std::isfinite(pressure)) {
      return messageOf(at, "pressure is ", pressure,
                       "; expected a finite value; correct it or leave it out");
    }
    if (!(std::isfinite(length) && length > 0)) {
      return messageOf(at, "length is ", length,
                       " m; expected a finite value > 0; correct it or leave it out");
    }
    if (length < kShortest || length > kLongest) {
      return messageOf(at, "length is ", length, " m; expected ", kShortest, " to ", kLongest, " m",
                       unitOfLength(length));
    }
    if (pressure < 0) {
      return messageOf(at, "pressure is ", pressure,
                       " Pa; expected gauge pressures >= 0; set readings of a vented muscle to 0");
    }
  }
  return {};
}

// Samples of the branch, sorted by pressure; lengths at one pressure are averaged.
struct Knots {
  std::vector<double> pressure, length, weight;

  std::size_t size() const { return pressure.size(); }
};

Knots knotsOf(const std::vector<LengthSample>& samples, const std::vector<bool>& counts) {
  std::vector<LengthSample> sorted;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (counts[i]) sorted.push_back(samples[i]);
  }
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const auto& a, const auto& b) { return a.pressure < b.pressure; });
  Knots knots;
  for (const auto& [pressure, length] : sorted) {
    if (knots.size() == 0 ||
        pressure - knots.pressure.back() > kSameKnot * sorted.back().pressure) {
      knots.pressure.push_back(pressure);
      knots.length.push_back(0);
      knots.weight.push_back(0);
    }
    knots.weight.back() += 1;
    knots.length.back() += (length - knots.length.back()) / knots.weight.back();
  }
  return knots;
}

// Slope of the line through the samples of the branch [m/Pa]; 0 if it is not significant.
double trendOf(const std::vector<LengthSample>& samples, const std::vector<bool>& counts) {
  std::vector<double> pressures, lengths;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (!counts[i]) continue;
    pressures.push_back(samples[i].pressure);
    lengths.push_back(samples[i].length);
  }
  const auto n = static_cast<Eigen::Index>(pressures.size());
  Eigen::VectorXd p = Eigen::VectorXd::Map(pressures.data(), n);
  Eigen::VectorXd l = Eigen::VectorXd::Map(lengths.data(), n);
  const double mean_length = l.mean();
  p.array() -= p.mean();
  l.array() -= mean_length;
  const double slope = p.dot(l) / p.squaredNorm();
  // Lengths that differ only by rounding have no slope.
  if (l.squaredNorm() <= static_cast<double>(n) * std::pow(1e-12 * mean_length, 2)) return 0;
  const double freedom = static_cast<double>(n) - 2;
  const double variance =
      freedom > 0 ? (l - slope * p).squaredNorm() / freedom / p.squaredNorm() : 0;
  return std::abs(slope) > kLeastTrend * std::sqrt(variance) ? slope : 0;
}

// Least squares under G c >= least (Lawson and Hanson, Solving Least Squares Problems, 1974, ch.
// 23: the multipliers are >= 0, and 0 where their constraint is loose).
//
// @param R, z  of the orthogonal decomposition of the samples: |R c - z| is least.
struct Constrained {
  Coefficients c;
  bool tight;  // whether any constraint is active
};
Constrained solveConstrained(const Matrix6& R, const Coefficients& z,
                             const Eigen::Matrix<double, Eigen::Dynamic, kCoefficients>& G,
                             double least) {
  // x = R c - z turns it into the shortest x with M x >= d.
  const auto upper = R.triangularView<Eigen::Upper>();
  const Eigen::Matrix<double, kCoefficients, Eigen::Dynamic> Mt =
      upper.transpose().solve(G.transpose());
  const Eigen::VectorXd d = Eigen::VectorXd::Constant(G.rows(), least) - Mt.transpose() * z;
  std::vector<Eigen::Index> tight;
  Eigen::VectorXd multiplier = Eigen::VectorXd::Zero(G.rows());
  Coefficients x = Coefficients::Zero();
  for (Eigen::Index round = 0; round < G.rows(); ++round) {
    Eigen::Index worst = 0;
    const double violation = (d - Mt.transpose() * x).maxCoeff(&worst);
    // A thousandth of the smallest slope is rounding, not a violation.
    if (violation <= 1e-3 * least) break;
    tight.push_back(worst);
    for (;;) {
      const auto count = static_cast<Eigen::Index>(tight.size());
      Eigen::MatrixXd columns(kCoefficients, count);
      Eigen::VectorXd target(count);
      for (Eigen::Index k = 0; k < count; ++k) {
        columns.col(k) = Mt.col(tight[k]);
        target[k] = d[tight[k]];
      }
      // Shortest x that meets all active constraints, x = columns * wanted.
      const Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> rows(columns.transpose());
      const Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> combination(columns);
      const Eigen::VectorXd shortest = rows.solve(target), wanted = combination.solve(shortest);
      x = shortest;
      double step = 1.0;
      Eigen::Index blocking = -1;
      for (Eigen::Index k = 0; k < count; ++k) {
        const double now = multiplier[tight[k]];
        if (wanted[k] > 0 || now / (now - wanted[k]) > step) continue;
        step = now / (now - wanted[k]);
        blocking = k;
      }
      for (Eigen::Index k = 0; k < count; ++k) {
        double& now = multiplier[tight[k]];
        now = k == blocking ? 0.0 : now + step * (wanted[k] - now);
      }
      if (blocking < 0) break;
      tight.erase(tight.begin() + blocking);
    }
  }
  return {upper.solve(x + z), !tight.empty()};
}

ContractionFit fitQuintic(const Knots& knots, double trend) {
  const double first = knots.pressure.front(), last = knots.pressure.back();
  if (first > kNearZero * last) {
    return failed(
        messageOf("the smallest pressure is ", first, " Pa; expected at most ", kNearZero,
                  " of the largest, ", last,
                  " Pa, since a quintic begins at 0: measure the vented muscle too, or fit "
                  "a table"));
  }
  const auto n = static_cast<Eigen::Index>(knots.size());
  if (n < kCoefficients) {
    return failed(messageOf("distinct pressures: ", n, "; expected at least ", kCoefficients,
                            " for a quintic: measure at more, or fit a table"));
  }
  Eigen::Matrix<double, Eigen::Dynamic, kCoefficients> A(n, kCoefficients);
  Eigen::VectorXd y(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double root = std::sqrt(knots.weight[i]);
    double power = root;
    for (int k = 0; k < kCoefficients; ++k, power *= knots.pressure[i] / last) A(i, k) = power;
    y[i] = root * knots.length[i];
  }
  const Eigen::HouseholderQR<Eigen::MatrixXd> decomposition(A);
  const Matrix6 R = decomposition.matrixQR().topRows<kCoefficients>();
  const auto diagonal = R.diagonal().cwiseAbs();
  if (diagonal.minCoeff() <= kRankThreshold * diagonal.maxCoeff()) {
    return failed(messageOf(n, " pressures, too close together to determine the ", kCoefficients,
                            " coefficients of a quintic: spread them, or fit a table"));
  }
  const Coefficients z = (decomposition.householderQ().adjoint() * y).head<kCoefficients>();

  // Slopes, positive in the direction of the trend.
  Eigen::Matrix<double, Eigen::Dynamic, kCoefficients> G(kSlopeChecks, kCoefficients);
  for (int i = 0; i < kSlopeChecks; ++i) {
    double power = trend < 0 ? -1.0 : 1.0;
    G(i, 0) = 0;
    for (int k = 1; k < kCoefficients; ++k, power *= i / (kSlopeChecks - 1.0)) {
      G(i, k) = k * power;
    }
  }
  const Constrained solution = solveConstrained(R, z, G, kLeastSlope * std::abs(trend) * last);
  ContractionFit fit;
  fit.constrained = solution.tight;
  fit.reference_pressure = last;
  Coefficients::Map(fit.coefficients.data()) = solution.c;
  const double shortest = trend < 0 ? solution.c.sum() : solution.c[0];
  if (!(shortest > 0)) return failed(shortestReason(shortest));
  fit.curve = model::Contraction::quintic(fit.coefficients, last, last);
  return fit;
}

// Least squares of lengths that fall, or rise, by at least the least slope (pool adjacent
// violators).
ContractionFit fitTable(const Knots& knots, double trend) {
  struct Pool {
    double mean, weight;
    std::size_t count;
  };
  const double sign = trend < 0 ? -1.0 : 1.0;
  const double slope = kLeastSlope * std::abs(trend);
  // Length minus the smallest permitted change: monotone if the lengths are steep enough.
  const auto excess = [&](std::size_t i) {
    return sign * knots.length[i] - slope * knots.pressure[i];
  };
  std::vector<Pool> pools;
  for (std::size_t i = 0; i < knots.size(); ++i) {
    pools.push_back({excess(i), knots.weight[i], 1});
    for (; pools.size() > 1 && pools[pools.size() - 2].mean > pools.back().mean; pools.pop_back()) {
      Pool& into = pools[pools.size() - 2];
      const Pool& from = pools.back();
      into.mean += (from.mean - into.mean) * from.weight / (into.weight + from.weight);
      into.weight += from.weight;
      into.count += from.count;
    }
  }
  ContractionFit fit;
  fit.constrained = pools.size() < knots.size();
  fit.pressures = knots.pressure;
  for (const Pool& pool : pools) {
    for (std::size_t k = 0; k < pool.count; ++k) {
      const std::size_t i = fit.lengths.size();
      fit.lengths.push_back(pool.count == 1 ? knots.length[i]
                                            : sign * (pool.mean + slope * knots.pressure[i]));
    }
  }
  const double shortest = std::min(fit.lengths.front(), fit.lengths.back());
  if (!(shortest > 0)) return failed(shortestReason(shortest));
  fit.curve = model::Contraction::table(fit.pressures, fit.lengths);
  return fit;
}

// The spline at close points, held monotone.
ContractionFit fitSplineTable(const Knots& knots, double trend, const ContractionSpline* given) {
  ContractionSpline spline =
      given != nullptr ? *given : fitSpline(knots.pressure, knots.length, knots.weight);
  Knots points;
  for (std::size_t k = 0; k + 1 < spline.knots.size(); ++k) {
    const double step = (spline.knots[k + 1] - spline.knots[k]) / kPointsPerKnot;
    for (int i = 0; i < kPointsPerKnot; ++i) points.pressure.push_back(spline.knots[k] + i * step);
  }
  points.pressure.push_back(spline.knots.back());
  for (const double p : points.pressure)
    points.length.push_back(spline.weights(p) * spline.lengths);
  points.weight.assign(points.size(), 1.0);
  ContractionFit fit = fitTable(points, trend);
  if (fit.curve) fit.spline = std::move(spline);
  return fit;
}

// The curve alone, if there is none with its reason. @param given  spline to use instead of a fit.
ContractionFit curveOf(const std::vector<LengthSample>& samples, const std::vector<bool>& counts,
                       const ContractionFitOptions& options, const ContractionSpline* given) {
  const Knots knots = knotsOf(samples, counts);
  const bool quintic = options.kind == CurveKind::kQuintic;
  if (knots.size() < 2) {
    const char* const where = options.branch == Branch::kBoth     ? ""
                              : options.branch == Branch::kRising ? " on the rising branch"
                                                                  : " on the falling branch";
    return failed(messageOf("distinct pressures", where, ": ", knots.size(), "; expected at least ",
                            quintic ? kCoefficients : 2, ": measure at more"));
  }
  const double trend = trendOf(samples, counts);
  if (trend == 0) {
    return failed(
        messageOf("the lengths neither rise nor fall with pressure; expected a linear trend of "
                  "at least ",
                  kLeastTrend, " of its standard errors: check which column is which"));
  }
  return quintic                             ? fitQuintic(knots, trend)
         : options.kind == CurveKind::kTable ? fitTable(knots, trend)
                                             : fitSplineTable(knots, trend, given);
}

// @param given  spline to use instead of a fit, if any.
ContractionFit fittedCurve(const std::vector<LengthSample>& samples,
                           const ContractionFitOptions& options, const ContractionSpline* given) {
  const auto of_kind = [&options](ContractionFit fit) {
    fit.kind = options.kind;
    return fit;
  };
  if (const std::string fault = faultOf(samples); !fault.empty()) return of_kind(failed(fault));
  const std::vector<Branches> branches = branchesOf(samples);
  std::vector<bool> counts;
  for (const Branches& on : branches) {
    counts.push_back(options.branch == Branch::kBoth ||
                     (options.branch == Branch::kRising ? on.rising : on.falling));
  }
  ContractionFit fit = of_kind(curveOf(samples, counts, options, given));
  if (!fit.curve) return fit;

  fit.residual = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(samples.size()));
  std::vector<double> rising, falling;  // residuals of samples on one branch only
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto [pressure, length] = samples[i];
    const model::Range range = fit.curve->inputRange();
    if (!counts[i] && !range.contains(pressure)) continue;
    const double residual =
        fit.curve->length(std::clamp(pressure, range.lower, range.upper)) - length;
    if (counts[i]) fit.residual[static_cast<Eigen::Index>(i)] = residual;
    if (branches[i].rising != branches[i].falling) {
      (branches[i].rising ? rising : falling).push_back(residual);
    }
  }
  fit.rms = fit.residual.norm() /
            std::sqrt(static_cast<double>(std::count(counts.begin(), counts.end(), true)));
  if (!rising.empty() && !falling.empty())
    fit.hysteresis = basics::medianOf(falling) - basics::medianOf(rising);
  return fit;
}

}  // namespace

Eigen::RowVectorXd ContractionSpline::weights(double pressure) const {
  const auto above = std::upper_bound(knots.begin() + 1, knots.end() - 1, pressure);
  const Eigen::Index i = above - knots.begin() - 1;
  const double h = knots[i + 1] - knots[i];
  const double b = (pressure - knots[i]) / h, a = 1 - b;
  const Eigen::MatrixXd bends = bendsOf(knots);
  Eigen::RowVectorXd out =
      h * h / 6 * ((a * a * a - a) * bends.row(i) + (b * b * b - b) * bends.row(i + 1));
  out[i] += a;
  out[i + 1] += b;
  return out;
}

ContractionSpline fitSpline(const std::vector<double>& pressures,
                            const std::vector<double>& lengths,
                            const std::vector<double>& weights) {
  ContractionSpline spline;
  spline.knots = quantilesOf(pressures);
  const auto n = static_cast<Eigen::Index>(spline.knots.size());
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
  for (std::size_t i = 0; i < pressures.size(); ++i) {
    const Eigen::RowVectorXd row = spline.weights(pressures[i]);
    information += weights[i] * row.transpose() * row;
    right += weights[i] * lengths[i] * row.transpose();
  }
  const Eigen::LLT<Eigen::MatrixXd> factors(information);
  spline.lengths = factors.solve(right);
  // The inverse of the factor L': its product with its transpose is the inverse of L L'.
  spline.root = kFreeLengthNoise * factors.matrixU().solve(Eigen::MatrixXd::Identity(n, n));
  return spline;
}

ContractionFit fitContraction(const std::vector<LengthSample>& samples,
                              const ContractionFitOptions& options) {
  return fittedCurve(samples, options, nullptr);
}

ContractionFit contractionOf(const ContractionSpline& spline,
                             const std::vector<LengthSample>& samples, Branch branch) {
  return fittedCurve(samples, {CurveKind::kSpline, branch}, &spline);
}

}  // namespace helix_arm::estimation
