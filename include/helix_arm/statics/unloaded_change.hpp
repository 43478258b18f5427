#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"

namespace helix_arm::statics {

/// Derivatives of an arm without load with respect to some parameters: those of the twist g*(s) and
/// of the compliance C(s) of each section. With them the tiers that take a load differentiate their
/// equilibrium.
template <class Group>
class UnloadedChange {
 public:
  using Tangent = typename Group::Tangent;
  using Motion = Eigen::Matrix<double, Group::kDof, Eigen::Dynamic>;

  virtual ~UnloadedChange() = default;
  /// Number of all parameters.
  virtual int count() const = 0;
  /// The parameters that change section k: columns(k) of them, from first(k).
  virtual int first(int k) const = 0;
  virtual int columns(int k) const = 0;
  /// (dof x columns(k)) derivatives of g*(s), s in [0, 1] of section k.
  virtual Motion twist(int k, double s) const = 0;
  /// (dof x columns(k)) derivatives of C(s) W.
  /// @param strain  C(s) W.
  virtual Motion strain(int k, double s, const Tangent& strain) const = 0;
};

/// Derivatives with respect to the free lengths of the actuators and, on request, to the entries of
/// their stiffness. From A g = D l:
///   A dg = sum Ad_i^-T (K_i e1 dl_i + dK_i (l_i e1 - Ad_i^-1 g)),  dA+ = -A+ dA A+.
/// With StiffnessTables K_i depends on the lengths, too, as unloadedUnderOfLengths() has it.
///
/// The columns of section k are its lengths [m]; then K_gamma [1], K_tau [m^2] and K_kappa [m^2] of
/// its first actuator, of the second one, and so on.
template <class Group>
class ActuatorChange final : public UnloadedChange<Group> {
 public:
  using typename UnloadedChange<Group>::Tangent;
  using typename UnloadedChange<Group>::Motion;
  enum class By { kLengths, kLengthsAndStiffness };
  static constexpr int kEntries = 3;  ///< of a stiffness

  /// Keeps a reference to the arm.
  /// @param load  null without. @param lengths  (n) [m].
  ActuatorChange(const model::ArmOf<Group>& arm, const Load* load, const Eigen::VectorXd& lengths,
                 By by);

  int count() const override { return per_actuator_ * arm_.actuatorCount(); }
  int first(int k) const override { return per_actuator_ * arm_.firstActuator(k); }
  int columns(int k) const override { return first(k + 1) - first(k); }
  Motion twist(int k, double s) const override;
  Motion strain(int k, double s, const Tangent& strain) const override;

  /// Column of an actuator's length, and of one component of its stiffness: K_gamma, K_tau,
  /// K_kappa.
  int lengthColumn(int k, int actuator) const {
    return first(k) + actuator - arm_.firstActuator(k);
  }
  int stiffnessColumn(int k, int actuator, int component) const;
  /// Whether the shape jumps when an entry of the stiffness is raised, because it is 0 and resists
  /// a motion that nothing else resists. That column is 0.
  bool jumps(int actuator, int component) const { return jumps_[actuator][component]; }

 private:
  using Matrix = typename Group::Matrix;
  // Factor of an actuator: that on its stiffness, and its derivative by the length.
  struct Factor {
    double value = 1.0, slope = 0.0;
  };

  bool hasTable(int k) const {
    return load_ != nullptr && !load_->tables.empty() && !load_->tables[k].empty();
  }
  // Whether any stiffness of section k depends on inputs.
  bool varies(int k) const { return hasTable(k) || !arm_.bending(k).empty(); }
  // At these inputs; sets the factors of section k.
  typename model::ArmOf<Group>::Balance balanceOf(int k);
  void setJumps(int k);
  Matrix toActuatorAt(int i, double s) const;
  Matrix toActuator(int k, int i, double s) const;
  Matrix compliance(int k, double s) const;  // A(s)+
  // Ad_i^T dK_i e of all parameters, with `strains` e (dof x actuators of the section).
  Motion forces(int k, double s, const Motion& strains) const;

  const model::ArmOf<Group>& arm_;
  const Load* load_;
  Eigen::VectorXd lengths_;
  int per_actuator_;
  std::vector<Factor> factors_;
  std::vector<typename model::ArmOf<Group>::Bending> bending_;  // of each section
  std::vector<Matrix> compliance_;                              // A+ of each section without taper
  std::vector<Matrix> to_actuator_;                             // of each actuator, at s = 0
  std::vector<std::array<bool, kEntries>> jumps_;
  std::vector<Motion> constant_;  // twist() of each section without taper
};

/// Motion of part of a tapered section, as model::TaperTwist::step() has it, and its derivatives.
template <class Group>
struct TaperStep {
  typename Group::Tangent twist;
  typename UnloadedChange<Group>::Motion by;  ///< (dof x columns(k))
};
template <class Group>
TaperStep<Group> taperStep(const model::TaperTwist<Group>& profile,
                           const UnloadedChange<Group>& change, int k, double from, double to);

}  // namespace helix_arm::statics
