#pragma once

#include <Eigen/Core>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/procedures/sample.hpp"

namespace helix_arm::procedures {

/// When an arm counts as standing still.
struct SettleRules {
  /// Mean of each pressure about its set point, over each half of the window, > 0 [Pa].
  double pressure_tolerance = 3e3;
  /// How far a tag may be from where the last picture has it, all the window long (RMS over its
  /// corners), > 0 [px].
  double corner_tolerance = 1.0;
  double window = 1.0;   ///< how long, > 0 [s]
  double max_age = 1.0;  ///< pressures or pictures older than this are stale, > 0 [s]

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

enum class SettleState {
  kSettled,
  kStale,     ///< pressures or pictures have not come, or not for long
  kPressure,  ///< the pressures are not at their set point yet
  kMoving,    ///< the tags are
  kNoTags,    ///< none is in sight
};

/// Whether an arm stands still, and what it is like where it does.
struct Settling {
  SettleState state = SettleState::kStale;
  std::string reason;  ///< culprit, value and rule; empty where settled
  /// (actuators) in force since the window began [Pa]; absent where none was told.
  std::optional<Eigen::VectorXd> set_point;
  /// Where settled: the last picture and the mean of the pressures that were measured in the
  /// window.
  std::optional<Sample> last;

  bool settled() const { return state == SettleState::kSettled; }
  bool stale() const { return state == SettleState::kStale; }
};

/// Watches whether pressures are where they are to be and the shape stands still.
///
/// All times are the stamps of what is measured [s]. A stamp before the last one of its kind, or
/// farther from it than max_age, is a break: nothing of that kind from before it counts. Without
/// set points, of a recording that lacks them, pressures must stay near their own mean instead. Of
/// stamps that creep no more is kept than two minutes bring at 1000 readings and 60 pictures a
/// second.
class SettleWatch {
 public:
  /// @param names  of the actuators, for the reasons; at least one.
  /// @throws std::invalid_argument naming what breaks a rule.
  SettleWatch(std::vector<std::string> names, const SettleRules& rules);

  const SettleRules& rules() const { return rules_; }

  /// The pressures to come: (actuators) [Pa]. Each throws std::invalid_argument on a wrong size.
  void command(double time, const Eigen::VectorXd& set_point);
  /// The pressures that were measured: (actuators) [Pa].
  void measured(double time, const Eigen::VectorXd& pressure);
  /// The arm's tags of one picture, ascending ids, none twice.
  void seen(double time, std::vector<TagSighting> tags);

  /// The command in force, absent before the first.
  const std::optional<Eigen::VectorXd>& setPoint() const { return set_point_; }

  /// How things stand at `now` [s].
  Settling at(double now) const;
  /// One sample a picture of the window. Only where at() is settled.
  std::vector<Sample> samples() const;

 private:
  struct Reading {
    double time;
    Eigen::VectorXd pressure;
  };
  struct Sight {
    double time;
    std::vector<TagSighting> tags;
  };

  template <class Entry>
  void add(std::deque<Entry>& history, Entry entry, std::size_t most) const;
  void checkSize(const Eigen::VectorXd& pressure) const;
  std::string staleness(double now) const;
  std::string pressureFault(double begin, Eigen::VectorXd& mean) const;
  std::string motion(double begin) const;
  double windowBegin() const { return sights_.back().time - rules_.window; }

  std::vector<std::string> names_;
  SettleRules rules_;
  std::optional<Eigen::VectorXd> set_point_;
  double set_since_ = 0;          ///< when it was set to what it is
  double set_last_ = 0;           ///< when it was last told
  std::deque<Reading> readings_;  ///< both by ascending time, of a window and one before it
  std::deque<Sight> sights_;
};

}  // namespace helix_arm::procedures
