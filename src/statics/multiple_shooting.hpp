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

/// Result of Newton's method.
struct Balance {
  bool found = false;
  std::vector<Node> nodes;  ///< the solution, if found
  /// Last Newton step, relative to the arm's size and one radian.
  double residual = std::numeric_limits<double>::infinity();
};

/// Equilibrium of a loaded rod by multiple shooting: the frames and moments at the starts of all
/// segments are the unknowns of Newton's method.
///
/// Keeps references to the rod and to the unloaded state.
class MultipleShooting {
 public:
  MultipleShooting(const Rod& rod, const model::Unloaded& unloaded, const ExactOptions& options)
      : rod_(rod), unloaded_(unloaded), options_(options) {}

  /// The nodes of the arm without load.
  std::vector<Node> unloadedNodes() const;

  /// Newton's method from given nodes, under a fraction of the load.
  /// @param damped  shorten steps until they reduce the error; otherwise, steps that leave their
  ///     branch end the search.
  /// @param iterations  incremented, up to ExactOptions::max_iterations.
  Balance balance(std::vector<Node> nodes, double share, bool damped, int& iterations) const;

  /// Size of the Newton step at given nodes, as Balance::residual.
  double residualOf(std::vector<Node> nodes, double share) const;

 private:
  // The arm integrated from given nodes, with the data for Newton's method.
  struct Shot {
    std::vector<Node> nodes;
    std::vector<lie::Matrix6> Phi;     // derivative of each segment's end with respect to its start
    std::vector<lie::Vector6> defect;  // difference between the segment's end and the next node;
                                       // for the last segment, the unbalanced moment
    double norm = std::numeric_limits<double>::infinity();
  };
  struct Step;

  Shot shoot(std::vector<Node> nodes, double share) const;
  Step newtonStep(const Shot& shot) const;
  std::vector<Node> moved(const std::vector<Node>& nodes, const Step& step, double factor) const;

  const Rod& rod_;
  const model::Unloaded& unloaded_;
  const ExactOptions& options_;
};

}  // namespace helix_arm::statics
