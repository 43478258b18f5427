#include "response_readings.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace helix_arm::estimation {
namespace {

constexpr int kCurveDegree = 5;     // of a contraction curve and of its inverse
constexpr double kTakesPart = 0.1;  // of the largest range: an actuator that takes part
constexpr double kSameEffectivePressure = 0.02;  // of the range: counts as the same
constexpr double kRestLag = 0.5;                 // [s]
constexpr double kInMotion = 0.02;               // of the range, behind a lag of kRestLag
constexpr double kMostCorrelation = 0.9999;
constexpr double kSignificantWeight = 2.0;  // standard errors

// Number of monomials in n variables up to a degree.
int monomials(int n, int degree) {
  int out = 1;
  for (int k = 1; k <= degree; ++k) out = out * (n + k) / k;
  return out;
}

// Those monomials, multiplied by a product of earlier ones.
template <class Row>
void setMonomials(const Eigen::VectorXd& x, Eigen::Index from, int degree, double product, Row& row,
                  Eigen::Index& column) {
  row[column++] = product;
  if (degree == 0) return;
  for (Eigen::Index i = from; i < x.size(); ++i) {
    setMonomials(x, i, degree - 1, product * x[i], row, column);
  }
}

// The value of x in [-1, 1] to powers 0 .. degree.
template <class Row>
void setPowers(double x, int degree, Row&& row) {
  double power = 1.0;
  for (int k = 0; k <= degree; ++k, power *= x) row[k] = power;
}

// Least squares min |columns c - target| in which the first `free` coefficients have any sign and
// the few others none below zero: of all sets of the others, the best whose coefficients are >= 0.
class NonNegativeLeastSquares {
 public:
  struct Solution {
    double rss = std::numeric_limits<double>::infinity();
    std::vector<int> columns;       // of those beyond the free ones, which have a weight
    Eigen::VectorXd weight, error;  // theirs, with standard errors
  };

  NonNegativeLeastSquares(const Eigen::MatrixXd& columns, const Eigen::VectorXd& target,
                          Eigen::Index free)
      : gram_(columns.transpose() * columns),
        projected_(columns.transpose() * target),
        target2_(target.squaredNorm()),
        rows_(columns.rows()),
        free_(free) {}

  // @param allowed  bits of the columns beyond the free ones that may have a weight.
  Solution solve(unsigned allowed) const {
    Solution best;
    for (unsigned set = 0; set <= allowed; ++set) {
      if ((set & ~allowed) != 0) continue;
      Solution next = solveSet(set);
      if (next.rss < best.rss) best = std::move(next);
    }
    return best;
  }

 private:
  Solution solveSet(unsigned set) const {
    Solution out;
    std::vector<Eigen::Index> index;
    for (Eigen::Index k = 0; k < free_; ++k) index.push_back(k);
    for (Eigen::Index j = 0; free_ + j < gram_.cols(); ++j) {
      if ((set >> j & 1U) == 0) continue;
      out.columns.push_back(static_cast<int>(j));
      index.push_back(free_ + j);
    }
    const auto n = static_cast<Eigen::Index>(index.size());
    const Eigen::MatrixXd G = gram_(index, index);
    const Eigen::VectorXd z = projected_(index);
    const Eigen::LDLT<Eigen::MatrixXd> normal(G);
    const Eigen::VectorXd solution = normal.solve(z);
    const Eigen::Index weights = n - free_;
    out.weight = solution.tail(weights);
    if (weights > 0 && out.weight.minCoeff() < 0) return out;
    out.rss = std::max(target2_ - z.dot(solution), 0.0);
    const double variance = out.rss / static_cast<double>(std::max<Eigen::Index>(rows_ - n, 1));
    out.error = (variance * normal.solve(Eigen::MatrixXd::Identity(n, n)).diagonal().tail(weights))
                    .cwiseMax(0)
                    .cwiseSqrt();
    return out;
  }

  const Eigen::MatrixXd gram_;
  const Eigen::VectorXd projected_;
  const double target2_;
  const Eigen::Index rows_, free_;
};

}  // namespace

