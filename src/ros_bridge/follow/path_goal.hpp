#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <future>
#include <limits>
#include <memory>
#include <optional>
#include <system_error>
#include <utility>
#include <variant>
#include <vector>

#include <ros/time.h>

#include "helix_arm/FollowTipPathGoal.h"
#include "helix_arm/FollowTipPathResult.h"
#include "helix_arm/control/tip_path.hpp"
#include "helix_arm/follow/visual_servo.hpp"

namespace helix_arm::ros_bridge {

/// Remedy where the arm is not seen.
inline constexpr char kCheckVision[] = "check that camera and node vision run (vision_status)";

/// When a goal of follow_tip_path is reached, and when it has failed.
struct GoalRules {
  /// Largest distance of the measured tip from the path; infinite: any [m].
  double path_tolerance = std::numeric_limits<double>::infinity();
  double goal_tolerance = 0.002;  ///< largest distance at the end [m]
  double time_tolerance = 2.0;    ///< time after the path to come within goal_tolerance [s]
  bool require_vision = false;
  double vision_patience = 3.0;  ///< longest wait for the first picture, if it is required [s]
};

/// How a goal ended.
struct GoalEnding {
  std::int32_t code;    ///< of FollowTipPathResult
  std::string message;  ///< what is wrong, and the remedy
};

/// Cause that the loop assumes for a contact, and the remedy.
struct ContactWords {
  std::string what, remedy;
};

/// Distances of the measured tip from the path, without the way to it.
struct GoalFigures {
  double rms = std::numeric_limits<double>::quiet_NaN();  ///< [m]
  double max = std::numeric_limits<double>::quiet_NaN();  ///< [m]
  std::uint32_t pictures = 0;
};

/// Decides how a path that a VisualServo follows ends: compares what was measured with what was
/// wanted at the time of the picture. Time is a number [s].
class GoalWatch {
 public:
  /// The wanted tip at one time.
  struct Moment {
    double time;                        ///< [s]
    double path_time;                   ///< since the path's start [s]
    lie::SE3 wanted;                    ///< tip, base frame
    std::optional<lie::SE3> predicted;  ///< tip of the corrected model
    follow::LoopState state;
  };

  /// @param end      time of the path's last point, since its start [s].
  /// @param contact  asked where a contact ends the goal.
  GoalWatch(const GoalRules& rules, double end, std::function<ContactWords()> contact)
      : rules_(rules), end_(end), contact_(std::move(contact)) {}

  /// Notes a turn since the loop follows the path. @return how the goal ended, if it did.
  std::optional<GoalEnding> turn(double time, const follow::Turn& turn);

  /// The moment of a picture, by its stamp, with positions between those of two turns; nothing
  /// before the first turn.
  std::optional<Moment> momentOf(double stamp) const;
  /// Notes the tip in a picture that the loop used (base frame) [m]. @return as turn().
  std::optional<GoalEnding> picture(const Moment& moment, const Eigen::Vector3d& tip);

  GoalFigures figures() const {
    if (pictures_ == 0) return {};
    return {std::sqrt(sum2_ / pictures_), max_, pictures_};
  }

 private:
  std::optional<GoalEnding> visionEnding(double time, const follow::Turn& turn);
  GoalEnding lateEnding(const follow::Turn& turn) const;

  const GoalRules rules_;
  const double end_;
  const std::function<ContactWords()> contact_;
  std::deque<Moment> moments_;  ///< by ascending time
  std::optional<double> blind_since_;
  bool was_seen_ = false;
  std::optional<double> last_seen_;   ///< time of a picture, or of a state that tells of one
  std::optional<double> last_error_;  ///< of a picture after the path's end [m]
  double sum2_ = 0.0, max_ = 0.0;     ///< of distances [m^2], [m]
  std::uint32_t pictures_ = 0;
};

/// A goal of follow_tip_path.
struct PathGoal {
  control::TipPath path;       ///< base frame
  ros::Time start;             ///< zero: at once
  GoalRules rules;             ///< without vision_patience
  std::uint8_t on_contact;     ///< of FollowTipPathGoal
  bool ignore_contacts;        ///< likewise
  std::optional<double> hold;  ///< of the last point [s]; nothing: the default
};

/// Decision on a goal: to be followed, or refused.
using DecidedGoal = std::variant<PathGoal, GoalEnding>;

/// Why the arm cannot follow a path, empty if it can. @param tolerance  of its positions [m].
/// @param stop  once it is set, the result does not matter.
using PathCheck = std::function<std::string(const control::TipPath& path, double tolerance,
                                            const std::atomic<bool>& stop)>;

/// Why a goal is refused by the number of its points, or by its start.
/// @param max_age  age of the start that still counts as now, > 0 [s].
std::optional<GoalEnding> refusalOf(const FollowTipPathGoal& goal, double max_age);

/// Converts a goal that refusalOf() does not refuse, and checks its path.
/// @param X_BF  place of the path's frame F, seen from the base frame B.
DecidedGoal decide(const FollowTipPathGoal& goal, const lie::SE3& X_BF, const PathCheck& check,
                   const std::atomic<bool>& stop);

/// Checks one goal after the other in threads of its own, at most kMostThreads at a time.
///
/// A check that is replaced or discarded is told to stop, and nobody waits for it. While too many
/// have not stopped yet, the present check waits; if it is replaced meanwhile, it never runs.
///
/// For one thread, except the checks.
class PathChecker {
 public:
  static constexpr std::size_t kMostThreads = 2;
  /// Decides a goal. Runs in another thread; once `stop` is set it should return soon, whatever it
  /// returns.
  using Check = std::function<DecidedGoal(const std::atomic<bool>& stop)>;

  /// Tells all checks to stop, and waits for them.
  ~PathChecker() {
    discard();  // the futures wait
  }

  /// Begins a check, in place of the present one.
  void begin(Check check) {
    discard();
    waiting_ = std::move(check);
    start();
  }
  /// Gives the present check up.
  void discard() {
    waiting_ = nullptr;
    if (!present_) return;
    *present_->stop = true;
    discarded_.push_back(std::move(*present_));
    present_.reset();
  }
  /// The result of the present check, once; what a check throws refuses its goal. To be called
  /// regularly: it also begins a check that waits.
  std::optional<DecidedGoal> take() {
    start();
    if (!present_ || !isReady(present_->result)) return std::nullopt;
    Run run = std::move(*present_);
    present_.reset();
    try {
      return run.result.get();
    } catch (const std::exception& fault) {
      return GoalEnding{FollowTipPathResult::INVALID_GOAL, fault.what()};
    }
  }

 private:
  struct Run {
    std::shared_ptr<std::atomic<bool>> stop;
    std::future<DecidedGoal> result;
  };

  static bool isReady(const std::future<DecidedGoal>& result) {
    return result.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  }

  void start() {
    discarded_.erase(std::remove_if(discarded_.begin(), discarded_.end(),
                                    [](const Run& run) { return isReady(run.result); }),
                     discarded_.end());
    if (!waiting_ || discarded_.size() >= kMostThreads) return;
    const auto stop = std::make_shared<std::atomic<bool>>(false);
    try {
      auto result =
          std::async(std::launch::async, [check = waiting_, stop] { return check(*stop); });
      present_.emplace(Run{stop, std::move(result)});
      waiting_ = nullptr;
    } catch (const std::system_error&) {
      // The system has no thread left; it may have one the next time.
    }
  }

  Check waiting_;               ///< empty: none
  std::optional<Run> present_;  ///< begun
  std::vector<Run> discarded_;  ///< told to stop
};

}  // namespace helix_arm::ros_bridge
