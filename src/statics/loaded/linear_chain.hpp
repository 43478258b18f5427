#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"

/// Derivatives of a loaded arm's equilibrium. A motion is a twist about the base's origin, seen
/// from the base: rigid links do not change it, and along the arm motions add up.
namespace helix_arm::statics {

/// A Gauss point of an element with m parameters. The element's unknowns are rates at its Gauss
/// points; their integral up to this one is z.
template <class Group>
struct LinearNode {
  using Tangent = typename Group::Tangent;
  using Matrix = typename Group::Matrix;
  using Motion = Eigen::Matrix<double, Group::kDof, Eigen::Dynamic>;

  Group X;                ///< pose seen from the base
  Tangent wrench;         ///< of all loads beyond, seen from X
  Matrix motion_by_z;     ///< motion relative to that of the element's start
  Motion motion;          ///< (dof x m) the same by the parameters
  Matrix rate_by_wrench;  ///< rate that balances the load
  Matrix rate_by_z;
  Motion rate;  ///< (dof x m) by the parameters
};

/// Part of an arm, with loads at its end and an even weight.
template <class Group>
struct LinearElement {
  using Matrix = typename Group::Matrix;
  using Motion = typename LinearNode<Group>::Motion;
  struct Pull {
    typename Group::Point at, force;  ///< base frame
  };

  /// Weights of a rule of Gauss points: column j of the matrices holds those of the integrals up to
  /// and from point j.
  Eigen::MatrixXd before, after;
  Eigen::VectorXd weights;
  int first_column = 0;  ///< of its parameters
  std::vector<LinearNode<Group>> nodes;
  Matrix end_by_z;               ///< as LinearNode::motion_by_z
  Motion end;                    ///< (dof x m) as LinearNode::motion
  typename Group::Point weight;  ///< of the whole element, base frame [N]
  std::vector<Pull> pulls;
};

/// Elements in series, from the base to the tip.
template <class Group>
class LinearChain {
 public:
  using Motion = typename LinearNode<Group>::Motion;
  /// With respect to m parameters.
  struct Response {
    std::vector<Motion> starts;  ///< (dof x m) motion of the start of each element; then of the tip
    std::vector<Eigen::MatrixXd> rates;  ///< (dof nodes x m) of each element
  };

  explicit LinearChain(const std::vector<LinearElement<Group>>& elements);

  /// Response in equilibrium: the rates that balance the load are the rates of the shape.
  /// @param at_tip  (dof x m) derivatives of the wrench beyond the tip, about the base's origin.
  Response balanced(const Motion& at_tip) const;
  /// Response of the rates that balance the load, where the shape has given responses of its rates.
  Response answer(const std::vector<Eigen::MatrixXd>& rates, const Motion& at_tip) const;

 private:
  // Derivatives by the element's rates, its start's motion, the wrench beyond it, its parameters.
  struct Part {
    int unknowns, first_column, columns;
    Eigen::MatrixXd rates;  // that balance the load
    Motion end, wrench;     // motion of the end; wrench at the start
  };
  static Part partOf(const LinearElement<Group>& element);

  std::vector<Part> parts_;
};

}  // namespace helix_arm::statics
