#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "helix_arm/clearance/sweep.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/statics/arm_model.hpp"

namespace helix_arm::planning {

/// Progress of a search.
struct PlanProgress {
  const char* phase;  ///< "searches", "shortens" or "times"
  double seconds;     ///< since its begin [s]
};

/// Bounds of a search, and its rows.
struct PlanOptions {
  double longest = 5.0;    ///< time of the search, > 0 [s]
  std::uint32_t seed = 1;  ///< of its samples
  double every = 0.1;      ///< time between rows, > 0 [s]
  /// Told from time to time, may be empty; true ends the search.
  std::function<bool(const PlanProgress&)> stops = {};
};

/// A place of a path.
struct PlanRow {
  double time;               ///< since its begin, a multiple of PlanOptions::every [s]
  Eigen::VectorXd pressure;  ///< (n) set points [Pa]; linear until the next row
  lie::SE3 tip;              ///< seen from the base
  clearance::Clearance clearance;
};

/// A path, or why there is none.
struct Plan {
  std::vector<PlanRow> rows;  ///< from start to goal; empty: none was found
  std::string reason;         ///< empty with a path
  double seconds = 0.0;       ///< that it took [s]

  bool found() const { return !rows.empty(); }
  /// The row with the least clearance. Requires found().
  const PlanRow& nearest() const;
};

/// Finds ways of the pressures around zones: RRT-Connect and shortcuts, by OMPL, in fractions of
/// the pressures' limits. Every motion is swept (SweepCheck), and the whole path once more with the
/// lag of the regulator behind its set points.
///
/// No path within the time does not prove that there is none.
class PressurePlanner {
 public:
  /// @param channels  (n) their slew bounds the speed; without one, the whole range takes 1 s.
  /// @param rules     The lag of the pressures.
  /// @throws std::invalid_argument as SweepCheck.
  PressurePlanner(const statics::ArmModel& model, const clearance::KeepOut& keep_out,
                  std::vector<control::ChannelRules> channels, const control::SafetyRules& rules);

  const clearance::SweepCheck& check() const { return check_; }

  /// @param from, to  (n) pressures within the limits [Pa].
  Plan toPressures(const Eigen::VectorXd& from, const Eigen::VectorXd& to,
                   const PlanOptions& options = {}) const;
  /// Takes those pressures that bring the tip there and are clear.
  /// @param tip  base frame [m].
  Plan toTip(const Eigen::VectorXd& from, const Eigen::Vector3d& tip,
             const PlanOptions& options = {}) const;

 private:
  Plan plan(const Eigen::VectorXd& from, const std::vector<Eigen::VectorXd>& goals,
            const PlanOptions& options, double begin) const;
  std::vector<Eigen::VectorXd> search(const Eigen::VectorXd& from,
                                      const std::vector<Eigen::VectorXd>& goals,
                                      const PlanOptions& options, double begin) const;
  std::vector<Eigen::VectorXd> timed(const std::vector<Eigen::VectorXd>& corners,
                                     double every) const;
  std::string refusalOf(const char* what, const Eigen::VectorXd& q) const;

  statics::ArmModel model_;
  clearance::SweepCheck check_;
  std::vector<control::ChannelRules> channels_;
  control::SafetyRules rules_;
};

}  // namespace helix_arm::planning