ResponseReadings::ResponseReadings(const model::InputHistory& history,
                                   const Eigen::MatrixXd& reading, Kind kind, int degree)
    : history_(history), kind_(kind), degree_(degree) {
  const Eigen::RowVectorXd low = history.input.colwise().minCoeff();
  const Eigen::RowVectorXd high = history.input.colwise().maxCoeff();
  const double widest = (high - low).maxCoeff();
  double least = std::numeric_limits<double>::infinity(), most = -least;
  for (Eigen::Index i = 0; i < low.size(); ++i) {
    if (high[i] - low[i] < kTakesPart * widest || widest == 0) continue;
    moving_.push_back(i);
    least = std::min(least, low[i]);
    most = std::max(most, high[i]);
  }
  range_ = moving_.empty() ? 0.0 : most - least;
  middle_ = moving_.empty() ? 0.0 : 0.5 * (most + least);
  std::set<long> distinct;
  for (Eigen::Index row = 0; row < history.rows(); ++row) {
    if (history.starts_anew[static_cast<std::size_t>(row)]) ++trials_;
    if (!perActuator()) {
      if (reading.row(row).allFinite()) usable_.push_back({row, -1, trials_ - 1});
      continue;
    }
    for (const Eigen::Index i : moving_) {
      if (!std::isfinite(reading(row, i))) continue;
      usable_.push_back({row, i, trials_ - 1});
      distinct.insert(std::lround(history.input(row, i) / (kSameEffectivePressure * range_)));
    }
  }
  outputs_ = perActuator() ? 1 : reading.cols();
  reading_.resize(static_cast<Eigen::Index>(usable_.size()), outputs_);
  for (std::size_t k = 0; k < usable_.size(); ++k) {
    const auto& [row, i, trial] = usable_[k];
    if (perActuator()) {
      reading_(static_cast<Eigen::Index>(k), 0) = reading(row, i);
    } else {
      reading_.row(static_cast<Eigen::Index>(k)) = reading.row(row);
    }
  }
  if (perActuator()) degree_ = std::min(kCurveDegree, static_cast<int>(distinct.size()) - 1);
  coefficients_ =
      perActuator() ? degree_ + 1 : monomials(static_cast<int>(moving_.size()), degree_);
}

Eigen::MatrixXd ResponseReadings::effective(const model::Response& response) const {
  Eigen::MatrixXd effective = history_.input;
  for (const Eigen::Index i : moving_) {
    model::ResponseState state(response);
    for (Eigen::Index row = 0; row < effective.rows(); ++row) {
      const auto k = static_cast<std::size_t>(row);
      if (history_.starts_anew[k]) state.restart();
      const bool first = history_.starts_anew[k];
      const double dt = history_.time.empty() ? std::numeric_limits<double>::infinity()
                        : first               ? 0.0
                                              : history_.time[k] - history_.time[k - 1];
      state.step(history_.input(row, i), dt);
      effective(row, i) = state.effective();
    }
  }
  return effective;
}

Eigen::MatrixXd ResponseReadings::basis(const Eigen::MatrixXd& effective) const {
  Eigen::MatrixXd out(static_cast<Eigen::Index>(usable_.size()), coefficients_);
  const auto scaled = [&](double pressure) { return (pressure - middle_) / (0.5 * range_); };
  Eigen::VectorXd x(static_cast<Eigen::Index>(moving_.size()));
  for (std::size_t k = 0; k < usable_.size(); ++k) {
    auto row = out.row(static_cast<Eigen::Index>(k));
    if (perActuator()) {
      setPowers(scaled(effective(usable_[k].row, usable_[k].actuator)), degree_, row);
      continue;
    }
    for (std::size_t a = 0; a < moving_.size(); ++a) {
      x[static_cast<Eigen::Index>(a)] = scaled(effective(usable_[k].row, moving_[a]));
    }
    Eigen::Index column = 0;
    setMonomials(x, 0, degree_, 1.0, row, column);
  }
  return out;
}

Eigen::VectorXd ResponseReadings::residual(const model::Response& response) const {
  const Eigen::MatrixXd columns = basis(effective(response));
  const Eigen::LDLT<Eigen::MatrixXd> normal(columns.transpose() * columns);
  Eigen::MatrixXd deviation = reading_ - columns * normal.solve(columns.transpose() * reading_);
  return Eigen::Map<const Eigen::VectorXd>(deviation.data(), deviation.size());
}

Eigen::VectorXd ResponseReadings::heldOutErrors(const model::Response& response) const {
  const Eigen::MatrixXd columns = basis(effective(response));
  const Eigen::MatrixXd normal = columns.transpose() * columns;
  const Eigen::MatrixXd projected = columns.transpose() * reading_;
  std::vector<double> errors;
  Eigen::Index begin = 0;
  for (Eigen::Index end = 1; end <= rows(); ++end) {
    const auto trialOf = [&](Eigen::Index k) { return usable_[static_cast<std::size_t>(k)].trial; };
    if (end < rows() && trialOf(end) == trialOf(begin)) continue;
    const auto own = columns.middleRows(begin, end - begin);
    const auto seen = reading_.middleRows(begin, end - begin);
    const Eigen::LDLT<Eigen::MatrixXd> others(normal - own.transpose() * own);
    const Eigen::MatrixXd error = seen - own * others.solve(projected - own.transpose() * seen);
    errors.push_back(error.norm() / std::sqrt(static_cast<double>(end - begin)));
    begin = end;
  }
  return Eigen::Map<const Eigen::VectorXd>(errors.data(), static_cast<Eigen::Index>(errors.size()));
}

