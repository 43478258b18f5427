#include "helix_arm/clearance/sweep.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "basics/text.hpp"

namespace helix_arm::clearance {
namespace {

constexpr double kLongestPart = 0.05;  // of the arm's length, between two looks
constexpr double kCurved = 1.25;       // way of a place by the distance of its ends
constexpr double kAwayMotion = 1e-3;   // between two looks at an arm that is too close [m]
constexpr double kStepsPerLag = 4;
constexpr double kArrived = 2e-3;  // of a channel's range

}  // namespace

std::string Blocked::text() const {
  if (zone.empty()) return "passes pressures at which no shape balances the load";
  return basics::format("comes within %.2f mm of %s; clearance_m asks for %g mm", 1e3 * clearance,
                        zone.c_str(), 1e3 * least);
}

struct SweepCheck::Look {
  Eigen::VectorXd q;
  std::optional<Clearance> clearance;
  Eigen::Matrix3Xd marks;
  Eigen::Vector3d tip;
};

SweepCheck::SweepCheck(const statics::ArmModel& model, const KeepOut& keep_out)
    : model_(model), clearance_(keep_out), longest_(kLongestPart * model.arm().restLength()) {}

SweepCheck::Look SweepCheck::look(const Eigen::VectorXd& q) const {
  const Eigen::VectorXd inside = model_.arm().clamped(q);
  const statics::Solution found = model_.solve(inside);
  if (!found.converged()) return {inside, std::nullopt, {}, {}};
  return {inside, clearance_.of(found.shape), clearance_.marks(found.shape), found.tip.translation};
}

std::optional<Clearance> SweepCheck::at(const model::InputRef& q) const {
  const statics::Solution found = model_.solve(q);
  if (!found.converged()) return std::nullopt;
  return clearance_.of(found.shape);
}

bool SweepCheck::isClear(const model::InputRef& q) const {
  const std::optional<Clearance> found = at(q);
  return found && found->distance >= clearance_.keepOut().clearance;
}

// Goes along a motion, look by look, and stops before it is too close.
class SweepCheck::Walk {
 public:
  Walk(const SweepCheck& check, double nearer, Look start)
      : check_(check),
        nearer_(nearer),
        least_(check.clearance_.keepOut().clearance + nearer),
        at_(std::move(start)) {
    if (at_.clearance) allowed_ = std::min(least_, at_.clearance->distance);
    escapes_ = allowed_ < least_;
  }

  /// Whether the arm begins too close.
  bool escapes() const { return escapes_; }
  const Look& here() const { return at_; }

  /// Goes on to a look. @return whether all until there is clear.
  bool to(const Look& next) {
    if (!at_.clearance) return block(at_);
    if (next.clearance && isClearUntil(next)) {
      at_ = next;
      allowed_ = std::min(least_, std::max(allowed_, next.clearance->distance));
      return true;
    }
    if (at_.marks.size() == next.marks.size() && motionTo(next) < kFinestMotion) return block(next);
    if ((next.q - at_.q).isZero(0)) return block(next);
    return to(check_.look(0.5 * (at_.q + next.q))) && to(next);
  }

  std::optional<Blocked> blocked() const { return blocked_; }
  bool block(const Look& at) {
    blocked_ = Blocked{};
    blocked_->least = least_ - nearer_;
    blocked_->input = at.q;
    if (at.clearance) {
      blocked_->zone = check_.clearance_.nameOf(at.clearance->zone);
      blocked_->clearance = at.clearance->distance - nearer_;
    }
    if (at_.clearance && at_.clearance->distance >= least_) {
      blocked_->last_clear = at_.q;
      blocked_->clear_tip = at_.tip;
    }
    return false;
  }

 private:
  double motionTo(const Look& next) const {
    return kCurved * (next.marks - at_.marks).colwise().norm().maxCoeff();
  }
  bool isClearUntil(const Look& next) const {
    const double motion = motionTo(next);
    const Clearance &here = *at_.clearance, &there = *next.clearance;
    if (allowed_ < least_) return motion <= kAwayMotion && there.distance >= allowed_;
    // Both of two places of the arm move.
    return motion <= check_.longest_ && isClear(here.distance, there.distance, motion, motion) &&
           isClear(here.own, there.own, motion, 2 * motion);
  }
  // Whether a distance that changes by at most this much is kept all the way.
  bool isClear(double here, double there, double motion, double change) const {
    return std::min(here, there) >= least_ &&
           (motion < kFinestMotion || here + there - change >= 2 * least_);
  }

