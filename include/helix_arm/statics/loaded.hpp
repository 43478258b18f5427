#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/load.hpp"
#include "helix_arm/statics/solution.hpp"
#include "helix_arm/statics/unloaded_change.hpp"

namespace helix_arm::statics {

/// Permitted orders of the loaded tier: the degree of the strain's polynomials.
inline constexpr int kLeastOrder = 2;
inline constexpr int kMostOrder = 8;

/// Number of pieces per section in the shape of a loaded arm.
inline constexpr int kLoadedPieces = 8;
/// Maximum number of places inside sections (not at their ends) where point loads may act.
inline constexpr int kMaxInnerPoints = 16;

/// Largest tip error of a converged solution of this order against the exact tier, as a fraction of
/// the arm's length. This is what SolveStatus::kConverged guarantees. Most tips are far more
/// accurate; TierChoice::relative_tip_error is the error for a particular arm and load.
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

/// Statics of a loaded arm, with its strain in Legendre modes on Gauss points.
///
/// In each section the wrench W of the load deforms the shape that the actuators set:
///   g(s) = g* + C Ad_X(s)^T W(s),  X' = X g,
/// where g* is the twist without load (eq. 17) and C = (l / K_eps) A+ is the section's compliance;
/// in a tapered section both depend on s. With X(s) = X_k exp(z(s)) exp(s g*), z' is a polynomial
/// of the tier's order. Picard's iteration with Anderson's acceleration finds it at order + 1 Gauss
/// points. A point load inside a section divides the section there. Order kLeastOrder takes one
/// step and recovers the strain once more, for any load. Without load this is the linear model.
/// Where the error may exceed statedTipError(), as near a buckling load or with more turns per
/// section than the order resolves, the shape is compared with one on 16 Gauss points. It counts as
/// not converged if the error is exceeded.
/// Under loads that could buckle the arm, a shape that is in equilibrium but unstable (a motion
/// away from it releases energy) counts as not converged. So does a stable one on another branch
/// than that which grows from the unloaded shape: if there may be several, the shape is compared
/// with one for which the load was applied in steps (load_steps of the result).
///
/// For arms in a plane (Group SE2) the load must lie in the plane; see inPlane().
template <class Group>
class LoadedArmOf {
 public:
  using Twists = model::TwistsOf<Group>;
  using Unloaded = model::UnloadedOf<Group>;

  /// @param order  degree of the polynomials, kLeastOrder .. kMostOrder.
  /// @throws std::invalid_argument naming the value that breaks a rule of Load, the order, or the
  ///     number of inner points.
  LoadedArmOf(const model::ArmOf<Group>& arm, const Load& load, int order);

  int order() const { return order_; }

  /// Tip for the twists (dof x sections) of the arm without load, for ArmOf::unloaded() of a
  /// tapered arm, or for unloadedUnder() of a load with StiffnessTables. Does not allocate with
  /// twists alone.
  /// @throws std::invalid_argument if the other two get twists alone.
  TipOf<Group> tip(const Unloaded& unloaded) const;

  /// The same with the shape, kLoadedPieces per section.
  Solution solve(const Unloaded& unloaded) const;

  /// Points of the base curve at `count` >= 2 evenly spaced s, including base and tip. Every point
  /// is as accurate as the tip, whereas the pieces of solve() are helices between their ends.
  /// @throws std::invalid_argument when count < 2.
  std::vector<model::CurvePoint<lie::SE3>> curve(const Unloaded& unloaded, int count) const;

  /// Shape and its derivatives with respect to the parameters of `change`, then, on request, to a
  /// force (3) [1/N] and a moment (3) [1/(N m)] at the tip that keep their directions, base frame.
  /// From the implicit function theorem at the equilibrium of this order; of the lowest order, of
  /// its steps.
  ShapeResponse differentiate(const Unloaded& unloaded, const UnloadedChange<Group>& change,
                              bool by_load = true) const;

  /// Tip and its derivative with respect to the parameters of `change`, in the same manner.
  TipResponseOf<Group> tipBy(const Unloaded& unloaded, const UnloadedChange<Group>& change) const;

  /// Tip and its derivative when the unloaded twists change along each of m directions (dof *
  /// sections x m). With an actuator's map and the slope of its contraction as direction, this is
  /// the derivative with respect to its input. Central differences of solutions, accurate to 1e-6
  /// of the largest column: faster than tipBy() for few directions. For arms without taper and
  /// loads without StiffnessTables.
  TipResponseOf<Group> tipByUnloaded(const Twists& unloaded,
                                     const Eigen::MatrixXd& directions) const;

 private:
  struct Element {
    int section;
    double begin, length;     // in s of the section
    std::vector<int> points;  // indices of the point loads at its end
    bool linked = false;      // whether a link follows
  };
  class Relaxation;
  class UnloadedElements;

  // Runs a relaxation, starting from the solution `near` of a similar problem if there is one.
  Relaxation solved(const Unloaded& unloaded, const Relaxation* near = nullptr) const;
  // Rejects a relaxation whose tip differs from that of a finer one; of one that steps the load, if
  // there may be several branches.
  void check(const Unloaded& unloaded, Relaxation& solver, bool branches) const;

  int order_;
  Load load_;
  std::vector<typename Group::Matrix> compliance_;  // of each section
  std::vector<typename model::Equilibrium<Group>::Basis> null_space_;
  // Tapers of tapered sections, null for the others: with the factor l / K_eps of its compliance.
  std::vector<std::shared_ptr<const model::TaperOf<Group>>> tapers_;
  std::vector<double> per_K_;
  std::vector<int> first_;  // actuator of each section
  bool tapered_ = false;
  bool has_tables_ = false;
  std::vector<Element> elements_;
  std::shared_ptr<const model::LinksOf<Group>> links_;  // null without any
  std::shared_ptr<const model::Links> links_in_space_;
  double size_ = 0.0;  // length scale of the arm [m]
  bool may_buckle_ = false;
};

using LoadedArm = LoadedArmOf<lie::SE3>;
using PlanarLoadedArm = LoadedArmOf<lie::SE2>;

/// Whether a load lies in the x-y plane of the arm's base.
bool inPlane(const Load& load);

/// Whether an arm in its x-y plane stays there under this load: the load lies in the plane and is
/// too small to buckle the arm out of it.
/// @param arm  the arm in space. @throws std::invalid_argument naming the value that breaks a rule
///     of Load.
bool staysInPlane(const model::Arm& arm, const Load& load);

}  // namespace helix_arm::statics
