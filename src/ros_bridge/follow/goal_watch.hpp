#pragma once

#include <cstdint>
#include <deque>
#include <limits>
#include <optional>
#include <string>

#include "helix_arm/FollowTipPathResult.h"
#include "helix_arm/follow/visual_servo.hpp"

namespace helix_arm::ros_bridge {

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
  /// What was wanted at one time.
  struct Moment {
    double time;                        ///< [s]
    double path_time;                   ///< since the path's start [s]
    lie::SE3 wanted;                    ///< tip, base frame
    std::optional<lie::SE3> predicted;  ///< tip of the corrected model
    follow::LoopState state;
  };

  /// @param end  time of the path's last point, since its start [s].
  GoalWatch(const GoalRules& rules, double end) : rules_(rules), end_(end) {}

  /// Notes a turn since the loop follows the path. @return how the goal ended, if it did.
  std::optional<GoalEnding> turn(double time, const follow::Turn& turn);

  /// The moment of a picture, by its stamp, with positions between those of two turns; nothing
  /// before the first turn.
  std::optional<Moment> momentOf(double stamp) const;
  /// Notes the tip in a picture that the loop used (base frame) [m]. @return as turn().
  std::optional<GoalEnding> picture(const Moment& moment, const Eigen::Vector3d& tip);

  GoalFigures figures() const;

 private:
  std::optional<GoalEnding> visionEnding(double time, const follow::Turn& turn);
  GoalEnding lateEnding(const follow::Turn& turn) const;

  const GoalRules rules_;
  const double end_;
  std::deque<Moment> moments_;  ///< by ascending time
  std::optional<double> blind_since_;
  bool was_seen_ = false;
  std::optional<double> last_seen_;   ///< time of a picture, or of a state that tells of one
  std::optional<double> last_error_;  ///< of a picture after the path's end [m]
  double sum2_ = 0.0, max_ = 0.0;     ///< of distances [m^2], [m]
  std::uint32_t pictures_ = 0;
};

}  // namespace helix_arm::ros_bridge
