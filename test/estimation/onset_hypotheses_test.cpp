#include "helix_arm/tracking/onset_hypotheses.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "helix_arm/statics/loaded.hpp"
#include "support/loaded_arm.hpp"

namespace helix_arm::estimation {
namespace {

using statics::ArmModel;

constexpr double kPeriod = 1.0 / 30;  // of pictures [s]
constexpr double kK_eps = 900.0;      // [N]
constexpr double kArmed = 10.0;       // of pictures [s]
constexpr double kCreep = 0.02;       // of the bias [s^-1/2]
constexpr int kLateral[] = {1, 2};    // axes across an arm that hangs along x

ArmModel knownStiffness() {
  return ArmModel(test::ringArm(test::helicalRing()), std::nullopt, test::weightless(1, kK_eps));
}

// A true arm that a force may pull, a filter that watches it, and onsets of that filter. The mean
// of the strain is measured, with noise.
class Bench {
 public:
  explicit Bench(unsigned seed, const OnsetOptions& options = {})
      : onsets(options), random(seed), truth_(model) {}

  // Of the true arm: how it differs from its model.
  void differ(const statics::Correction& correction) { truth_.set(correction); }

  model::Twists trueTwists() const {
    const Eigen::VectorXd lengths = truth_.scaled(model.arm().lengths(pressure - lost));
    model::Twists unloaded = truth_.arm().twistsOfLengths(lengths);
    if (!force.isZero(0)) {
      statics::Load load = test::weightless(1, kK_eps);
      load.points.emplace_back();
      load.points.back().s = place;
      load.points.back().force = force;
      const auto pulled = statics::LoadedArm(truth_.arm(), load, 5).solve(unloaded);
      EXPECT_TRUE(pulled.converged());
      unloaded = pulled.shape.twists();
    }
    return unloaded + truth_.correction().offset + crept_;
  }

  // A picture.
  void see() {
    time += kPeriod;
    if (creeps) {
      const Eigen::VectorXd& deviation = watch.biasDeviation();
      for (int i = 0; i < 6; ++i) {
        crept_(i, 0) += kCreep * std::sqrt(kPeriod) * deviation[i] * random.normal();
      }
    }
    ArmFilter::Input picture{time, pressure, Eigen::VectorXd::Zero(3), trueTwists(), {}};
    lie::Vector6 deviation;
    deviation << 3e-5, 3e-5, 3e-5, 3e-4, 3e-4, 3e-4;
    for (int i = 0; i < 6; ++i) picture.twists(i, 0) += noise * deviation[i] * random.normal();
    picture.covariance = deviation.cwiseAbs2().asDiagonal();
    watch.see(picture);
    compliance.moveTo(picture.pressure, watch.correction());
    onsets.see(time, tip_deviation, model::shapeOf(model.arm(), picture.twists), true, motion,
               watch, compliance);
  }
  void run(double seconds) {
    for (double end = time + seconds; time < end - kPeriod / 2;) see();
  }
  // Time until a contact is found [s]; infinite if none is.
  double delay(double deadline) {
    const double begin = time;
    while (!onsets.load().contact && time < begin + deadline) see();
    return onsets.load().contact ? time - begin : INFINITY;
  }
  // A force that is found.
  void touch(const Eigen::Vector3d& by) {
    force = by;
    ASSERT_TRUE(std::isfinite(delay(1)));
  }
  // Targets in a row until contacts may be found.
  void moveUntilArmed() {
    for (int k = 0; k < 5; ++k) {
      pressure = test::randomInput(model.arm(), random);
      run(2.2);
    }
    pressure = model.arm().inputAt(Eigen::Vector3d(0.3, 0.5, 0.4));
    run(4);
  }

  static ArmFilterOptions options() {
    ArmFilterOptions out;
    out.creep = kCreep;
    return out;
  }

  const ArmModel model = knownStiffness();
  ArmFilter watch{model, options()};
  TipCompliance compliance{model};
  OnsetHypotheses onsets;
  test::Random random;
  double time = 0.0, noise = 1.0, tip_deviation = 1e-3;
  double place = 1.0;   // of the force
  bool creeps = false;  // the true arm, as the filter assumes
  double motion = 0.0;
  Eigen::Vector3d lost = Eigen::Vector3d::Zero();  // by play, of the pressures [Pa]
  Eigen::Vector3d force = Eigen::Vector3d::Zero();
  Eigen::VectorXd pressure = model.arm().inputAt(Eigen::Vector3d(0.3, 0.5, 0.4));

