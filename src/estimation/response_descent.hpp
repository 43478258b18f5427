#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "response_readings.hpp"

namespace helix_arm::estimation {

inline constexpr double kSignificantResponse = 2.0;  // standard errors
inline constexpr double kLongestLag = 60.0;          // [s]
inline constexpr int kMostResponseSteps = 60;
inline constexpr double kResponseAtRest =
    1e-8;  // of the sum of squares: a smaller gain ends a descent

// A number of a response that is fitted.
struct ResponseNumber {
  enum Kind { kLag, kRise, kFall, kReach, kWeight } kind;  // kLag: both alike
  int play = 0;
};

inline double responseValueOf(const model::Response& response, const ResponseNumber& number) {
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

  // Least squares from a start (Levenberg and Marquardt, within bounds); with standard errors.
  ResponseCandidate polish(const model::Response& start,
                           std::vector<ResponseNumber> numbers) const {
    ResponseCandidate now{start, std::move(numbers), 0.0, readings_.residual(start), {}};
    now.rss = now.residual.squaredNorm();
    double damping = 1e-3;
    for (int step = 0; step < kMostResponseSteps && !now.numbers.empty(); ++step) {
      const Eigen::MatrixXd J = jacobian(now);
      const Eigen::VectorXd gradient = J.transpose() * now.residual;
      Eigen::MatrixXd normal = J.transpose() * J;
      for (Eigen::Index k = 0; k < gradient.size(); ++k) {
        const double diagonal = normal(k, k);
        // At a bound that it would leave, or without effect.
        if (diagonal == 0 ||
            (responseValueOf(now.response, at(now, k)) <= least(at(now, k)) && gradient[k] > 0)) {
          normal.row(k).setZero();
          normal.col(k).setZero();
        }
      }
      const double before = now.rss;
      for (; damping < 1e6; damping *= 10) {
        Eigen::MatrixXd damped = normal;
        for (Eigen::Index k = 0; k < gradient.size(); ++k) {
          damped(k, k) = normal(k, k) > 0 ? normal(k, k) * (1 + damping) : 1.0;
        }
        Eigen::VectorXd wanted = gradient;
        for (Eigen::Index k = 0; k < gradient.size(); ++k) {
          if (normal(k, k) == 0) wanted[k] = 0;
        }
        const Eigen::VectorXd move = -damped.ldlt().solve(wanted);
        model::Response next = now.response;
        for (Eigen::Index k = 0; k < move.size(); ++k) {
          set(next, at(now, k), responseValueOf(next, at(now, k)) + move[k]);
        }
        Eigen::VectorXd residual = readings_.residual(next);
        if (!(residual.squaredNorm() < now.rss)) continue;
        now.response = next;
        now.residual = std::move(residual);
        now.rss = now.residual.squaredNorm();
        damping = std::max(damping / 100, 1e-9);
        break;
      }
      if (before - now.rss <= kResponseAtRest * before) break;
    }
    now.error = errors(now);
    return now;
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
  static const ResponseNumber& at(const ResponseCandidate& fit, Eigen::Index k) {
    return fit.numbers[static_cast<std::size_t>(k)];
  }
  double least(const ResponseNumber& number) const {
    return number.kind == ResponseNumber::kReach ? readings_.range() / 200 : 0.0;
  }

  Eigen::MatrixXd jacobian(const ResponseCandidate& fit) const {
    Eigen::MatrixXd J(fit.residual.size(), static_cast<Eigen::Index>(fit.numbers.size()));
    for (Eigen::Index k = 0; k < J.cols(); ++k) {
      const ResponseNumber& number = at(fit, k);
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

}  // namespace helix_arm::estimation
