#include "stand_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <utility>

#include "basics/least_squares.hpp"
#include "basics/median.hpp"
#include "calibration_checks.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::estimation {
namespace {

constexpr int kMostStandKnots = 7;
constexpr int kLeastOfKnot = 8;         // readings nearest to a knot
constexpr double kLeastStretch = 0.02;  // of the lengths, relative to the longest
constexpr double kStandMove = 0.01;     // change of pressure that starts a branch, of the largest
constexpr int kTenths = 10;

// Hats of knots at a pressure.
Eigen::RowVectorXd hatsAt(const std::vector<double>& knots, double p) {
  Eigen::RowVectorXd out = Eigen::RowVectorXd::Zero(static_cast<Eigen::Index>(knots.size()));
  const auto above = std::upper_bound(knots.begin() + 1, knots.end() - 1, p);
  const Eigen::Index i = above - knots.begin() - 1;
  const double t = std::clamp((p - knots[i]) / (knots[i + 1] - knots[i]), 0.0, 1.0);
  out[i] = 1 - t;
  out[i + 1] = t;
  return out;
}

// Even pressures, without those near which nothing was measured.
std::vector<double> standKnots(const std::vector<StandReading>& readings) {
  double least = readings.front().pressure, most = least;
  for (const StandReading& one : readings) {
    least = std::min(least, one.pressure);
    most = std::max(most, one.pressure);
  }
  std::vector<int> near(kMostStandKnots, 0);
  const double step = (most - least) / (kMostStandKnots - 1);
  for (const StandReading& one : readings) {
    if (step > 0) ++near[static_cast<std::size_t>(std::lround((one.pressure - least) / step))];
  }
  std::vector<double> out;
  for (int k = 0; k < kMostStandKnots && step > 0; ++k) {
    const bool end = k == 0 || k == kMostStandKnots - 1;
    if (end || near[static_cast<std::size_t>(k)] >= kLeastOfKnot) out.push_back(least + k * step);
  }
  return out;
}

// The stiffness a [N/m] of one muscle and its free length [m] at the knots: (2 knots).
class StandProblem {
 public:
  StandProblem(const std::vector<StandReading>& readings, const std::vector<double>& knots,
               int muscles)
      : hats_(readings.size(), knots.size()),
        spline_(readings.size(), knots.size()),
        length_(readings.size()),
        force_(readings.size()) {
    const ContractionSpline spline{knots, {}, {}};
    for (std::size_t i = 0; i < readings.size(); ++i) {
      const auto row = static_cast<Eigen::Index>(i);
      hats_.row(row) = hatsAt(knots, readings[i].pressure);
      spline_.row(row) = spline.weights(readings[i].pressure);
      length_[row] = readings[i].length;
      force_[row] = readings[i].force / muscles;
    }
  }

  // With a l linear between the knots as well: a linear problem.
  Eigen::VectorXd start() const {
    Eigen::MatrixXd A(hats_.rows(), 2 * hats_.cols());
    A << length_.asDiagonal() * hats_, -hats_;
    Eigen::VectorXd z = A.colPivHouseholderQr().solve(force_);
    const Eigen::Index n = hats_.cols();
    z.tail(n) = z.tail(n).cwiseQuotient(z.head(n));
    return z;
  }

  Eigen::VectorXd residual(const Eigen::VectorXd& z) const {
    const Eigen::Index n = hats_.cols();
    return (hats_ * z.head(n)).cwiseProduct(length_ - spline_ * z.tail(n)) - force_;
  }
  double cost(const Eigen::VectorXd& z) const { return residual(z).squaredNorm() / 2; }
  basics::DenseEquations linearise(const Eigen::VectorXd& z) const {
    const Eigen::Index n = hats_.cols();
    const Eigen::VectorXd stretch = length_ - spline_ * z.tail(n), stiffness = hats_ * z.head(n);
    Eigen::MatrixXd J(hats_.rows(), 2 * n);
    J << stretch.asDiagonal() * hats_, Eigen::VectorXd(-stiffness).asDiagonal() * spline_;
    return {J.transpose() * J, J.transpose() * residual(z)};
  }
  static Eigen::VectorXd moved(const Eigen::VectorXd& z, const Eigen::VectorXd& dz) {
    return z + dz;
  }

