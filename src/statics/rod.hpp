#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "helix_arm/lie/so3.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"
#include "rod_flow.hpp"

namespace helix_arm::statics {

/// A loaded arm as a rod. It is divided into segments at point loads, at the ends of sections, and
/// where errors of the start would grow too much along a segment.
class Rod {
 public:
  /// @param load  valid for the arm. @param tolerance  relative to the arm's size and one radian.
  Rod(const model::Arm& arm, const Load& load, double tolerance);

  int sections() const { return static_cast<int>(laws_.size()); }
  /// Null without links.
  const std::shared_ptr<const model::Links>& links() const { return links_; }
  /// The link after segment j; null if the next segment begins where this one ends.
  const lie::SE3* linkAfter(int j) const {
    const Segment& segment = segments_[j];
    return links_ && segment.end == 1.0 ? &(*links_)[segment.section] : nullptr;
  }
  /// From the base to the tip.
  const std::vector<Segment>& segments() const { return segments_; }
  int segmentCount() const { return static_cast<int>(segments_.size()); }

  /// The integrator of segment j; keeps a reference to this rod.
  /// @param unloaded  the arm without load. @param share  fraction of the load.
  template <int kColumns>
  Flow<kColumns> flow(int j, const model::Unloaded& unloaded, double share) const;
  /// Rotation of the unloaded arm from the start of a section to s of it.
  lie::SO3 unloadedRotation(int section, double s, const model::Unloaded& unloaded) const;
  /// Motion of the unloaded arm between two s of a section.
  lie::SE3 unloadedMotion(int section, double from, double to,
                          const model::Unloaded& unloaded) const;
  /// Twist per body wrench at s of a section.
  lie::Matrix6 compliance(int section, double s, const model::Unloaded& unloaded) const;
  bool tapered() const { return tapered_; }
  bool hasTables() const { return has_tables_; }

  /// Magnitude of the whole load [N], [N m].
  double forceScale() const { return force_scale_; }
  double momentScale() const { return moment_scale_; }
  /// Moment that bends the arm by about one radian [N m].
  double momentUnit() const { return moment_unit_; }
  /// False if a moment keeps its direction: it then has no potential energy that decides about
  /// stability.
  bool conservative() const { return conservative_; }

 private:
  double tolerance_;
  std::vector<SectionLaw> laws_;
  std::vector<Segment> segments_;
  std::shared_ptr<const model::Links> links_;
  std::vector<int> first_;  // actuator of each section
  bool tapered_ = false;
  bool has_tables_ = false;

  lie::Matrix6 constantCompliance(int section, const model::Unloaded& unloaded) const {
    return has_tables_ ? lie::Matrix6(unloaded.compliance.middleCols<6>(6 * section))
                       : laws_[section].C;
  }
  std::optional<model::TaperTwist<lie::SE3>> profileOf(int section,
                                                       const model::Unloaded& unloaded) const;
  double size_ = 0.0;  // length of the arm [m]
  double force_scale_ = 0.0;
  double moment_scale_ = 0.0;
  bool conservative_ = true;
  double moment_unit_ = 1.0;
};

template <int kColumns>
Flow<kColumns> Rod::flow(int j, const model::Unloaded& unloaded, double share) const {
  const Segment& segment = segments_[j];
  // A tenth of the tolerance per step, for about ten steps.
  return {laws_[segment.section],
          segment,
          unloaded.twists.col(segment.section),
          profileOf(segment.section, unloaded),
          constantCompliance(segment.section, unloaded),
          share,
          size_,
          moment_unit_,
          0.1 * tolerance_};
}

}  // namespace helix_arm::statics
