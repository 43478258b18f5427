#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "basics/median.hpp"
#include "helix_arm/calibration/series_fit.hpp"
#include "series_problem.hpp"

namespace helix_arm::estimation {
namespace {

// ---- Rows that are no positions of the tip ----

constexpr double kNearOrigin = 0.05;     // of the farthest position: tips that come there by motion
constexpr double kFrozenTime = 1.5;      // in which a position has not changed in any digit [s]
constexpr double kFrozenRange = 0.2;     // of the range of pressures, which changed meanwhile
constexpr double kFar = 5.0;             // times the 95 % point of the distances from the median
constexpr double kJump = 10.0;           // times the 95 % point of the distances from neighbours
constexpr Eigen::Index kNeighbours = 2;  // rows to either side

std::vector<Eigen::Index> seenRows(const TipSeries& series) {
  std::vector<Eigen::Index> out;
  for (Eigen::Index row = 0; row < series.position.rows(); ++row) {
    if (series.position.row(row).allFinite()) out.push_back(row);
  }
  return out;
}

double percentile95(std::vector<double> values) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(values.size() * 95 / 100);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

Eigen::RowVectorXd medianOfRows(const Eigen::MatrixXd& position,
                                const std::vector<Eigen::Index>& rows) {
  Eigen::RowVectorXd out(position.cols());
  for (Eigen::Index axis = 0; axis < position.cols(); ++axis) {
    std::vector<double> values;
    for (const Eigen::Index row : rows) values.push_back(position(row, axis));
    out[axis] = basics::medianOf(std::move(values));
  }
  return out;
}

std::vector<Eigen::Index> zeroRows(const Eigen::MatrixXd& position,
                                   const std::vector<Eigen::Index>& seen) {
  std::vector<Eigen::Index> zero;
  double least = std::numeric_limits<double>::infinity(), most = 0;
  for (const Eigen::Index row : seen) {
    const double distance = position.row(row).norm();
    if (distance == 0) zero.push_back(row);
    if (distance > 0) least = std::min(least, distance);
    most = std::max(most, distance);
  }
  if (!(least > kNearOrigin * most)) zero.clear();  // the tip passes the origin
  return zero;
}

// All but the first of positions that stay the same to the last digit while the pressures change.
std::vector<Eigen::Index> frozenRows(const TipSeries& series,
                                     const std::vector<Eigen::Index>& seen) {
  std::vector<Eigen::Index> out;
  const model::InputHistory& history = series.history;
  if (history.time.empty() || history.input.cols() == 0) return out;
  const Eigen::RowVectorXd least = history.input.colwise().minCoeff();
  const double range = (history.input.colwise().maxCoeff() - least).maxCoeff();
  for (std::size_t begin = 0, end; begin < seen.size(); begin = end) {
    for (end = begin + 1; end < seen.size(); ++end) {
      const Eigen::Index row = seen[end];
      if (history.starts_anew[static_cast<std::size_t>(row)] ||
          series.position.row(row) != series.position.row(seen[begin])) {
        break;
      }
    }
    const Eigen::Index first = seen[begin], last = seen[end - 1];
    const double time = history.time[static_cast<std::size_t>(last)] -
                        history.time[static_cast<std::size_t>(first)];
    if (time < kFrozenTime) continue;
    const auto pressures = history.input.middleRows(first, last - first + 1);
    const double change =
        (pressures.colwise().maxCoeff() - pressures.colwise().minCoeff()).maxCoeff();
    if (change >= kFrozenRange * range) {
      out.insert(out.end(), seen.begin() + static_cast<std::ptrdiff_t>(begin) + 1,
                 seen.begin() + static_cast<std::ptrdiff_t>(end));
    }
  }
  return out;
}

// Rows far away from all others, or from the rows about them.
std::vector<Eigen::Index> farRows(const Eigen::MatrixXd& position,
                                  const std::vector<Eigen::Index>& seen) {
  const Eigen::RowVectorXd middle = medianOfRows(position, seen);
  std::vector<double> away, off;
  for (std::size_t k = 0; k < seen.size(); ++k) {
    const auto at = static_cast<Eigen::Index>(k), count = static_cast<Eigen::Index>(seen.size());
    const Eigen::Index from = std::max<Eigen::Index>(0, at - kNeighbours);
    const Eigen::Index to = std::min(count, at + kNeighbours + 1);
    const std::vector<Eigen::Index> near(seen.begin() + from, seen.begin() + to);
    away.push_back((position.row(seen[k]) - middle).norm());
    off.push_back((position.row(seen[k]) - medianOfRows(position, near)).norm());
  }
  const double most_away = kFar * percentile95(away), most_off = kJump * percentile95(off);
  std::vector<Eigen::Index> out;
  for (std::size_t k = 0; k < seen.size(); ++k) {
    if (away[k] > most_away || (most_off > 0 && off[k] > most_off)) out.push_back(seen[k]);
  }
  return out;
}

// ---- A cubic of the pressures ----

constexpr Eigen::Index kCubicRows = 1500;  // that are compared
constexpr Eigen::Index kRowsPerTerm = 4;
constexpr double kRidge = 1e-5;  // of the rows: keeps it from running away where it extrapolates
constexpr double kLags[] = {0.0, 0.1, 0.3, 1.0, 3.0};  // [s]

// Pressures through a first-order lag, in parts of their ranges.
Eigen::MatrixXd lagged(const model::InputHistory& history, double lag) {
  const Eigen::RowVectorXd least = history.input.colwise().minCoeff();
  const Eigen::RowVectorXd range =
      (history.input.colwise().maxCoeff() - least).cwiseMax(std::numeric_limits<double>::min());
  Eigen::MatrixXd out = (history.input.rowwise() - least).array().rowwise() / range.array();
  for (Eigen::Index row = 1; lag > 0 && row < out.rows(); ++row) {
    const auto k = static_cast<std::size_t>(row);
    if (history.starts_anew[k]) continue;
    const double share = -std::expm1(-(history.time[k] - history.time[k - 1]) / lag);
    out.row(row) = out.row(row - 1) + share * (out.row(row) - out.row(row - 1));
  }
  return out;
}

// All products of at most three pressures; of each pressure alone where there are too few rows.
Eigen::MatrixXd termsOf(const Eigen::MatrixXd& p, bool mixed) {
  std::vector<Eigen::VectorXd> terms{Eigen::VectorXd::Ones(p.rows())};
  for (Eigen::Index i = 0; i < p.cols(); ++i) {
    terms.emplace_back(p.col(i));
    for (Eigen::Index j = mixed ? 0 : i; j <= i; ++j) {
      terms.emplace_back(p.col(i).cwiseProduct(p.col(j)));
      for (Eigen::Index k = mixed ? 0 : j; k <= j; ++k) {
        terms.emplace_back(p.col(i).cwiseProduct(p.col(j)).cwiseProduct(p.col(k)));
      }
    }
  }
  Eigen::MatrixXd out(p.rows(), static_cast<Eigen::Index>(terms.size()));
  for (std::size_t k = 0; k < terms.size(); ++k) out.col(static_cast<Eigen::Index>(k)) = terms[k];
  return out;
}

// Fits of a cubic to the seen rows, or to a part of them.
class Cubic {
 public:
  explicit Cubic(const TipSeries& series) {
    std::vector<int> trial_of;
    int trials = 0;
    for (const bool begins : series.history.starts_anew) {
      trials += begins ? 1 : 0;
      trial_of.push_back(trials - 1);
    }
    const std::vector<Eigen::Index> seen = seenRows(series);
    const auto count = static_cast<Eigen::Index>(seen.size());
    const Eigen::Index stride = std::max<Eigen::Index>(1, count / kCubicRows);
    std::vector<Eigen::Index> rows;
    std::vector<int> trial_at;
    for (Eigen::Index k = 0; k < count; k += stride) {
      rows.push_back(seen[static_cast<std::size_t>(k)]);
      trial_at.push_back(trial_of[static_cast<std::size_t>(rows.back())]);
    }
    if (rows.empty() || series.history.input.cols() == 0) return;
    blocks_ = Blocks(trial_at, trials);
    measured_ = series.position(rows, Eigen::all);
    for (const double lag : kLags) {
      if (lag > 0 && series.history.time.empty()) break;
      const Eigen::MatrixXd pressures = lagged(series.history, lag)(rows, Eigen::all);
      terms_.push_back(termsOf(pressures, true));
      if (kRowsPerTerm * terms_.back().cols() > terms_.back().rows()) {
        terms_.back() = termsOf(pressures, false);
      }
    }
  }