 private:
  statics::CorrectedModel truth_;
  model::Twists crept_ = model::Twists::Zero(6, 1);
};

const ExternalLoad& loadOf(const Bench& bench) { return bench.onsets.load(); }

// An onset that is two pictures old: its score against least squares over these pictures, whose
// unknowns are theta and b as the watch knew them, and f.
TEST(OnsetHypotheses, TheScoreIsThatOfLeastSquaresOverThePicturesSinceTheFork) {
  Bench bench(1);
  for (int k = 0; k < 3; ++k) bench.see();  // the third picture is forked
  const Gaussian before = bench.watch.state();
  bench.force = {0, 0.3, -0.2};
  const Eigen::Index m = bench.watch.parameterCount(), d = 6, size = m + d + 3;
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(size, size);
  covariance.topLeftCorner(m + d, m + d) = before.covariance;
  covariance.bottomRightCorner<3, 3>().setIdentity();
  Eigen::MatrixXd information;
  Eigen::VectorXd vector;
  for (int k = 0; k < 2; ++k) {
    bench.see();
    const ArmFilter::Step& step = *bench.watch.lastStep();
    // What happens between two pictures adds to the covariance before the next one.
    const Eigen::MatrixXd prior = k == 0 ? covariance : Eigen::MatrixXd(information.inverse());
    const Eigen::VectorXd mean = k == 0 ? Eigen::VectorXd::Zero(size).eval()
                                        : Eigen::VectorXd(information.ldlt().solve(vector));
    Eigen::VectorXd expected = mean;
    if (k == 0) expected.head(m + d) = before.mean;
    Eigen::MatrixXd predicted = prior;
    predicted.block(m, m, d, d) += step.bias_growth;
    predicted.diagonal().tail<3>().array() += 0.05 * 0.05 * step.dt;
    Eigen::MatrixXd H(d, size);
    H << step.model.by_theta, Eigen::MatrixXd::Identity(d, d), bench.compliance.atTip();
    const Eigen::VectorXd value =
        step.measured - step.model.twists + step.model.by_theta * step.theta;
    information = predicted.inverse() + H.transpose() * step.noise.inverse() * H;
    vector = predicted.inverse() * expected + H.transpose() * step.noise.inverse() * value;
  }
  const Eigen::VectorXd mean = information.ldlt().solve(vector);
  const Eigen::MatrixXd P = information.inverse();
  const Eigen::Vector3d f = mean.tail<3>();
  const double expected = f.dot(P.bottomRightCorner<3, 3>().inverse() * f);
  ASSERT_GT(expected, 1.0);
  EXPECT_NEAR(loadOf(bench).score, expected, 1e-4 * expected);
}

TEST(OnsetHypotheses, AForceAcrossTheArmIsFoundWithItsOnsetAndItsSize) {
  Bench bench(2);
  bench.moveUntilArmed();
  ASSERT_FALSE(loadOf(bench).contact);
  EXPECT_EQ(loadOf(bench).force, Eigen::Vector3d::Zero());
  EXPECT_EQ(loadOf(bench).determined.cols(), 0);
  const double begin = bench.time;
  bench.force = {0, 0.3, 0};
  EXPECT_LT(bench.delay(1), 0.5);
  EXPECT_NEAR(loadOf(bench).onset, begin, 0.15);
  bench.run(1.5);
  const ExternalLoad& load = loadOf(bench);
  ASSERT_TRUE(load.contact);
  EXPECT_FALSE(load.normalised);
  for (const int axis : kLateral) EXPECT_NEAR(load.force[axis], bench.force[axis], 0.1);
  ASSERT_GE(load.determined.cols(), 1);
  EXPECT_GT(load.determined.rightCols<1>().dot(Eigen::Vector3d::UnitY()), 0.0);
  for (int i = 0; i < load.determined.cols(); ++i) {
    const Eigen::Vector3d axis = load.determined.col(i);
    EXPECT_NEAR(axis.norm(), 1, 1e-9);
    EXPECT_GT(axis.dot(load.force), 3 * std::sqrt(axis.dot(load.covariance * axis)));
  }
}

TEST(OnsetHypotheses, NothingIsFoundBeforeTenSecondsOfPictures) {
  Bench bench(3);
  bench.run(kArmed - 0.5);
  bench.force = {0, 1, 0};
  while (bench.time < kArmed - 1.5 * kPeriod) {
    bench.see();
    ASSERT_FALSE(loadOf(bench).contact) << bench.time;
  }
  EXPECT_GT(loadOf(bench).score, 32) << "the force shows";
  EXPECT_LT(bench.delay(1), 4 * kPeriod);
}

TEST(OnsetHypotheses, NothingIsFoundWhileTheTipIsUncertain) {
  Bench bench(4);
  bench.moveUntilArmed();
  bench.force = {0, 1, 0};
  bench.tip_deviation = 3.01e-3;
  for (int k = 0; k < 15; ++k) {
    bench.see();
    ASSERT_FALSE(loadOf(bench).contact);
  }
  EXPECT_GT(loadOf(bench).score, 32);
  bench.tip_deviation = 2.99e-3;
  bench.see();
  EXPECT_TRUE(loadOf(bench).contact);
}

TEST(OnsetHypotheses, AForceDuringMotionScoresLessByItsSquare) {
  const auto scoreAt = [](double motion) {
    Bench bench(2);
    bench.onsets.ignoreContacts(true);
    bench.run(11.0);
    bench.motion = motion;
    bench.force = {0, 0.5, 0};
    bench.run(0.3);
    return loadOf(bench).score;
  };
  const double still = scoreAt(1.0);
  EXPECT_EQ(scoreAt(0.5), still);
  EXPECT_NEAR(scoreAt(4.0), still / 16, 1e-9 * still);
  EXPECT_GT(still, OnsetOptions().limit);
  EXPECT_LT(still / 16, OnsetOptions().limit);
}

TEST(OnsetHypotheses, SmallChangesThatPlayKeepsFromArrivingAreNoForce) {
  Bench bench(2);
  bench.moveUntilArmed();
  for (int k = 0; k < 60; ++k) {
    const double change = 100;
    bench.pressure[0] += change;
    bench.lost[0] += change;
    bench.see();
    ASSERT_FALSE(loadOf(bench).contact) << bench.lost[0] << " Pa";
  }
}

TEST(OnsetHypotheses, AForceThatIsGoneIsNoContactAfterHalfASecond) {
  Bench bench(7);
  bench.moveUntilArmed();
  bench.touch({0, 0.5, 0});
  bench.run(2);
  bench.force.setZero();
  const double begin = bench.time;
  double low_since = INFINITY;
  while (loadOf(bench).contact && bench.time < begin + 5) {
    bench.see();
    if (loadOf(bench).score >= 7.8) low_since = INFINITY;
    if (loadOf(bench).score < 7.8) low_since = std::min(low_since, bench.time);
  }
  EXPECT_LT(bench.time, begin + 3);
  EXPECT_NEAR(bench.time - low_since, 0.5, 1.5 * kPeriod);
  EXPECT_EQ(loadOf(bench).force, Eigen::Vector3d::Zero());
  EXPECT_FALSE(loadOf(bench).place);
  // And the next one is found.
  bench.run(1);
  ASSERT_FALSE(loadOf(bench).contact);
  bench.force = {0, -0.5, 0};
  EXPECT_LT(bench.delay(1), 0.5);
}

// Other tags err by other placements: a jump of that size is no contact, if its covariance is told.
TEST(OnsetHypotheses, AJumpOfWhatOtherTagsMeasureIsNoContact) {
  for (const bool told : {true, false}) {
    Bench bench(12);
    bench.moveUntilArmed();
    lie::Vector6 deviation;
    deviation << 0, 5e-4, 5e-4, 5e-3, 5e-3, 5e-3;
    statics::Correction jump(bench.model.arm());
    jump.offset.col(0) << 0, 5e-4, -4e-4, 3e-3, 5e-3, 4e-3;
    bench.differ(jump);
    const Eigen::MatrixXd covariance = deviation.cwiseAbs2().asDiagonal();
    const Eigen::MatrixXd before = bench.watch.state().covariance;
    if (told) {
      bench.onsets.growBias(covariance, bench.watch);
      const Eigen::MatrixXd grown = bench.watch.state().covariance - before;
      EXPECT_LT((grown.bottomRightCorner<6, 6>() - covariance).norm(), 1e-12);
      EXPECT_TRUE(grown.topRows(grown.rows() - 6).isZero(0));
    }
    EXPECT_EQ(std::isfinite(bench.delay(2)), !told);
  }
}

}  // namespace
}  // namespace helix_arm::estimation
