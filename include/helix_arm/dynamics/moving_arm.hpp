#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "helix_arm/dynamics/motion_config.hpp"
#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"

namespace helix_arm::dynamics {

/// Equations of motion of an arm whose strain is a polynomial of s in each section:
///
///   M(q) q'' + c(q, q') + V'(q) + K (q - g*) + D q' = 0
///
/// The coordinates q are the coefficients of Legendre polynomials of degree 0 .. order over the
/// section; those of degree 0 are the section's twist g, and with order 0 nothing else. M and c are
/// those of the masses of the load: each section's is uniform in s with the inertia m diag(1, 1, 1,
/// r^2, r^2 / 2, r^2 / 2), points have none about themselves. V is the potential of gravity and of
/// dead forces, K = (K_eps / l) A (eq. 14-17) and D its strains' share times their damping.
///
/// Immutable; no call allocates but the constructor. For an arm in a plane (Group SE2) the load
/// must lie in it (statics::staysInPlane()).
template <class Group>
class MovingArmOf {
 public:
  using Tangent = typename Group::Tangent;
  using Matrix = typename Group::Matrix;
  using Point = typename Group::Point;

  /// @throws std::invalid_argument naming what motion does not have (tapered sections, stiffness
  ///     that depends on pressure), a section without mass or inertia, a value that breaks a rule.
  MovingArmOf(const model::ArmOf<Group>& arm, const statics::Load& load,
              const MotionConfig& config);

  const model::ArmOf<Group>& arm() const { return arm_; }
  const MotionConfig& config() const { return config_; }
  /// Number n of coordinates: dof x (order + 1) x sections, by sections, then by degree.
  int coordinates() const { return static_cast<int>(stiffness_.rows()); }
  /// K and D (n x n).
  const Eigen::MatrixXd& stiffness() const { return stiffness_; }
  const Eigen::MatrixXd& damping() const { return damping_; }

  /// Coordinates of constant twists (dof x sections).
  void setTwists(const model::TwistsOf<Group>& twists, Eigen::VectorXd& q) const;
  Group tip(const Eigen::VectorXd& q) const;

  /// Mass matrix M (n x n) and force c + V' (n), and the memory that evaluate() takes.
  struct Terms {
    Eigen::MatrixXd mass;
    Eigen::VectorXd force;
    double moment_power = 0.0;  ///< power of dead moments, which have no potential [W]

    explicit Terms(const MovingArmOf& arm);
    ~Terms();
    Terms(const Terms&) = delete;
    Terms& operator=(const Terms&) = delete;

   private:
    friend class MovingArmOf;
    struct Memory;
    std::unique_ptr<Memory> memory_;
  };
  void evaluate(const Eigen::VectorXd& q, const Eigen::VectorXd& rate, Terms& terms) const;

  /// Energies of the masses and dead forces [J]; the potential is 0 at the arm's base.
  struct Energies {
    double kinetic, potential;
  };
  Energies energies(const Eigen::VectorXd& q, const Eigen::VectorXd& rate) const;

 private:
  using Moment = Eigen::Matrix<double, Group::kRotations, 1>;
  // A dead load: force and moment seen from the base, its place from the node.
  struct Pull {
    Point force;
    Moment moment;
    Point offset;
  };
  // Masses and dead loads at one s, and the stretch of the section before it; the last one of a
  // section is at s = 1.
  struct Mark {
    double s;
    Matrix inertia = Matrix::Zero();
    double mass = 0.0;
    Point moment_of_mass = Point::Zero();  // mass times its place, seen from the node
    std::vector<Pull> pulls{};
    double length = 0.0;                    // of the stretch, in s
    double values[2][kMostOrder + 1] = {};  // of the polynomials at its two Gauss points
    bool loaded() const { return mass > 0 || !pulls.empty(); }
  };
  struct Section {
    std::vector<Mark> marks;
    Group link;
    bool has_link;
  };
  // Twist of a stretch, its rate, and the part of its second derivative without q''.
  struct Stretch {
    Tangent twist, rate, bias;
  };

  std::vector<Mark> marksOf(int k, const statics::Load& load) const;
  Stretch stretchOf(const Mark& mark, const double* q, const double* rate) const;
  Tangent wrenchAt(const Mark& mark, const Group& X, const Tangent& velocity,
                   const Tangent& acceleration, double& power) const;
  void assemble(Terms& terms) const;

  model::ArmOf<Group> arm_;
  MotionConfig config_;
  int modes_;  // polynomials of a section
  Point gravity_;
  std::vector<Section> sections_;
  std::vector<int> first_node_;
  int nodes_ = 0;
  Eigen::MatrixXd stiffness_, damping_;
};

}  // namespace helix_arm::dynamics