  // RMS about the best of the lags, per degree of freedom; NaN without rows.
  double error() const {
    if (terms_.empty()) return std::nan("");
    return best(Eigen::VectorXi::LinSpaced(measured_.rows(), 0, measured_.rows() - 1)).error;
  }

  // RMS of the rows of each block, with the cubic of the others.
  double heldOutError() const {
    if (terms_.empty()) return std::nan("");
    double sum = 0;
    for (int block = 0; block < blocks_.count; ++block) {
      std::vector<Eigen::Index> in, out;
      for (std::size_t k = 0; k < blocks_.of.size(); ++k) {
        (blocks_.of[k] == block ? out : in).push_back(static_cast<Eigen::Index>(k));
      }
      const Fit fit = best(in);
      const Eigen::MatrixXd terms = (*fit.terms)(out, Eigen::all);
      const Eigen::MatrixXd predicted = (terms * fit.factors).rowwise() + fit.mean;
      sum += (predicted - measured_(out, Eigen::all)).squaredNorm();
    }
    return std::sqrt(sum / static_cast<double>(measured_.rows()));
  }

 private:
  struct Fit {
    const Eigen::MatrixXd* terms = nullptr;
    Eigen::MatrixXd factors;
    Eigen::RowVectorXd mean;
    double error = std::numeric_limits<double>::infinity();
  };
  template <class Rows>
  Fit best(const Rows& rows) const {
    const Eigen::RowVectorXd mean = measured_(rows, Eigen::all).colwise().mean();
    const Eigen::MatrixXd measured = measured_(rows, Eigen::all).rowwise() - mean;
    Fit out;
    for (const Eigen::MatrixXd& all : terms_) {
      const Eigen::MatrixXd terms = all(rows, Eigen::all);
      Eigen::MatrixXd square = terms.transpose() * terms;
      square.diagonal().array() += kRidge * static_cast<double>(terms.rows());
      const Eigen::MatrixXd factors = square.ldlt().solve(terms.transpose() * measured);
      const auto freedom =
          static_cast<double>(std::max<Eigen::Index>(1, terms.rows() - terms.cols()));
      const double error = std::sqrt((terms * factors - measured).squaredNorm() / freedom);
      if (error < out.error) out = {&all, factors, mean, error};
    }
    return out;
  }

  Eigen::MatrixXd measured_;
  std::vector<Eigen::MatrixXd> terms_;  // behind each lag
  Blocks blocks_;
};

}  // namespace

SeriesFaults faultyRows(const TipSeries& series) {
  SeriesFaults out;
  std::vector<Eigen::Index> seen = seenRows(series);
  const auto leave = [&seen](const std::vector<Eigen::Index>& rows) {
    const auto is_left = [&rows](Eigen::Index row) {
      return std::binary_search(rows.begin(), rows.end(), row);
    };
    seen.erase(std::remove_if(seen.begin(), seen.end(), is_left), seen.end());
  };
  out.zero = zeroRows(series.position, seen);
  leave(out.zero);
  out.frozen = frozenRows(series, seen);
  leave(out.frozen);
  if (!seen.empty()) out.far = farRows(series.position, seen);
  return out;
}

double cubicError(const TipSeries& series) { return Cubic(series).error(); }

double cubicHeldOutError(const TipSeries& series) { return Cubic(series).heldOutError(); }

}  // namespace helix_arm::estimation
