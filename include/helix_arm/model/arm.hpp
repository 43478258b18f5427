#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "helix_arm/model/actuator.hpp"
#include "helix_arm/model/taper.hpp"

namespace helix_arm::model {

/// Maximum number of sections of an arm.
inline constexpr int kMaxSections = 16;

/// Inputs of all actuators, section by section from the base: gauge pressures [Pa], or spool angles
/// [rad] for tendons.
using InputRef = Eigen::Ref<const Eigen::VectorXd>;

/// Twists of an arm's sections, (dof x sections). Column k is section k, counted from the base; v
/// [m], w [rad].
template <class Group>
using TwistsOf =
    Eigen::Matrix<double, Group::kDof, Eigen::Dynamic, Eigen::ColMajor, Group::kDof, kMaxSections>;
using Twists = TwistsOf<lie::SE3>;
using PlanarTwists = TwistsOf<lie::SE2>;

/// A bundle of actuators between two separators, with one constant twist.
template <class Group>
struct SectionOf {
  std::vector<ActuatorOf<Group>> actuators;
  double plate = 0.0;      ///< rigid length beyond the section, along x of its end, >= 0 [m]
  BendingTable bending{};  ///< factor on K_kappa
};

/// Rigid links of an arm, (sections): pose of what follows section k, seen from the end of its base
/// curve. This is the start of the next section or, for the last section, the tip.
template <class Group>
using LinksOf = std::vector<Group>;
using Links = LinksOf<lie::SE3>;

/// Maximum number of pieces of a shape.
inline constexpr int kMaxPieces = 128;
/// Twists of constant pieces in series, (dof x pieces), each over its own length; v [m], w [rad].
template <class Group>
using PiecesOf =
    Eigen::Matrix<double, Group::kDof, Eigen::Dynamic, Eigen::ColMajor, Group::kDof, kMaxPieces>;

/// An arm without load at given inputs.
template <class Group>
struct UnloadedOf {
  /// Constant twists (dof x sections): all that a linear arm needs.
  template <class Derived>
  UnloadedOf(const Eigen::MatrixBase<Derived>& constant) : twists(constant) {}
  UnloadedOf(const TwistsOf<Group>& mean, Eigen::VectorXd all_lengths)
      : twists(mean), lengths(std::move(all_lengths)) {}

  TwistsOf<Group> twists;   ///< (dof x sections) means over each section
  Eigen::VectorXd lengths;  ///< (n) free lengths [m] unless the arm isLinear(); otherwise empty
  /// (dof x dof * sections) twist per wrench of each section, where that depends on the inputs;
  /// otherwise empty.
  Eigen::Matrix<double, Group::kDof, Eigen::Dynamic, Eigen::ColMajor, Group::kDof,
                Group::kDof * kMaxSections>
      compliance;
};
using Unloaded = UnloadedOf<lie::SE3>;

/// Sections in series, without load: X_tip = prod_k exp(g_k) X_link,k, each g_k = (A+ D)_k l_k (eq.
/// 17). A link is the section's plate; that of the last section is followed by the tool.
///
/// In a tapered section the actuators' poses vary, and so does its twist: g(s) = A(s)+ D(s) l. Its
/// motion is a product of Magnus steps of order 6, as many as move the tip by less than 1e-5 of the
/// arm's length when doubled, and as are within 2e-4 of the curve between their ends (at sampled
/// inputs). Its twist is the sum of those of the steps.
///
/// Where K_kappa depends on the mean input of a section's actuators (SectionOf::bending), as in
/// chambers that share a body, the maps do, too: g = A(q)^-1 D l.
///
/// Immutable; the maps of constant stiffness are computed once, in the constructor. All poses are
/// seen from the arm's base, with x along the tangent there.
template <class Group>
class ArmOf {
 public:
  using Twists = TwistsOf<Group>;

  /// @param tool  pose of the tip, seen from the end of the last section's plate.
  /// @throws std::invalid_argument naming the section and actuator that break a rule: 1 ..
  ///     kMaxSections sections, 1 .. kMaxActuators actuators each, limits inside the contraction's
  ///     range, stiffness finite and >= 0, plates finite and >= 0, a finite tool. If K_kappa
  ///     depends on inputs, also those of needForTables().
  explicit ArmOf(std::vector<SectionOf<Group>> sections, const Group& tool = {});