double ResponseReadings::correlationFactor(const Eigen::VectorXd& residual) const {
  const auto rows = static_cast<Eigen::Index>(usable_.size());
  double product = 0.0, square = 0.0;
  for (Eigen::Index output = 0; output < outputs_; ++output) {
    // Readings of one actuator follow one another at the distance of the number of actuators.
    const Eigen::Index stride =
        perActuator() && !moving_.empty() ? static_cast<Eigen::Index>(moving_.size()) : 1;
    for (Eigen::Index k = stride; k < rows; ++k) {
      const Entry& now = usable_[static_cast<std::size_t>(k)];
      const Entry& before = usable_[static_cast<std::size_t>(k - stride)];
      if (now.actuator != before.actuator ||
          history_.starts_anew[static_cast<std::size_t>(now.row)]) {
        continue;
      }
      product += residual[output * rows + k] * residual[output * rows + k - stride];
      square += residual[output * rows + k] * residual[output * rows + k];
    }
  }
  const double correlation = square > 0 ? std::clamp(product / square, 0.0, kMostCorrelation) : 0.0;
  return (1 + correlation) / (1 - correlation);
}

double ResponseReadings::largestReversal() const {
  double largest = 0.0;
  for (const Eigen::Index i : moving_) {
    double low = 0, high = 0, down = 0, up = 0;
    for (Eigen::Index row = 0; row < history_.rows(); ++row) {
      const double p = history_.input(row, i);
      if (history_.starts_anew[static_cast<std::size_t>(row)]) {
        low = high = p;
        down = up = 0;
      }
      low = std::min(low, p);
      high = std::max(high, p);
      down = std::max(down, high - p);
      up = std::max(up, p - low);
      largest = std::max(largest, std::min(down, up));
    }
  }
  return range_ > 0 ? largest / range_ : 0.0;
}

ResponseReadings::Motion ResponseReadings::motion() const {
  Motion motion;
  if (history_.time.empty() || moving_.empty()) return motion;
  model::Response rest;
  rest.rise_time = rest.fall_time = kRestLag;
  const Eigen::MatrixXd behind = history_.input - effective(rest);
  motion.rising = static_cast<int>((behind.array() > kInMotion * range_).count());
  motion.falling = static_cast<int>((behind.array() < -kInMotion * range_).count());
  return motion;
}

// The reading as a polynomial of itself and the plays' share of the effective pressure: columns
// whose combination is the pressure behind the lags.
ResponseReadings::WeightProblem ResponseReadings::weightProblem(
    const model::Response& lags, const std::vector<double>& reaches) const {
  const Eigen::MatrixXd x = effective(lags);
  const int curve = degree_ + 1;
  const auto rows = static_cast<Eigen::Index>(usable_.size());
  WeightProblem out{Eigen::MatrixXd(rows, curve + static_cast<Eigen::Index>(reaches.size())),
                    Eigen::VectorXd(rows)};
  const double low = reading_.minCoeff(), high = reading_.maxCoeff();
  for (Eigen::Index k = 0; k < rows; ++k) {
    const Entry& entry = usable_[static_cast<std::size_t>(k)];
    setPowers((2 * reading_(k, 0) - low - high) / (high - low), degree_, out.columns.row(k));
    out.target[k] = x(entry.row, entry.actuator) / range_;
  }
  for (std::size_t j = 0; j < reaches.size(); ++j) {
    model::Response play = lags;
    play.play_count = 1;
    play.plays[0] = {reaches[j], 0.5};
    const Eigen::MatrixXd behind = effective(play);  // x + (y - x) / 2
    for (Eigen::Index k = 0; k < rows; ++k) {
      const Entry& entry = usable_[static_cast<std::size_t>(k)];
      out.columns(k, curve + static_cast<Eigen::Index>(j)) =
          -2 * (behind(entry.row, entry.actuator) - x(entry.row, entry.actuator)) / range_;
    }
  }
  return out;
}

model::Response ResponseReadings::withWeights(const model::Response& lags,
                                              const std::vector<double>& reaches) const {
  model::Response out = lags;
  out.play_count = 0;
  const WeightProblem problem = weightProblem(out, reaches);
  const NonNegativeLeastSquares fit(problem.columns, problem.target, degree_ + 1);
  // The least significant play is left out until all are significant.
  unsigned allowed = (1U << reaches.size()) - 1;
  NonNegativeLeastSquares::Solution best;
  for (;;) {
    best = fit.solve(allowed);
    Eigen::Index weakest = 0;
    if (best.columns.empty() ||
        (best.weight - kSignificantWeight * best.error).minCoeff(&weakest) > 0)
      break;
    allowed = 0;
    for (std::size_t j = 0; j < best.columns.size(); ++j) {
      if (static_cast<Eigen::Index>(j) != weakest) allowed |= 1U << best.columns[j];
    }
  }
  const double sum = best.columns.empty() ? 0.0 : best.weight.sum();
  const double most = 0.99 * model::Response::kMostWeight;
  for (std::size_t j = 0; j < best.columns.size(); ++j) {
    const double weight = best.weight[static_cast<Eigen::Index>(j)];
    out.plays[static_cast<std::size_t>(out.play_count++)] = {
        reaches[static_cast<std::size_t>(best.columns[j])],
        sum > most ? weight * most / sum : weight};
  }
  return out;
}

}  // namespace helix_arm::estimation
