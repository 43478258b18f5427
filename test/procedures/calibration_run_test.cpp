// What a calibration run does: it waits at each pressure of its plan until all is at rest.
#include <cmath>

#include <gtest/gtest.h>

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
  // Lets time pass, from just after the last one.
  template <class Pressure, class Tags>
  void pass(double seconds, const Pressure& pressureAt, const Tags& tagsAtTime) {
    const int ticks = static_cast<int>(std::lround(100 * seconds));
    for (int k = 0; k < ticks; ++k) {
      now = 0.01 * ++tick_;
      watch.command(now, set_point);
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

  SettleWatch watch{{"left", "right"}, kRules};
  Eigen::Vector2d set_point = kSetPoint;
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
}

TEST(SettleWatch, ANewSetPointBeginsAnew) {
  Watched arm;
  arm.pass(2);
  ASSERT_TRUE(arm.state().settled());
  arm.set_point += Eigen::Vector2d(1, 0);
  arm.pass(0.5);
  EXPECT_EQ(arm.state().state, SettleState::kPressure);
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
  for (int k = 1; k <= 60; ++k) {  // and the other way round
    arm.watch.command(arm.now + 0.6 + 0.01 * k, kSetPoint);
    arm.watch.seen(arm.now + 0.6 + 0.01 * k, tagsAt(5));
  }
  const Settling unread = arm.watch.at(arm.now + 1.2);
  EXPECT_TRUE(unread.stale());
  EXPECT_FALSE(unread.unseen());
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

TEST(SettleWatch, CreepThatAWindowDoesNotSeeIsWaitedFor) {
  model::Actuator slow = test::sampleArm().actuator(0);
  slow.response.slow_time = 2;
  slow.response.slow_weight = 0.5;
  std::vector<model::Section> sections(1);
  sections[0].actuators = {slow};
  Watched arm;
  arm.watch.waitForRest(model::Arm(sections));
  arm.pass(9.9);
  EXPECT_EQ(arm.state().state, SettleState::kPressure);
  arm.pass(0.3);
  EXPECT_TRUE(arm.state().settled()) << arm.state().reason;
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

TEST(PressurePlan, TheWayBackIsThatThereReversed) {
  const Eigen::MatrixXd loop = std::get<Eigen::MatrixXd>(checkPlan(kArm, {}, true));
  ASSERT_EQ(loop.rows(), 23);
  EXPECT_EQ(loop, loop.colwise().reverse());
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

TEST(PressureTour, NeighbouringSectionsLeadWithDifferentMuscles) {
  const Eigen::MatrixXd tour = pressureTour(test::sampleArm(2, 2));
  Eigen::Index first, second;
  tour.row(1).head(2).maxCoeff(&first);
  tour.row(1).tail(2).maxCoeff(&second);
  EXPECT_NE(first, second);
}

}  // namespace
}  // namespace helix_arm::procedures
