#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "contraction_reader.hpp"
#include "helix_arm/io/section_look.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// A stiffness that actuators inherit: none given, given but invalid (reported once), or a value.
struct InheritedStiffness {
  bool given = false;
  std::optional<model::Stiffness> value;
  bool K_eps_given = false;
  std::optional<double> K_eps;  ///< [N]; of a table, the least
  statics::StiffnessTable table;
};

/// The map's own `stiffness`, otherwise the inherited one; K_eps is inherited separately.
InheritedStiffness readStiffness(const MapReader& owner, const Value& value,
                                 const InheritedStiffness& inherited, FaultList& faults);

/// State shared by all sections of an arm.
struct ArmContext {
  bool planar = false;
  InheritedStiffness stiffness;
  const Contractions& contractions;
  FaultList& faults;
  std::set<std::string> section_names;
  std::set<std::string> actuator_names;
  int actuator_count = 0;  ///< numbers the default names, muscle_1 from the base on
};

struct SectionParts {
  model::Section section;
  SectionLook look;
  bool K_eps_given = false;     ///< possibly invalid, which is reported
  std::optional<double> K_eps;  ///< [N]
  statics::StiffnessTable table;
};

/// Reads one entry of `arm.sections`. If it has faults, its parts are incomplete. The actuators of
/// a planar arm have poses in the x-y plane.
SectionParts readSection(const Value& value, const std::string& path, ArmContext& arm);

}  // namespace helix_arm::io
