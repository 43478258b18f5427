#include "procedures/follow_run.hpp"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "support/has.hpp"
#include "support/shipped_scene.hpp"

namespace helix_arm::procedures {
namespace {

using follow::LoopState;
using test::demo;

// Tips in the middle of the demo arm's reach.
const Eigen::Vector3d kLeft(0.36, 0.03, 0.02), kRight(0.36, -0.03, 0.0);

FollowPlan tipPlan(std::vector<Eigen::Vector3d> tips, double seconds) {
  FollowPlan plan;
  plan.tips = std::move(tips);
  plan.seconds = seconds;
  return plan;
}

double errorOf(const FollowRow& row) { return (row.true_tip - *row.wanted).norm(); }

std::vector<LoopState> statesOf(const FollowResult& result) {
  std::vector<LoopState> states;
  for (const FollowState& change : result.states) states.push_back(change.state);
  return states;
}

TEST(FollowRun, TipsShareTheTimeAndTheirFiguresAreTheirErrors) {
  const FollowResult result = runFollow(demo(), tipPlan({kLeft, kRight}, 6));
  ASSERT_EQ(result.rows.size(), 600u);
  ASSERT_EQ(result.figures.steady_rms.size(), 2u);
  EXPECT_FALSE(result.figures.path_rms);
  EXPECT_EQ(result.vented, "");
  for (const int tip : {0, 1}) {
    const auto begin = result.rows.begin() + 300 * tip, end = begin + 300;
    for (auto row = begin; row != end; ++row) EXPECT_EQ(*row->wanted, tip == 0 ? kLeft : kRight);
    double square = 0.0;
    for (auto row = end - 101; row != end; ++row) square += errorOf(*row) * errorOf(*row);
    EXPECT_NEAR(result.figures.steady_rms[tip], std::sqrt(square / 101), 1e-5);
    // From the time of settling on it stays within the bound; just before, it does not.
    const double bound = 0.002 + 0.05 * errorOf(*begin);
    ASSERT_TRUE(result.figures.settle[tip]);
    const auto settled = begin + std::lround(*result.figures.settle[tip] / 0.01);
    EXPECT_TRUE(std::all_of(settled, end, [&](const auto& row) { return errorOf(row) <= bound; }));
    ASSERT_GT(settled, begin);
    EXPECT_GT(errorOf(*(settled - 1)), bound);
    EXPECT_FALSE(result.figures.unreachable[tip]);
  }
}

TEST(FollowRun, MeasurementsComeLateAndNotWhileTheCameraIsBlind) {
  FollowPlan plan = tipPlan({kLeft}, 9);
  plan.latency = 0.1;
  plan.blind = model::Range{2, 7};
  const FollowResult result = runFollow(demo(), plan);
  int measured = 0;
  for (const FollowRow& row : result.rows) {
    if (!row.measured) continue;
    ++measured;
    EXPECT_NEAR(row.time - row.measured_time, 0.1, 1e-9);
    EXPECT_TRUE(row.measured_time < 2 || row.measured_time > 7) << row.measured_time;
    EXPECT_LT(
        (*row.measured - result.rows[std::lround(row.measured_time / 0.01) - 1].true_tip).norm(),
        0.005);
  }
  EXPECT_GT(measured, 90);
  EXPECT_EQ(statesOf(result),
            (std::vector<LoopState>{LoopState::kOpen, LoopState::kClosed, LoopState::kCoasting,
                                    LoopState::kOpen, LoopState::kClosed}));
  EXPECT_NEAR(result.states[2].time, 2.3 + 0.1, 0.05);
}

TEST(FollowRun, AnArmThatIsVentedEndsTheRun) {
  const FollowResult result =
      runFollow(demo({{"safety.follow", "{tolerance_kpa: 1, time_s: 0.2, time_constant_s: 0.05}"}}),
                tipPlan({kLeft}, 3));
  EXPECT_LT(result.rows.size(), 300u);
  EXPECT_TRUE(result.figures.steady_rms.empty());
  EXPECT_TRUE(test::has(result.vented, "muscle_"));
}

}  // namespace
}  // namespace helix_arm::procedures
