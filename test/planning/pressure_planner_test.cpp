// Ways around zones: against dense samples of what they sweep, and a grid search of the pressures.
#include "helix_arm/planning/pressure_planner.hpp"

#include <algorithm>
#include <cstdio>
#include <limits>
#include <queue>
#include <vector>

#include <gtest/gtest.h>

#include "basics/median.hpp"
#include "clearance/random_zones.hpp"
#include "support/loaded_arm.hpp"
#include "support/test_size.hpp"

namespace helix_arm::planning {
namespace {

using clearance::KeepOut;
using Eigen::VectorXd;

// Two muscles in a plane, whose tip moves along and across.
statics::ArmModel twoMuscles() {
  const model::PlanarArm plane = test::planarArm(1);
  return statics::ArmModel(model::embed(plane), plane);
}

std::vector<control::ChannelRules> channelsOf(const model::Arm& arm, double slew) {
  std::vector<control::ChannelRules> out;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    out.push_back({arm.actuator(i).name, arm.actuator(i).limits, slew});
  }
  return out;
}

VectorXd drawInput(const model::Arm& arm, test::Random& random) {
  VectorXd fraction(arm.actuatorCount());
  for (double& one : fraction) one = random.uniform(0, 1);
  return arm.inputAt(fraction);
}

// Five zones among which start and goal are clear.
KeepOut randomScene(const statics::ArmModel& model, const VectorXd& from, const VectorXd& to,
                    test::Random& random) {
  KeepOut keep_out;
  keep_out.clearance = 0.005;
  keep_out.radii.assign(static_cast<std::size_t>(model.arm().sectionCount()), 0.01);
  for (int tries = 0; tries < 200 && keep_out.zones.size() < 5; ++tries) {
    clearance::Zone zone = test::randomZone(random, 0.08, 0.01, random.integer(0, 2), "post");
    zone.X_WZ.translation += model.solve(drawInput(model.arm(), random)).tip.translation;
    keep_out.zones.push_back(zone);
    const clearance::SweepCheck check(model, keep_out);
    if (!check.isClear(from) || !check.isClear(to)) keep_out.zones.pop_back();
  }
  return keep_out;
}

// Whether a grid of pressures, of which all neighbours between two clear ones are joined, leads
// from one input to the other.
bool gridLeads(const statics::ArmModel& model, const KeepOut& keep_out, const VectorXd& from,
               const VectorXd& to, int steps) {
  const auto inputAt = [&](int i, int j) {
    return model.arm().inputAt(Eigen::Vector2d(i, j) / steps);
  };
  const auto cellOf = [&](const VectorXd& q) {
    const VectorXd part = (q - model.arm().inputAt(0.0))
                              .cwiseQuotient(model.arm().inputAt(1.0) - model.arm().inputAt(0.0));
    return std::pair(static_cast<int>(std::lround(part[0] * steps)),
                     static_cast<int>(std::lround(part[1] * steps)));
  };
  std::vector<char> clear(static_cast<std::size_t>((steps + 1) * (steps + 1)));
  const auto at = [&](int i, int j) -> char& {
    return clear[static_cast<std::size_t>(i * (steps + 1) + j)];
  };
  for (int i = 0; i <= steps; ++i) {
    for (int j = 0; j <= steps; ++j) {
      const auto shape = model.solve(inputAt(i, j)).shape;
      at(i, j) = test::denseClearance(keep_out, shape, 60) >= keep_out.clearance;
    }
  }
  const auto goal = cellOf(to);
  std::queue<std::pair<int, int>> open({cellOf(from)});
  if (!at(open.front().first, open.front().second)) return false;
  at(open.front().first, open.front().second) = 0;
  while (!open.empty()) {
    const auto [i, j] = open.front();
    open.pop();
    if (std::pair(i, j) == goal) return true;
    for (const auto& [di, dj] : {std::pair(1, 0), {-1, 0}, {0, 1}, {0, -1}}) {
      const int a = i + di, b = j + dj;
      if (a < 0 || b < 0 || a > steps || b > steps || !at(a, b)) continue;
      at(a, b) = 0;
      open.push({a, b});
    }
  }
  return false;
}

// Least clearance of what a path sweeps, its pressures with and without the lag of the regulator.
double leastAlong(const statics::ArmModel& model, const KeepOut& keep_out, const Plan& plan,
                  double lag) {
  double least = std::numeric_limits<double>::infinity();
  VectorXd now = plan.rows.front().pressure;
  const double step = 0.002, end = plan.rows.back().time;
  for (double t = 0; t < end + 10 * lag; t += step) {
    const auto i = std::min(static_cast<std::size_t>(t / 0.1), plan.rows.size() - 2);
    const double part = std::min(t, end) / 0.1 - static_cast<double>(i);
    const VectorXd set_point =
        plan.rows[i].pressure + part * (plan.rows[i + 1].pressure - plan.rows[i].pressure);
    now = lag > 0 ? VectorXd(now + step / lag * (set_point - now)) : set_point;
    const auto found = model.solve(model.arm().clamped(now));
    least = std::min(least, test::denseClearance(keep_out, found.shape, 40));
  }
  return least;
}

TEST(PressurePlanner, FindsAWayWhereAGridOfPressuresHasOneAndNoneWhereItHasNone) {
  test::Random random(1);
  const statics::ArmModel model = twoMuscles();
  int ways = 0, none = 0;
  std::vector<double> seconds, of_detours;
  for (int i = 0; i < test::draws(20, 200); ++i) {
    const VectorXd from = drawInput(model.arm(), random), to = drawInput(model.arm(), random);
    const KeepOut keep_out = randomScene(model, from, to, random);
    const PressurePlanner planner(model, keep_out, channelsOf(model.arm(), 3e5), {});
    PlanOptions options;
    options.longest = test::isFullSize() ? 2 : 0.5;
    const Plan plan = planner.toPressures(from, to, options);
    // A way of a coarse grid with more clearance exists; without one of a fine grid with less, none
    // does.
    KeepOut tight = keep_out, loose = keep_out;
    tight.clearance += 0.003;
    loose.clearance -= 0.001;
    const bool exists = gridLeads(model, tight, from, to, 40);
    const bool may_exist = gridLeads(model, loose, from, to, 80);
    if (plan.found()) {
      ++ways;
      seconds.push_back(plan.seconds);
      if (clearance::SweepCheck(model, keep_out).sweep({from, to})) {
        of_detours.push_back(plan.seconds);
      }
      EXPECT_TRUE(may_exist) << i;
      EXPECT_LT((plan.rows.front().pressure - from).norm(), 1e-6);
      EXPECT_LT((plan.rows.back().pressure - to).norm(), 1e-6);
      EXPECT_GE(leastAlong(model, keep_out, plan, 0), keep_out.clearance - 2e-4) << i;
      EXPECT_GE(leastAlong(model, keep_out, plan, 0.2), keep_out.clearance - 2e-4) << i;
      for (std::size_t k = 1; k < plan.rows.size(); ++k) {
        EXPECT_NEAR(plan.rows[k].time, 0.1 * static_cast<double>(k), 1e-9);
        EXPECT_LE((plan.rows[k].pressure - plan.rows[k - 1].pressure).cwiseAbs().maxCoeff(),
                  0.6001 * 3e5 * 0.1);
      }
    } else {
      ++none;
      EXPECT_FALSE(exists) << i << ": " << plan.reason;
    }
  }
  ASSERT_FALSE(of_detours.empty());
  std::printf("%d ways, %zu of them detours, %d without a way; median %.4f s, of detours %.4f s\n",
              ways, of_detours.size(), none, basics::medianOf(seconds),
              basics::medianOf(of_detours));
  EXPECT_GT(none, 0);
}

// Redundant muscles in space: the tip reaches its place by pressures that are clear.
TEST(PressurePlanner, BringsATipToItsPlace) {
  test::Random random(3);
  const statics::ArmModel model(test::softHelicalArm());
  int ways = 0;
  for (int i = 0; i < test::draws(5, 40); ++i) {
    const VectorXd from = drawInput(model.arm(), random), to = drawInput(model.arm(), random);
    const Eigen::Vector3d tip = model.solve(to).tip.translation;
    const KeepOut keep_out = randomScene(model, from, to, random);
    const Plan plan =
        PressurePlanner(model, keep_out, channelsOf(model.arm(), 3e5), {}).toTip(from, tip);
    if (!plan.found()) continue;
    ++ways;
    const Eigen::Vector3d end = model.solve(plan.rows.back().pressure).tip.translation;
    EXPECT_LT((end - tip).norm(), 1e-5);
    EXPECT_GE(leastAlong(model, keep_out, plan, 0.2), keep_out.clearance - 2e-4);
  }
  EXPECT_GT(ways, 1);
}

TEST(PressurePlanner, EndsWithItsTimeAndSaysWhatIsInTheWay) {
  const statics::ArmModel model = twoMuscles();
  const VectorXd from = model.arm().inputAt(Eigen::Vector2d(0.9, 0.1)),
                 to = model.arm().inputAt(Eigen::Vector2d(0.1, 0.9));
  KeepOut keep_out;
  keep_out.radii = {0.01};
  clearance::Zone post{"post", clearance::Sphere{0.02}, {}};
  post.X_WZ.translation = model.solve(to).tip.translation;
  keep_out.zones = {post};
  const auto channels = channelsOf(model.arm(), 3e5);
  const Plan at_goal = PressurePlanner(model, keep_out, channels, {}).toPressures(from, to);
  EXPECT_EQ(at_goal.reason.rfind("at the goal ", 0), 0u) << at_goal.reason;
  // A wall across all that the arm can pass.
  keep_out.zones[0].form = clearance::Box{{1, 1e-3, 1}};
  keep_out.zones[0].X_WZ.translation = {0.8, 0, 0};
  PlanOptions options;
  options.longest = 0.3;
  const Plan walled = PressurePlanner(model, keep_out, channels, {}).toPressures(from, to, options);
  EXPECT_NE(walled.reason.find("no clear path"), std::string::npos) << walled.reason;
  EXPECT_LT(walled.seconds, 5.0);
}

}  // namespace
}  // namespace helix_arm::planning