 private:
  Eigen::MatrixXd hats_, spline_;
  Eigen::VectorXd length_, force_;  // of one muscle
};

StandFit refused(std::string reason) {
  StandFit out;
  out.reason = std::move(reason);
  return out;
}

// The reading that no law can be fitted to, as a reason; empty if none.
std::string faultOf(const std::vector<StandReading>& readings, double most) {
  double shortest = readings.front().length, longest = shortest;
  for (const StandReading& one : readings) {
    shortest = std::min(shortest, one.length);
    longest = std::max(longest, one.length);
    if (one.length > 0 && one.pressure >= -kStandMove * most) continue;
    return messageOf("a reading has a length of ", one.length, " m at ", one.pressure / 1e3,
                     " kPa; expected lengths > 0 and gauge pressures >= 0");
  }
  if (longest - shortest >= kLeastStretch * longest) return {};
  return messageOf("the lengths are all within ", longest - shortest,
                   " m; expected forces at several "
                   "lengths, by at least 2 % apart: stretch the muscle at each pressure");
}

// The law that the numbers at the knots describe, held monotone.
void setLaw(const std::vector<StandReading>& readings, int muscles, const Eigen::VectorXd& z,
            StandFit& out) {
  const auto n = static_cast<Eigen::Index>(out.pressures.size());
  out.lengths = z.tail(n);
  out.K_eps = z[n] * z.head(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    if (z[k] > 0 && z[n + k] > 0) continue;
    out.reason = messageOf("at ", out.pressures[static_cast<std::size_t>(k)] / 1e3, " kPa ",
                           z[k] > 0 ? "the force vanishes at no length > 0"
                                    : "the force does not rise with the length",
                           "; expected tension to be positive and length_m the muscle's length");
    return;
  }
  std::vector<LengthSample> samples;  // where the force would vanish
  for (const StandReading& one : readings) {
    const double a = hatsAt(out.pressures, one.pressure) * z.head(n);
    samples.push_back({one.pressure, std::max(one.length - one.force / (muscles * a), 1e-6)});
  }
  out.contraction = contractionOf({out.pressures, out.lengths, Eigen::MatrixXd::Zero(n, n)},
                                  samples, Branch::kBoth);
  if (!out.contraction.curve) {
    out.reason = out.contraction.reason;
    return;
  }
  const double least = out.K_eps.minCoeff();
  out.law = StandLaw{*out.contraction.curve, least, {}};
  for (Eigen::Index k = 0; k < n; ++k) {
    out.law->table.input.push_back(out.pressures[static_cast<std::size_t>(k)]);
    out.law->table.factor.push_back(out.K_eps[k] / least);
  }
}

void setErrors(const StandProblem& problem, const Eigen::VectorXd& z, StandFit& out) {
  const auto n = static_cast<Eigen::Index>(out.pressures.size());
  const Eigen::VectorXd residual = problem.residual(z);
  const double factor = basics::correlationFactor(
      residual, std::vector<int>(static_cast<std::size_t>(residual.size()), 0));
  const double variance = factor * residual.squaredNorm() /
                          std::max<double>(1, static_cast<double>(residual.size() - 2 * n));
  const Eigen::MatrixXd covariance =
      variance * problem.linearise(z).hessian.ldlt().solve(Eigen::MatrixXd::Identity(2 * n, 2 * n));
  out.lengths_error = covariance.diagonal().tail(n).cwiseSqrt();
  out.K_eps_error.resize(n);
  for (Eigen::Index k = 0; k < n; ++k) {  // K_eps = l_0 a
    Eigen::VectorXd by = Eigen::VectorXd::Zero(2 * n);
    by[k] += z[n];
    by[n] += z[k];
    out.K_eps_error[k] = std::sqrt(by.dot(covariance * by));
  }
}

StandFit fitReadings(std::vector<StandReading> readings, int muscles) {
  if (readings.empty()) return refused("there are no readings; expected some");
  double most = 0.0;
  for (const StandReading& one : readings) most = std::max(most, one.pressure);
  if (const std::string fault = faultOf(readings, most); !fault.empty()) return refused(fault);
  for (StandReading& one : readings) one.pressure = std::max(one.pressure, 0.0);
  StandFit out;
  out.pressures = standKnots(readings);
  if (out.pressures.size() < 2 || readings.size() <= 2 * out.pressures.size()) {
    return refused(
        "the readings have too few pressures; expected 2 or more, and forces at several "
        "lengths for each");
  }
  const StandProblem problem(readings, out.pressures, muscles);
  const auto found = basics::descend(problem, problem.start(), {1e-6, 10, 1e8, 1e-12, 0, 100});
  setLaw(readings, muscles, found.at, out);
  if (out.law) setErrors(problem, found.at, out);
  return out;
}

// Each run; of a single one, each tenth.
std::vector<StandRun> partsOf(const std::vector<StandRun>& runs) {
  if (runs.size() > 1) return runs;
  const std::vector<StandReading>& all = runs.front().readings;
  std::vector<StandRun> out;
  for (std::size_t k = 0; k < kTenths; ++k) {
    out.push_back({"tenth " + std::to_string(k + 1),
                   {all.begin() + static_cast<std::ptrdiff_t>(k * all.size() / kTenths),
                    all.begin() + static_cast<std::ptrdiff_t>((k + 1) * all.size() / kTenths)}});
  }
  return out;
}

void holdOut(const std::vector<StandRun>& runs, int muscles, StandFit& out) {
  const std::vector<StandRun> parts = partsOf(runs);
  double squares = 0.0;
  std::size_t count = 0;
  for (std::size_t k = 0; k < parts.size(); ++k) {
    std::vector<StandReading> others;
    for (std::size_t j = 0; j < parts.size(); ++j) {
      if (j == k) continue;
      others.insert(others.end(), parts[j].readings.begin(), parts[j].readings.end());
    }
    const StandFit fit = fitReadings(others, muscles);
    if (!fit.law || parts[k].readings.empty()) continue;
    const double rms = compareStand(*fit.law, parts[k], muscles).rms;
    out.held_out.emplace_back(parts[k].name, rms);
    squares += rms * rms * static_cast<double>(parts[k].readings.size());
    count += parts[k].readings.size();
  }
  out.held_out_rms = std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, count)));
}

}  // namespace

