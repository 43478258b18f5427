#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "helix_arm/clearance/keep_out.hpp"
#include "helix_arm/dynamics/motion_config.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/statics/load.hpp"
#include "helix_arm/statics/tier.hpp"
#include "io/document/document.hpp"
#include "io/document/map_reader.hpp"
#include "regulator_profile.hpp"

namespace helix_arm::io {

inline constexpr char kResponseKey[] = "response";

/// Reads a `response`: how an actuator follows its pressure. None without the key, or if it is an
/// empty map. Values with faults are reported and read as none.
model::Response readResponse(const MapReader& owner, const std::string& key);

/// A curve that actuators refer to by name.
struct NamedContraction {
  model::Contraction curve;
  model::Drive drive;
  model::Response response{};  ///< between the pressure and the curve
};

/// All curves by name; one that has faults maps to nothing: they are not reported at every use.
using Contractions = std::map<std::string, std::optional<NamedContraction>>;

Contractions readContractions(const MapReader& scene);

/// A stiffness that actuators inherit; a member that was given with faults has any value.
struct InheritedStiffness {
  std::optional<model::Stiffness> value;
  std::optional<double> K_eps;  ///< [N]; of a table, the least
  statics::StiffnessTable table;
  model::BendingTable bending;  ///< of K_kappa, whose least one is that of `value`
};

/// Key of the pressures in a table of K_kappa.
const char* keyOf(model::BendingTable::Argument argument);

/// The map's own `stiffness`, otherwise the inherited one; K_eps is inherited separately.
InheritedStiffness readStiffness(const MapReader& owner, InheritedStiffness inherited);

/// State shared by all sections of an arm.
struct ArmContext {
  bool planar = false;
  InheritedStiffness stiffness;
  const Contractions& contractions;
  std::set<std::string> section_names = {};
  std::set<std::string> actuator_names = {};
  int actuator_count = 0;  ///< numbers the default names, muscle_1 from the base on
};

struct SectionParts {
  model::Section section;
  SectionLook look;
  InheritedStiffness stiffness;
};

/// Reads one entry of `arm.sections`. If it has faults, its parts are incomplete. The actuators of
/// a planar arm have poses in the x-y plane.
SectionParts readSection(const Value& value, const std::string& path, FaultList& faults,
                         ArmContext& arm);

struct ArmParts {
  lie::SE3 X_WB;
  model::Arm arm;
  std::optional<model::PlanarArm> planar;
  std::vector<SectionLook> looks;
  std::vector<double> K_eps;                    ///< per section [N]; empty if one has none
  std::vector<statics::StiffnessTable> tables;  ///< per section; empty if all are constant
  std::optional<clearance::ToolBody> tool_body = {};
};

/// The sections by their names; what they stand for is their index.
OneOf<int> sectionsOf(const ArmParts& arm);

/// How scenes are recognised.
const DocumentKind& sceneKind();

/// The text of a scene file. @throws DocumentError if it cannot be read.
std::string readSceneText(const std::string& path, FaultList& faults);

/// The tree of a scene's text with overrides; those that do not apply are faults.
/// @throws DocumentError if the text is not YAML or not a scene.
Value parseScene(const std::string& text, const std::vector<Override>& overrides,
                 FaultList& faults);

/// The arm of a scene.
struct SceneArmParts {
  std::optional<std::string> name;
  Contractions contractions;
  std::optional<ArmParts> arm;
  std::optional<statics::ArmModel> model;
};

/// Reads the keys that loadArm() names. Each part is absent if faults concern it.
SceneArmParts readSceneArm(const MapReader& scene);

// Readers of the other keys. A key that the scene omits gives nothing, or the defaults. The arm is
// null, and the regulator absent, if faults leave none: references to them are then not checked.

/// The optical frame C (z forward, x right, y down) seen from the camera's body (x forward, z up).
extern const Eigen::Matrix3d kOpticalInBody;

std::optional<CameraConfig> readCamera(const MapReader& scene);

struct TagParts {
  std::string family;
  estimation::TagLayout layout;
  estimation::TagPrior prior;
  lie::SE3 X_BF;  ///< the frame F of tag poses in data sets, seen from the base
};
std::optional<TagParts> readTags(const MapReader& scene, const ArmParts* arm);

/// Reads `bodies`: the ids of the layout count from 0 in their order.
std::optional<estimation::TagLayout> readBodies(const MapReader& scene, const ArmParts* arm);

MotionCapture readMotionCapture(const MapReader& scene);

/// Reads `vision`.
/// @param family  family of the tags; empty if the scene has none.
vision::LocalizerConfig readVision(const MapReader& scene, const std::string& family);

/// Reads `simulation`.
/// @param load   of the scene; null without. @param usual  what the rig's arm moves by where
///     `simulation.arm.dynamics` says nothing else.
SimulationConfig readSimulation(const MapReader& scene, const ArmParts* arm,
                                const statics::Load* load, const dynamics::MotionConfig& usual);

/// The profile of a device: the map below the single key of a document, its kind of regulator.
///
/// @param kind  the key that is needed; null for any.
/// @param name  the profile's.
/// @return nothing, and at least one fault, if a rule is broken.
std::optional<regulator::Profile> readProfile(const Value& document, const char* kind,
                                              const std::string& name, FaultList& faults);

/// The profile that a scene names by a path relative to the scene's folder (with a '/' or ending in
/// .yaml); null if there is none. Such a path becomes invalid if the scene is moved.
Value* relativeProfile(Value& scene);

/// Reads `regulator` and the profile that it names.
std::optional<regulator::Config> readRegulator(const MapReader& scene, const ArmParts* arm);

/// Reads `safety`. Without an arm, there are no channels.
SafetyConfig readSafety(const MapReader& scene, const ArmParts* arm,
                        const std::optional<regulator::Config>& regulator);

/// Reads `body` of a tool.
std::optional<clearance::ToolBody> readToolBody(const MapReader& tool);
/// Reads `keep_out` and `clearance_m`.
std::optional<clearance::KeepOut> readKeepOut(const MapReader& scene, const ArmParts* arm);
/// The meshes that a scene names by paths relative to its folder.
std::vector<Value*> relativeMeshes(Value& scene);

/// The rows of `dynamics.damping_s`.
std::vector<Key> dampingKeys(dynamics::StrainTimes& damping);
dynamics::MotionConfig readDynamics(const MapReader& scene);

/// Reads `follow`.
/// @param safety   tells the regulator's lag.
/// @param slowest  vibration of the arm where `follow.mode_hz` tells none.
follow::VisualServoConfig readFollow(const MapReader& scene, const SafetyConfig& safety,
                                     const std::optional<regulator::Config>& regulator,
                                     const std::optional<dynamics::Vibration>& slowest);

std::optional<Provenance> readProvenance(const MapReader& scene);
/// The value of `calibration` for this provenance; reading it gives the same.
Value writeProvenance(Provenance provenance);

/// The tree of a scene file with its overrides, and the hash of the bytes read.
struct SceneDocument {
  Value document;
  std::string sha256;
};
/// Reads a scene file; overrides that do not apply are faults.
/// @throws DocumentError if the file cannot be read, is not YAML or not a scene.
SceneDocument readSceneDocument(const std::string& path, const std::vector<Override>& overrides,
                                FaultList& faults);

/// The scene that a tree describes.
/// @throws DocumentError with all faults.
Scene makeScene(const Value& document, FaultList& faults);

}  // namespace helix_arm::io
