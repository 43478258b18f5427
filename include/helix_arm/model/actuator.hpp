#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/contraction.hpp"
#include "helix_arm/model/response.hpp"

namespace helix_arm::model {

/// Stiffness of one actuator, normalised by its extensional stiffness K_eps: K = diag(1, gamma,
/// gamma, tau, kappa, kappa).
struct Stiffness {
  double gamma = 10.0;  ///< shear K_gamma, unitless, >= 0
  double tau = 0.0;     ///< torsion K_tau [m^2], >= 0
  double kappa = 0.0;   ///< bending K_kappa [m^2], >= 0

  /// The diagonal of K in the order of the group's twists.
  template <class Group>
  typename Group::Tangent diagonal() const;
  /// The part of it that K_kappa contributes.
  template <class Group>
  typename Group::Tangent bending() const;
};

/// How a stiffness of a section's actuators depends on their inputs: factors on its least value,
/// linear between given inputs, constant beyond them.
struct StiffnessTable {
  std::vector<double> input;   ///< ascending [Pa]; empty: the stiffness is constant
  std::vector<double> factor;  ///< one per input, >= 1

  bool empty() const { return input.empty(); }
  double at(double q) const;
  /// Derivative of at() [1/Pa]; at a given input, that of the interval above, if there is one.
  double slopeAt(double q) const;
  /// @param who  in messages, as is `factors`, what the table is of.
  /// @throws std::invalid_argument naming the value and its rule.
  void validate(const char* who, const char* factors) const;
};

/// How K_kappa of a section depends on the pressures of its actuators.
struct BendingTable : StiffnessTable {
  /// The pressure p that its inputs are, of pressures q_1 .. q_n.
  enum class Argument {
    kMean,    ///< p = sum q_i / n
    kOthers,  ///< p = sum |q_i| o_i / sum |q_i|, where o_i is the mean of all but q_i: 0 while one
              ///< actuator alone has pressure, q if all have q
  };

  BendingTable() = default;
  BendingTable(StiffnessTable table, Argument of = Argument::kMean)
      : StiffnessTable(std::move(table)), argument(of) {}

  /// p of the inputs (n) of a section [Pa], and its derivative by input i.
  double argumentAt(const Eigen::Ref<const Eigen::VectorXd>& q) const noexcept;
  double argumentSlope(const Eigen::Ref<const Eigen::VectorXd>& q, int i) const noexcept;

  Argument argument = Argument::kMean;
};

/// How an actuator is driven, which sets the unit of its input q.
enum class Drive {
  kPressure,  ///< a muscle or bellows; q is its gauge pressure [Pa]
  kTendon,    ///< a tendon; q is the angle of its spool [rad]
};

/// Units and spellings of the input of a drive. Inputs are in SI units everywhere in the library.
struct DriveUnit {
  bool pressure;          ///< whether the input is a pressure
  const char* quantity;   ///< in column names, as in "pressure_1_pa"
  const char* si;         ///< SI unit: "Pa"
  const char* si_suffix;  ///< in names of columns in SI units: "pa"
  const char* shown;      ///< unit of messages and files for users: "kPa"
  const char* suffix;     ///< in YAML keys and in names of columns in that unit: "kpa"
  double scale;           ///< SI units per displayed unit
};

/// The unit of each drive. Add a case for a new drive here.
constexpr DriveUnit unitOf(Drive drive) {
  switch (drive) {
    case Drive::kPressure:
      return {true, "pressure", "Pa", "pa", "kPa", "kpa", 1e3};
    case Drive::kTendon:
      return {false, "input", "rad", "rad", "rad", "rad", 1.0};
  }
  return {};
}

constexpr bool isPressure(Drive drive) { return unitOf(drive).pressure; }

/// One actuator of a section.
template <class Group>
struct ActuatorOf {
  std::string name;
  Group X_O;  ///< pose in the base-curve frame, constant along the section (eq. 10)
  Stiffness stiffness;
  Contraction contraction;
  Range limits;  ///< of the input; inside contraction.inputRange()
  Drive drive = Drive::kPressure;
  Response response{};  ///< between the measured pressure and the contraction
  /// If the section is tapered: poses at evenly spaced s from its beginning, X_O, to its end, >= 2;
  /// between them the position is linear in s, and the rotation is about a constant axis.
  std::vector<Group> taper{};
  std::string curve{};  ///< name of its contraction curve in the scene; empty without a scene
};

/// The input that gives an actuator a free length, within its limits.
struct NearestInput {
  double q;
  bool inside;  ///< whether that length is the given one, not that of a limit
};

/// @param length  [m], any.
template <class Group>
NearestInput nearestInput(const ActuatorOf<Group>& actuator, double length) noexcept {
  const Contraction& contraction = actuator.contraction;
  const double one = contraction.lengthInside(actuator.limits.lower);
  const double other = contraction.lengthInside(actuator.limits.upper);
  const double nearest = std::clamp(length, std::min(one, other), std::max(one, other));
  const double middle = 0.5 * (actuator.limits.lower + actuator.limits.upper);
  return {contraction.inverseInside(nearest, middle), nearest == length};
}

using Actuator = ActuatorOf<lie::SE3>;
using PlanarActuator = ActuatorOf<lie::SE2>;

}  // namespace helix_arm::model
