#include "box_quadratic.hpp"

#include <algorithm>
#include <cmath>

namespace helix_arm::statics {

BoxQuadratic::BoxQuadratic(int n)
    : H(n, n),
      g(n),
      lower(n),
      upper(n),
      n_(n),
      free_(n),
      state_(n),
      x_(n),
      y_(n),
      inverse_pivot_(n),
      factor_(n, n) {}

const Eigen::VectorXd& BoxQuadratic::solve() noexcept {
  for (int i = 0; i < n_; ++i) {
    x_[i] = 0;
    state_[i] = lower[i] >= 0 && g[i] > 0   ? State::kLower
                : upper[i] <= 0 && g[i] < 0 ? State::kUpper
                                            : State::kFree;
  }
  // Every pass fixes or releases one variable; the limit only guards against cycling on ties.
  for (int pass = 0; pass < 10 * n_ + 10; ++pass) {
    solveFree();
    if (advance() && !release()) break;
  }
  return x_;
}

// Minimises over the free variables with the others fixed: L D L' on packed rows, hand-written
// since n is small and known only at run time.
void BoxQuadratic::solveFree() noexcept {
  free_count_ = 0;
  for (int i = 0; i < n_; ++i) {
    if (state_[i] == State::kFree) free_[free_count_++] = i;
  }
  for (int a = 0; a < free_count_; ++a) {
    const int i = free_[a];
    double right = -g[i];
    if (free_count_ < n_) {
      for (int j = 0; j < n_; ++j) {
        if (state_[j] != State::kFree) right -= coupling(i, j) * x_[j];
      }
    }
    double pivot = H(i, i);
    for (int b = 0; b < a; ++b) {
      double sum = H(i, free_[b]);  // L(a, b) D(b)
      for (int c = 0; c < b; ++c) sum -= factor_(c, a) * factor_(b, c);
      factor_(b, a) = sum;
      factor_(a, b) = sum * inverse_pivot_[b];
      pivot -= sum * factor_(a, b);
      right -= factor_(a, b) * y_[b];
    }
    // Rounding may make a tiny pivot negative; the caller's damping keeps H positive definite.
    inverse_pivot_[a] = 1.0 / std::max(pivot, 1e-300);
    y_[a] = right;
  }
  for (int a = free_count_ - 1; a >= 0; --a) {
    double sum = y_[a] * inverse_pivot_[a];
    for (int b = a + 1; b < free_count_; ++b) sum -= factor_(b, a) * y_[b];
    y_[a] = sum;
  }
}

// Moves to the free minimiser and returns true, or to the first bound on the way and fixes it.
bool BoxQuadratic::advance() noexcept {
  double fraction = 1.0;
  int blocking = -1;
  State side = State::kFree;
  for (int a = 0; a < free_count_; ++a) {
    const int i = free_[a];
    const double step = y_[a] - x_[i];
    const double room = (step < 0 ? lower[i] : upper[i]) - x_[i];
    if (std::abs(room) < std::abs(step) * fraction) {
      fraction = room / step;
      blocking = i;
      side = step < 0 ? State::kLower : State::kUpper;
    }
  }
  for (int a = 0; a < free_count_; ++a) x_[free_[a]] += fraction * (y_[a] - x_[free_[a]]);
  if (blocking < 0) return true;
  state_[blocking] = side;
  x_[blocking] = side == State::kLower ? lower[blocking] : upper[blocking];
  return false;
}

// Releases the fixed variable with the steepest descent into the box; false if there is none.
bool BoxQuadratic::release() noexcept {
  if (free_count_ == n_) return false;
  int worst = -1;
  double pull = 0.0;
  for (int i = 0; i < n_; ++i) {
    if (state_[i] == State::kFree) continue;
    double slope = g[i];
    for (int j = 0; j < n_; ++j) slope += coupling(i, j) * x_[j];
    const double gain = state_[i] == State::kLower ? -slope : slope;
    if (gain > pull + 1e-14 * std::abs(g[i])) {
      pull = gain;
      worst = i;
    }
  }
  if (worst < 0) return false;
  state_[worst] = State::kFree;
  return true;
}

}  // namespace helix_arm::statics