  /// The same arm with this stiffness for every actuator.
  ArmOf withStiffness(const Stiffness& stiffness) const;
  /// The same arm with this stiffness for one actuator.
  ArmOf withStiffness(int actuator, const Stiffness& stiffness) const;

  int sectionCount() const { return static_cast<int>(equilibria_.size()); }
  int actuatorCount() const { return static_cast<int>(actuators_.size()); }
  const ActuatorOf<Group>& actuator(int i) const { return actuators_[i]; }
  /// Names of all actuators, in the order of the inputs.
  std::vector<std::string> actuatorNames() const;
  /// Index of section k's first actuator; firstActuator(sectionCount()) is actuatorCount().
  int firstActuator(int k) const { return first_[k]; }
  /// Equilibrium of section k; of a tapered section the mean over s; with the least K_kappa, where
  /// it depends on inputs.
  const Equilibrium<Group>& equilibrium(int k) const { return equilibria_[k]; }
  /// Null if section k is not tapered.
  const std::shared_ptr<const TaperOf<Group>>& taper(int k) const { return tapers_[k]; }
  /// Whether any section is tapered.
  bool tapered() const { return steps_ > 0; }
  /// Factor on K_kappa of section k as a function of the inputs of its actuators; empty if it is
  /// constant.
  const BendingTable& bending(int k) const { return bending_[k]; }
  /// Whether K_kappa of any section depends on inputs.
  bool hasTables() const { return has_tables_; }
  /// Whether the twist of each section is constant and linear in the lengths: without taper, and
  /// with constant K_kappa.
  bool isLinear() const { return is_linear_; }
  /// The missing condition of section k for a stiffness that depends on inputs, as a remedy; null
  /// if nothing.
  const char* needForTables(int k) const;
  /// Number of pieces per section of the shape without load: 1, or the steps of a tapered arm.
  int piecesPerSection() const { return steps_ > 0 ? steps_ : 1; }
  /// Null if the arm has neither plates nor a tool.
  const std::shared_ptr<const LinksOf<Group>>& links() const { return links_; }
  /// Length of the plate beyond section k [m].
  double plate(int k) const { return plates_[k]; }
  /// Pose of the tip, seen from the end of the last plate.
  const Group& tool() const { return tool_; }
  /// Link of section k.
  Group link(int k) const { return links_ ? (*links_)[k] : Group(); }

  /// Twist of section k when every actuator has its rest length.
  const typename Group::Tangent& restTwist(int k) const { return rest_twists_[k]; }

  /// Length of the base curve of section k when every actuator has its rest length [m].
  double restLength(int k) const { return rest_twists_[k].template head<Group::kSpace>().norm(); }

  /// Length of the base curve of the whole arm in that state, without links [m].
  double restLength() const;

  /// Mean rest length of the actuators of section k [m]: the length l that converts strain, as a
  /// fraction, to the twist over a section.
  double freeLength(int k) const;

  /// The same arm with the stiffness of every actuator multiplied by these factors, entry by entry.
  ArmOf scaledStiffness(const Stiffness& factors) const;

  /// Inputs (n) at a fraction (n) of each actuator's limits: 0 is the lower limit, 1 the upper.
  /// Inside the limits for fractions in [0, 1]. Throws as lengths() does on a wrong size.
  Eigen::VectorXd inputAt(const Eigen::VectorXd& fraction) const;
  /// The same with one fraction for all actuators.
  Eigen::VectorXd inputAt(double fraction) const;

  /// The inputs (n), each clamped to its limits; NaN is kept.
  /// @throws std::invalid_argument on a wrong size.
  Eigen::VectorXd clamped(Eigen::VectorXd q) const;

  /// Free lengths (n) [m] of the actuators at inputs q (n).
  /// @throws std::invalid_argument on a wrong size, std::out_of_range naming an actuator outside
  ///     its limits.
  Eigen::VectorXd lengths(const InputRef& q) const;

  /// Twists (dof x sections) at inputs q (n). Does not allocate. Throws as lengths() does.
  Twists twists(const InputRef& q) const;

  /// Twists (dof x sections) of given lengths (n) [m]. Does not allocate and does not check.
  Twists twistsOfLengths(const InputRef& lengths) const noexcept;

  /// Factor on K_kappa of a section, and its derivative by the section's lengths [1/m].
  struct Bending {
    double factor;
    typename TaperOf<Group>::Lengths by_length;
  };
  /// Bending of section k at given lengths (n) [m] of all actuators: K_kappa is as at the inputs
  /// that give these lengths; beyond its limits, an actuator counts as there.
  Bending bendingOfLengths(const InputRef& lengths, int k) const noexcept;

