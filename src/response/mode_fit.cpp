#include "mode_fit.hpp"

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "basics/least_squares.hpp"
#include "basics/pi.hpp"
#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::estimation {
namespace {

constexpr double kLowestFrequency = 0.3, kFrequencyRatio = 1.1;  // [Hz], of the grid
constexpr double kHighestOfRate = 1.0 / 3;                       // of the rate of the rows
constexpr std::array<double, 3> kRingDampings{0.05, 0.15, 0.35};
constexpr double kLeastDamping = 0.002;
// An arm that is damped more overshoots by less than a sixth, like creep beside an exponential.
constexpr double kMostDamping = 0.5;

// Begin of a fit after the fastest motion, in periods, unless the ringing would have died away by
// the factor exp(-kLost) then: what drives the arm is over by then.
constexpr double kSettled = 0.8, kLost = 0.5;
constexpr double kDiedAway = 4.0;                        // log of the factor at the end of a fit
constexpr double kFewestPeriods = 3, kMostPeriods = 30;  // of a fit, if the trial is long enough
constexpr double kLeastPeriods = 1.5;                    // that a trial has to show
constexpr int kLeastRingRows = 12;

constexpr double kFastMotion = 0.4;                        // of the fastest one
constexpr double kPressureStep = 0.2;                      // of the largest range
constexpr double kStillPressure = 0.05, kStillTime = 0.1;  // of that range; [s]

constexpr double kMostSlow = 3;        // largest time constant, of the duration of a fit
constexpr int kExponentials = 9;       // time constants of the motion without ringing
constexpr double kClearGain = 2;       // of the criterion for a mode
constexpr double kLargestError = 0.5;  // of a value that is identified
constexpr double kMostRingCorrelation = 0.99;
// Creep after a slow drive may turn back once.
constexpr int kFewestTurns = 2;
constexpr double kTakesPartInRing = 0.3;  // of the longest way of a coordinate
// A mode of an arm shows in at least this part of the releases and steps.
constexpr double kLeastRinging = 1.0 / 3;
// Weights assume at least this scatter between releases, so that none outweighs all others.
constexpr double kUsualScatter = 0.03;
constexpr int kMostWindows = 6;  // until a window fits its mode
constexpr std::size_t kCandidates = 6;

// The shape of a motion.
struct Ringing {
  double frequency, damping, slow;  // [Hz], ratio, time constant [s]
};

// Rows of one release.
struct Motion {
  Eigen::VectorXd time;          // [s]
  Eigen::MatrixXd position;      // (rows x outputs) [m]
  std::vector<Eigen::Index> at;  // places in the recording

  Eigen::Index rows() const { return time.size(); }
  double duration() const { return time[rows() - 1] - time[0]; }
  double rate() const { return static_cast<double>(rows() - 1) / duration(); }
  Motion part(Eigen::Index begin, Eigen::Index end) const {
    return {time.segment(begin, end - begin),
            position.middleRows(begin, end - begin),
            {at.begin() + begin, at.begin() + end}};
  }
};

// Positions without their best combination of columns.
Eigen::MatrixXd without(const Eigen::MatrixXd& columns, const Eigen::MatrixXd& position) {
  return position - columns * columns.colPivHouseholderQr().solve(position);
}

// Deviation of a motion from the best one of a shape.
Eigen::MatrixXd residualOf(const Motion& motion, const Ringing& shape) {
  const Eigen::ArrayXd t = motion.time.array() - motion.time[0];
  const double w = 2 * basics::kPi * shape.frequency;
  const double turn = w * std::sqrt(1 - shape.damping * shape.damping);
  const Eigen::ArrayXd decay = (-shape.damping * w * t).exp();
  Eigen::MatrixXd columns(t.size(), 4);
  columns << Eigen::VectorXd::Ones(t.size()), (-t / shape.slow).exp().matrix(),
      (decay * (turn * t).cos()).matrix(), (decay * (turn * t).sin()).matrix();
  return without(columns, motion.position);
}

// Least sum of squares about two exponentials: how an arm moves that does not ring.
double squaresWithoutRinging(const Motion& motion, int count) {
  const Eigen::ArrayXd t = motion.time.array() - motion.time[0];
  const double longest = kMostSlow * motion.duration();
  const double ratio = std::pow(longest * motion.rate(), 1.0 / (count - 1));
  double least = std::numeric_limits<double>::infinity();
  Eigen::MatrixXd columns(t.size(), 3);
  columns.col(0).setOnes();
  double first = longest;
  for (int i = 0; i < count; ++i, first /= ratio) {
    double second = first;
    columns.col(1) = (-t / first).exp();
    for (int j = i; j < count; ++j, second /= ratio) {
      columns.col(2) = i == j ? (t * columns.col(1).array()).eval() : (-t / second).exp().eval();
      least = std::min(least, without(columns, motion.position).squaredNorm());
    }
  }
  return least;
}

// Frequency, damping and slow time constant of a motion by their logarithms, for basics::descend.
class RingProblem {
 public:
  explicit RingProblem(const Motion& motion, double highest) : motion_(motion), highest_(highest) {}

