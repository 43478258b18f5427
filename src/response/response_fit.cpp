#include "helix_arm/response/response_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <sstream>
#include <utility>
#include <vector>

#include "basics/least_squares.hpp"
#include "helix_arm/model/arm_response.hpp"

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

/// Readings of what pressures did, as a polynomial of the effective pressures whose coefficients
/// are unknown and eliminated. Keeps a reference to the history.
class ResponseReadings {
 public:
  enum class Kind {
    kPerActuator,  ///< one reading per actuator and row, all of one curve
    kOfTheArm,     ///< up to three readings per row, of all pressures that move
  };

  /// @param degree  of the polynomial, of kOfTheArm; that of a curve follows from its readings.
  ResponseReadings(const model::InputHistory& history, const Eigen::MatrixXd& reading, Kind kind,
                   int degree = 2)
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

  /// Effective pressures (rows x actuators) [Pa].
  Eigen::MatrixXd effective(const model::Response& response) const {
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

  /// Deviation of the readings from the best polynomial.
  Eigen::VectorXd residual(const model::Response& response) const {
    const Eigen::MatrixXd columns = basis(effective(response));
    const Eigen::LDLT<Eigen::MatrixXd> normal(columns.transpose() * columns);
    Eigen::MatrixXd deviation = reading_ - columns * normal.solve(columns.transpose() * reading_);
    return Eigen::Map<const Eigen::VectorXd>(deviation.data(), deviation.size());
  }

  /// RMS error of the readings of each trial, predicted with the polynomial of the others.
  Eigen::VectorXd heldOutErrors(const model::Response& response) const {
    const Eigen::MatrixXd columns = basis(effective(response));
    const Eigen::MatrixXd normal = columns.transpose() * columns;
    const Eigen::MatrixXd projected = columns.transpose() * reading_;
    std::vector<double> errors;
    Eigen::Index begin = 0;
    for (Eigen::Index end = 1; end <= rows(); ++end) {
      const auto trialOf = [&](Eigen::Index k) {
        return usable_[static_cast<std::size_t>(k)].trial;
      };
      if (end < rows() && trialOf(end) == trialOf(begin)) continue;
      const auto own = columns.middleRows(begin, end - begin);
      const auto seen = reading_.middleRows(begin, end - begin);
      const Eigen::LDLT<Eigen::MatrixXd> others(normal - own.transpose() * own);
      const Eigen::MatrixXd error = seen - own * others.solve(projected - own.transpose() * seen);
      errors.push_back(error.norm() / std::sqrt(static_cast<double>(end - begin)));
      begin = end;
    }
    return Eigen::Map<const Eigen::VectorXd>(errors.data(),
                                             static_cast<Eigen::Index>(errors.size()));
  }

  /// Number of rows, or rows of actuators, with readings.
  Eigen::Index rows() const { return reading_.rows(); }
  Eigen::Index count() const { return reading_.size(); }
  int coefficients() const { return coefficients_; }  ///< of the polynomial, per output
  Eigen::Index outputs() const { return outputs_; }   ///< 1, or those of the arm
  double range() const { return range_; }             ///< of the pressures [Pa]
  bool perActuator() const { return kind_ == Kind::kPerActuator; }

  /// Factor by which residuals that are correlated in time raise a variance, >= 1.
  double correlationFactor(const Eigen::VectorXd& residual) const {
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
    const double correlation =
        square > 0 ? std::clamp(product / square, 0.0, kMostCorrelation) : 0.0;
    return (1 + correlation) / (1 - correlation);
  }

  /// Largest stroke back within one memory, relative to the range: the least of down and up.
  double largestReversal() const {
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

  /// Numbers of rows at which a pressure rises, or falls, too fast to be at rest.
  struct Motion {
    int rising = 0, falling = 0;
  };

  Motion motion() const {
    Motion motion;
    if (history_.time.empty() || moving_.empty()) return motion;
    model::Response rest;
    rest.rise_time = rest.fall_time = kRestLag;
    const Eigen::MatrixXd behind = history_.input - effective(rest);
    motion.rising = static_cast<int>((behind.array() > kInMotion * range_).count());
    motion.falling = static_cast<int>((behind.array() < -kInMotion * range_).count());
    return motion;
  }

  /// Weights of plays of these reaches by non-negative least squares, in which also the inverse
  /// curve is linear; those within two standard errors of 0 are left out. kPerActuator only.
  model::Response withWeights(const model::Response& lags,
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

 private:
  struct Entry {
    Eigen::Index row, actuator;  // -1: all
    int trial;
  };
  struct WeightProblem {
    Eigen::MatrixXd columns;  // (usable x (degree + 1 + plays))
    Eigen::VectorXd target;
  };

  Eigen::MatrixXd basis(const Eigen::MatrixXd& effective) const {
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

  // The reading as a polynomial of itself and the plays' share of the effective pressure: columns
  // whose combination is the pressure behind the lags.
  WeightProblem weightProblem(const model::Response& lags,
                              const std::vector<double>& reaches) const {
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

  const model::InputHistory& history_;
  Kind kind_;
  std::vector<Eigen::Index> moving_;  // actuators
  std::vector<Entry> usable_;
  Eigen::MatrixXd reading_;  // (usable x outputs)
  Eigen::Index outputs_ = 1;
  int degree_;
  int trials_ = 0;
  int coefficients_ = 0;
  double range_ = 0.0, middle_ = 0.0;
};

constexpr double kSignificantResponse = 2.0;  // standard errors
constexpr double kLongestLag = 60.0;          // [s]
// A gain below 1e-8 of the sum of squares ends a descent.
constexpr basics::DescentRules kResponseDescent{1e-3, 100.0, 1e6, 1e-8, 0.0, 60};

// A number of a response that is fitted.
struct ResponseNumber {
  enum Kind { kLag, kRise, kFall, kReach, kWeight } kind;  // kLag: both alike
  int play = 0;
};

double responseValueOf(const model::Response& response, const ResponseNumber& number) {
  const auto play = static_cast<std::size_t>(number.play);
  switch (number.kind) {
    case ResponseNumber::kLag:
    case ResponseNumber::kRise:
      return response.rise_time;
    case ResponseNumber::kFall:
      return response.fall_time;
    case ResponseNumber::kReach:
      return response.plays[play].reach;
    case ResponseNumber::kWeight:
      break;
  }
  return response.plays[play].weight;
}

struct ResponseCandidate {
  model::Response response;
  std::vector<ResponseNumber> numbers;
  double rss = std::numeric_limits<double>::infinity();
  Eigen::VectorXd residual, error;  // error: (numbers) standard errors

  double ratio(std::size_t k) const {
    return responseValueOf(response, numbers[k]) / error[static_cast<Eigen::Index>(k)];
  }
};

class ResponseDescent {
 public:
  explicit ResponseDescent(const ResponseReadings& readings) : readings_(readings) {}

  // Least squares from a start, with standard errors.
  ResponseCandidate polish(const model::Response& start,
                           std::vector<ResponseNumber> numbers) const {
    ResponseCandidate from = at(start, std::move(numbers));
    ResponseCandidate out = from.numbers.empty()
                                ? std::move(from)
                                : basics::descend(*this, std::move(from), kResponseDescent).at;
    out.error = errors(out);
    return out;
  }

  // Of basics::descend().
  double cost(const ResponseCandidate& fit) const { return fit.rss; }
  basics::DenseEquations linearise(const ResponseCandidate& fit) const {
    const Eigen::MatrixXd J = jacobian(fit);
    basics::DenseEquations out{J.transpose() * J, J.transpose() * fit.residual};
    for (Eigen::Index k = 0; k < out.gradient.size(); ++k) {
      const ResponseNumber& number = numberOf(fit, k);
      const bool leaves =
          responseValueOf(fit.response, number) <= least(number) && out.gradient[k] > 0;
      if (out.hessian(k, k) == 0 || leaves) out.hold(k);
    }
    return out;
  }
  ResponseCandidate moved(const ResponseCandidate& fit, const Eigen::VectorXd& step) const {
    model::Response next = fit.response;
    for (Eigen::Index k = 0; k < step.size(); ++k) {
      set(next, numberOf(fit, k), responseValueOf(next, numberOf(fit, k)) + step[k]);
    }
    return at(next, fit.numbers);
  }

  // The weakest number that is within two standard errors of 0 is left out until none is.
  ResponseCandidate prune(ResponseCandidate fit) const {
    for (;;) {
      std::size_t weakest = fit.numbers.size();
      for (std::size_t k = 0; k < fit.numbers.size(); ++k) {
        if (fit.numbers[k].kind == ResponseNumber::kReach || fit.ratio(k) > kSignificantResponse)
          continue;
        if (weakest == fit.numbers.size() || fit.ratio(k) < fit.ratio(weakest)) weakest = k;
      }
      if (weakest == fit.numbers.size()) return fit;
      const ResponseNumber out = fit.numbers[weakest];
      model::Response response = fit.response;
      std::vector<ResponseNumber> left;
      if (out.kind == ResponseNumber::kWeight) {
        for (int j = out.play; j + 1 < response.play_count; ++j) {
          response.plays[static_cast<std::size_t>(j)] =
              response.plays[static_cast<std::size_t>(j + 1)];
        }
        --response.play_count;
      } else {
        set(response, out, 0.0);
      }
      for (const ResponseNumber& one : fit.numbers) {
        const bool of_play =
            one.kind == ResponseNumber::kReach || one.kind == ResponseNumber::kWeight;
        if (out.kind == ResponseNumber::kWeight && of_play) {
          if (one.play == out.play) continue;
          left.push_back({one.kind, one.play - (one.play > out.play ? 1 : 0)});
        } else if (of_play || one.kind != out.kind) {
          left.push_back(one);
        }
      }
      fit = polish(response, std::move(left));
    }
  }

  // Of a fit with this many readings that count; the lower, the better.
  double criterion(const ResponseCandidate& fit, double effective) const {
    const auto k = static_cast<double>(fit.numbers.size());
    return effective * std::log(std::max(fit.rss, 1e-300)) + k * std::log(std::max(effective, 2.0));
  }

  void set(model::Response& response, const ResponseNumber& number, double value) const {
    const auto play = static_cast<std::size_t>(number.play);
    value = std::max(value, least(number));
    switch (number.kind) {
      case ResponseNumber::kLag:
        response.rise_time = response.fall_time = std::min(value, kLongestLag);
        return;
      case ResponseNumber::kRise:
        response.rise_time = std::min(value, kLongestLag);
        return;
      case ResponseNumber::kFall:
        response.fall_time = std::min(value, kLongestLag);
        return;
      case ResponseNumber::kReach:
        response.plays[play].reach = std::min(value, 0.5 * readings_.range());
        return;
      case ResponseNumber::kWeight:
        break;
    }
    double others = 0.0;
    for (int j = 0; j < response.play_count; ++j) {
      if (j != number.play) others += response.plays[static_cast<std::size_t>(j)].weight;
    }
    response.plays[play].weight =
        std::clamp(value, 0.0, std::max(model::Response::kMostWeight - others, 0.0));
  }

 private:
  ResponseCandidate at(const model::Response& response, std::vector<ResponseNumber> numbers) const {
    ResponseCandidate out{response, std::move(numbers), 0.0, readings_.residual(response), {}};
    out.rss = out.residual.squaredNorm();
    return out;
  }
  static const ResponseNumber& numberOf(const ResponseCandidate& fit, Eigen::Index k) {
    return fit.numbers[static_cast<std::size_t>(k)];
  }
  double least(const ResponseNumber& number) const {
    return number.kind == ResponseNumber::kReach ? readings_.range() / 200 : 0.0;
  }

  Eigen::MatrixXd jacobian(const ResponseCandidate& fit) const {
    Eigen::MatrixXd J(fit.residual.size(), static_cast<Eigen::Index>(fit.numbers.size()));
    for (Eigen::Index k = 0; k < J.cols(); ++k) {
      const ResponseNumber& number = numberOf(fit, k);
      const double value = responseValueOf(fit.response, number);
      const double step = number.kind == ResponseNumber::kReach    ? 1e-4 * readings_.range()
                          : number.kind == ResponseNumber::kWeight ? 1e-4
                                                                   : std::max(1e-3 * value, 1e-5);
      model::Response next = fit.response;
      // Weights at their largest sum only go down.
      const bool full = number.kind == ResponseNumber::kWeight;
      set(next, number, full ? value - step : value + step);
      if (full && value < step) set(next, number, value + step);
      const double moved = responseValueOf(next, number) - value;
      J.col(k) = moved == 0 ? Eigen::VectorXd::Zero(J.rows()).eval()
                            : ((readings_.residual(next) - fit.residual) / moved).eval();
    }
    return J;
  }

  Eigen::VectorXd errors(const ResponseCandidate& fit) const {
    const auto n = static_cast<Eigen::Index>(fit.numbers.size());
    Eigen::VectorXd out = Eigen::VectorXd::Constant(n, std::numeric_limits<double>::infinity());
    if (n == 0) return out;
    const Eigen::MatrixXd J = jacobian(fit);
    std::vector<Eigen::Index> active;  // parameters with an effect
    for (Eigen::Index k = 0; k < n; ++k) {
      if (J.col(k).squaredNorm() > 0) active.push_back(k);
    }
    const auto m = static_cast<Eigen::Index>(active.size());
    if (m == 0) return out;
    Eigen::MatrixXd effect(J.rows(), m);
    for (Eigen::Index k = 0; k < m; ++k) effect.col(k) = J.col(active[static_cast<std::size_t>(k)]);
    const double freedom =
        static_cast<double>(std::max<Eigen::Index>(J.rows() - m - readings_.coefficients(), 1));
    const double variance = readings_.correlationFactor(fit.residual) * fit.rss / freedom;
    const Eigen::MatrixXd covariance =
        (effect.transpose() * effect).ldlt().solve(Eigen::MatrixXd::Identity(m, m));
    for (Eigen::Index k = 0; k < m; ++k) {
      out[active[static_cast<std::size_t>(k)]] =
          std::sqrt(std::max(variance * covariance(k, k), 0.0));
    }
    return out;
  }

  const ResponseReadings& readings_;
};

constexpr std::array<double, 4> kPlayThresholds{1.0 / 40, 1.0 / 20, 1.0 / 10,
                                                1.0 / 5};  // of the range
constexpr double kLeastReversal = 0.05;  // of the range: twice the least threshold
constexpr int kLeastInMotion = 10;       // rows
constexpr int kLeastTrials = 3;          // for the scatter between them
constexpr double kStartWeight = 0.3;     // of a play, where nothing linear tells it
// Of the polynomial for positions: a strongly bent arm needs more than the second degree.
constexpr int kLeastDegree = 2, kMostDegree = 4;
constexpr int kMostCoefficients = 84;  // six pressures to the third degree

std::vector<ResponseNumber> responseLags(const ResponseReadings::Motion& motion) {
  if (motion.rising + motion.falling < kLeastInMotion) return {};
  if (std::min(motion.rising, motion.falling) < kLeastInMotion / 2) return {{ResponseNumber::kLag}};
  return {{ResponseNumber::kRise}, {ResponseNumber::kFall}};
}

// Common lags to start from: none, and the best of a series.
std::vector<double> startingLags(const ResponseReadings& readings, bool lags) {
  if (!lags) return {0.0};
  double best = 0.0, least = std::numeric_limits<double>::infinity();
  for (double lag = 0.03; lag < 31; lag *= 1.5) {
    model::Response response;
    response.rise_time = response.fall_time = lag;
    const double rss = readings.residual(response).squaredNorm();
    if (rss < least) {
      least = rss;
      best = lag;
    }
  }
  return {0.0, best};
}

// Plays to start from: none, the linear fit, and single ones.
std::vector<model::Response> startingPlays(const ResponseReadings& readings,
                                           const model::Response& lags) {
  std::vector<model::Response> out;
  std::vector<double> reaches;
  for (const double part : kPlayThresholds) reaches.push_back(part * readings.range());
  if (readings.perActuator()) {
    const model::Response linear = readings.withWeights(lags, reaches);
    if (linear.play_count > 1) {
      out.push_back(linear);
      // Two thresholds may stand for one play between them.
      double weight = 0.0;
      for (int j = 0; j < linear.play_count; ++j) {
        weight += linear.plays[static_cast<std::size_t>(j)].weight;
      }
      model::Response between = lags;
      between.play_count = 1;
      between.plays[0] = {linear.halfWidth() / weight, weight};
      out.push_back(between);
    }
    // Noise of the readings may have hidden some of them from it.
    model::Response all = lags;
    for (const double reach : reaches) {
      all.plays[static_cast<std::size_t>(all.play_count++)] = {reach, kStartWeight / 2};
    }
    out.push_back(all);
  }
  model::Response best;
  double least = std::numeric_limits<double>::infinity();
  for (double reach = readings.range() / 60; reach < readings.range() / 3; reach *= 1.35) {
    model::Response single = lags;
    if (readings.perActuator()) single = readings.withWeights(lags, {reach});
    if (!readings.perActuator()) {
      single.play_count = 1;
      single.plays[0] = {reach, kStartWeight};
    }
    if (single.play_count == 0) continue;
    const double rss = readings.residual(single).squaredNorm();
    if (rss >= least) continue;
    least = rss;
    best = single;
  }
  if (best.play_count > 0) out.push_back(best);
  return out;
}

std::vector<ResponseNumber> withPlayNumbers(std::vector<ResponseNumber> numbers,
                                            const model::Response& response) {
  for (int j = 0; j < response.play_count; ++j) numbers.push_back({ResponseNumber::kWeight, j});
  if (response.play_count == 1) numbers.push_back({ResponseNumber::kReach, 0});
  return numbers;
}

void reportResponse(const ResponseReadings& readings, const ResponseCandidate& fit,
                    ResponseFit& out) {
  out.response = fit.response;
  for (std::size_t k = 0; k < fit.numbers.size(); ++k) {
    const ResponseNumber& number = fit.numbers[k];
    const Estimate estimate{responseValueOf(fit.response, number),
                            fit.error[static_cast<Eigen::Index>(k)]};
    const auto play = static_cast<std::size_t>(number.play);
    if (number.kind == ResponseNumber::kLag || number.kind == ResponseNumber::kRise)
      out.rise_time = estimate;
    if (number.kind == ResponseNumber::kLag || number.kind == ResponseNumber::kFall)
      out.fall_time = estimate;
    if (number.kind == ResponseNumber::kReach) out.reach[play] = estimate;
    if (number.kind == ResponseNumber::kWeight) out.weight[play] = estimate;
  }
  for (int j = 0; j < fit.response.play_count; ++j) {
    const auto play = static_cast<std::size_t>(j);
    out.reach[play].value = fit.response.plays[play].reach;
  }
  out.rms = std::sqrt(fit.rss / static_cast<double>(readings.rows()));
  out.effective = readings.effective(fit.response);
}

// Whether the first errors of trials that were left out are less than the others, by two standard
// errors of the differences between trials. With fewer than three trials nothing contradicts it.
bool areLess(const Eigen::VectorXd& errors, const Eigen::VectorXd& others) {
  const Eigen::VectorXd gain = others - errors;
  const auto trials = static_cast<double>(gain.size());
  if (trials < kLeastTrials) return true;
  const double mean = gain.mean();
  const double variance = (gain.array() - mean).square().sum() / (trials - 1);
  return mean > kSignificantResponse * std::sqrt(variance / trials);
}

// Whether a polynomial of a higher degree explains the readings better, for its number of
// coefficients and on trials that are left out.
bool explainsMore(const ResponseReadings& finer, const ResponseReadings& coarse,
                  const model::Response& response) {
  if (finer.coefficients() > kMostCoefficients || finer.count() < 3 * finer.coefficients()) {
    return false;
  }
  const Eigen::VectorXd residual = finer.residual(response);
  const double effective = static_cast<double>(finer.count()) / finer.correlationFactor(residual);
  const double gain =
      std::log(coarse.residual(response).squaredNorm() / std::max(residual.squaredNorm(), 1e-300));
  const auto more =
      static_cast<double>((finer.coefficients() - coarse.coefficients()) * finer.outputs());
  return effective * gain > more * std::log(std::max(effective, 2.0)) &&
         areLess(finer.heldOutErrors(response), coarse.heldOutErrors(response));
}

bool hasLag(const model::Response& response) {
  return response.rise_time > 0 || response.fall_time > 0;
}

const ResponseCandidate& closestOf(const std::vector<ResponseCandidate>& candidates) {
  return *std::min_element(
      candidates.begin(), candidates.end(),
      [](const ResponseCandidate& a, const ResponseCandidate& b) { return a.rss < b.rss; });
}

// Fits from several lags and plays; the first one has neither.
// @param lags  numbers of the lags that the readings tell. @param reverses  whether they tell
// plays.
std::vector<ResponseCandidate> candidatesOf(const ResponseReadings& readings,
                                            const ResponseDescent& descent,
                                            const std::vector<ResponseNumber>& lags,
                                            bool reverses) {
  std::vector<ResponseCandidate> out{descent.polish({}, {})};
  const auto withPlays = [&](const model::Response& plays, bool lagged) {
    return descent.polish(plays,
                          withPlayNumbers(lagged ? lags : std::vector<ResponseNumber>{}, plays));
  };
  for (const double lag : startingLags(readings, !lags.empty())) {
    model::Response start;
    start.rise_time = start.fall_time = lag;
    if (lag > 0) out.push_back(descent.polish(start, lags));
    if (!reverses) continue;
    const model::Response from = out.back().response;
    for (const model::Response& plays : startingPlays(readings, from)) {
      out.push_back(withPlays(plays, lag > 0));
    }
  }
  if (!reverses) return out;
  // A lag found without plays makes up for some of them: again from the lags found with them.
  model::Response from = closestOf(out).response;
  from.play_count = 0;
  for (const model::Response& plays : startingPlays(readings, from)) {
    out.push_back(descent.prune(withPlays(plays, hasLag(from))));
  }
  return out;
}

// What the readings say of lag and play, with the reasons where that is nothing.
void conclude(bool in_motion, bool reverses, bool play_is_scatter, ResponseFit& out) {
  const auto verdict = [](bool told, bool found) {
    return !told   ? ResponseVerdict::kNotDetermined
           : found ? ResponseVerdict::kFound
                   : ResponseVerdict::kNone;
  };
  out.lag = verdict(in_motion, hasLag(out.response));
  out.play = verdict(reverses, out.response.play_count > 0);
  const std::string none = " within two standard errors of 0 and is left out";
  if (!in_motion) {
    out.lag_reason =
        "nothing was recorded in motion: record a series with times (time_s) through "
        "steps of the pressure";
  } else if (out.lag == ResponseVerdict::kNone) {
    out.lag_reason = "the lag is" + none;
  }
  if (!reverses) {
    out.play_reason =
        "the pressures do not turn back by a twentieth of their range: record on the "
        "way down as well, in the order taken";
  } else if (out.play == ResponseVerdict::kNone) {
    out.play_reason = play_is_scatter ? "plays do not predict trials that were left out better, by "
                                        "two standard errors of the differences between trials"
                                      : "the weight of every play is" + none;
  }
}

ResponseFit fitReadings(const ResponseReadings& readings) {
  ResponseFit out;
  if (readings.range() == 0 || readings.count() < 3 * readings.coefficients()) {
    std::ostringstream text;
    text << "the data hold " << readings.count() << " readings; expected at least "
         << 3 * readings.coefficients() << " at pressures that differ";
    out.failure = text.str();
    return out;
  }
  const std::vector<ResponseNumber> lags = responseLags(readings.motion());
  const bool reverses = readings.largestReversal() >= kLeastReversal;
  const ResponseDescent descent(readings);
  std::vector<ResponseCandidate> candidates = candidatesOf(readings, descent, lags, reverses);
  out.static_rms = std::sqrt(candidates.front().rss / static_cast<double>(readings.rows()));
  const double effective = static_cast<double>(readings.count()) /
                           readings.correlationFactor(closestOf(candidates).residual);
  ResponseCandidate best = descent.prune(
      *std::min_element(candidates.begin(), candidates.end(),
                        [&](const ResponseCandidate& a, const ResponseCandidate& b) {
                          return descent.criterion(a, effective) < descent.criterion(b, effective);
                        }));
  bool play_is_scatter = false;
  if (best.response.play_count > 0) {
    candidates.erase(
        std::remove_if(candidates.begin(), candidates.end(),
                       [](const ResponseCandidate& one) { return one.response.play_count > 0; }),
        candidates.end());
    ResponseCandidate plain = descent.prune(closestOf(candidates));
    play_is_scatter =
        !areLess(readings.heldOutErrors(best.response), readings.heldOutErrors(plain.response));
    if (play_is_scatter) best = std::move(plain);
  }
  reportResponse(readings, best, out);
  conclude(!lags.empty(), reverses, play_is_scatter, out);
  return out;
}

}  // namespace

ResponseFit fitResponse(const model::InputHistory& history, const Eigen::MatrixXd& shortening) {
  return fitReadings({history, shortening, ResponseReadings::Kind::kPerActuator});
}

ResponseFit fitResponseToPositions(const model::InputHistory& history,
                                   const Eigen::MatrixXd& position) {
  const auto readingsOf = [&](int degree) {
    return ResponseReadings(history, position, ResponseReadings::Kind::kOfTheArm, degree);
  };
  int degree = kLeastDegree;
  ResponseFit fit = fitReadings(readingsOf(degree));
  for (int higher = degree + 1; fit.fitted() && higher <= kMostDegree; ++higher) {
    const ResponseReadings finer = readingsOf(higher);
    if (!explainsMore(finer, readingsOf(degree), fit.response)) continue;
    fit = fitReadings(finer);
    degree = higher;
  }
  return fit;
}

}  // namespace helix_arm::estimation
