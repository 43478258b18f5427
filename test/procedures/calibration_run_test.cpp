// What a calibration run does: it waits at each pressure of its plan until all is at rest.
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "procedures/pressure_plan.hpp"
#include "procedures/settle_watch.hpp"
#include "support/has.hpp"
#include "support/sample_arm.hpp"

namespace helix_arm::procedures {
namespace {

const SettleRules kRules{3e3, 1.0, 1.0, 0.5};
const Eigen::Vector2d kSetPoint(1e5, 2e5);

std::vector<TagObservation> tagsAt(double x, int count = 8) {
  std::vector<TagObservation> out;
  for (int id = 0; id < count; ++id) {
    out.push_back({id, Eigen::Matrix<double, 2, 4>::Constant(x)});
  }
  return out;
}

// An arm that is watched: pressures at 100 Hz, pictures at 10 Hz.
class Watched {
 public:
  explicit Watched(const SettleRules& rules = kRules) : watch({"left", "right"}, rules) {}

  // Lets time pass, from just after the last one.
  template <class Pressure, class Tags>
  void pass(double seconds, const Pressure& pressureAt, const Tags& tagsAtTime) {
    const int ticks = static_cast<int>(std::lround(100 * seconds));
    for (int k = 0; k < ticks; ++k) {
      now = 0.01 * ++tick_;
      if (commanded) watch.command(now, set_point);
      watch.measured(now, pressureAt(now));
      if (tick_ % 10 == 0) watch.seen(now, tagsAtTime(now));
    }
  }
  // At the set point, without motion.
  void pass(double seconds) {
    passAt(seconds, [this](double) { return set_point; });
  }
  // Without motion, at these pressures.
  template <class Pressure>
  void passAt(double seconds, const Pressure& pressureAt) {
    pass(seconds, pressureAt, [](double) { return tagsAt(5); });
  }
  // At the set point, with these tags.
  template <class Tags>
  void see(double seconds, const Tags& tagsAtTime) {
    pass(
        seconds, [this](double) { return set_point; }, tagsAtTime);
  }
  Settling state() const { return watch.at(now); }

  SettleWatch watch;
  Eigen::Vector2d set_point = kSetPoint;
  bool commanded = true;
  double now = 0;