  double cost(const Ringing& at) const { return 0.5 * residualOf(motion_, at).squaredNorm(); }

  Eigen::MatrixXd jacobian(const Ringing& at) const {
    Eigen::MatrixXd J(motion_.position.size(), 3);
    constexpr double kLogStep = 1e-4;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d step = kLogStep * Eigen::Vector3d::Unit(k);
      const Ringing after = moved(at, step), before = moved(at, -step);
      const double log_ratio = logsOf(after)[k] - logsOf(before)[k];
      const Eigen::MatrixXd slope =
          (residualOf(motion_, after) - residualOf(motion_, before)) / log_ratio;
      J.col(k) = Eigen::Map<const Eigen::VectorXd>(slope.data(), slope.size());
    }
    return J;
  }

  basics::DenseEquations linearise(const Ringing& at) const {
    const Eigen::MatrixXd J = jacobian(at);
    const Eigen::MatrixXd residual = residualOf(motion_, at);
    return {J.transpose() * J,
            J.transpose() * Eigen::Map<const Eigen::VectorXd>(residual.data(), residual.size())};
  }

  Ringing moved(const Ringing& from, const Eigen::VectorXd& step) const {
    const auto bounded = [](double value, double log_step, double least, double most) {
      return std::clamp(value * std::exp(std::clamp(log_step, -0.7, 0.7)), least, most);
    };
    const double longest = kMostSlow * motion_.duration();
    return {bounded(from.frequency, step[0], 0.5 * kLowestFrequency, highest_),
            bounded(from.damping, step[1], kLeastDamping, 0.95),
            bounded(from.slow, step[2], 1 / motion_.rate(), longest)};
  }

  Ringing descended(const Ringing& start) const {
    constexpr basics::DescentRules kRules{1e-3, 5.0, 1e8, 1e-9, 1e-30, 60};
    return basics::descend(*this, moved(start, Eigen::Vector3d::Zero()), kRules).at;
  }

 private:
  static Eigen::Vector3d logsOf(const Ringing& at) {
    return {std::log(at.frequency), std::log(at.damping), std::log(at.slow)};
  }

  const Motion& motion_;
  double highest_;
};

// Row of the fastest motion within a quarter of a period: of the last group of fast motions that
// are at most a period apart, the ringing between them included.
Eigen::Index fastestRow(const Motion& motion, double frequency) {
  const Eigen::Index rows = motion.rows();
  Eigen::VectorXd moved = Eigen::VectorXd::Zero(rows);
  for (Eigen::Index from = 0, to = 0; from < rows; ++from) {
    to = std::max(to, from + 1);
    while (to < rows && motion.time[to] < motion.time[from] + 0.25 / frequency) ++to;
    if (to >= rows) break;
    moved[(from + to) / 2] = (motion.position.row(to) - motion.position.row(from)).norm();
  }
  const double fast = kFastMotion * moved.maxCoeff();
  Eigen::Index fastest = 0, last = -1;
  for (Eigen::Index row = 0; row < rows; ++row) {
    if (moved[row] < fast) continue;
    const bool anew = last < 0 || motion.time[row] > motion.time[last] + 1 / frequency;
    if (anew || moved[row] > moved[fastest]) fastest = row;
    last = row;
  }
  return fastest;
}

// The rows in which a mode rings after the fastest motion; nothing if they do not show it.
std::optional<Motion> windowOf(const Motion& motion, double frequency, double damping) {
  const double ebb = 2 * basics::kPi * damping;  // of the logarithm in a period
  const double begin =
      motion.time[fastestRow(motion, frequency)] + std::min(kSettled, kLost / ebb) / frequency;
  const double periods = std::clamp(kDiedAway / ebb, kFewestPeriods, kMostPeriods);
  const double* const times = motion.time.data();
  const Eigen::Index first = std::lower_bound(times, times + motion.rows(), begin) - times;
  const double end = begin + periods / frequency;
  const Eigen::Index last = std::upper_bound(times, times + motion.rows(), end) - times;
  if (last - first < kLeastRingRows) return std::nullopt;
  Motion window = motion.part(first, last);
  if (window.duration() < kLeastPeriods / frequency) return std::nullopt;
  return window;
}