  const SweepCheck& check_;
  const double nearer_;
  const double least_;
  double allowed_ = 0.0;  // less than least_ as long as an arm that began too close still is
  bool escapes_ = false;
  Look at_;
  std::optional<Blocked> blocked_;
};

std::optional<Blocked> SweepCheck::sweep(const std::vector<Eigen::VectorXd>& corners,
                                         double nearer) const {
  const Look start = look(corners.front());
  Walk walk(*this, nearer, start);
  for (std::size_t i = 1; i < corners.size(); ++i) {
    if (!walk.to(look(corners[i]))) return walk.blocked();
  }
  const Look& end = walk.here();
  const bool stays = !end.clearance || (walk.escapes() && corners.size() > 1 &&
                                        end.clearance->distance <= start.clearance->distance);
  const bool rests = corners.size() == 1 && walk.escapes();
  if (stays || rests) walk.block(end);
  return walk.blocked();
}

namespace {

// Pressures that follow their set points, and the corners of their way.
class Follower {
 public:
  Follower(const std::vector<control::ChannelRules>& channels, const control::SafetyRules& rules,
           const Eigen::VectorXd& set_point, const Eigen::VectorXd& pressure)
      : rules_(rules), set_(set_point), now_(pressure), corners_{pressure} {
    arrived_.resize(set_.size());
    for (Eigen::Index i = 0; i < set_.size(); ++i) {
      const model::Range& limits = channels[static_cast<std::size_t>(i)].limits;
      arrived_[i] = kArrived * (limits.upper - limits.lower);
    }
  }
  double step() const {
    return std::min(rules_.time_constant, rules_.fallTimeConstant()) / kStepsPerLag;
  }
  const Eigen::VectorXd& setPoint() const { return set_; }

  /// Moves on by a time [s], in which the set points go to these at an even rate: exact, except
  /// where a pressure that falls begins to rise.
  void go(double dt, const Eigen::VectorXd& set_point) {
    for (Eigen::Index i = 0; i < now_.size(); ++i) {
      const double lag = set_point[i] < now_[i] ? rules_.fallTimeConstant() : rules_.time_constant;
      const double behind = (set_point[i] - set_[i]) / dt * lag;
      now_[i] = set_point[i] - behind + (now_[i] - set_[i] + behind) * std::exp(-dt / lag);
    }
    set_ = set_point;
    const auto far = (now_ - corners_.back()).cwiseAbs().array() > arrived_.array();
    if (far.any()) corners_.push_back(now_);
  }
  bool isAt(const Eigen::VectorXd& target) const {
    return ((target - now_).cwiseAbs().array() <= arrived_.array()).all();
  }
  std::vector<Eigen::VectorXd> endAt(const Eigen::VectorXd& target) {
    corners_.push_back(target);
    return std::move(corners_);
  }

 private:
  const control::SafetyRules& rules_;
  Eigen::VectorXd set_, now_, arrived_;
  std::vector<Eigen::VectorXd> corners_;
};

}  // namespace

std::vector<Eigen::VectorXd> pressuresOnTheWay(const std::vector<control::ChannelRules>& channels,
                                               const control::SafetyRules& rules,
                                               const Eigen::VectorXd& set_point,
                                               const Eigen::VectorXd& pressure,
                                               const Eigen::VectorXd& target) {
  Follower follower(channels, rules, set_point, pressure);
  while (!follower.isAt(target)) {
    Eigen::VectorXd next = follower.setPoint();
    for (Eigen::Index i = 0; i < next.size(); ++i) {
      const double most = channels[static_cast<std::size_t>(i)].slew * follower.step();
      next[i] += std::clamp(target[i] - next[i], -most, most);
    }
    follower.go(follower.step(), next);
  }
  return follower.endAt(target);
}

std::vector<Eigen::VectorXd> pressuresBehind(const std::vector<control::ChannelRules>& channels,
                                             const control::SafetyRules& rules, double every,
                                             const std::vector<Eigen::VectorXd>& set_points) {
  Follower follower(channels, rules, set_points.front(), set_points.front());
  const double count = std::ceil(every / follower.step());
  for (std::size_t i = 1; i < set_points.size(); ++i) {
    const Eigen::VectorXd way = set_points[i] - set_points[i - 1];
    for (double k = 1; k <= count; ++k) {
      follower.go(every / count, set_points[i - 1] + k / count * way);
    }
  }
  while (!follower.isAt(set_points.back())) follower.go(follower.step(), set_points.back());
  return follower.endAt(set_points.back());
}

}  // namespace helix_arm::clearance
