#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/model/actuator.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/response.hpp"
#include "helix_arm/statics/load.hpp"
#include "io/document/map_reader.hpp"

namespace helix_arm::io {

/// Of a contraction.
inline constexpr char kResponseKey[] = "response";

/// Reads a `response`: how an actuator follows its pressure. An empty map is none. Values with
/// faults are reported and read as none.
model::Response readResponse(const Value& value, const std::string& path, FaultList& faults);

/// A curve that actuators refer to by name.
struct NamedContraction {
  model::Contraction curve;
  model::Drive drive;
  model::Response response{};  ///< between the pressure and the curve
};

/// All curves by name. A name whose declaration has faults maps to nothing: they are reported once,
/// not at every use.
using Contractions = std::map<std::string, std::optional<NamedContraction>>;

/// Reads `contractions`.
Contractions readContractions(const MapReader& scene, FaultList& faults);

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