struct RingCandidate {
  Ringing shape;
  double gain;  // of the logarithm of the likelihood over a motion without ringing
};

// Factor by which residuals that are correlated in time raise a variance, >= 1.
double correlationFactor(const Eigen::VectorXd& residual) {
  const Eigen::Index n = residual.size() - 1;
  const double square = residual.squaredNorm();
  const double product = residual.head(n).dot(residual.tail(n));
  const double correlation =
      square > 0 ? std::clamp(product / square, 0.0, kMostRingCorrelation) : 0.0;
  return (1 + correlation) / (1 - correlation);
}

// Number of independent readings in a residual.
double independentOf(const Eigen::MatrixXd& residual) {
  double sum = 0;
  for (const auto& one : residual.colwise()) sum += one.squaredNorm() / correlationFactor(one);
  const double square = residual.squaredNorm();
  return static_cast<double>(residual.size()) * (square > 0 ? sum / square : 1.0);
}

double gainOf(const Motion& window, const Ringing& shape, int exponentials) {
  const Eigen::MatrixXd residual = residualOf(window, shape);
  return independentOf(residual) * std::log(squaresWithoutRinging(window, exponentials) /
                                            std::max(residual.squaredNorm(), 1e-300));
}

// The shapes of a grid that explain most, the best first; one of each frequency.
std::vector<RingCandidate> ringCandidates(const Motion& motion, double highest) {
  std::vector<RingCandidate> found;
  for (double frequency = kLowestFrequency; frequency <= highest; frequency *= kFrequencyRatio) {
    RingCandidate best{{}, 0};
    for (const double damping : kRingDampings) {
      const auto window = windowOf(motion, frequency, damping);
      if (!window) continue;
      for (const double slow : {0.5 / frequency, 0.3 * window->duration(), window->duration()}) {
        const Ringing shape{frequency, damping, slow};
        const double gain = gainOf(*window, shape, 4);
        if (gain > best.gain) best = {shape, gain};
      }
    }
    if (best.gain > 0) found.push_back(best);
  }
  std::sort(found.begin(), found.end(),
            [](const auto& a, const auto& b) { return a.gain > b.gain; });
  if (found.size() > kCandidates) found.resize(kCandidates);
  return found;
}

// Standard errors of the logarithms of frequency and damping, by a residual.
Eigen::Vector2d errorsOf(const Motion& window, double highest, const Ringing& shape,
                         const Eigen::MatrixXd& residual) {
  const Eigen::MatrixXd J = RingProblem(window, highest).jacobian(shape);
  const Eigen::Index rows = window.rows(), outputs = residual.cols();
  const double freedom = static_cast<double>(rows) - 4 - 3.0 / static_cast<double>(outputs);
  Eigen::Matrix3d H = J.transpose() * J, scatter = Eigen::Matrix3d::Zero();
  // Coordinates differ in their noise and in how far they move.
  for (Eigen::Index i = 0; i < outputs; ++i) {
    const auto own = J.middleRows(i * rows, rows);
    scatter += correlationFactor(residual.col(i)) * residual.col(i).squaredNorm() / freedom *
               (own.transpose() * own);
  }
  // A slow time constant may have no effect.
  H += 1e-9 * H.diagonal().maxCoeff() * Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d covariance = H.inverse() * scatter * H.inverse();
  return covariance.diagonal().head<2>().cwiseMax(0.0).cwiseSqrt();
}

// How often the fitted motion turns back, in a coordinate that takes part.
int turnsOf(const Eigen::MatrixXd& fitted) {
  const Eigen::Index rows = fitted.rows() - 1;
  const Eigen::ArrayXXd steps = fitted.bottomRows(rows) - fitted.topRows(rows);
  const Eigen::ArrayXd travel = steps.abs().colwise().sum().transpose();
  Eigen::Index most = 0;
  for (Eigen::Index i = 0; i < steps.cols(); ++i) {
    if (travel[i] < kTakesPartInRing * travel.maxCoeff()) continue;
    most = std::max(most, (steps.col(i).head(rows - 1) * steps.col(i).tail(rows - 1) < 0).count());
  }
  return static_cast<int>(most);
}

struct JudgedRing {
  RingDown ring;
  double gain = 0;
};

JudgedRing noRinging() {
  JudgedRing out;
  out.ring.reason = "no ringing found";
  return out;
}

