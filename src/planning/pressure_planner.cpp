#include "helix_arm/planning/pressure_planner.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <utility>

#include <ompl/base/MotionValidator.h>
#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/goals/GoalStates.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/PathSimplifier.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/statics/inverse.hpp"

namespace helix_arm::planning {
namespace {

namespace ob = ompl::base;
namespace og = ompl::geometric;
using Eigen::VectorXd;

constexpr double kMargin = 1e-3;     // beyond the clearance, for the lag [m]
constexpr double kSlewPart = 0.6;    // of the slew; the rest is for a loop that smooths corners
constexpr double kWholeRange = 1.0;  // time of a range without slew [s]
constexpr double kRange = 0.3;       // of a motion of the search, in ranges per root of n
constexpr unsigned kShortcuts = 40;
constexpr double kSlower = 1.5;
constexpr int kMostSlower = 10;
constexpr double kSame = 1e-3;  // of two solutions of an inverse, in ranges

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// A motion is valid if its sweep is clear.
class SweptMotion : public ob::MotionValidator {
 public:
  using InputOf = std::function<VectorXd(const ob::State*)>;
  SweptMotion(const ob::SpaceInformationPtr& space, const clearance::SweepCheck& check,
              InputOf input_of)
      : ob::MotionValidator(space), check_(check), input_of_(std::move(input_of)) {}

  bool checkMotion(const ob::State* from, const ob::State* to) const override {
    return !check_.sweep({input_of_(from), input_of_(to)});
  }
  bool checkMotion(const ob::State* from, const ob::State* to,
                   std::pair<ob::State*, double>& last) const override {
    const bool clear = checkMotion(from, to);
    last.second = clear ? 1.0 : 0.0;
    if (last.first != nullptr) si_->copyState(last.first, clear ? to : from);
    return clear;
  }