double StandLaw::force(double pressure, double length) const {
  const model::Range& range = contraction.inputRange();
  const double p = std::clamp(pressure, range.lower, range.upper);
  return K_eps * (table.empty() ? 1.0 : table.at(p)) * (length - contraction.lengthInside(p)) /
         contraction.restLength();
}

StandComparison compareStand(const StandLaw& law, const StandRun& run, int muscles) {
  StandComparison out;
  const std::vector<StandReading>& all = run.readings;
  out.residual.resize(static_cast<Eigen::Index>(all.size()));
  double least = all.front().force, most = least, largest = 0.0;
  for (const StandReading& one : all) largest = std::max(largest, one.pressure);
  std::vector<double> rising, falling;
  std::size_t turn = 0;  // where the pressure last moved
  int way = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto [pressure, length, force] = all[i];
    const double residual = muscles * law.force(pressure, length) - force;
    out.residual[static_cast<Eigen::Index>(i)] = residual;
    least = std::min(least, force);
    most = std::max(most, force);
    const model::Range& range = law.contraction.inputRange();
    const double slack = kStandMove * (range.upper - range.lower);
    if (pressure < range.lower - slack || pressure > range.upper + slack) ++out.beyond;
    if (std::abs(pressure - all[turn].pressure) > kStandMove * largest) {
      way = pressure > all[turn].pressure ? 1 : -1;
      turn = i;
      (way > 0 ? rising : falling).push_back(residual);
    }
  }
  out.rms = std::sqrt(out.residual.squaredNorm() / static_cast<double>(all.size()));
  out.span = most - least;
  if (!rising.empty() && !falling.empty()) {
    out.loop = std::abs(basics::medianOf(falling) - basics::medianOf(rising));
  }
  return out;
}

StandFit fitStand(const std::vector<StandRun>& runs, int muscles) {
  basics::require(muscles >= 1, "the number of muscles is ", muscles, "; expected 1 or more");
  std::vector<StandReading> all;
  for (const StandRun& run : runs) {
    all.insert(all.end(), run.readings.begin(), run.readings.end());
  }
  StandFit out = fitReadings(all, muscles);
  if (!out.law) return out;
  out.rms = compareStand(*out.law, {"", all}, muscles).rms;
  holdOut(runs, muscles, out);
  return out;
}

}  // namespace helix_arm::estimation
