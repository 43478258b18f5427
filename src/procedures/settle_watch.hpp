#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"

namespace helix_arm::procedures {

/// Detection of one tag in one picture, or of one body at one time.
struct TagObservation {
  int id;  ///< in its family; of a body, its index in the scene
  /// x, y of bottom left, bottom right, top right, top left as one reads the tag, with lens
  /// distortion [px].
  Eigen::Matrix<double, 2, 4> corners;
  /// Points of a body, which has no corners: origin and ends of its axes, each kAxis long, in the
  /// frame of its poses [m].
  std::optional<Eigen::Matrix<double, 3, 4>> points = {};

  static constexpr double kAxis = 0.03;  ///< [m]
  static TagObservation ofBody(int id, const lie::SE3& X_FM);
  /// Pose of a body.
  lie::SE3 X_FM() const;
};

/// The pressures and visible tags of an arm at rest.
struct Sample {
  double time;                       ///< time of its last picture [s]
  Eigen::VectorXd pressure;          ///< (actuators) gauge [Pa]
  std::vector<TagObservation> tags;  ///< unique ids in ascending order
};

/// Combines several samples at the same pressures: the median of each pressure and of each
/// coordinate of each tag or body. Tags seen in fewer than half of them are omitted.
///
/// @throws std::invalid_argument if there is no sample, or their numbers of pressures differ.
Sample medianOf(const std::vector<Sample>& samples);

/// Rules for an arm to count as at rest.
struct SettleRules {
  /// Maximum deviation of each pressure's mean from its set point, over each half of the window, >
  /// 0 [Pa].
  double pressure_tolerance = 3e3;
  /// Maximum distance of a tag from its position in the last picture during the window (RMS over
  /// its corners), > 0 [px].
  double corner_tolerance = 1.0;
  double window = 1.0;   ///< how long, > 0 [s]
  double max_age = 1.0;  ///< pressures or pictures older than this are stale, > 0 [s]
  /// As corner_tolerance, of a body: RMS over its points, > 0 [m].
  double body_tolerance = 2e-3;

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// Whether a shape is at rest.
enum class SettleState {
  kSettled,
  kStale,     ///< pressures are missing or too old
  kUnseen,    ///< pressures are recent, but pictures are missing or too old
  kPressure,  ///< the pressures are not at their set point yet
  kMoving,    ///< the tags are moving
  kNoTags,    ///< no tag is visible
};

/// Whether an arm is at rest, and its sample if so.
struct Settling {
  SettleState state = SettleState::kStale;
  std::string reason;  ///< cause, value and rule; empty if settled
  /// (actuators) in force since the window began [Pa]; absent if unknown.
  std::optional<Eigen::VectorXd> set_point;
  /// If settled: the last picture and the mean of the pressures measured in the window.
  std::optional<Sample> last;

  bool settled() const { return state == SettleState::kSettled; }
  /// Pressures or pictures are missing or too old.
  bool stale() const { return state == SettleState::kStale || unseen(); }
  bool unseen() const { return state == SettleState::kUnseen; }
};

/// Decides whether the pressures are at their set points and the shape is at rest.
///
/// All times are the stamps of the measurements [s]. A stamp before the last one of its kind, or
/// farther from it than max_age, discards the earlier measurements of that kind. Without set points
/// (in a recording that lacks them), pressures must stay near their own mean instead.
class SettleWatch {
 public:
  /// @param names  of the actuators, for the reasons; at least one.
  /// @throws std::invalid_argument naming the value and its rule.
  SettleWatch(std::vector<std::string> names, const SettleRules& rules);
  /// Names the actuators as the arm does, and waits for its rest. Throws likewise.
  SettleWatch(const model::Arm& arm, const SettleRules& rules);

  /// From now on pressures have to hold for model::ArmResponse::restTime() of this arm as well: a
  /// slow state creeps too slowly for a window to see.
  void waitForRest(const model::Arm& arm);

  /// New set points: (actuators) [Pa]. Throws std::invalid_argument on a wrong size, as measured()
  /// does.
  void command(double time, const Eigen::VectorXd& set_point);
  /// Measured pressures: (actuators) [Pa].
  void measured(double time, const Eigen::VectorXd& pressure);
  /// The arm's tags in one picture, unique ids in ascending order.
  void seen(double time, std::vector<TagObservation> tags);

  /// The state at `now` [s].
  Settling at(double now) const;
  /// One sample per picture of the window. Call only if at() is settled.
  std::vector<Sample> samples() const;

 private:
  struct Reading {
    double time;
    Eigen::VectorXd pressure;
  };
  struct Observation {
    double time;
    std::vector<TagObservation> tags;
  };

  template <class Entry>
  void add(std::deque<Entry>& history, Entry entry) const;
  void checkSize(const Eigen::VectorXd& pressure) const;
  std::string pressureStaleness(double now) const;
  std::string pictureStaleness(double now) const;
  std::string pressureFault(Eigen::VectorXd& mean) const;
  std::string motion(double begin) const;
  double windowBegin() const { return observations_.back().time - rules_.window; }
  double holdTime() const { return std::max(rules_.window, rest_time_); }
  double readingTime() const { return set_point_ ? rules_.window : holdTime(); }

  std::vector<std::string> names_;
  SettleRules rules_;
  double rest_time_ = 0;  ///< [s]
  std::optional<Eigen::VectorXd> set_point_;
  double set_since_ = 0;          ///< when its value last changed
  double set_last_ = 0;           ///< when it was last received
  std::deque<Reading> readings_;  ///< both by ascending time, covering two windows or more
  std::deque<Observation> observations_;
};

}  // namespace helix_arm::procedures
