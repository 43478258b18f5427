#pragma once

#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"
#include "rod_flow.hpp"

namespace helix_arm::statics {

/// A loaded arm as a rod, cut into segments where points pull, at the sections' ends, and where
/// errors of a start would grow too much along it.
class Rod {
 public:
  /// @param load  valid for the arm. @param tolerance  relative to the arm's size and one radian.
  Rod(const model::Arm& arm, const Load& load, double tolerance);

  int sections() const { return static_cast<int>(laws_.size()); }
  /// From the base to the tip.
  const std::vector<Segment>& segments() const { return segments_; }
  int segmentCount() const { return static_cast<int>(segments_.size()); }

  /// What integrates segment j; refers to this rod.
  /// @param unloaded  twists (6 x sections) without load. @param share  of the load.
  template <int kColumns>
  Flow<kColumns> flow(int j, const model::Twists& unloaded, double share) const;

  /// Of all that pulls [N], [N m].
  double forceScale() const { return force_scale_; }
  double momentScale() const { return moment_scale_; }
  /// Moment that bends the arm by about one radian [N m].
  double momentUnit() const { return moment_unit_; }
  /// False where a moment keeps its direction: it has no energy that tells whether a shape holds.
  bool conservative() const { return conservative_; }

 private:
  double tolerance_;
  std::vector<SectionLaw> laws_;
  std::vector<Segment> segments_;
  double size_ = 0.0;  // length of the arm [m]
  double force_scale_ = 0.0;
  double moment_scale_ = 0.0;
  bool conservative_ = true;
  double moment_unit_ = 1.0;
};

template <int kColumns>
Flow<kColumns> Rod::flow(int j, const model::Twists& unloaded, double share) const {
  const Segment& segment = segments_[j];
  // A tenth of the tolerance for each step: there are some ten of them.
  return {laws_[segment.section], segment,         unloaded.col(segment.section), share, size_,
          moment_unit_,           0.1 * tolerance_};
}

}  // namespace helix_arm::statics
