#include "helix_arm/follow/path_check.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/lie/se3.hpp"

namespace helix_arm::follow {
namespace {

constexpr char kCulprit[] = "path check";
constexpr double kLeastWindow = kCheckStep / 2;  // of a rate [s]
constexpr int kPlacesBeyond = 200;               // examined after the first one out of reach
constexpr double kMostApproachPlaces = 1000;     // of a first point that may be far away
constexpr int kHalvings = 6;                     // of a step in which pressures change too fast
constexpr double kJumpPart = 0.5;  // of that change within 1 / 2^kHalvings of the step: a jump

// Inputs along a path, each position starting from the previous solution.
class Walk {
 public:
  /// @param zones  null: none are looked at.
  Walk(const control::TipPath& path, statics::InverseSolver& solver, Eigen::VectorXd start,
       const clearance::SweepCheck* zones = nullptr)
      : path_(path), solver_(solver), zones_(zones), input_(std::move(start)) {}

  const statics::InverseResult& to(double time) {
    const control::TipReference place = path_.at(time);
    const statics::InverseResult& result =
        place.rotation ? solver_.toPose(lie::SE3{*place.rotation, place.position}, input_)
                       : solver_.toPosition(place.position, input_);
    go(result.input);
    return result;
  }
  // Along the line on which a loop approaches the path: what redundant actuators do on the path
  // depends on where they begin. @return false if it was stopped.
  bool approach(const Eigen::Vector3d& from, const std::function<bool()>& stops) {
    const Eigen::Vector3d line = path_.at(path_.firstTime()).position - from;
    const double places = std::min(std::ceil(line.norm() / kCheckSpacing), kMostApproachPlaces);
    for (double k = 0; k < places; ++k) {
      if (stops && stops()) return false;
      go(solver_.toPosition(from + k / places * line, input_).input);
      if (blocked_) return true;
    }
    return true;
  }
  const Eigen::VectorXd& input() const { return input_; }
  /// The zone that was met first.
  const std::optional<clearance::Blocked>& blocked() const { return blocked_; }

 private:
  void go(const Eigen::VectorXd& next) {
    if (zones_ != nullptr && !blocked_) blocked_ = zones_->sweep({input_, next});
    input_ = next;
  }

  const control::TipPath& path_;
  statics::InverseSolver& solver_;
  const clearance::SweepCheck* zones_;
  std::optional<clearance::Blocked> blocked_;
  Eigen::VectorXd input_;
};

// The fastest step of an actuator, relative to its permitted change, which is that of kLeastWindow
// at least: the noise of the inverse divided by a shorter time would look like a rate.
struct Fastest {
  double excess = 0.0;
  int actuator = -1;
  double begin = 0.0, end = 0.0;  // [s]
  Eigen::VectorXd from;           // inputs at the beginning
  double change = 0.0;            // of the actuator [Pa]