  /// Equilibrium of a section at given lengths.
  struct Balance {
    typename Group::Tangent twist;      ///< A^-1 D l
    typename Group::Matrix compliance;  ///< A^-1
  };
  /// Balance of section k, to which needForTables() applies, with other stiffness.
  /// @param lengths  (n) [m]. @param bending  factor on K_kappa. @param factors  (n) on the whole
  ///     stiffness of each actuator; null: 1.
  Balance balance(int k, const InputRef& lengths, double bending,
                  const Eigen::VectorXd* factors = nullptr) const noexcept;

  /// The arm at inputs q (n) or at given lengths (n) [m], which are not checked. Both allocate
  /// unless the arm isLinear(). @throws as lengths() does.
  UnloadedOf<Group> unloaded(const InputRef& q) const;
  UnloadedOf<Group> unloadedOfLengths(const InputRef& lengths) const;
  /// Its pieces (dof x sections * piecesPerSection()).
  PiecesOf<Group> pieces(const UnloadedOf<Group>& unloaded) const;
  /// Derivative (dof x n) of piece j of section k by the lengths of the section's actuators.
  typename Equilibrium<Group>::Map pieceByLengths(int k, int j,
                                                  const UnloadedOf<Group>& unloaded) const;

  /// Pose of the tip at inputs q (n). Does not allocate. Throws as lengths() does.
  Group tip(const InputRef& q) const;
  /// The same without check.
  Group tipInside(const InputRef& q) const noexcept;
  /// The same at given lengths (n) [m].
  Group tipOfLengths(const InputRef& lengths) const noexcept;
  /// Pose of the tip with given twists (dof x sections), each constant along its section.
  Group tipOf(const Twists& twists) const;

 private:
  using Steps = std::vector<typename TaperOf<Group>::Step>;
  using Lengths = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor,
                                kMaxSections * kMaxActuators, 1>;  // without the heap

  ArmOf(std::vector<SectionOf<Group>> sections, const Group& tool, int steps);
  void setBending(int k, const BendingTable& table);
  void chooseSteps();
  void setSteps(int steps);
  Lengths lengthsInside(const InputRef& q) const noexcept;
  typename TaperOf<Group>::Lengths ofSection(const InputRef& lengths, int k) const noexcept;
  typename TaperOf<Group>::Lengths restLengths(int k) const;
  typename Group::Tangent taperedTwist(const typename TaperOf<Group>::Lengths& lengths,
                                       int k) const noexcept;
  // At lengths and, where they are known, their inputs; null otherwise.
  typename Group::Tangent twistAt(const InputRef& lengths, const InputRef* q, int k) const noexcept;
  Twists twistsAt(const InputRef& lengths, const InputRef* q) const noexcept;
  Group tipAt(const InputRef& lengths, const InputRef* q) const noexcept;
  template <class StiffnessOf>
  ArmOf stiffened(const StiffnessOf& stiffnessOf) const;
  void check(const InputRef& q) const;
  typename Group::Tangent sectionTwist(const InputRef& q, int k) const noexcept;
  // Returns the one pose that it builds, in place: a copy waits for all of its numbers.
  Group untaperedTip(const InputRef& q) const noexcept;
  [[noreturn]] void refuse(const InputRef& q) const;

  std::vector<ActuatorOf<Group>> actuators_;
  std::vector<int> first_;
  std::vector<Equilibrium<Group>> equilibria_;
  std::vector<typename Group::Tangent> rest_twists_;
  std::vector<std::shared_ptr<const TaperOf<Group>>> tapers_;
  std::vector<Steps> section_steps_;  // empty where a section is not tapered
  int steps_ = 0;                     // per section; 0 without taper
  std::vector<BendingTable> bending_;
  bool has_tables_ = false, is_linear_ = true;
  std::vector<double> plates_;
  Group tool_;
  std::shared_ptr<const LinksOf<Group>> links_;  // shared with shapes, which are copied often
};

using Arm = ArmOf<lie::SE3>;
using Section = SectionOf<lie::SE3>;
using PlanarArm = ArmOf<lie::SE2>;
using PlanarSection = SectionOf<lie::SE2>;

/// The same arm, embedded in space.
Arm embed(const PlanarArm& arm);
/// The same twists, embedded in space.
Twists embed(const PlanarTwists& twists);

}  // namespace helix_arm::model
