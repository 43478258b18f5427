#pragma once

#include <gtest/gtest.h>

#include "support/loop_bench.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::test {

/// A visual servo on an arm that is softer in shear, stiffer in bending and longer than its model.
class LoopTest : public ::testing::Test {
 protected:
  static statics::Correction truthOf(const model::Arm& arm) {
    statics::Correction out(arm);
    out.stiffness_factors = {0.6, 1.0, 1.2};
    out.length_scale.setConstant(1.01);
    return out;
  }
  Eigen::Vector3d tipAt(double a, double b, double c) const {
    return model_.tip(model_.arm().inputAt(Eigen::Vector3d(a, b, c))).tip.translation;
  }
  follow::LoopState state() const { return bench_.loop.state(); }
  void close() {
    bench_.loop.aimAt(here_);
    bench_.run(3);
    ASSERT_EQ(state(), follow::LoopState::kClosed);
  }

  void touch() { bench_.options.push << 0, 0, 0, 0, 0.06, -0.04; }
  void letGo() { bench_.options.push.setZero(); }
  // Pictures that bend more and more, while the arm does not [rad/s].
  void lie(double rate, double seconds) {
    const int steps = static_cast<int>(seconds / LoopBench::kStep);
    for (int k = 0; k < steps; ++k) {
      bench_.options.lie[5] += rate * LoopBench::kStep;
      bench_.step();
    }
  }

  const statics::ArmModel model_ = statics::ArmModel(ringArm(helicalRing()));
  const Eigen::Vector3d here_ = tipAt(0.3, 0.5, 0.4), there_ = tipAt(0.6, 0.3, 0.4);
  LoopBench bench_{model_, truthOf(model_.arm()), LoopBench::config(), {}};
};

}  // namespace helix_arm::test
