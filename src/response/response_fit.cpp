#include "response_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <utility>
#include <vector>

#include "basics/least_squares.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::estimation {
namespace {

constexpr int kCurveDegree = 5;     // of a contraction curve
constexpr double kTakesPart = 0.1;  // of the largest range: an actuator that takes part
constexpr double kSameEffectivePressure = 0.02;  // of the range: counts as the same
constexpr double kRestLag = 0.5;                 // [s]
constexpr double kInMotion = 0.02;               // of the range, behind a lag of kRestLag

// Number of monomials in n variables up to a degree; none below degree 0.
int monomials(int n, int degree) {
  int out = degree < 0 ? 0 : 1;
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

// Degree of the curve of one actuator: as many coefficients as pressures that differ determine.
int curveDegree(const model::InputHistory& history, const Eigen::VectorXd& shortening) {
  const double range = history.input.maxCoeff() - history.input.minCoeff();
  std::set<long> distinct;
  for (Eigen::Index row = 0; range > 0 && row < history.rows(); ++row) {
    if (!std::isfinite(shortening[row])) continue;
    distinct.insert(std::lround(history.input(row, 0) / (kSameEffectivePressure * range)));
  }
  return std::min(kCurveDegree, static_cast<int>(distinct.size()) - 1);
}

/// Readings of what pressures did, up to three per row, as a polynomial of the effective pressures
/// that move, whose coefficients are unknown and eliminated. Keeps a reference to the history.
class ResponseReadings {
 public:
  /// @param degree  of the polynomial; below 0 no reading counts.
  ResponseReadings(const model::InputHistory& history, const Eigen::MatrixXd& reading, int degree)
      : history_(history), degree_(degree) {
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
    int trial = -1;
    for (Eigen::Index row = 0; row < history.rows(); ++row) {
      trial += history.starts_anew[row] ? 1 : 0;
      if (degree < 0 || !reading.row(row).allFinite()) continue;
      usable_.push_back(row);
      trial_.push_back(trial);
    }
    reading_ = reading(usable_, Eigen::all);
    coefficients_ = monomials(static_cast<int>(moving_.size()), degree);
  }

  /// Effective pressures (rows x actuators) [Pa].
  Eigen::MatrixXd effective(const model::Response& response) const {
    Eigen::MatrixXd effective = history_.input;
    for (const Eigen::Index i : moving_) effective.col(i) = effectiveOf(history_, i, response);
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
      if (end < rows() && trial_[end] == trial_[begin]) continue;
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

  /// Number of rows with readings, and of readings.
  Eigen::Index rows() const { return reading_.rows(); }
  Eigen::Index count() const { return reading_.size(); }
  Eigen::Index outputs() const { return reading_.cols(); }
  int coefficients() const { return coefficients_; }  ///< of the polynomial, per output
  double range() const { return range_; }             ///< of the pressures [Pa]

  /// Factor by which residuals that are correlated in time raise a variance, >= 1.
  double correlationFactor(const Eigen::VectorXd& residual) const {
    return basics::correlationFactor(residual.reshaped(rows(), outputs()), trial_);
  }

  /// Largest stroke back within one memory, relative to the range: the least of down and up.
  double largestReversal() const {
    double largest = 0.0;
    for (const Eigen::Index i : moving_) {
      double low = 0, high = 0, down = 0, up = 0;
      for (Eigen::Index row = 0; row < history_.rows(); ++row) {
        const double p = history_.input(row, i);
        if (history_.starts_anew[row]) {
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

  /// Pressures (rows x actuators) less those of an arm that is nearly at rest, in parts of the
  /// range; without rows if no motion is known.
  Eigen::ArrayXXd behind() const {
    if (history_.time.empty() || moving_.empty()) return {};
    model::Response rest;
    rest.rise_time = rest.fall_time = kRestLag;
    return (history_.input - effective(rest)) / range_;
  }

 private:
  Eigen::MatrixXd basis(const Eigen::MatrixXd& effective) const {
    Eigen::MatrixXd out(rows(), coefficients_);
    Eigen::VectorXd x(static_cast<Eigen::Index>(moving_.size()));
    for (Eigen::Index k = 0; k < rows(); ++k) {
      for (Eigen::Index a = 0; a < x.size(); ++a) {
        x[a] = (effective(usable_[k], moving_[a]) - middle_) / (0.5 * range_);
      }
      auto row = out.row(k);
      Eigen::Index column = 0;
      setMonomials(x, 0, degree_, 1.0, row, column);
    }
    return out;
  }

  const model::InputHistory& history_;
  std::vector<Eigen::Index> moving_;  // actuators
  std::vector<Eigen::Index> usable_;  // rows
  std::vector<int> trial_;            // (usable)
  Eigen::MatrixXd reading_;           // (usable x outputs)
  int degree_, coefficients_;
  double range_, middle_;
};

constexpr double kSignificantResponse = 2.0;  // standard errors
constexpr double kLongestLag = 60.0;          // [s]
// A gain below 1e-8 of the sum of squares ends a descent.
constexpr basics::DescentRules kResponseDescent{1e-3, 100.0, 1e6, 1e-8, 0.0, 60};

// A number of a response that is fitted.
struct ResponseNumber {
  enum Kind { kLag, kRise, kFall, kReach, kWeight } kind;  // kLag: both alike
  int play = 0;

  bool ofPlay() const { return kind == kReach || kind == kWeight; }
};

double& entryOf(model::Response& response, const ResponseNumber& number) {
  switch (number.kind) {
    case ResponseNumber::kReach:
      return response.plays[number.play].reach;
    case ResponseNumber::kWeight:
      return response.plays[number.play].weight;
    case ResponseNumber::kFall:
      return response.fall_time;
    case ResponseNumber::kLag:
    case ResponseNumber::kRise:
      break;
  }
  return response.rise_time;
}

double valueOf(model::Response response, const ResponseNumber& number) {
  return entryOf(response, number);
}

struct ResponseCandidate {
  model::Response response;
  std::vector<ResponseNumber> numbers;
  double rss = std::numeric_limits<double>::infinity();
  Eigen::VectorXd residual, error;  // error: (numbers) standard errors

  double ratio(std::size_t k) const { return valueOf(response, numbers[k]) / error[k]; }
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

  // For basics::descend().
  double cost(const ResponseCandidate& fit) const { return fit.rss; }
  basics::DenseEquations linearise(const ResponseCandidate& fit) const {
    const Eigen::MatrixXd J = jacobian(fit);
    basics::DenseEquations out{J.transpose() * J, J.transpose() * fit.residual};
    for (Eigen::Index k = 0; k < out.gradient.size(); ++k) {
      const ResponseNumber& number = fit.numbers[k];
      const bool leaves = valueOf(fit.response, number) <= least(number) && out.gradient[k] > 0;
      if (out.hessian(k, k) == 0 || leaves) out.hold(k);
    }
    return out;
  }
  ResponseCandidate moved(const ResponseCandidate& fit, const Eigen::VectorXd& step) const {
    model::Response next = fit.response;
    for (Eigen::Index k = 0; k < step.size(); ++k) {
      set(next, fit.numbers[k], valueOf(next, fit.numbers[k]) + step[k]);
    }
    return at(next, fit.numbers);
  }

  // The weakest number that is within two standard errors of 0 is left out until none is, and a
  // play whose reach went to its bound: the readings do not tell it.
  ResponseCandidate prune(ResponseCandidate fit) const {
    for (;;) {
      std::vector<ResponseNumber>& numbers = fit.numbers;
      std::size_t weakest = numbers.size();
      for (std::size_t k = 0; k < numbers.size(); ++k) {
        const bool counts = numbers[k].kind == ResponseNumber::kReach
                                ? std::isfinite(fit.error[k])
                                : fit.ratio(k) > kSignificantResponse;
        if (counts) continue;
        if (weakest == numbers.size() || fit.ratio(k) < fit.ratio(weakest)) weakest = k;
      }
      if (weakest == numbers.size()) return fit;
      const ResponseNumber out = numbers[weakest];
      const auto leaves = [&out](const ResponseNumber& one) {
        return out.ofPlay() ? one.ofPlay() && one.play == out.play : one.kind == out.kind;
      };
      numbers.erase(std::remove_if(numbers.begin(), numbers.end(), leaves), numbers.end());
      if (out.ofPlay()) {
        const auto own = fit.response.plays.begin() + out.play;
        std::rotate(own, own + 1, fit.response.plays.end());
        --fit.response.play_count;
        for (ResponseNumber& one : numbers) one.play -= one.ofPlay() && one.play > out.play;
      } else {
        set(fit.response, out, 0.0);
      }
      fit = polish(fit.response, std::move(numbers));
    }
  }

  // Criterion of a fit with this many readings that count; the lower, the better.
  double criterion(const ResponseCandidate& fit, double effective) const {
    const auto k = static_cast<double>(fit.numbers.size());
    return effective * std::log(std::max(fit.rss, 1e-300)) + k * std::log(std::max(effective, 2.0));
  }

 private:
  ResponseCandidate at(const model::Response& response, std::vector<ResponseNumber> numbers) const {
    ResponseCandidate out{response, std::move(numbers), 0.0, readings_.residual(response), {}};
    out.rss = out.residual.squaredNorm();
    return out;
  }
  double least(const ResponseNumber& number) const {
    return number.kind == ResponseNumber::kReach ? readings_.range() / 200 : 0.0;
  }

  // Sets a number within its bounds.
  void set(model::Response& response, const ResponseNumber& number, double value) const {
    double& entry = entryOf(response, number);
    double most = number.kind == ResponseNumber::kReach ? 0.5 * readings_.range() : kLongestLag;
    if (number.kind == ResponseNumber::kWeight) {
      entry = 0;
      most = model::Response::kMostWeight;
      for (int j = 0; j < response.play_count; ++j) most -= response.plays[j].weight;
    }
    entry = std::min(std::max(value, least(number)), std::max(most, 0.0));
    if (number.kind == ResponseNumber::kLag) response.fall_time = entry;
  }

  Eigen::MatrixXd jacobian(const ResponseCandidate& fit) const {
    Eigen::MatrixXd J(fit.residual.size(), static_cast<Eigen::Index>(fit.numbers.size()));
    for (Eigen::Index k = 0; k < J.cols(); ++k) {
      const ResponseNumber& number = fit.numbers[k];
      const double value = valueOf(fit.response, number);
      const double step = number.kind == ResponseNumber::kReach    ? 1e-4 * readings_.range()
                          : number.kind == ResponseNumber::kWeight ? 1e-4
                                                                   : std::max(1e-3 * value, 1e-5);
      model::Response next = fit.response;
      // Weights at their largest sum only go down.
      const bool down = number.kind == ResponseNumber::kWeight && value >= step;
      set(next, number, down ? value - step : value + step);
      const double moved = valueOf(next, number) - value;
      J.col(k) = moved == 0 ? Eigen::VectorXd::Zero(J.rows()).eval()
                            : ((readings_.residual(next) - fit.residual) / moved).eval();
    }
    return J;
  }

  Eigen::VectorXd errors(const ResponseCandidate& fit) const {
    const auto n = static_cast<Eigen::Index>(fit.numbers.size());
    Eigen::VectorXd out = Eigen::VectorXd::Constant(n, std::numeric_limits<double>::infinity());
    const Eigen::MatrixXd J = jacobian(fit);
    std::vector<Eigen::Index> active;  // numbers with an effect
    for (Eigen::Index k = 0; k < n; ++k) {
      if (J.col(k).squaredNorm() > 0) active.push_back(k);
    }
    const auto m = static_cast<Eigen::Index>(active.size());
    if (m == 0) return out;
    const Eigen::MatrixXd effect = J(Eigen::all, active);
    const double freedom =
        static_cast<double>(std::max<Eigen::Index>(J.rows() - m - readings_.coefficients(), 1));
    const double variance = readings_.correlationFactor(fit.residual) * fit.rss / freedom;
    const Eigen::MatrixXd covariance =
        (effect.transpose() * effect).ldlt().solve(Eigen::MatrixXd::Identity(m, m));
    out(active) = (variance * covariance.diagonal()).cwiseMax(0.0).cwiseSqrt();
    return out;
  }

  const ResponseReadings& readings_;
};

// Thresholds of play as shares of the range.
constexpr std::array<double, 4> kPlayThresholds{1.0 / 40, 1.0 / 20, 1.0 / 10, 1.0 / 5};
constexpr double kLeastReversal = 0.05;  // of the range: twice the least threshold
constexpr int kLeastInMotion = 10;       // rows
constexpr int kLeastTrials = 3;          // for the scatter between them
constexpr double kStartWeight = 0.3;     // of one play
// Degree of the polynomial for positions: a strongly bent arm needs more than the second degree.
constexpr int kLeastDegree = 2, kMostDegree = 4;
constexpr int kMostCoefficients = 84;  // six pressures to the third degree

// The lags that the readings tell: of rises and falls, or one for both.
std::vector<ResponseNumber> responseLags(const ResponseReadings& readings) {
  const Eigen::ArrayXXd behind = readings.behind();
  const auto rising = (behind > kInMotion).count(), falling = (behind < -kInMotion).count();
  if (rising + falling < kLeastInMotion) return {};
  if (std::min(rising, falling) < kLeastInMotion / 2) return {{ResponseNumber::kLag}};
  return {{ResponseNumber::kRise}, {ResponseNumber::kFall}};
}

// The one of some responses with the least deviation of the readings.
model::Response closestOf(const ResponseReadings& readings,
                          const std::vector<model::Response>& responses) {
  std::vector<double> rss;
  for (const model::Response& one : responses) rss.push_back(readings.residual(one).squaredNorm());
  return responses[std::min_element(rss.begin(), rss.end()) - rss.begin()];
}

// The best common lag of a series, to start from.
model::Response startingLag(const ResponseReadings& readings) {
  std::vector<model::Response> series;
  for (double lag = 0.03; lag < 31; lag *= 1.5) {
    series.emplace_back().rise_time = lag;
    series.back().fall_time = lag;
  }
  return closestOf(readings, series);
}

// Plays to start from: the best single one and, if there may be several, one at each threshold.
std::vector<model::Response> startingPlays(const ResponseReadings& readings,
                                           const model::Response& lags, bool several) {
  std::vector<model::Response> singles, out;
  for (double reach = readings.range() / 60; reach < readings.range() / 3; reach *= 1.35) {
    singles.push_back(lags);
    singles.back().play_count = 1;
    singles.back().plays[0] = {reach, kStartWeight};
  }
  if (several) {
    out.push_back(lags);
    for (const double part : kPlayThresholds) {
      model::Response& all = out.back();
      all.plays[all.play_count++] = {part * readings.range(), kStartWeight / 2};
    }
  }
  out.push_back(closestOf(readings, singles));
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
    const Estimate estimate{valueOf(fit.response, number), fit.error[k]};
    if (number.kind == ResponseNumber::kLag || number.kind == ResponseNumber::kRise)
      out.rise_time = estimate;
    if (number.kind == ResponseNumber::kLag || number.kind == ResponseNumber::kFall)
      out.fall_time = estimate;
    if (number.kind == ResponseNumber::kReach) out.reach[number.play] = estimate;
    if (number.kind == ResponseNumber::kWeight) out.weight[number.play] = estimate;
  }
  for (int j = 0; j < fit.response.play_count; ++j) {
    out.reach[j].value = fit.response.plays[j].reach;
  }
  out.rms = std::sqrt(fit.rss / static_cast<double>(readings.rows()));
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
// plays. @param several  of startingPlays().
std::vector<ResponseCandidate> candidatesOf(const ResponseReadings& readings,
                                            const ResponseDescent& descent,
                                            const std::vector<ResponseNumber>& lags, bool reverses,
                                            bool several) {
  std::vector<ResponseCandidate> out{descent.polish({}, {})};
  const auto withPlays = [&](const model::Response& plays, bool lagged) {
    return descent.polish(plays,
                          withPlayNumbers(lagged ? lags : std::vector<ResponseNumber>{}, plays));
  };
  for (const bool lagged : {false, true}) {
    if (lagged && lags.empty()) break;
    if (lagged) out.push_back(descent.polish(startingLag(readings), lags));
    if (!reverses) continue;
    const model::Response from = out.back().response;
    for (const model::Response& plays : startingPlays(readings, from, several)) {
      out.push_back(withPlays(plays, lagged));
    }
  }
  if (!reverses) return out;
  // A lag found without plays makes up for some of them: again from the lags found with them.
  model::Response from = closestOf(out).response;
  from.play_count = 0;
  for (const model::Response& plays : startingPlays(readings, from, several)) {
    out.push_back(descent.prune(withPlays(plays, hasLag(from))));
  }
  return out;
}

// Verdict of the readings on lag and play, with the reasons where that is nothing.
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

ResponseFit fitReadings(const ResponseReadings& readings, bool several) {
  ResponseFit out;
  if (readings.range() == 0 || readings.count() < 3 * readings.coefficients()) {
    out.failure =
        basics::messageOf("the data hold ", readings.count(), " readings; expected at least ",
                          3 * readings.coefficients(), " at pressures that differ");
    return out;
  }
  const std::vector<ResponseNumber> lags = responseLags(readings);
  const bool reverses = readings.largestReversal() >= kLeastReversal;
  const ResponseDescent descent(readings);
  std::vector<ResponseCandidate> candidates =
      candidatesOf(readings, descent, lags, reverses, several);
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

Eigen::VectorXd effectiveOf(const model::InputHistory& history, Eigen::Index actuator,
                            const model::Response& response) {
  model::ResponseState state(response);
  Eigen::VectorXd out(history.rows());
  for (Eigen::Index row = 0; row < out.size(); ++row) {
    if (history.starts_anew[row]) state.restart();
    const double dt = !state.started()       ? 0.0
                      : history.time.empty() ? std::numeric_limits<double>::infinity()
                                             : history.time[row] - history.time[row - 1];
    state.step(history.input(row, actuator), dt);
    out[row] = state.effective();
  }
  return out;
}

ResponseFit fitResponse(const model::InputHistory& history, const Eigen::VectorXd& shortening) {
  return fitReadings({history, shortening, curveDegree(history, shortening)}, true);
}

ResponseFit fitResponseToPositions(const model::InputHistory& history,
                                   const Eigen::MatrixXd& position) {
  const auto readingsOf = [&](int degree) { return ResponseReadings(history, position, degree); };
  int degree = kLeastDegree;
  ResponseFit fit = fitReadings(readingsOf(degree), false);
  for (int higher = degree + 1; fit.fitted() && higher <= kMostDegree; ++higher) {
    const ResponseReadings finer = readingsOf(higher);
    if (!explainsMore(finer, readingsOf(degree), fit.response)) continue;
    fit = fitReadings(finer, false);
    degree = higher;
  }
  return fit;
}

}  // namespace helix_arm::estimation