  void see(const model::Range& time, const Eigen::VectorXd& first, const Eigen::VectorXd& last,
           const PathRules& rules) {
    const double window = std::max(time.upper - time.lower, kLeastWindow);
    for (int i = 0; i < last.size(); ++i) {
      const double step = last[i] - first[i];
      const double rate = std::abs(step) / (window * kSlewShare * rules.slew[i]);
      if (rate > excess) *this = {rate, i, time.lower, time.upper, first, step};
    }
  }
};

// Places of a segment after its first point.
double placesOf(const control::TipSegment& segment) {
  const double speed =
      segment.top_speed + statics::InverseOptions{}.rotation_weight * segment.turn_rate;
  return std::ceil((segment.end - segment.begin) *
                   std::max(1.0 / kCheckStep, speed / kCheckSpacing));
}

void validate(const PathRules& rules, const model::Arm& arm) {
  basics::requirePositive(kCulprit, "the tolerance [m]", rules.tolerance);
  basics::requireValue(rules.slew.size() == arm.actuatorCount(), kCulprit,
                       "the number of slew rates", rules.slew.size(), "one per actuator");
  for (const double slew : rules.slew) {
    basics::requireValue(slew > 0, kCulprit, "a slew rate [Pa/s]", slew, "> 0");
  }
}

// Its numbers have so many digits.
template <class... Parts>
std::string textOf(int digits, const Parts&... parts) {
  std::ostringstream out;
  out.precision(digits);
  (out << ... << parts);
  return out.str();
}

std::string placeText(double time, const Eigen::Vector3d& position) {
  return textOf(4, time, " s, at (", position.x(), ", ", position.y(), ", ", position.z(), ") m");
}

std::optional<PathRefusal> tooLong(const control::TipPath& path) {
  double places = 1.0;
  for (std::size_t i = 0; i < path.segmentCount(); ++i) places += placesOf(path.segment(i));
  if (places <= kMostCheckPlaces) return std::nullopt;
  PathRefusal out{PathFault::kTooLong, path.lastTime(), path.at(path.lastTime()).position};
  out.reason =
      textOf(10, "the path takes ", path.lastTime() - path.firstTime(), " s and has ", places,
             " places to check, one for each point and at least one every ", 1e3 * kCheckStep,
             " ms and every ", 1e3 * kCheckSpacing, " mm; expected at most ", kMostCheckPlaces,
             ", as in ", kCheckStep * kMostCheckPlaces, " s; send it in parts");
  return out;
}

// `next` is the time of the next point, where a path that leaves the reach often turns back.
PathRefusal unreachable(const control::TipPath& path, Walk& walk, double since, double next,
                        double residual, const PathRules& rules) {
  PathRefusal out{PathFault::kUnreachable, since, path.at(since).position, residual};
  for (int k = 0; k <= kPlacesBeyond; ++k) {
    const double time = k == 0 ? next : since + (path.lastTime() - since) * k / kPlacesBeyond;
    const double there = walk.to(time).residual;
    if (!(there > out.residual)) continue;
    out.time = time;
    out.position = path.at(time).position;
    out.residual = there;
  }
  out.reason = textOf(3, "the path leaves the arm's reach after ", since, " s; farthest after ",
                      placeText(out.time, out.position), ": ");
  out.reason +=
      std::isfinite(out.residual)
          ? textOf(3, 1e3 * out.residual, " mm from the closest reachable position, and ",
                   1e3 * rules.tolerance, " mm are allowed; move the path or make it smaller")
          : "no shape of the arm balances its load there; move the path or lower the load";
  return out;
}

PathRefusal blockedBy(const clearance::Blocked& zone, const control::TipPath& path, double time) {
  PathRefusal out{PathFault::kBlocked, time, path.at(time).position};
  out.reason = "before " + placeText(time, out.position) + ", the arm " + zone.text() +
               "; move the path, or plan a way around: helix_arm plan";
  return out;
}

// Whether a fast step is a jump: if the step is halved repeatedly, the change stays in one half.
bool isJump(const control::TipPath& path, statics::InverseSolver& solver, const Fastest& step) {
  Fastest part = step;
  for (int k = 0; k < kHalvings; ++k) {
    const double middle = 0.5 * (part.begin + part.end);
    Walk walk(path, solver, part.from);
    const Eigen::VectorXd half = walk.to(middle).input;
    const double second = walk.to(part.end).input[step.actuator] - half[step.actuator];
    const double first = half[step.actuator] - part.from[step.actuator];
    if (std::abs(first) >= std::abs(second)) {
      part.end = middle;
      part.change = first;
    } else {
      part = {part.excess, part.actuator, middle, part.end, half, second};
    }
  }
  return std::abs(part.change) > kJumpPart * std::abs(step.change);
}

PathRefusal tooFast(const control::TipPath& path, const model::Arm& arm,
                    statics::InverseSolver& solver, const Fastest& step, const PathRules& rules) {
  const double time = step.begin;
  const bool jumps = isJump(path, solver, step);
  PathRefusal out{jumps ? PathFault::kJump : PathFault::kTooFast, time, path.at(time).position};
  out.actuator = step.actuator;
  out.rate = step.excess * kSlewShare * rules.slew[step.actuator];
  const std::string& name = arm.actuator(step.actuator).name;
  const std::string place = placeText(time, out.position);
  if (jumps) {
    out.reason = textOf(3, "the pressure of ", name, " has to jump by ",
                        std::abs(step.change) / 1e3, " kPa after ", place,
                        ", where the arm snaps from one shape to another; move the path");
  } else {
    out.stretch = step.excess;
    out.reason = textOf(3, "the path is too fast after ", place, ": ", name, " has to change by ",
                        out.rate / 1e3, " kPa/s, and ", 100 * kSlewShare,
                        " % of its slew rate are ", kSlewShare * rules.slew[step.actuator] / 1e3,
                        " kPa/s; multiply all times by ", std::ceil(100 * step.excess) / 100);
  }
  return out;
}

}  // namespace

std::optional<PathRefusal> checkPath(const control::TipPath& path, const model::Arm& arm,
                                     statics::InverseSolver& solver, const Eigen::VectorXd& start,
                                     const PathRules& rules, const std::function<bool()>& stops) {
  validate(rules, arm);
  if (const auto refusal = tooLong(path)) return refusal;
  Walk walk(path, solver, start, rules.zones);
  if (!path.hasRotations() && !walk.approach(arm.tip(start).translation, stops)) {
    return std::nullopt;
  }
  if (walk.blocked()) return blockedBy(*walk.blocked(), path, path.firstTime());
  Fastest fastest;
  double since = path.firstTime();
  Eigen::VectorXd before;  // inputs at that time
  for (std::size_t i = 0; i < path.segmentCount(); ++i) {
    const control::TipSegment segment = path.segment(i);
    const auto places = static_cast<int>(placesOf(segment));
    for (int k = i == 0 ? 0 : 1; k <= places; ++k) {
      if (stops && stops()) return std::nullopt;
      const double time =
          k == places ? segment.end : segment.begin + (segment.end - segment.begin) * k / places;
      const statics::InverseResult& result = walk.to(time);
      if (!(result.residual <= rules.tolerance)) {
        return unreachable(path, walk, time, segment.end, result.residual, rules);
      }
      if (walk.blocked()) return blockedBy(*walk.blocked(), path, time);
      if (before.size() > 0) fastest.see({since, time}, before, result.input, rules);
      if (before.size() > 0 && time - since < kLeastWindow) continue;
      since = time;
      before = result.input;
    }
  }
  if (fastest.excess <= 1) return std::nullopt;
  return tooFast(path, arm, solver, fastest, rules);
}

}  // namespace helix_arm::follow
