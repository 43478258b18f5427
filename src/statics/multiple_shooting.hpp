#pragma once

#include <Eigen/Core>
#include <limits>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/lie/so3.hpp"
#include "helix_arm/statics/exact.hpp"
#include "rod.hpp"

namespace helix_arm::statics {

/// Frame and body moment at the start of a segment.
struct Node {
  lie::SO3 R;         ///< seen from the base
  Eigen::Vector3d m;  ///< [N m]
};

/// What Newton's method makes of the nodes that it is given.
struct Balance {
  bool found = false;
  std::vector<Node> nodes;  ///< that balance, where they were found
  /// Last Newton step, relative to the arm's size and one radian.
  double residual = std::numeric_limits<double>::infinity();
};

/// Balance of a loaded rod by shooting from the starts of all its segments at once, whose frames
/// and moments are the unknowns of Newton's method.
///
/// Keeps references to the rod and to the unloaded twists (6 x sections).
class MultipleShooting {
 public:
  MultipleShooting(const Rod& rod, const model::Twists& unloaded, const ExactOptions& options)
      : rod_(rod), unloaded_(unloaded), options_(options) {}

  /// The nodes of the arm without load.
  std::vector<Node> unloadedNodes() const;

  /// Newton's method from given nodes, under a share of the load.
  /// @param damped  shortens steps until they gain; without it, steps that leave their branch end
  ///        the search.
  /// @param iterations  taken so far; counted on, up to ExactOptions::max_iterations.
  Balance balance(std::vector<Node> nodes, double share, bool damped, int& iterations) const;

  /// Newton step at given nodes, as Balance::residual.
  double residualOf(std::vector<Node> nodes, double share) const;

 private:
  // The arm shot from given nodes, with all that Newton's method asks for.
  struct Shot {
    std::vector<Node> nodes;
    std::vector<lie::Matrix6> Phi;     // derivative of each segment's end by its start
    std::vector<lie::Vector6> defect;  // what the segment's end misses the next node by; of the
                                       // last one the moment that is left over
    double norm = std::numeric_limits<double>::infinity();
  };
  struct Step;

  Shot shoot(std::vector<Node> nodes, double share) const;
  Step newtonStep(const Shot& shot) const;
  std::vector<Node> moved(const std::vector<Node>& nodes, const Step& step, double factor) const;

  const Rod& rod_;
  const model::Twists& unloaded_;
  const ExactOptions& options_;
};

}  // namespace helix_arm::statics