 private:
  const clearance::SweepCheck& check_;
  const InputOf input_of_;
};

}  // namespace

const PlanRow& Plan::nearest() const {
  return *std::min_element(rows.begin(), rows.end(), [](const PlanRow& a, const PlanRow& b) {
    return a.clearance.distance < b.clearance.distance;
  });
}

PressurePlanner::PressurePlanner(const statics::ArmModel& model, const clearance::KeepOut& keep_out,
                                 std::vector<control::ChannelRules> channels,
                                 const control::SafetyRules& rules)
    : model_(model), check_(model, keep_out), channels_(std::move(channels)), rules_(rules) {}

Plan PressurePlanner::toPressures(const VectorXd& from, const VectorXd& to,
                                  const PlanOptions& options) const {
  return plan(from, {to}, options, now());
}

Plan PressurePlanner::toTip(const VectorXd& from, const Eigen::Vector3d& tip,
                            const PlanOptions& options) const {
  const double begin = now();
  using statics::Preference;
  std::vector<VectorXd> goals;
  double nearest = std::numeric_limits<double>::infinity();
  for (const Preference preference :
       {Preference::kMinChange, Preference::kMinPressure, Preference::kCocontraction}) {
    statics::InverseOptions of_inverse;
    of_inverse.preference = preference;
    statics::InverseSolver solver(model_, of_inverse);
    for (const double start : {-1.0, 0.1, 0.5, 0.9}) {  // the first: from where the arm is
      const statics::InverseResult& found =
          solver.toPosition(tip, start < 0 ? from : model_.arm().inputAt(start));
      nearest = std::min(nearest, found.position_error);
      if (found.status != statics::InverseStatus::kReached) continue;
      const auto isSame = [&](const VectorXd& other) {
        return (other - found.input).norm() <
               kSame * (model_.arm().inputAt(1.0) - model_.arm().inputAt(0.0)).norm();
      };
      if (std::none_of(goals.begin(), goals.end(), isSame)) goals.push_back(found.input);
    }
  }
  if (goals.empty()) {
    return {{},
            basics::format("the tip is out of reach: it stays %.1f mm away; give another tip",
                           1e3 * nearest),
            now() - begin};
  }
  return plan(from, goals, options, begin);
}

std::string PressurePlanner::refusalOf(const char* what, const VectorXd& q) const {
  const auto blocked = check_.sweep({q});
  return blocked ? std::string("at the ") + what + " the arm " + blocked->text() : std::string();
}

Plan PressurePlanner::plan(const VectorXd& from, const std::vector<VectorXd>& goals,
                           const PlanOptions& options, double begin) const {
  basics::requirePositive("plan", {{"the time of the search [s]", options.longest},
                                   {"the time between corners [s]", options.every}});
  const auto none = [&](const std::string& reason) -> Plan { return {{}, reason, now() - begin}; };
  std::string reason = refusalOf("start", from);
  if (!reason.empty()) return none(reason + "; move it away first");
  std::vector<VectorXd> clear;
  for (const VectorXd& goal : goals) {
    const std::string refusal = refusalOf("goal", goal);
    if (refusal.empty()) clear.push_back(goal);
    if (reason.empty()) reason = refusal;
  }
  if (clear.empty()) return none(reason + "; give another goal");
  const std::vector<VectorXd> corners = search(from, clear, options, begin);
  if (corners.empty()) {
    return none(basics::format("no clear path was found within %g s; give it longer, or make room",
                               options.longest));
  }
  if (options.stops && options.stops({"times", now() - begin})) return none("cancelled");
  const std::vector<VectorXd> set_points = timed(corners, options.every);
  if (set_points.empty()) {
    return none("the path found is clear only without the regulator's lag; make room");
  }
  Plan out;
  for (const VectorXd& set_point : set_points) {
    const VectorXd q = model_.arm().clamped(set_point);
    const statics::Solution at = model_.solve(q);
    out.rows.push_back({static_cast<double>(out.rows.size()) * options.every, q, at.tip,
                        check_.clearance().of(at.shape)});
  }
  out.seconds = now() - begin;
  return out;
}

std::vector<VectorXd> PressurePlanner::search(const VectorXd& from,
                                              const std::vector<VectorXd>& goals,
                                              const PlanOptions& options, double begin) const {
  for (const VectorXd& goal : goals) {
    if (!check_.sweep({from, goal})) return {from, goal};
  }
  // With room for the lag, except where start or goal have none.
  clearance::KeepOut roomy = check_.clearance().keepOut();
  double room = check_.at(from)->distance;
  for (const VectorXd& goal : goals) room = std::min(room, check_.at(goal)->distance);
  roomy.clearance = std::min(roomy.clearance + kMargin, room);
  const clearance::SweepCheck check(model_, roomy);

  ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
  ompl::RNG::setSeed(options.seed);  // of all that are made from now on
  const int n = model_.arm().actuatorCount();
  const VectorXd lower = model_.arm().inputAt(0.0), range = model_.arm().inputAt(1.0) - lower;
  const auto space = std::make_shared<ob::RealVectorStateSpace>(static_cast<unsigned>(n));
  space->setBounds(0, 1);
  const SweptMotion::InputOf input_of = [&](const ob::State* state) -> VectorXd {
    const double* values = state->as<ob::RealVectorStateSpace::StateType>()->values;
    return model_.arm().clamped(lower + range.cwiseProduct(VectorXd::Map(values, n)));
  };
  const auto info = std::make_shared<ob::SpaceInformation>(space);
  info->setStateValidityChecker(
      [&](const ob::State* state) { return check.isClear(input_of(state)); });
  info->setMotionValidator(std::make_shared<SweptMotion>(info, check, input_of));
  info->setup();
  const auto stateOf = [&](const VectorXd& q) {
    ob::ScopedState<ob::RealVectorStateSpace> state(space);
    VectorXd::Map(state->values, n) = (q - lower).cwiseQuotient(range);
    return state;
  };
  const auto problem = std::make_shared<ob::ProblemDefinition>(info);
  problem->addStartState(stateOf(from));
  const auto goal_states = std::make_shared<ob::GoalStates>(info);
  for (const VectorXd& goal : goals) goal_states->addState(stateOf(goal));
  problem->setGoal(goal_states);
  og::RRTConnect planner(info);
  planner.setRange(kRange * std::sqrt(n));
  planner.setProblemDefinition(problem);
  planner.setup();
  const auto stops = [&] {
    const double seconds = now() - begin;
    return seconds > options.longest || (options.stops && options.stops({"searches", seconds}));
  };
  if (planner.solve(ob::PlannerTerminationCondition(stops)) != ob::PlannerStatus::EXACT_SOLUTION) {
    return {};
  }
  auto path = std::static_pointer_cast<og::PathGeometric>(problem->getSolutionPath());
  if (options.stops && options.stops({"shortens", now() - begin})) return {};
  og::PathSimplifier simplifier(info);
  simplifier.reduceVertices(*path);
  simplifier.shortcutPath(*path, kShortcuts, kShortcuts);
  std::vector<VectorXd> corners;
  for (const ob::State* state : path->getStates()) corners.push_back(input_of(state));
  return corners;
}

// Set points at even times, slow enough for slew and lag; empty if none are.
std::vector<VectorXd> PressurePlanner::timed(const std::vector<VectorXd>& corners,
                                             double every) const {
  double stretch = 1;
  for (int k = 0; k < kMostSlower; ++k, stretch *= kSlower) {
    std::vector<VectorXd> rows{corners.front()};
    for (std::size_t i = 1; i < corners.size(); ++i) {
      const VectorXd way = corners[i] - corners[i - 1];
      double time = 0;
      for (Eigen::Index c = 0; c < way.size(); ++c) {
        const control::ChannelRules& channel = channels_[static_cast<std::size_t>(c)];
        const double usual = (channel.limits.upper - channel.limits.lower) / kWholeRange;
        time = std::max(time, std::abs(way[c]) / (kSlewPart * std::min(channel.slew, usual)));
      }
      const double steps = std::max(1.0, std::ceil(stretch * time / every));
      for (double step = 1; step <= steps; ++step) {
        rows.emplace_back(corners[i - 1] + step / steps * way);
      }
    }
    if (!check_.sweep(clearance::pressuresBehind(channels_, rules_, every, rows))) return rows;
  }
  return {};
}

}  // namespace helix_arm::planning
