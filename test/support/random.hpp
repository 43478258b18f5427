#pragma once

#include <Eigen/Core>
#include <cmath>
#include <random>

namespace helix_arm::test {

/// Seeded randomness of the property tests.
class Random {
 public:
  explicit Random(unsigned seed) : generator_(seed) {}

  double uniform(double lower, double upper) {
    return std::uniform_real_distribution<double>(lower, upper)(generator_);
  }
  /// Uniform in the logarithm.
  double logUniform(double lower, double upper) {
    return std::exp(uniform(std::log(lower), std::log(upper)));
  }
  int integer(int lower, int upper) {
    return std::uniform_int_distribution<int>(lower, upper)(generator_);
  }
  /// Of mean 0 and standard deviation 1.
  double normal() { return std::normal_distribution<double>()(generator_); }
  template <int kSize>
  Eigen::Matrix<double, kSize, 1> direction() {
    Eigen::Matrix<double, kSize, 1> u;
    do {
      for (int i = 0; i < kSize; ++i) u[i] = normal();
    } while (u.norm() < 1e-3);
    return u.normalized();
  }

 private:
  std::mt19937_64 generator_;
};

}  // namespace helix_arm::test
