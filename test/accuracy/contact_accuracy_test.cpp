// Contacts that the loop over vision finds, in lockstep on the ideal rig of `demo`, but for a
// softer true K_eps; on the demo's own rig where a test says so.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "procedures/follow_run.hpp"
#include "support/random.hpp"
#include "support/shipped_scene.hpp"
#include "support/test_size.hpp"

namespace helix_arm {
namespace {

using namespace procedures;

constexpr double kMm = 1e3;
constexpr double kForce = 0.3;        // [N]
constexpr double kTouched = 14.5;     // time of the force [s]
constexpr double kLeastScore = 16.0;  // of what nearly is an alarm

io::Scene demo(std::vector<io::Override> changes = {}) {
  changes.push_back({"simulation.arm.K_eps_scale", "0.9"});
  return test::demo(changes);
}

io::Scene arm(std::vector<io::Override> changes = {}) {
  changes.insert(changes.begin(), test::kIdealRig);
  return demo(changes);
}

// Of the true muscles: play of 4 kPa to either side.
constexpr char kPlay[] = "{play_kpa: [4], play_weight: [0.95]}";

Eigen::VectorXd randomPressure(const model::Arm& arm, test::Random& random) {
  Eigen::VectorXd fraction(arm.actuatorCount());
  for (double& one : fraction) one = random.uniform(0.05, 0.95);
  return arm.inputAt(fraction);
}

FollowPlan randomTips(const io::Scene& scene, int count, double seconds, unsigned seed) {
  test::Random random(seed);
  FollowPlan plan;
  for (int k = 0; k < count; ++k) {
    plan.tips.push_back(scene.model.tip(randomPressure(scene.arm, random)).tip.translation);
  }
  plan.seconds = seconds;
  plan.seed = seed;
  return plan;
}

// Four tips, and a force of a random direction across the arm's end at the last one.
FollowPlan touchedPlan(const io::Scene& scene, double seconds, unsigned seed,
                       double force = kForce) {
  FollowPlan plan = randomTips(scene, 4, seconds, seed);
  test::Random random(1000 + seed);
  statics::InverseSolver solver(scene.model);
  const Eigen::VectorXd& input = solver.toPosition(plan.tips.back(), scene.arm.inputAt(0.3)).input;
  const Eigen::Vector3d along = scene.model.tip(input).tip.rotation.col(0);
  const Eigen::Vector3d across = along.cross(random.direction<3>()).normalized();
  plan.force = procedures::TimedForce{kTouched, force * across};
  return plan;
}

// RMS of the true tip's error between two times.
double rms(const FollowResult& result, double from, double to) {
  double square = 0.0;
  int rows = 0;
  for (const FollowRow& row : result.rows) {
    if (row.time < from || row.time > to) continue;
    square += (row.true_tip - *row.wanted).squaredNorm();
    ++rows;
  }
  return std::sqrt(square / rows);
}

struct Draw {
  double delay;      // of the alarm after the force [s]
  double lateral;    // error of the force across the arm's end [N]
  double distance2;  // of the force, by its covariance
};

// The force as it is known 1.5 s after it came.
std::optional<Draw> touch(const io::Scene& scene, unsigned seed, double force) {
  const FollowPlan plan = touchedPlan(scene, kTouched + 1.5, seed, force);
  const FollowResult result = procedures::runFollow(scene, plan);
  EXPECT_EQ(result.vented, "") << seed;
  EXPECT_LE(result.alarms.size(), 1u) << seed;
  if (result.alarms.empty()) return std::nullopt;
  const FollowAlarm& alarm = result.alarms.front();
  EXPECT_GT(alarm.time, kTouched) << seed << ": before the force";
  EXPECT_FALSE(alarm.normalised);
  const Eigen::Vector3d error = alarm.force - plan.force->force;
  const FollowRow& last = result.rows.back();
  EXPECT_TRUE(last.wanted);
  const simulation::TrueArm truth(scene.model, scene.simulation.arm);
  const Eigen::Vector3d along = model::tipPose(truth.shape(last.pressure)).rotation.col(0);
  return Draw{alarm.time - kTouched, (error - along * along.dot(error)).norm(),
              error.dot(alarm.covariance.ldlt().solve(error))};
}

// What is found of a force across the arm.
struct Found {
  int soon = 0;            // within half a second
  double lateral = 0;      // error of the force that 9 in 10 stay below [N]
  double mean_square = 0;  // error by its covariance, 3 in the mean if it is right
};

Found found(double force, const io::Scene& scene, int draws) {
  std::vector<double> delays, laterals;
  double sum = 0;
  for (int seed = 1; seed <= draws; ++seed) {
    const auto draw = touch(scene, seed, force);
    if (!draw) continue;
    delays.push_back(draw->delay);
    laterals.push_back(draw->lateral);
    sum += draw->distance2;
  }
  std::sort(delays.begin(), delays.end());
  std::sort(laterals.begin(), laterals.end());
  if (delays.empty()) return {};
  const auto soon = std::upper_bound(delays.begin(), delays.end(), 0.5) - delays.begin();
  const double mean = sum / static_cast<double>(delays.size());
  std::printf(
      "[  FIGURE  ] %.1f N across the arm, %d draws: %zu found, %d within 0.5 s, after %.2f s in "
      "the median; lateral error after 1.5 s %.2f N in the median, %.2f N at most; error^2 %.2f of "
      "3 in the mean\n",
      force, draws, delays.size(), static_cast<int>(soon), delays[delays.size() / 2],
      laterals[laterals.size() / 2], laterals.back(), mean);
  return {static_cast<int>(soon), laterals[delays.size() * 9 / 10], mean};
}

// Draws that are found within half a second: 18 of 20; of fewer, what docs/closed_loop.md quotes.
int leastSoon(int draws) { return draws == 20 ? 18 : test::leastOf(draws, 0.98); }

TEST(Contact, AForceAcrossTheArmIsFoundWithinHalfASecond) {
  const int draws = test::draws(5, 20);
  for (const double force : {2 * kForce, kForce}) {
    const Found figures = found(force, arm(), draws);
    EXPECT_GE(figures.soon, leastSoon(draws));
    EXPECT_LE(figures.lateral, 0.15);
    EXPECT_GT(figures.mean_square, 0.5);
    EXPECT_LT(figures.mean_square, 3.0 + std::sqrt(20.0 / draws));
  }
}

// After 14.5 s of pictures, strokes are not yet known as well as on the ideal rig: they hide some
// of the lightest touches.
TEST(Contact, AForceAcrossTheDemosArmIsFoundWithinHalfASecond) {
  const int draws = test::draws(4, 20);
  EXPECT_GE(found(2 * kForce, demo(), draws).soon, leastSoon(draws));
  if (test::isFullSize()) {
    EXPECT_GE(found(kForce, demo(), draws).soon, 16);
  }
}

// A force that an arm of 900 N would hardly notice. Were forces expected to be as large on a soft
// arm, the place would be named wrong, and the force with it, after a few seconds.
TEST(Contact, AForceOnASoftHangingArmIsKnown) {
  const struct {
    double K_eps;           // [N]
    Eigen::Vector3d force;  // across the arm [N]
    bool by_default = false;
  } cases[] = {{30, {0, 0.05, 0}}, {30, {0, 0, 0.05}}, {60, {0, 0.1, 0}}, {60, {0, 0, -0.1}, true}};
  for (const auto& one : cases) {
    if (!one.by_default && !test::isFullSize()) continue;
    const io::Scene scene =
        test::shippedScene("loaded", {{"arm.stiffness.K_eps_n", std::to_string(one.K_eps)},
                                      {"load.mass_kg", "0.45"},
                                      {"simulation.arm", "{}"}});
    FollowPlan plan;
    plan.tips = {{0.36, 0.03, 0.02}, {0.36, -0.02, 0.03}};
    plan.seconds = kTouched + 5.5;
    plan.force = TimedForce{kTouched, one.force};
    const FollowResult result = runFollow(scene, plan);
    ASSERT_EQ(result.alarms.size(), 1u) << one.K_eps << " N, " << one.force.transpose();
    const double error = (result.alarms.front().force - one.force).norm();
    std::printf("[  FIGURE  ] K_eps %.0f N: a force of %.2f N is known to %.3f N\n", one.K_eps,
                one.force.norm(), error);
    EXPECT_GT(result.alarms.front().time, kTouched);
    EXPECT_LT(error, 0.5 * one.force.norm());
  }
}

// At 6 mm/s.
TEST(Contact, AForceDuringASlowPathIsFoundWithinASecond) {
  const int draws = test::draws(3, 10);
  const io::Scene scene = arm();
  int soon = 0;
  for (int seed = 1; seed <= draws; ++seed) {
    test::Random random(500 + seed);
    Eigen::Vector3d fraction;
    for (double& one : fraction) one = random.uniform(0.35, 0.65);
    const lie::SE3 middle = scene.model.tip(scene.arm.inputAt(fraction)).tip;
    control::ShapedPath circle;
    circle.centre = middle.translation;
    circle.radius = 0.015;
    circle.period = 15;
    circle.turns = 2;
    FollowPlan plan;
    plan.path = control::TipPath(control::wayPointsOf(circle));
    plan.seconds = kTouched + 1.5;
    plan.seed = seed;
    const Eigen::Vector3d across = middle.rotation.col(0).cross(random.direction<3>()).normalized();
    plan.force = procedures::TimedForce{kTouched, 0.5 * across};
    const FollowResult result = procedures::runFollow(scene, plan);
    EXPECT_LE(result.alarms.size(), 1u) << seed;
    if (!result.alarms.empty()) soon += result.alarms[0].time <= kTouched + 1.0;
  }
  std::printf("[  FIGURE  ] 0.5 N on a path at 6 mm/s: %d of %d found within a second\n", soon,
              draws);
  EXPECT_GE(soon, draws == 10 ? 8 : test::leastOf(draws, 0.98));
}

// The scores of onsets while nothing touches the arm.
struct Quiet {
  double hours = 0.0;
  int alarms = 0;
  int doubts = 0;     // of the loop
  int crossings = 0;  // of kLeastScore, upwards
  double highest = 0.0;
};

void watch(const io::Scene& scene, const FollowPlan& plan, Quiet& quiet) {
  const FollowResult result = procedures::runFollow(scene, plan);
  EXPECT_EQ(result.vented, "");
  quiet.hours += result.rows.back().time / 3600;
  quiet.alarms += static_cast<int>(result.alarms.size());
  for (const procedures::FollowState& state : result.states) {
    quiet.doubts += state.state == follow::LoopState::kDoubtful ? 1 : 0;
  }
  double before = 0;
  for (const FollowRow& row : result.rows) {
    quiet.highest = std::max(quiet.highest, row.load_score);
    quiet.crossings += before <= kLeastScore && row.load_score > kLeastScore ? 1 : 0;
    before = row.load_score;
  }
}

void print(const char* what, const Quiet& quiet) {
  std::printf(
      "[  FIGURE  ] %.2f h %s: %d false alarms, %d false doubts, highest score %.1f of 32, %d "
      "above 16\n",
      quiet.hours, what, quiet.alarms, quiet.doubts, quiet.highest, quiet.crossings);
}

Quiet stepsWithoutContact(int runs, double seconds, const io::Scene& scene = arm(),
                          const char* what = "of steps") {
  Quiet quiet;
  for (int run = 0; run < runs; ++run) {
    watch(scene, randomTips(scene, static_cast<int>(seconds / 4), seconds, 200 + run), quiet);
  }
  print(what, quiet);
  return quiet;
}

Quiet restWithoutContact(int runs, double seconds) {
  const io::Scene scene = arm();
  Quiet quiet;
  for (int run = 0; run < runs; ++run) {
    watch(scene, randomTips(scene, 1, seconds, 300 + run), quiet);
  }
  print("at rest", quiet);
  return quiet;
}

void expectQuiet(const Quiet& quiet) {
  EXPECT_EQ(quiet.alarms, 0);
  EXPECT_EQ(quiet.doubts, 0);
}

TEST(Contact, StepsAreNoContact) { expectQuiet(stepsWithoutContact(1, test::draws(60, 240))); }

TEST(Contact, StepsOfMusclesWithAKnownPlayAreNoContact) {
  const io::Scene known = arm({{"contractions.fig3_muscle.response", kPlay}});
  expectQuiet(
      stepsWithoutContact(1, test::draws(60, 240), known, "of steps with a play that is known"));
}

TEST(Contact, RestIsNoContact) { expectQuiet(restWithoutContact(1, test::draws(60, 480))); }

// The whole figures, which take minutes: run with --gtest_also_run_disabled_tests.
TEST(Contact, DISABLED_AnHourOfStepsIsNoContact) { expectQuiet(stepsWithoutContact(12, 310)); }

TEST(Contact, DISABLED_HalfAnHourOfStepsWithPlay) {
  const io::Scene known = arm({{"contractions.fig3_muscle.response", kPlay}}),
                  unknown = arm({{"simulation.arm.response", kPlay}});
  const int alarms = stepsWithoutContact(6, 310, known, "of steps, play known").alarms;
  EXPECT_LT(alarms, stepsWithoutContact(6, 310, unknown, "of steps, play unknown").alarms);
}

TEST(Contact, DISABLED_ThreeHoursOfRestAreNoContact) {
  const Quiet quiet = restWithoutContact(18, 610);
  EXPECT_EQ(quiet.alarms, 0);
  // Chance alone gives 17; fewer mean that the scores are too careful.
  EXPECT_LE(quiet.crossings, 50);
}

TEST(Contact, DISABLED_TwoHundredDraws) { EXPECT_GE(found(kForce, arm(), 200).soon, 180); }

struct Carried {
  const char* name;
  Eigen::Vector3d force;  // base frame [N]; 0: as drawn
};

// RMS of the tip's error 1 to 4 s after the load came, of the worst draw [m].
double worstOf(const Carried& load) {
  const int draws = test::draws(2, 8);
  const io::Scene scene = arm();
  double first = 0, steady = 0, worst = 0;
  int found = 0;
  for (int seed = 1; seed <= draws; ++seed) {
    FollowPlan plan = touchedPlan(scene, kTouched + 4, seed);
    if (!load.force.isZero(0)) plan.force->force = load.force;
    const FollowResult result = procedures::runFollow(scene, plan);
    found += static_cast<int>(result.alarms.size());
    first += std::pow(rms(result, kTouched, kTouched + 0.3), 2);
    const double one = rms(result, kTouched + 1, kTouched + 4);
    steady += one * one;
    worst = std::max(worst, one);
  }
  std::printf(
      "[  FIGURE  ] %s, %d draws, %d found: RMS %.2f mm in the first 0.3 s, %.2f mm from 1 to 4 s, "
      "%.2f mm at worst\n",
      load.name, draws, found, kMm * std::sqrt(first / draws), kMm * std::sqrt(steady / draws),
      kMm * worst);
  return worst;
}

// The loop goes on: the arm carries what pulls it.
TEST(CarriedLoad, StaysWithinAMillimetre) {
  EXPECT_LE(worstOf({"0.3 N across the arm", {0, 0, 0}}), 0.001);
  EXPECT_LE(worstOf({"50 g hung on", {0.05 * 9.81, 0, 0}}), 0.001);
}

}  // namespace
}  // namespace helix_arm