// Fits a mode, and the window in which it rings, from a shape of the grid.
JudgedRing ringFrom(const Ringing& start, const Motion& motion, double highest) {
  JudgedRing out;
  Ringing shape = start;
  std::optional<Motion> window;
  for (int i = 0; i < kMostWindows; ++i) {
    std::optional<Motion> next = windowOf(motion, shape.frequency, shape.damping);
    if (!next) return noRinging();
    const bool same = window && next->time[0] == window->time[0] && next->rows() == window->rows();
    if (same) break;
    window = std::move(next);
    shape = RingProblem(*window, highest).descended(shape);
  }
  const Eigen::MatrixXd residual = residualOf(*window, shape);
  const double independent = std::max(independentOf(residual), 2.0);
  const auto more_numbers = static_cast<double>(residual.cols() + 1);
  out.gain = gainOf(*window, shape, kExponentials);
  if (out.gain < kClearGain * more_numbers * std::log(independent) ||
      shape.damping > kMostDamping || shape.frequency < kLowestFrequency ||
      turnsOf(window->position - residual) < kFewestTurns) {
    return noRinging();
  }
  const Eigen::Vector2d errors = errorsOf(*window, highest, shape, residual);
  out.ring.frequency = {shape.frequency, shape.frequency * errors[0]};
  out.ring.damping = {shape.damping, shape.damping * errors[1]};
  out.ring.slow = shape.slow;
  out.ring.rows = static_cast<int>(window->rows());
  out.ring.at = window->at;
  out.ring.position = window->position;
  out.ring.rms = residual.norm() / std::sqrt(static_cast<double>(window->rows()));
  if (!(errors.maxCoeff() <= kLargestError)) {
    out.ring.reason = "the ringing is not identifiable: a standard error exceeds half of its value";
  }
  return out;
}

RingDown ringDownOf(const Motion& motion) {
  JudgedRing best = noRinging();
  const bool enough = motion.rows() >= kLeastRingRows && motion.duration() > 0;
  const double highest = enough ? kHighestOfRate * motion.rate() : 0.0;
  for (const RingCandidate& one : ringCandidates(motion, highest)) {
    JudgedRing next = ringFrom(one.shape, motion, highest);
    if (next.gain > best.gain) best = std::move(next);
  }
  if (enough) {
    best.ring.begin = motion.time[fastestRow(
        motion, best.ring.found() ? best.ring.frequency.value : 0.1 * motion.rate())];
  }
  return best.ring;
}

// Rows of a trial at which a pressure begins to change by a step, or else its first row.
std::vector<Eigen::Index> stepsOf(const model::InputHistory& history, double range,
                                  Eigen::Index begin, Eigen::Index end) {
  std::vector<Eigen::Index> steps;
  if (range > 0) {
    Eigen::RowVectorXd level = history.input.row(begin);
    double level_since = history.time[begin];
    bool moves = false;
    for (Eigen::Index row = begin; row < end; ++row) {
      const double change = (history.input.row(row) - level).cwiseAbs().maxCoeff();
      if (change > (moves ? kStillPressure : kPressureStep) * range) {
        if (!moves) steps.push_back(row);
        moves = true;
        level = history.input.row(row);
        level_since = history.time[row];
      } else if (history.time[row] >= level_since + kStillTime) {
        moves = false;
      }
    }
  }
  if (steps.empty()) steps.push_back(begin);
  return steps;
}

// The rows with readings.
Motion motionOf(const model::InputHistory& history, const Eigen::MatrixXd& position,
                Eigen::Index begin, Eigen::Index end) {
  std::vector<Eigen::Index> rows;
  for (Eigen::Index row = begin; row < end; ++row) {
    if (position.row(row).allFinite()) rows.push_back(row);
  }
  const Eigen::Map<const Eigen::VectorXd> time(history.time.data(), history.rows());
  return {time(rows), position(rows, Eigen::all), rows};
}

// The mode that the releases have in common.
void pool(ModeFit& fit) {
  std::vector<Estimate> frequencies, dampings;
  double squares = 0, rows = 0;
  for (const RingDown& ring : fit.rings) {
    if (!ring.found()) continue;
    frequencies.push_back(ring.frequency);
    dampings.push_back(ring.damping);
    squares += ring.rms * ring.rms * ring.rows;
    rows += ring.rows;
  }
  const std::size_t found = frequencies.size(), all = fit.rings.size();
  if (found == 0 || static_cast<double>(found) < kLeastRinging * static_cast<double>(all)) {
    fit.failure = basics::messageOf(
        found == 0 ? "no ringing found in " : "ringing found only in ", found == 0 ? all : found,
        found == 0 ? "" : basics::messageOf(" of ", all), all == 1 ? " release" : " releases",
        " or steps, so that frequency and damping are not identifiable: the arm is "
        "overdamped, or it moved too little, too slowly or for too short a time");
    return;
  }
  fit.frequency = pooled(frequencies);
  fit.damping = pooled(dampings);
  fit.rms = std::sqrt(squares / rows);
}

}  // namespace

