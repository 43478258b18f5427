#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/load.hpp"
#include "helix_arm/statics/solution.hpp"

namespace helix_arm::statics {

/// Orders of the loaded tier: degree of the strain's polynomials.
inline constexpr int kLeastOrder = 2;
inline constexpr int kMostOrder = 8;

/// Pieces that a loaded section's shape is given in.
inline constexpr int kLoadedPieces = 8;
/// The most places inside sections, not at their ends, where points may pull.
inline constexpr int kMaxInnerPoints = 16;

/// Largest error of a converged tip against the exact tier, as a part of the arm's length: what
/// SolveStatus::kConverged of an order means. Most tips are better by far; what they err by on an
/// arm and its load is TierChoice::tip_error.
constexpr double statedTipError(int order) {
  switch (order) {
    case 2:
      return 1e-2;
    case 3:
      return 5e-3;
    case 4:
      return 2e-3;
    default:
      return 1e-3;
  }
}

/// Statics of a loaded arm, its strain in Legendre modes on Gauss points.
///
/// In each section the wrench of the load bends what the actuators shape:
///   g(s) = g* + C Ad_X(s)^T W(s),  X' = X g,
/// g* the twist without load (eq. 17), C = (l / K_eps) A+ its compliance. With X(s) = X_k exp(z(s))
/// exp(s g*), z' is a polynomial of the tier's order, found at order + 1 Gauss points by Picard's
/// iteration with Anderson's acceleration; points that pull inside a section cut it there. Order
/// kLeastOrder takes one step and recovers the strain once more, whatever the load. Without load it
/// is the linear model.
/// Where a shape may be off by more than statedTipError(), as close to a load that buckles the arm
/// or with more turns a section than the order follows, it is compared with one on 16 Gauss points
/// and counts as not converged where it is.
/// Of loads that could buckle the arm, a shape that balances but would not stay (a motion away from
/// it frees energy) counts as not converged.
///
/// Of arms in a plane (Group SE2) the load must lie in the plane; see lies in inPlane().
template <class Group>
class LoadedArmOf {
 public:
  using Twists = model::TwistsOf<Group>;
  using Motion = Eigen::Matrix<double, Group::kDof, Eigen::Dynamic>;

  /// A tip and how it changes.
  struct Response {
    TipOf<Group> at;  ///< its status is that of the tips nearby, too
    Motion by;        ///< (dof x m) its body twist by each of m changes

    // Central difference of the tips a step below and above.
    void add(int column, double step, const TipOf<Group>& below, const TipOf<Group>& above);
  };

  /// @param order  kLeastOrder .. kMostOrder: degree of the polynomials.
  /// @throws std::invalid_argument naming what breaks a rule of Load, the order, or the number of
  /// inner points.
  LoadedArmOf(const model::ArmOf<Group>& arm, const Load& load, int order);

  int order() const { return order_; }

  /// Tip for twists (dof x sections) of the arm without load. Does not allocate.
  TipOf<Group> tip(const Twists& unloaded) const;

  /// The same with the shape, kLoadedPieces a section.
  Solution solve(const Twists& unloaded) const;

  /// The curve at `count` >= 2 evenly spaced s, base and tip included, as good as the tip: not that
  /// of solve()'s pieces, which are helices from one end to the next.
  /// @throws std::invalid_argument when count < 2.
  std::vector<model::CurvePoint<lie::SE3>> curve(const Twists& unloaded, int count) const;

  /// Tip, and its change when the twists without load change along each of m directions (dof *
  /// sections x m): with map and slope of the contraction of an actuator, its input. Central
  /// differences of solutions, good to 1e-6 of the largest column.
  Response tipByUnloaded(const Twists& unloaded, const Eigen::MatrixXd& directions) const;

  /// The same when the load changes: a column for the mass of each section [1/kg], then for each
  /// point its mass, its force (3) [1/N] and its moment (3) [1/(N m)], in the order of Load.
  Response tipByLoad(const Twists& unloaded) const;

 private:
  struct Element {
    int section;
    double begin, length;     // in s of its section
    std::vector<int> points;  // that pull at its end
  };
  template <int kNodes>
  class Relaxation;

  // A relaxation that has run, from the solution of a problem nearby where there is one.
  template <class Solver>
  Solver solved(const Load& load, const Twists& unloaded, const Solver* near) const;
  // Refuses a relaxation whose tip is not that of a finer one.
  template <class Solver>
  void check(const Load& load, const Twists& unloaded, Solver& solver) const;

  int order_;
  Load load_;
  std::vector<typename Group::Matrix> compliance_;  // of the sections
  std::vector<typename model::Equilibrium<Group>::Basis> null_space_;
  std::vector<Element> elements_;
  double size_ = 0.0;  // of the arm [m]
  bool may_buckle_ = false;
};

using LoadedArm = LoadedArmOf<lie::SE3>;
using PlanarLoadedArm = LoadedArmOf<lie::SE2>;

/// Whether a load lies in the x-y plane of the arm's base.
bool inPlane(const Load& load);

/// Whether a load keeps an arm that lies in its x-y plane there: it lies there itself, and is too
/// small to make the arm buckle out of it.
/// @param arm  in space. @throws std::invalid_argument naming what breaks a rule of Load.
bool staysInPlane(const model::Arm& arm, const Load& load);

}  // namespace helix_arm::statics