 private:
  int tick_ = 0;
};

TEST(SettleWatch, SettlesOnceAWindowHasPassedWithoutMotion) {
  Watched arm;
  EXPECT_TRUE(arm.state().stale());
  arm.pass(0.9);
  EXPECT_FALSE(arm.state().settled());
  EXPECT_FALSE(arm.state().stale());
  arm.pass(0.3);
  const Settling state = arm.state();
  ASSERT_TRUE(state.settled()) << state.reason;
  EXPECT_TRUE(state.reason.empty());
  EXPECT_EQ(*state.set_point, kSetPoint);
  EXPECT_NEAR(state.last->time, 1.2, 1e-12);
  EXPECT_LT((state.last->pressure - kSetPoint).norm(), 1e-6);
  EXPECT_EQ(state.last->tags.size(), 8u);
  EXPECT_GE(arm.watch.samples().size(), 10u);
  EXPECT_LE(arm.watch.samples().size(), 12u);
}

TEST(SettleWatch, ANewSetPointBeginsAnew) {
  Watched arm;
  arm.pass(2);
  ASSERT_TRUE(arm.state().settled());
  arm.set_point += Eigen::Vector2d(1, 0);
  arm.pass(0.5);
  EXPECT_EQ(arm.state().state, SettleState::kPressure);
  EXPECT_TRUE(test::has(arm.state().reason, "set point has held for"));
  arm.pass(0.7);
  EXPECT_TRUE(arm.state().settled()) << arm.state().reason;
}

TEST(SettleWatch, ThePressureMustBeWithinItsToleranceOfTheSetPoint) {
  for (const double off : {2.9e3, 3.1e3}) {
    Watched arm;
    arm.passAt(2, [&](double) -> Eigen::VectorXd { return kSetPoint + Eigen::Vector2d(0, off); });
    EXPECT_EQ(arm.state().settled(), off < 3e3);
    if (off < 3e3) continue;
    EXPECT_EQ(arm.state().state, SettleState::kPressure);
    EXPECT_TRUE(test::has(arm.state().reason, "right is 3.10 kPa"));
  }
}

TEST(SettleWatch, NoiseThatAveragesOutDoesNotUnsettle) {
  std::mt19937 generator(7);
  std::normal_distribution<double> noise(0, 5e3);  // of one reading, larger than the tolerance
  Watched arm;
  int settled = 0;
  arm.pass(1.5);
  for (int k = 0; k < 100; ++k) {
    arm.passAt(0.1, [&](double) -> Eigen::VectorXd {
      return kSetPoint + Eigen::Vector2d(noise(generator), noise(generator));
    });
    settled += arm.state().settled();
  }
  EXPECT_GE(settled, 97);  // the means are within 0.7 kPa, 68 times of 100
}

TEST(SettleWatch, ALagIsWaitedForThoughTheMeanOverAllTheWindowWouldPass) {
  Watched arm;
  arm.passAt(1.2, [](double t) -> Eigen::VectorXd {
    return kSetPoint - Eigen::Vector2d(1e4 * std::exp(-t / 0.3), 0);
  });
  // Over all of it 3e3 (1 - exp(-1 / 0.3)) exp(-0.2 / 0.3) = 1.5e3; over its first half 2.5e3.
  EXPECT_TRUE(arm.state().settled());
  Watched slow;
  slow.passAt(1.2, [](double t) -> Eigen::VectorXd {
    return kSetPoint - Eigen::Vector2d(1.6e4 * std::exp(-t / 0.3), 0);
  });
  // 2.4e3 over all of it, but 4e3 over its first half.
  EXPECT_EQ(slow.state().state, SettleState::kPressure);
}

TEST(SettleWatch, AShapeThatCreepsIsNotSettled) {
  for (const double speed : {0.8, 1.3}) {  // [px/s]
    Watched arm;
    arm.see(3, [&](double t) { return tagsAt(speed * t / M_SQRT2); });
    EXPECT_EQ(arm.state().settled(), speed < 1);
    if (speed > 1) {
      EXPECT_EQ(arm.state().state, SettleState::kMoving);
    }
  }
}

TEST(SettleWatch, AQuarterOfTheTagsMayBeMisread) {
  for (const int misread : {2, 3}) {
    Watched arm;
    arm.see(3, [&](double t) {
      auto tags = tagsAt(5);
      for (int k = 0; k < misread; ++k) tags[k].corners.array() += 50 * t;
      return tags;
    });
    EXPECT_EQ(arm.state().settled(), misread == 2);
  }
}

TEST(SettleWatch, PicturesThatAreRarerThanTheWindowAreComparedWithTheOneBefore) {
  SettleRules rules = kRules;
  rules.max_age = 3;
  for (const bool moves : {false, true}) {
    SettleWatch watch({"left", "right"}, rules);
    for (int k = 0; k <= 400; ++k) {
      const double now = 0.01 * k;
      watch.command(now, kSetPoint);
      watch.measured(now, kSetPoint);
      if (k % 200 == 0) watch.seen(now, tagsAt(moves ? k : 5));
    }
    EXPECT_EQ(watch.at(4.0).settled(), !moves);
  }
}

TEST(SettleWatch, DataOlderThanItsLimitIsStale) {
  Watched arm;
  arm.pass(2);
  EXPECT_TRUE(arm.watch.at(arm.now + 0.49).settled());
  EXPECT_TRUE(arm.watch.at(arm.now + 0.51).stale());
  for (int k = 1; k <= 60; ++k) {  // pressures go on, pictures do not
    arm.watch.command(arm.now + 0.01 * k, kSetPoint);
    arm.watch.measured(arm.now + 0.01 * k, kSetPoint);
  }
  const Settling state = arm.watch.at(arm.now + 0.6);
  EXPECT_TRUE(state.stale());
  EXPECT_TRUE(state.unseen());
  EXPECT_TRUE(test::has(state.reason, "tag detections: the last are stamped 0.60 s before now"));
  for (int k = 1; k <= 60; ++k) {  // and the other way round
    arm.watch.command(arm.now + 0.6 + 0.01 * k, kSetPoint);
    arm.watch.seen(arm.now + 0.6 + 0.01 * k, tagsAt(5));
  }
  const Settling unread = arm.watch.at(arm.now + 1.2);
  EXPECT_TRUE(unread.stale());
  EXPECT_FALSE(unread.unseen());
  EXPECT_TRUE(test::has(unread.reason, "measured pressures"));
}

TEST(SettleWatch, StampsOfTheFutureAreNoFreshOnes) {
  Watched arm;
  arm.pass(2);
  EXPECT_TRUE(arm.watch.at(arm.now - 0.49).settled());
  const Settling state = arm.watch.at(arm.now - 3600);
  EXPECT_TRUE(state.stale());
  EXPECT_TRUE(test::has(state.reason, "3600.00 s ahead of now"));
}

TEST(SettleWatch, AGapOrAJumpBackInTimeBeginsAnew) {
  for (const double jump : {0.6, -1.0}) {
    Watched arm;
    arm.pass(2);
    ASSERT_TRUE(arm.state().settled());
    const double start = arm.now + jump;
    Settling state;
    for (int k = 0; k <= 150; ++k) {
      const double now = start + 0.01 * k;
      arm.watch.command(now, kSetPoint);
      arm.watch.measured(now, kSetPoint);
      if (k % 10 == 0) arm.watch.seen(now, tagsAt(5));
      state = arm.watch.at(now);
      if (k < 100) {
        EXPECT_FALSE(state.settled()) << jump << " " << k;
      }
    }
    EXPECT_TRUE(state.settled()) << state.reason;
  }
}

TEST(SettleWatch, WithoutTagsThereIsNothingToRecord) {
  Watched arm;
  arm.see(2, [](double) { return tagsAt(5, 0); });
  EXPECT_EQ(arm.state().state, SettleState::kNoTags);
}

TEST(SettleWatch, WithoutSetPointsPressuresMustStayNearTheirMean) {
  Watched arm;
  arm.commanded = false;
  arm.pass(2);
  EXPECT_TRUE(arm.state().settled()) << arm.state().reason;
  EXPECT_FALSE(arm.state().set_point);
  arm.passAt(2,
             [](double t) -> Eigen::VectorXd { return kSetPoint + Eigen::Vector2d(2e4 * t, 0); });
  EXPECT_EQ(arm.state().state, SettleState::kPressure);
}

TEST(SettleWatch, CreepThatAWindowDoesNotSeeIsWaitedFor) {
  model::Actuator slow = test::sampleArm().actuator(0);
  slow.response.slow_time = 2;
  slow.response.slow_weight = 0.5;
  std::vector<model::Section> sections(1);
  sections[0].actuators = {slow};
  for (const bool commanded : {true, false}) {
    Watched arm;
    arm.watch.waitForRest(model::Arm(sections));
    arm.commanded = commanded;
    arm.pass(9.9);
    EXPECT_EQ(arm.state().state, SettleState::kPressure);
    EXPECT_TRUE(test::has(arm.state().reason, "expected 10 s")) << arm.state().reason;
    arm.pass(0.3);
    EXPECT_TRUE(arm.state().settled()) << arm.state().reason;
  }
}

TEST(SettleWatch, APressureThatIsNoNumberIsNotSettled) {
  Watched arm;
  arm.passAt(2, [](double) { return Eigen::Vector2d(std::nan(""), 2e5); });
  EXPECT_EQ(arm.state().state, SettleState::kPressure);
}

TagObservation tagAt(int id, double x) { return {id, Eigen::Matrix<double, 2, 4>::Constant(x)}; }

Sample sampleOf(double time, double pressure, std::vector<TagObservation> tags) {
  return {time, Eigen::Vector2d(pressure, -pressure), std::move(tags)};
}

TEST(MedianSample, IsTheMiddleOneOfEveryNumberByItself) {
  const Sample median = medianOf({sampleOf(1, 10, {tagAt(3, 5), tagAt(7, 900)}),
                                  sampleOf(2, 30, {tagAt(3, 1), tagAt(7, 2)}),
                                  sampleOf(3, 20, {tagAt(3, 3), tagAt(7, 1)})});
  EXPECT_EQ(median.time, 3);
  EXPECT_EQ(median.pressure, Eigen::Vector2d(20, -20));
  ASSERT_EQ(median.tags.size(), 2u);
  EXPECT_EQ(median.tags[0].id, 3);
  EXPECT_EQ(median.tags[0].corners, tagAt(3, 3).corners);
  EXPECT_EQ(median.tags[1].corners, tagAt(7, 2).corners);
}

TEST(MedianSample, OfAnEvenNumberLiesHalfWayBetweenTheTwoInTheMiddle) {
  const Sample median = medianOf({sampleOf(1, 10, {tagAt(3, 5)}), sampleOf(2, 30, {tagAt(3, 1)})});
  EXPECT_EQ(median.pressure, Eigen::Vector2d(20, -20));
  EXPECT_EQ(median.tags.at(0).corners, tagAt(3, 3).corners);
}

TEST(MedianSample, LeavesOutTagsThatFewerThanHalfOfThePicturesShow) {
  const Sample median =
      medianOf({sampleOf(1, 1, {tagAt(1, 1), tagAt(2, 1)}), sampleOf(2, 1, {tagAt(2, 1)}),
                sampleOf(3, 1, {tagAt(2, 1), tagAt(5, 1)}), sampleOf(4, 1, {tagAt(5, 1)})});
  ASSERT_EQ(median.tags.size(), 2u);
  EXPECT_EQ(median.tags[0].id, 2);  // 3 of 4
  EXPECT_EQ(median.tags[1].id, 5);  // 2 of 4
}

// ---- Pressures of a run -------------------------------------------------------------------------

const model::Arm kArm = test::sampleArm(1, 3);

TEST(PressurePlan, OfThePaperGoesUpTo60PsiOnOneMuscleAfterTheOther) {
  const double psi[] = {0, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60};
  const Eigen::MatrixXd plan = defaultPressurePlan(kArm);
  ASSERT_EQ(plan.rows(), 12);
  ASSERT_EQ(plan.cols(), 3);
  for (int step = 0; step < 12; ++step) {
    for (int i = 0; i < 3; ++i) {
      const double expected = i == step % 3 ? test::kSampleMaxPressure * psi[step] / 60 : 0.0;
      EXPECT_NEAR(plan(step, i), expected, 1e-6) << step << " " << i;
    }
  }
}

TEST(PressurePlan, ThereAndBackReachesEveryPressureFromBelowAndFromAbove) {
  const Eigen::MatrixXd loop = std::get<Eigen::MatrixXd>(checkPlan(kArm, {}, true));
  ASSERT_EQ(loop.rows(), 23);
  EXPECT_EQ(loop, loop.colwise().reverse());
  const Eigen::MatrixXd plan = defaultPressurePlan(kArm);
  for (Eigen::Index k = 0; k < plan.rows(); ++k) {
    const Eigen::RowVectorXd level = plan.row(k);
    Eigen::Index actuator = 0;
    const double pressure = level.maxCoeff(&actuator);
    if (pressure == 0) continue;
    int from_below = 0, from_above = 0;
    for (Eigen::Index step = 1; step < loop.rows(); ++step) {
      if (loop.row(step) != level) continue;
      from_below += loop(step - 1, actuator) < pressure;
      from_above += loop(step - 1, actuator) > pressure;
    }
    EXPECT_GE(from_below, 1) << level;
    // The largest of each actuator has nothing above it.
    const bool largest = plan.col(actuator).maxCoeff() == pressure;
    EXPECT_EQ(from_above, largest ? 0 : 1) << level;
  }
}

TEST(PressurePlan, OfRowsGoesThereAndBackInTheirOrder) {
  const auto plan = std::get<Eigen::MatrixXd>(checkPlan(kArm, {0, 1, 2, 3, 4, 5, 6, 7, 8}, true));
  ASSERT_EQ(plan.rows(), 5);
  EXPECT_EQ(plan.row(1), Eigen::RowVector3d(3, 4, 5));
  EXPECT_EQ(plan.col(0), (Eigen::VectorXd(5) << 0, 3, 6, 3, 0).finished());
}

TEST(PressurePlan, ThatTheArmCannotFollowIsRefusedWithTheReason) {
  const auto faultOf = [](const std::vector<double>& rows) {
    return std::get<control::Refusal>(checkPlan(kArm, rows));
  };
  EXPECT_EQ(faultOf({0, 1, 2, 3}).fault, control::Fault::kWrongSize);
  EXPECT_EQ(faultOf({0, 1, std::nan(""), 3, 4, 5}).fault, control::Fault::kNotFinite);
  const control::Refusal beyond = faultOf({0, 0, 0, 0, 5e5, 0});
  EXPECT_EQ(beyond.fault, control::Fault::kOutOfRange);
  EXPECT_TRUE(test::has(beyond.message, "step 2 of the plan: s1_m2"));
  EXPECT_EQ(faultOf({1, 2, 3, 1, 2, 3}).fault, control::Fault::kOutOfRange);
  EXPECT_EQ(faultOf({1, 2, 3}).fault, control::Fault::kOutOfRange);
}

TEST(PressureTour, StaysWithinItsShareOfTheLimits) {
  for (const int sections : {1, 3}) {
    for (const int count : {1, 2, 3, 5}) {
      const model::Arm arm = test::sampleArm(sections, count);
      const Eigen::MatrixXd tour = pressureTour(arm, 0.5);
      ASSERT_EQ(tour.cols(), arm.actuatorCount());
      EXPECT_GE(tour.minCoeff(), 0.0);
      EXPECT_LE(tour.maxCoeff(), 0.5 * test::kSampleMaxPressure * (1 + 1e-12));
    }
  }
}

TEST(PressureTour, BeginsAndEndsAtRest) {
  const Eigen::MatrixXd tour = pressureTour(test::sampleArm());
  EXPECT_EQ(tour.row(0).cwiseAbs().maxCoeff(), 0.0);
  EXPECT_EQ(tour.bottomRows(1).cwiseAbs().maxCoeff(), 0.0);
}

TEST(PressureTour, BendsAThreeMuscleArmIntoEveryQuadrant) {
  const model::Arm arm = test::sampleArm();
  const Eigen::MatrixXd tour = pressureTour(arm);
  bool seen[2][2] = {};
  for (int row = 0; row < tour.rows(); ++row) {
    const Eigen::Vector3d tip = arm.tip(tour.row(row).transpose()).translation;
    if (tip.tail<2>().norm() > 0.05) seen[tip.y() > 0][tip.z() > 0] = true;
  }
  EXPECT_TRUE(seen[0][0] && seen[0][1] && seen[1][0] && seen[1][1]);
}

TEST(PressureTour, NeighbouringSectionsLeadWithDifferentMuscles) {
  const Eigen::MatrixXd tour = pressureTour(test::sampleArm(2, 2));
  Eigen::Index first, second;
  tour.row(1).head(2).maxCoeff(&first);
  tour.row(1).tail(2).maxCoeff(&second);
  EXPECT_NE(first, second);
}

}  // namespace
}  // namespace helix_arm::procedures