Estimate pooled(const std::vector<Estimate>& values) {
  const auto count = static_cast<Eigen::Index>(values.size());
  Eigen::ArrayXd value(count), variance(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    value[i] = values[i].value;
    variance[i] = std::max(values[i].standard_error * values[i].standard_error, 1e-300);
  }
  const Eigen::ArrayXd weight = 1 / variance;
  const double sum = weight.sum(), mean = (weight * value).sum() / sum;
  const double excess = (weight * (value - mean).square()).sum() - static_cast<double>(count - 1);
  const double own = count > 1 ? std::max(excess / (sum - weight.square().sum() / sum), 0.0) : 0.0;
  const double usual = std::pow(kUsualScatter * mean, 2);
  const Eigen::ArrayXd shared = 1 / (variance + std::max(own, usual));
  return {(shared * value).sum() / shared.sum(),
          std::sqrt((shared.square() * (variance + own)).sum()) / shared.sum()};
}

ModeFit fitMode(const model::InputHistory& history, const Eigen::MatrixXd& position) {
  const auto rows = static_cast<Eigen::Index>(history.time.size());
  basics::require(rows > 0 && rows == history.rows() && rows == position.rows(), "fitMode: ", rows,
                  " times, ", history.rows(), " rows of pressures and ", position.rows(),
                  " positions; expected as many of each, at least one");
  double range = 0;
  for (const auto& input : history.input.colwise()) {
    range = std::max(range, input.maxCoeff() - input.minCoeff());
  }
  ModeFit fit;
  int trial = 0;
  for (Eigen::Index begin = 0, end = 0; begin < rows; begin = end, ++trial) {
    for (end = begin + 1; end < rows && !history.starts_anew[end];) ++end;
    std::vector<Eigen::Index> steps = stepsOf(history, range, begin, end);
    steps.push_back(end);
    for (std::size_t i = 0; i + 1 < steps.size(); ++i) {
      fit.rings.push_back(ringDownOf(motionOf(history, position, steps[i], steps[i + 1])));
      fit.rings.back().trial = trial;
      if (history.input.cols() > 0) fit.rings.back().input = history.input.row(steps[i + 1] - 1);
    }
  }
  pool(fit);
  return fit;
}

RingDown refitted(const RingDown& ring, const model::InputHistory& history,
                  const Eigen::MatrixXd& position) {
  basics::require(ring.found() && position.rows() == history.rows() && position.cols() == 3,
                  "refitted: ", position.rows(), " positions for ", history.rows(),
                  " rows, or a release without a mode; expected as many, with x, y and z");
  const Eigen::Map<const Eigen::VectorXd> time(history.time.data(), history.rows());
  const Motion measured{time(ring.at), ring.position, ring.at},
      simulated{measured.time, position(ring.at, Eigen::all), ring.at};
  const Ringing shape{ring.frequency.value, ring.damping.value, ring.slow};
  const double highest = std::max(kHighestOfRate * measured.rate(), 2 * shape.frequency);
  const Ringing alike = RingProblem(simulated, highest).descended(shape);
  Eigen::MatrixXd noise = residualOf(measured, shape);
  if (noise.cols() == 3) {  // seen from any frame
    const Eigen::Matrix4d turned = Eigen::umeyama(simulated.position.transpose().eval(),
                                                  measured.position.transpose().eval(), false);
    const Eigen::MatrixXd own =
        noise - residualOf(simulated, alike) * turned.topLeftCorner<3, 3>().transpose();
    if (own.norm() < noise.norm()) noise = own;
  }
  const Eigen::Vector2d errors = errorsOf(measured, highest, shape, noise);
  RingDown out = ring;
  out.frequency = {alike.frequency, alike.frequency * errors[0]};
  out.damping = {alike.damping, alike.damping * errors[1]};
  if (!(errors.maxCoeff() <= kLargestError) || alike.damping > kMostDamping ||
      alike.frequency < kLowestFrequency) {
    out.reason = noRinging().ring.reason;
  }
  return out;
}

}  // namespace helix_arm::estimation
