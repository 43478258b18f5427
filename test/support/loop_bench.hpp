#pragma once

#include <deque>
#include <map>

#include <gtest/gtest.h>

#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/correction.hpp"
#include "support/paper_arm.hpp"
#include "support/random.hpp"

namespace helix_arm::test {

/// A visual servo, a regulator with a lag and an arm that differs from its model, step by step. The
/// arm's twists are those of a corrected model, its motion away from rest multiplied by a gain.
class LoopBench {
 public:
  static constexpr double kStep = 0.01;  // [s]

  struct Options {
    double latency = 0.06;                     // [s]
    double time_constant = 0.15;               // [s]
    double gain = 1.0;                         // of the true arm's motion over the model's
    double reading_noise = 2e3;                // [Pa]
    double twist_noise_v = 1e-4;               // [m]
    double twist_noise_w = 1e-3;               // [rad]
    lie::Vector6 push = lie::Vector6::Zero();  // what a force adds to the first section's twist
    lie::Vector6 lie = lie::Vector6::Zero();   // what pictures add to the first section's twist
    double stamp_shift = 0.0;                  // what is wrong with the stamps of pictures [s]
    std::optional<model::Twists> frozen = {};  // pictures show this shape, whatever the arm's
    unsigned seed = 1;
  };

  LoopBench(const statics::ArmModel& model, const statics::Correction& truth,
            const follow::VisualServoConfig& config, const Options& given)
      : loop(model, config),
        options(given),
        model_(model),
        truth_(model),
        random_(given.seed),
        pressure_(Eigen::VectorXd::Zero(model.arm().actuatorCount())),
        set_point_(pressure_) {
    truth_.set(truth);
    loop.enable(true);
    turn();
  }
  static follow::VisualServoConfig config() {
    follow::VisualServoConfig out;
    out.time_constant = 0.15;
    out.reading_noise = 2e3;
    return out;
  }

  model::Twists trueTwists() const {
    const model::Arm& arm = model_.arm();
    const model::Twists rest = truth_.shape(arm.lengths(arm.inputAt(0.0)))->twists();
    model::Twists out =
        rest + options.gain * (truth_.shape(arm.lengths(arm.clamped(pressure_)))->twists() - rest);
    out.col(0) += options.push;
    return out;
  }
  Eigen::Vector3d trueTip() const { return model::tipPose(trueTwists()).translation; }
  const Eigen::VectorXd& pressure() const { return pressure_; }
  double time() const { return kStep * steps_; }

  /// One turn; a picture every third one, while `sees`.
  void step(bool sees = true) {
    ++steps_;
    pressure_ += -std::expm1(-kStep / options.time_constant) * (set_point_ - pressure_);
    turn();
    if (sees && steps_ % 3 == 0) waiting_.push_back({time(), measured()});
    while (!waiting_.empty() && waiting_.front().stamp + options.latency <= time() + 1e-9) {
      const Picture& next = waiting_.front();
      ++faults[loop.picture(next.stamp + options.stamp_shift, time(), next.twists, covariance())
                   .fault];
      waiting_.pop_front();
    }
  }
  void run(double seconds, bool sees = true) {
    const int steps = static_cast<int>(std::lround(seconds / kStep));
    for (int k = 0; k < steps; ++k) step(sees);
  }
  Eigen::MatrixXd covariance() const {
    Eigen::VectorXd variance(6 * model_.arm().sectionCount());
    for (int i = 0; i < variance.size(); ++i) {
      const double noise = i % 6 < 3 ? options.twist_noise_v : options.twist_noise_w;
      variance[i] = noise * noise;
    }
    return variance.asDiagonal();
  }
  double error() const { return (trueTip() - loop.turn().wanted.translation).norm(); }

  follow::VisualServo loop;
  Options options;
  std::map<estimation::ObservationFault, int> faults;  // of all pictures

 private:
  struct Picture {
    double stamp;
    model::Twists twists;
  };
  void turn() {
    Eigen::VectorXd reading = pressure_;
    for (double& value : reading) value += options.reading_noise * random_.normal();
    const follow::Turn& turn = loop.reading(time(), set_point_, reading);
    if (turn.commands) set_point_ = turn.pressure;
  }
  model::Twists measured() {
    model::Twists out = options.frozen.value_or(trueTwists());
    out.col(0) += options.lie;
    for (int i = 0; i < out.size(); ++i) {
      out.reshaped()[i] +=
          (i % 6 < 3 ? options.twist_noise_v : options.twist_noise_w) * random_.normal();
    }
    return out;
  }

  const statics::ArmModel model_;
  statics::CorrectedModel truth_;
  Random random_;
  Eigen::VectorXd pressure_, set_point_;
  std::deque<Picture> waiting_;
  int steps_ = 0;
};

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
