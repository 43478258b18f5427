// The loop over vision on the simulated rig of `demo`, in lockstep: errors of the true tip, the
// open loop beside the closed one. docs/closed_loop.md quotes the lines marked FIGURE.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "helix_arm/control/tip_path.hpp"
#include "helix_arm/dynamics/arm_motion.hpp"
#include "helix_arm/model/curve.hpp"
#include "procedures/follow_run.hpp"
#include "support/loaded_arm.hpp"
#include "support/random.hpp"
#include "support/shipped_scene.hpp"
#include "support/test_size.hpp"

namespace helix_arm {
namespace {

using control::TipShape;
using procedures::FollowPlan;
using procedures::FollowResult;
using test::demo;

constexpr double kMm = 1e3;

// `simulation.arm.dynamics` with which the demo's true arm swings at a frequency [Hz] with a
// damping ratio, at a third of its pressures.
std::string swingingAt(double frequency, double damping) {
  constexpr double kStiffness = 60;  // [N]
  const io::Scene scene = demo();
  const simulation::TrueArm truth(scene.model, scene.simulation.arm);
  const model::Arm& arm = truth.arm();
  const statics::Load load = test::evenLoad(arm.sectionCount(), Eigen::Vector3d::Zero(),
                                            1.0 / arm.sectionCount(), kStiffness);
  const dynamics::ArmMotion motion(arm, std::nullopt, load, {});
  const double of_a_kilogram =
      dynamics::vibrationsOf(motion.linearisedAt(arm.inputAt(1.0 / 3))).front().frequency;
  const double mass = of_a_kilogram * of_a_kilogram / (frequency * frequency);
  const std::string time = std::to_string(damping / (basics::kPi * frequency));
  return "{mass_kg: " + std::to_string(mass) + ", K_eps_n: " + std::to_string(kStiffness) +
         ", damping_s: {stretch: " + time + ", shear: " + time + ", twist: " + time +
         ", bend: " + time + "}}";
}

// Tips that an arm reaches at random pressures.
std::vector<Eigen::Vector3d> randomTips(const statics::ArmModel& model, int count, unsigned seed) {
  test::Random random(seed);
  std::vector<Eigen::Vector3d> tips;
  for (int k = 0; k < count; ++k) {
    Eigen::VectorXd fraction(model.arm().actuatorCount());
    for (double& one : fraction) one = random.uniform(0.05, 0.95);
    tips.push_back(model.tip(model.arm().inputAt(fraction)).tip.translation);
  }
  return tips;
}

// Tips that the true arm reaches at random pressures.
std::vector<Eigen::Vector3d> trueTips(const io::Scene& scene, int count, test::Random& random) {
  const simulation::TrueArm truth(scene.model, scene.simulation.arm);
  std::vector<Eigen::Vector3d> tips;
  for (int k = 0; k < count; ++k) {
    Eigen::VectorXd fraction(scene.arm.actuatorCount());
    for (double& one : fraction) one = random.uniform(0.05, 0.95);
    tips.push_back(model::tipPose(truth.shape(scene.arm.inputAt(fraction))).translation);
  }
  return tips;
}

FollowPlan steps(const io::Scene& scene, int count, double seconds_each) {
  FollowPlan plan;
  plan.tips = randomTips(scene.model, count, 3);
  plan.seconds = count * seconds_each;
  return plan;
}

FollowPlan shape(const io::Scene& scene, TipShape kind, double period, int turns = 2) {
  const Eigen::VectorXd fraction = Eigen::Vector3d(0.5, 0.4, 0.4);
  control::ShapedPath path;
  path.shape = kind;
  path.centre = scene.model.tip(scene.arm.inputAt(fraction)).tip.translation;
  path.radius = 0.02;
  path.period = period;
  path.turns = turns;
  FollowPlan plan;
  plan.path = control::TipPath(control::wayPointsOf(path));
  EXPECT_FALSE(procedures::checkPath(scene, *plan.path));
  plan.seconds = turns * period + 3;
  return plan;
}

// When the loop first doubts the pictures [s].
std::optional<double> doubtedAt(const FollowResult& result) {
  for (const procedures::FollowState& state : result.states) {
    if (state.state == follow::LoopState::kDoubtful) return state.time;
  }
  return std::nullopt;
}

FollowResult run(const io::Scene& scene, FollowPlan plan, bool open = false) {
  plan.open = open;
  FollowResult result = procedures::runFollow(scene, plan);
  EXPECT_EQ(result.vented, "");
  EXPECT_EQ(doubtedAt(result).has_value(), plan.drift.has_value() && !open);
  return result;
}

// Of the tips within reach.
struct StepFigures {
  double steady_rms = 0.0, settle_median = 0.0, settle_worst = 0.0;
  int reached = 0;
};

// @param first  of the tips that count.
StepFigures figuresOf(const FollowResult& result, std::size_t first = 0) {
  StepFigures out;
  std::vector<double> times;
  double square = 0.0;
  for (std::size_t k = first; k < result.figures.settle.size(); ++k) {
    if (result.figures.unreachable[k]) continue;
    times.push_back(result.figures.settle[k].value_or(INFINITY));
    square += result.figures.steady_rms[k] * result.figures.steady_rms[k];
  }
  out.reached = static_cast<int>(times.size());
  if (times.empty()) return out;
  std::sort(times.begin(), times.end());
  out.steady_rms = std::sqrt(square / out.reached);
  out.settle_median = times[times.size() / 2];
  out.settle_worst = times.back();
  return out;
}

// The open loop is there for its figure; by default it goes to the first tip alone.
FollowResult openLoop(const io::Scene& scene, FollowPlan plan) {
  if (!test::isFullSize()) {
    plan.seconds /= static_cast<double>(plan.tips.size());
    plan.tips.resize(1);
  }
  return run(scene, plan, true);
}

StepFigures printSteps(const char* what, const FollowResult& closed, const FollowResult& open) {
  const StepFigures figures = figuresOf(closed);
  std::printf(
      "[  FIGURE  ] %s: steady RMS %.2f mm (open loop %.1f mm), settled after %.2f s in the "
      "median, %.2f s at worst, %d tips\n",
      what, kMm * figures.steady_rms, kMm * figuresOf(open).steady_rms, figures.settle_median,
      figures.settle_worst, figures.reached);
  return figures;
}

TEST(ClosedLoop, TipsFromCorners) {
  const int tips = test::draws(6, 20);
  const double usual = FollowPlan().latency;
  const io::Override play{"simulation.arm.response", "{play_kpa: [8], play_weight: [0.95]}"};
  const struct {
    const char* what;
    std::vector<io::Override> changes;
    double latency, steady_rms, settle_median, settle_worst;  // the last three: at most
  } cases[] = {{"tips", {}, usual, 0.0004, 1.0, 1.5},
               {"tips, ideal rig", {test::kIdealRig}, usual, 0.0003, 0.7, 1.0},
               {"tips, latency 0.3 s", {}, 0.3, 0.0006, INFINITY, INFINITY},
               {"tips, 8 kPa of play", {test::kIdealRig, play}, usual, 0.001, INFINITY, INFINITY}};
  for (const auto& one : cases) {
    SCOPED_TRACE(one.what);
    const io::Scene scene = demo(one.changes);
    FollowPlan plan = steps(scene, tips, 4);
    plan.latency = one.latency;
    const StepFigures figures = printSteps(one.what, run(scene, plan), openLoop(scene, plan));
    EXPECT_GE(figures.reached, tips - 1);  // one is at the border of its reach
    EXPECT_LE(figures.steady_rms, one.steady_rms);
    EXPECT_LE(figures.settle_median, one.settle_median);
    EXPECT_LE(figures.settle_worst, one.settle_worst);
  }
}

// The loop follows effective pressures, and asks for pressures that produce the wanted ones. An arm
// that falls twice as slowly as it rises, with play that the scene does not know, may be doubted.
TEST(ClosedLoop, AResponseThatTheSceneKnowsLeavesNoBias) {
  const std::string lag_and_play =
      "{rise_time_constant_s: 0.3, fall_time_constant_s: 0.6, play_kpa: [8], play_weight: [0.6]}";
  const io::Scene unknown = demo({test::kIdealRig, {"simulation.arm.response", lag_and_play}});
  const io::Scene known =
      demo({test::kIdealRig, {"contractions.fig3_muscle.response", lag_and_play}});
  const FollowPlan plan = steps(known, test::draws(6, 20), 6);
  const StepFigures with = figuresOf(run(known, plan)),
                    without = figuresOf(procedures::runFollow(unknown, plan));
  const auto followed = [](const io::Scene& scene) {
    const FollowPlan turns = shape(scene, TipShape::kCircle, 20, test::draws(1, 2));
    return procedures::runFollow(scene, turns).figures.path_rms.value();
  };
  const double circle = followed(known), circle_without = followed(unknown);
  std::printf(
      "[  FIGURE  ] lag 0.3 / 0.6 s and play of 8 kPa: steady RMS %.2f mm, settled after %.2f s in "
      "the median, circle in 20 s %.2f mm RMS; unknown to the scene %.2f mm, %.2f s, %.2f mm\n",
      kMm * with.steady_rms, with.settle_median, kMm * circle, kMm * without.steady_rms,
      without.settle_median, kMm * circle_without);
  EXPECT_LE(with.steady_rms, 0.001);
  EXPECT_LT(with.steady_rms, without.steady_rms);
  EXPECT_LT(circle, circle_without);
}

// Random rigs that swing, with play, lag, strokes and stiffness that the scene does not know: how
// often the true tip is within the ellipsoid of 95 % about the predicted one.
TEST(ClosedLoop, ThePredictedTipIsAsCertainAsItClaims) {
  constexpr double kLearnt = 5.0, kMoves = 0.01, kRests = 0.002;  // [s], [m/s]
  constexpr std::size_t kBefore = 5;                              // rows
  struct {
    int rows = 0, inside = 0;
    double error2 = 0;
  } moving, rest;
  test::Random random(8);
  const auto factors = [&random](double deviation) {
    std::string out;
    for (int i = 0; i < 3; ++i) {
      out += (i > 0 ? ", " : "") + std::to_string(random.uniform(1 - deviation, 1 + deviation));
    }
    return "[" + out + "]";
  };
  for (unsigned seed = 1; seed <= static_cast<unsigned>(test::draws(2, 6)); ++seed) {
    const io::Scene scene =
        demo({{"simulation.arm.stroke_scales", factors(0.05)},
              {"simulation.arm.stiffness_scales", factors(0.05)},
              {"simulation.arm.K_gamma_scale", std::to_string(random.uniform(0.6, 1.4))},
              {"simulation.arm.K_kappa_scale", std::to_string(random.uniform(0.7, 1.3))},
              {"simulation.arm.response",
               "{rise_time_constant_s: 0.1, fall_time_constant_s: 0.1, play_kpa: [4], "
               "play_weight: [0.7]}"},
              {"simulation.arm.dynamics", swingingAt(3, 0.2)}});
    FollowPlan tips, circle = shape(scene, TipShape::kCircle, 8);
    tips.tips = randomTips(scene.model, 6, seed);
    tips.seconds = 18;
    tips.seed = circle.seed = seed;
    for (const FollowPlan& plan : {tips, circle}) {
      const std::vector<procedures::FollowRow> rows = procedures::runFollow(scene, plan).rows;
      for (std::size_t k = kBefore; k < rows.size(); ++k) {
        const procedures::FollowRow& row = rows[k];
        if (row.time < kLearnt || !row.predicted_covariance) continue;
        const double speed = (row.true_tip - rows[k - kBefore].true_tip).norm() /
                             (row.time - rows[k - kBefore].time);
        if (speed > kRests && speed < kMoves) continue;
        auto& counted = speed < kMoves ? rest : moving;
        const Eigen::Vector3d error = row.true_tip - *row.predicted;
        constexpr double kChiSquare95 = 7.815;  // of 3 degrees
        ++counted.rows;
        counted.inside += error.dot(row.predicted_covariance->ldlt().solve(error)) < kChiSquare95;
        counted.error2 += error.squaredNorm();
      }
    }
  }
  for (const auto& [what, one] : {std::pair("moving", moving), {"at rest", rest}}) {
    const double share = static_cast<double>(one.inside) / one.rows;
    std::printf(
        "[  FIGURE  ] the predicted tip %s errs by %.2f mm RMS, and is within its ellipsoid of 95 "
        "%% in %.1f %%\n",
        what, kMm * std::sqrt(one.error2 / one.rows), 100 * share);
    EXPECT_GT(one.rows, test::draws(300, 1000));
    EXPECT_GE(share, 0.9) << what;
    EXPECT_LE(share, 0.99) << what;
  }
}

// An arm of discs with inertia, which shares no code with the rig: its strokes are off by up to 10
// %, its stiffness is uneven and grows with pressure, K_gamma, K_kappa, lag, play and dead time are
// not those of the scene. The first tips, in which the loop learns, count apart.
struct DiscArm {
  const char* name;
  const char* options;
  double steady, settled, last_turn;  // largest [m], [s], of a circle in 8 s [m]
  double first;                       // largest of the first tip, while the lag is learnt [m]
  // With the dead time, at most 20 ms from the estimate. Where no mode is found it contains a part
  // of the mode's own delay, at 3 Hz of 21 ms [s].
  double lag;
  bool by_default = false;
};

class ClosedLoopOnDiscs : public testing::TestWithParam<DiscArm> {};

TEST_P(ClosedLoopOnDiscs, IsSteadyAndNotTakenForAContact) {
  if (!GetParam().by_default && !test::isFullSize()) GTEST_SKIP() << test::kFullSizeOnly;
  const DiscArm& discs = GetParam();
  const io::Scene scene = demo();
  FollowPlan tips = steps(scene, test::draws(9, 12), 4),
             circle = shape(scene, TipShape::kCircle, 8, test::draws(2, 3));
  for (FollowPlan* plan : {&tips, &circle}) {
    plan->plant = std::string(HELIX_ARM_SOURCE_DIR) + "/test/accuracy/disc_arm.py " + discs.options;
    plan->latency = 0.1;
  }
  const FollowResult result = procedures::runFollow(scene, tips);
  const FollowResult turns = procedures::runFollow(scene, circle);
  const StepFigures figures = figuresOf(result, 6);
  ASSERT_TRUE(turns.figures.last_turn_rms);
  std::printf(
      "[  FIGURE  ] %s: steady RMS %.2f mm, %.2f mm at the first tip, settled after %.2f s in the "
      "median, circle in 8 s %.2f mm, %zu alarms\n",
      discs.name, kMm * figures.steady_rms, kMm * result.figures.steady_rms[0],
      figures.settle_median, kMm * *turns.figures.last_turn_rms,
      result.alarms.size() + turns.alarms.size());
  EXPECT_GE(figures.reached, test::draws(2, 4));
  EXPECT_LE(figures.steady_rms, discs.steady);
  EXPECT_LE(result.figures.steady_rms[0], discs.first);
  EXPECT_LE(figures.settle_median, discs.settled);
  EXPECT_LE(*turns.figures.last_turn_rms, discs.last_turn);
  EXPECT_NEAR(result.lag.value, discs.lag, 0.02);
  EXPECT_TRUE(result.alarms.empty());
  for (const procedures::FollowState& state : result.states) {
    EXPECT_NE(state.state, follow::LoopState::kDiverging);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Arms, ClosedLoopOnDiscs,
    testing::Values(
        DiscArm{"ten_hz", "--frequency 10 --damping 0.3", 0.0004, 1.5, 0.0015, 0.003, 0.13},
        DiscArm{"ten_hz_slow", "--frequency 10 --damping 0.3 --lag 0.3", 0.0004, 1.5, 0.0015,
                0.0013, 0.33},
        DiscArm{"three_hz", "--frequency 3 --damping 0.2", 0.0004, 1.5, 0.0015, 0.003, 0.14, true},
        DiscArm{"three_hz_slow", "--frequency 3 --damping 0.2 --lag 0.3", 0.0006, 1.5, 0.0015,
                0.0013, 0.34},
        DiscArm{"one_and_a_half_hz", "--frequency 1.5 --damping 0.05", 0.0006, 2.0, 0.0015, 0.003,
                0.13},
        DiscArm{"one_and_a_half_hz_slow", "--frequency 1.5 --damping 0.05 --lag 0.3", 0.0008, 2.0,
                0.0015, 0.003, 0.33}),
    [](const auto& discs) { return std::string(discs.param.name); });

struct Drawing {
  const char* name;
  TipShape shape;
  double period;
  double most;         // RMS [m]
  bool ideal = false;  // of the rig
  bool by_default = false;
};

class ClosedLoopPath : public testing::TestWithParam<Drawing> {};

TEST_P(ClosedLoopPath, IsDrawn) {
  if (!GetParam().by_default && !test::isFullSize()) GTEST_SKIP() << test::kFullSizeOnly;
  const io::Scene scene = GetParam().ideal ? demo({test::kIdealRig}) : demo();
  const FollowPlan plan = shape(scene, GetParam().shape, GetParam().period);
  const FollowResult closed = run(scene, plan), open = run(scene, plan, true);
  std::printf("[  FIGURE  ] %s in %.0f s: RMS %.2f mm, most %.2f mm (open loop %.1f mm)\n",
              GetParam().name, GetParam().period, kMm * closed.figures.path_rms.value(),
              kMm * closed.figures.path_max.value(), kMm * open.figures.path_rms.value());
  EXPECT_LE(closed.figures.path_rms.value(), GetParam().most);
}

INSTANTIATE_TEST_SUITE_P(
    Shapes, ClosedLoopPath,
    testing::Values(Drawing{"circle", TipShape::kCircle, 20, 0.001},
                    Drawing{"circle", TipShape::kCircle, 8, 0.002},
                    Drawing{"circle", TipShape::kCircle, 4, 0.003, false, true},
                    Drawing{"square", TipShape::kSquare, 12, 0.002, false, true},
                    Drawing{"ideal_circle", TipShape::kCircle, 20, 0.0005, true},
                    Drawing{"ideal_circle", TipShape::kCircle, 8, 0.0006, true},
                    Drawing{"ideal_circle", TipShape::kCircle, 4, 0.0011, true, true}),
    [](const auto& drawing) {
      return drawing.param.name + std::to_string(static_cast<int>(drawing.param.period));
    });

// The same rig, seen by a motion-capture system at 100 Hz with 0.2 mm and 0.2 degrees of noise.
TEST(ClosedLoop, OverPosesOfBodies) {
  const io::Scene scene = test::shippedScene("mocap");
  FollowPlan plan = steps(scene, test::draws(6, 20), 4);
  plan.latency = 0.01;
  const StepFigures figures =
      printSteps("tips, poses of bodies", run(scene, plan), openLoop(scene, plan));
  EXPECT_LE(figures.steady_rms, 0.00015);
  FollowPlan circle = shape(scene, TipShape::kCircle, 8);
  circle.latency = 0.01;
  const FollowResult result = run(scene, circle);
  std::printf("[  FIGURE  ] circle of 8 s, poses of bodies: RMS %.2f mm, last turn %.2f mm\n",
              kMm * *result.figures.path_rms, kMm * *result.figures.last_turn_rms);
  EXPECT_LE(*result.figures.path_rms, 0.0005);
  EXPECT_LE(*result.figures.last_turn_rms, 0.00025);
}

TEST(ClosedLoop, AContactIsFoundOverPosesOfBodies) {
  const io::Scene scene = test::shippedScene("mocap");
  constexpr double kTouched = 12;
  const int touches = test::draws(2, 8);
  double delay = 0;
  for (int k = 0; k < touches; ++k) {
    FollowPlan plan;
    plan.seed = 100 + k;
    plan.latency = 0.01;
    plan.seconds = kTouched + 2;
    const Eigen::Vector3d share(0.3 + 0.02 * k, 0.5 + 0.2 * std::sin(k),
                                0.5 + 0.3 * std::cos(3 * k));
    const lie::SE3 tip = scene.model.tip(scene.arm.inputAt(share)).tip;
    plan.tips = {tip.translation};
    const Eigen::Vector3d along = tip.rotation.col(0), side = along.unitOrthogonal();
    plan.force = procedures::TimedForce{
        kTouched, 0.3 * (std::cos(k) * side + std::sin(k) * along.cross(side))};
    const FollowResult result = run(scene, plan);
    ASSERT_EQ(result.alarms.size(), 1U) << k;
    EXPECT_GT(result.alarms[0].time, kTouched);
    delay += (result.alarms[0].time - kTouched) / touches;
  }
  std::printf("[  FIGURE  ] 0.3 N over poses of bodies: found %d of %d, after %.2f s in the mean\n",
              touches, touches, delay);
  EXPECT_LE(delay, 0.5);
}

TEST(ClosedLoop, ATurnOfTheCircleWithoutPictures) {
  const io::Scene scene = demo();
  FollowPlan plan = shape(scene, TipShape::kCircle, 8, 3), begin = plan;
  begin.seconds = 4;
  const FollowResult seeing = run(scene, begin);
  const auto start = std::find_if(seeing.rows.begin(), seeing.rows.end(),
                                  [](const auto& row) { return *row.path_time >= 0; });
  ASSERT_NE(start, seeing.rows.end());
  plan.blind = model::Range{start->time + 8, start->time + 16};
  const FollowResult blind = run(scene, plan);
  double square = 0.0;
  int rows = 0, seen = 0;
  for (const procedures::FollowRow& row : blind.rows) {
    if (!plan.blind->contains(row.time)) continue;
    square += (row.true_tip - *row.wanted).squaredNorm();
    if (row.measured && row.measured_time > plan.blind->lower) ++seen;
    ++rows;
  }
  const double rms = std::sqrt(square / rows);
  std::printf("[  FIGURE  ] a turn of 8 s without pictures: RMS %.2f mm\n", kMm * rms);
  EXPECT_NEAR(rows, 800, 2);
  EXPECT_EQ(seen, 0);
  EXPECT_LE(rms, 0.0015);
}

// Pictures that move by 62 px, as those of a camera that slips. What moves fast is first taken for
// a contact, and what moves faster still may look like an arm that bends the wrong way.
TEST(ClosedLoop, ACameraThatSlipsIsDoubted) {
  const io::Scene scene = demo();
  FollowPlan plan;
  const std::vector<Eigen::Vector3d> tips = randomTips(scene.model, 6, 5);
  plan.tips = {tips[0], tips[1], tips[2], tips[3], tips[4], tips[5], tips[5],
               tips[5], tips[5], tips[5], tips[5], tips[5], tips[5], tips[5]};
  plan.seconds = 56;
  constexpr double kBegin = 30;
  struct Slip {
    double seconds;
    Eigen::Vector2d pixels;
  };
  std::vector<Slip> slips = {{1, {62, 0}},  {20, {0, 62}},  {10, {62, 0}}, {10, {-62, 0}},
                             {10, {0, 62}}, {10, {0, -62}}, {1, {0, 62}},  {3, {62, 0}}};
  if (!test::isFullSize()) slips.erase(slips.begin() + 2, slips.end());
  for (const Slip& slip : slips) {
    plan.drift = procedures::PictureDrift{kBegin, slip.seconds, slip.pixels};
    const FollowResult result = procedures::runFollow(scene, plan);
    double said = INFINITY;
    const bool is_fast = slip.seconds <= 1;  // the contact that it is taken for may be all
    for (const procedures::FollowAlarm& alarm : result.alarms) {
      if (is_fast && alarm.time >= kBegin) said = std::min(said, alarm.time);
    }
    for (const procedures::FollowState& state : result.states) {
      const bool tells = state.state == follow::LoopState::kDoubtful ||
                         state.state == follow::LoopState::kDiverging;
      if (tells && state.time >= kBegin) said = std::min(said, state.time);
    }
    double then = INFINITY, most = 0;
    for (const procedures::FollowRow& row : result.rows) {
      if (row.time < kBegin) continue;
      const double error = (row.true_tip - *row.wanted).norm();
      most = std::max(most, error);
      if (row.time <= said) then = error;
    }
    std::printf(
        "[  FIGURE  ] a camera that moves by %.0f, %.0f px in %.0f s: told after %.1f s, the tip "
        "then %.1f mm off; %.1f mm at most, %s at the end\n",
        slip.pixels.x(), slip.pixels.y(), slip.seconds, said - kBegin, kMm * then, kMm * most,
        follow::nameOf(result.states.back().state));
    EXPECT_LT(said, kBegin + 10);
    EXPECT_LT(then, 0.018);
    EXPECT_LT(most, 0.026);
    EXPECT_TRUE(is_fast || result.states.back().state != follow::LoopState::kClosed);
  }
}

// Arms for which the loop was not tuned, in their first 24 s: strokes and lag are still learnt.
TEST(ClosedLoop, RandomArmsEachMuscleItsOwn) {
  const int arms = test::draws(3, 50);
  test::Random random(17);
  StepFigures worst;
  double open_worst = 0.0;
  for (int arm = 0; arm < arms; ++arm) {
    io::Scene scene = demo();
    simulation::ArmDeviation& truth = scene.simulation.arm;
    truth.K_gamma_scale = random.uniform(0.6, 1.6);
    truth.K_kappa_scale = random.uniform(0.6, 1.6);
    truth.length_scale = 1.0;
    truth.length_scales.resize(scene.arm.actuatorCount());
    for (double& scale : truth.length_scales) scale = random.uniform(0.98, 1.02);
    FollowPlan plan;
    plan.tips = trueTips(scene, 8, random);
    plan.seconds = 24;
    plan.seed = static_cast<std::uint32_t>(arm + 1);
    const StepFigures figures = figuresOf(run(scene, plan));
    EXPECT_EQ(figures.reached, 8) << arm;
    worst.steady_rms = std::max(worst.steady_rms, figures.steady_rms);
    worst.settle_median = std::max(worst.settle_median, figures.settle_median);
    worst.settle_worst = std::max(worst.settle_worst, figures.settle_worst);
    open_worst = std::max(open_worst, figuresOf(openLoop(scene, plan)).steady_rms);
  }
  std::printf(
      "[  FIGURE  ] the worst of %d random arms: steady RMS %.2f mm (open loop %.1f mm), "
      "settled after %.2f s in the median, %.2f s at worst\n",
      arms, kMm * worst.steady_rms, kMm * open_worst, worst.settle_median, worst.settle_worst);
  EXPECT_LE(worst.steady_rms, 0.001);
  EXPECT_LE(worst.settle_median, 1.0);
}

}  // namespace
}  // namespace helix_arm
