#include "gauss_rule.hpp"

#include <cmath>

#include "basics/pi.hpp"

namespace helix_arm::statics {

const GaussRule& GaussRule::of(int nodes) {
  static const std::vector<GaussRule> rules = all();
  return rules[static_cast<std::size_t>(nodes - 1)];
}

std::vector<GaussRule> GaussRule::all() {
  std::vector<GaussRule> out;
  for (int count = 1; count <= kMostNodes; ++count) out.push_back(GaussRule(count));
  return out;
}

GaussRule::GaussRule(int count)
    : nodes_(count), weights_(count), at_nodes_(count, count), before_(count, count) {
  for (int j = 0; j < count; ++j) {
    double x = -std::cos(basics::kPi * (j + 0.75) / (count + 0.5));
    double slope = 0.0;
    for (int i = 0; i < 8; ++i) {
      const Values P = legendre(0.5 * (1.0 + x));
      slope = count * (x * P[count] - P[count - 1]) / (x * x - 1.0);
      x -= P[count] / slope;
    }
    nodes_[j] = 0.5 * (1.0 + x);
    weights_[j] = 1.0 / ((1.0 - x * x) * slope * slope);
    const Values P = legendre(nodes_[j]);
    for (int n = 0; n < count; ++n) at_nodes_(j, n) = P[n];
  }
  highest_ = (2 * count - 1) * at_nodes_.col(count - 1).cwiseProduct(weights_);
  for (int j = 0; j < count; ++j) before_.col(j) = upTo(nodes_[j]);
  after_ = (-before_).colwise() + weights_;
}

GaussRule::Vector GaussRule::at(double t) const {
  const Values P = legendre(t);
  Vector out = Vector::Zero(count());
  for (int n = 0; n < count(); ++n) out += (2 * n + 1) * P[n] * at_nodes_.col(n);
  return out.cwiseProduct(weights_);
}

GaussRule::Vector GaussRule::upTo(double t) const {
  // The polynomial that is 1 at node l is w_l sum_n (2n + 1) P_n(c_l) P_n(t), and (2n + 1) times
  // the integral of P_n is (P_n+1 - P_n-1) / 2.
  Vector out = Vector::Constant(count(), t);
  const Values P = legendre(t);
  for (int n = 1; n < count(); ++n) out += 0.5 * (P[n + 1] - P[n - 1]) * at_nodes_.col(n);
  return out.cwiseProduct(weights_);
}

GaussRule::Values GaussRule::legendre(double t) const {
  const double x = 2.0 * t - 1.0;
  Values P;
  P[0] = 1.0;
  P[1] = x;
  for (int n = 1; n < count(); ++n) P[n + 1] = ((2 * n + 1) * x * P[n] - n * P[n - 1]) / (n + 1);
  return P;
}

}  // namespace helix_arm::statics
