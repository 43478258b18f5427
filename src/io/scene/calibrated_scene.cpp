#include "helix_arm/io/calibrated_scene.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "helix_arm/basics/requirement.hpp"
#include "io/document/number.hpp"
#include "scene_readers.hpp"

namespace helix_arm::io {
namespace {

constexpr char kLengthScaleKey[] = "length_scale", kStrokeScaleKey[] = "stroke_scale";

// A map in the document of a scene that describes actuators: a ring or a single one.
struct ActuatorEntry {
  Value* keys;
  std::string path;
  int first;  // index of its first actuator in the arm
  int count;
};

// Sections in the document of a valid scene.
std::vector<Value::Entry>& sectionsOf(Value& document) {
  return findValue(*findValue(document, "arm"), "sections")->entries;
}

// All actuators of the document of a valid scene, in the order of the arm.
std::vector<ActuatorEntry> actuatorEntries(Value& document) {
  std::vector<ActuatorEntry> entries;
  int first = 0;
  std::vector<Value::Entry>& sections = sectionsOf(document);
  for (std::size_t k = 0; k < sections.size(); ++k) {
    const std::string path = indexPath("arm.sections", k);
    if (Value* ring = findValue(sections[k].value, "ring")) {
      const int count = static_cast<int>(*parseNumber(ring->find("count")->text));
      entries.push_back({ring, joinPath(path, "ring"), first, count});
      first += count;
      continue;
    }
    std::vector<Value::Entry>& actuators = findValue(sections[k].value, "actuators")->entries;
    for (std::size_t i = 0; i < actuators.size(); ++i) {
      const std::string item = indexPath(joinPath(path, "actuators"), i);
      entries.push_back({&actuators[i].value, item, first++, 1});
    }
  }
  return entries;
}

// Given limits that exceed the range of a new curve.
void findLimitsBeyond(const std::string& name, const model::Range& range,
                      const std::vector<ActuatorEntry>& entries, FaultList& faults) {
  for (const ActuatorEntry& entry : entries) {
    if (entry.keys->find("contraction")->text != name) continue;
    for (const char* key : {"min_pressure_kpa", "max_pressure_kpa"}) {
      const Value* limit = entry.keys->find(key);
      if (limit == nullptr || range.contains(pascals(*parseNumber(limit->text)))) continue;
      report(faults, limit->place, joinPath(entry.path, key), " is ", limit->text,
             "; expected a pressure where the new curve of ", name, " was measured, ",
             formatNumber(kilopascals(range.lower)), " to ", formatNumber(kilopascals(range.upper)),
             ": move the limit there, or measure the free length as far as that");
    }
  }
}

Eigen::VectorXd vectorOf(const double* numbers, std::size_t count) {
  return Eigen::Map<const Eigen::VectorXd>(numbers, static_cast<Eigen::Index>(count));
}

Value curveValue(estimation::ContractionFit fit) {
  std::vector<double> coefficients(fit.coefficients.begin(), fit.coefficients.end());
  const bool quintic = fit.kind == estimation::CurveKind::kQuintic;
  const Value curve =
      quintic ? mapOf({{"coefficients_m", Numbers{kFinite}, coefficients},
                       {"reference_pressure_kpa", kPressure, fit.reference_pressure, kKilo},
                       {"max_pressure_kpa", kPressure, fit.reference_pressure, kKilo}})
              : mapOf({{"pressure_kpa", Numbers{kPressure}, fit.pressures, kKilo},
                       {"length_m", Numbers{kLength}, fit.lengths}});
  Value value = mapOf({});
  setValue(value, quintic ? "quintic" : "table", curve);
  return value;
}

// The map of a contraction by name.
Value& contractionOf(const Scene& scene, const std::string& name, Value& document) {
  Value& contractions = *findValue(document, "contractions");
  Value* const present = findValue(contractions, name);
  std::vector<std::string> known;
  for (const Value::Entry& entry : contractions.entries) known.push_back(entry.key);
  basics::require(present != nullptr, "calibratedSceneText: scene ", scene.name,
                  " has no contraction ", name, "; expected ", alternatives(known));
  basics::require(present->find("tendon") == nullptr, "calibratedSceneText: contraction ", name,
                  " of scene ", scene.name, " is a tendon; expected one that pressure drives");
  return *present;
}

// Replaces a curve of a scene's document and resets the length scales of its actuators; its
// response stays. Limits beyond the new curve are faults.
void putContraction(const Scene& scene, const std::string& name,
                    const estimation::ContractionFit& fit, Value& document, FaultList& faults) {
  basics::require(fit.curve.has_value(), "calibratedSceneText: contraction ", name,
                  " has no curve: ", fit.reason);
  Value& contraction = contractionOf(scene, name, document);
  findLimitsBeyond(name, fit.curve->inputRange(), actuatorEntries(document), faults);
  Value changed = curveValue(fit);
  if (const Value* response = contraction.find(kResponseKey)) {
    setValue(changed, kResponseKey, *response);
  }
  contraction = std::move(changed);
  // Scale factors of the old curve do not apply to the new one.
  for (const ActuatorEntry& entry : actuatorEntries(document)) {
    for (const char* key : {kLengthScaleKey, kStrokeScaleKey}) {
      const bool scaled = entry.keys->find(key) != nullptr;
      if (scaled && entry.keys->find("contraction")->text == name) {
        setValue(*entry.keys, key, numberValue(1));
      }
    }
  }
}

// Replaces the response of a curve; an instant one is removed.
void putResponse(const Scene& scene, const std::string& name, model::Response response,
                 Value& document) {
  Value& contraction = contractionOf(scene, name, document);
  if (response.instant()) return eraseValue(contraction, kResponseKey);
  Value keys = mapOf({{"rise_time_constant_s", kNotNegative, response.rise_time},
                      {"fall_time_constant_s", kNotNegative, response.fall_time}});
  if (response.play_count > 0) {
    std::vector<double> reach, weight;
    for (int j = 0; j < response.play_count; ++j) {
      reach.push_back(response.plays[static_cast<std::size_t>(j)].reach);
      weight.push_back(response.plays[static_cast<std::size_t>(j)].weight);
    }
    writeKeys({{"play_kpa", Numbers{kPressure}, reach, kKilo},
               {"play_weight", Numbers{kNotNegative}, weight}},
              keys);
  }
  if (response.slow_time > 0) {
    writeKeys({{"slow_time_constant_s", kNotNegative, response.slow_time},
               {"slow_weight", kNotNegative, response.slow_weight}},
              keys);
  }
  setValue(contraction, kResponseKey, std::move(keys));
}

const char* const kTitle =
    "# A calibrated scene. Its key calibration names the scene and the measurements that it was "
    "made\n# from, and how far to trust each number.\n";

// All maps of stiffness in the document, so that no old value remains in any.
std::vector<Value*> stiffnessesOf(Value& document) {
  std::vector<Value*> owners{findValue(document, "arm")}, given;
  for (Value::Entry& section : sectionsOf(document)) owners.push_back(&section.value);
  for (const ActuatorEntry& entry : actuatorEntries(document)) owners.push_back(entry.keys);
  for (Value* owner : owners) {
    if (Value* const own = findValue(*owner, "stiffness")) given.push_back(own);
  }
  return given;
}

// Numbers of a list, or of a single number.
Eigen::VectorXd numbersOf(const Value& given) {
  const bool single = given.kind != Value::Kind::kList;
  if (single) return Eigen::VectorXd::Constant(1, *parseNumber(given.text));
  Eigen::VectorXd numbers(static_cast<Eigen::Index>(given.entries.size()));
  std::transform(given.entries.begin(), given.entries.end(), numbers.begin(),
                 [](const Value::Entry& one) { return *parseNumber(one.value.text); });
  return numbers;
}

// K_kappa that depends on pressure: as before and scaled as a whole, or as a new table says.
void putKappa(double least, const std::optional<model::BendingTable>& bending, Value& stiffness) {
  Value* const given = findValue(stiffness, "K_kappa_m2");
  if (bending) {
    std::vector<double> pressure = bending->input, ratio = bending->factor;
    for (double& one : ratio) one *= least;
    setValue(stiffness, "K_kappa_m2",
             mapOf({{keyOf(bending->argument), Numbers{kPressure}, pressure, kKilo},
                    {"ratio_m2", Numbers{kStiffness}, ratio}}));
  } else if (given != nullptr && given->kind == Value::Kind::kMap) {
    Value& list = *findValue(*given, "ratio_m2");
    const Eigen::VectorXd ratio = numbersOf(list);
    list = numbersValue(least / ratio.minCoeff() * ratio);
  } else {
    setValue(stiffness, "K_kappa_m2", numberValue(least));
  }
}

void putStiffness(const model::Stiffness& stiffness,
                  const std::optional<model::BendingTable>& bending, Value& document) {
  if (bending) {
    // It belongs to sections: their actuators have no stiffness of their own.
    for (const ActuatorEntry& entry : actuatorEntries(document)) {
      eraseValue(*entry.keys, "stiffness");
    }
    Value& arm = *findValue(document, "arm");
    if (findValue(arm, "stiffness") == nullptr) setValue(arm, "stiffness", mapOf({}));
  }
  for (Value* const one : stiffnessesOf(document)) {
    setValue(*one, "K_gamma", numberValue(stiffness.gamma));
    setValue(*one, "K_tau_m2", numberValue(stiffness.tau));
    putKappa(stiffness.kappa, bending, *one);
  }
}

// A table is of muscles on a testing machine, also for scenes that have no K_eps yet.
void putK_eps(const Scene& scene, double K_eps, const model::StiffnessTable& table,
              Value& document) {
  Value entry = numberValue(K_eps);
  if (table.empty()) {
    basics::require(scene.model.load().has_value(),
                    "calibratedSceneText: K_eps is calibrated, but ", "scene ", scene.name,
                    " has no load; expected one with a load");
  } else {
    std::vector<double> pressure = table.input, force = table.factor;
    for (double& one : force) one *= K_eps;
    entry = mapOf({{"pressure_kpa", Numbers{kPressure}, pressure, kKilo},
                   {"force_n", Numbers{kPositive}, force}});
  }
  const std::vector<Value*> all = stiffnessesOf(document);
  const auto has = [](Value* one) { return findValue(*one, "K_eps_n") != nullptr; };
  if (std::none_of(all.begin(), all.end(), has)) return setValue(*all.front(), "K_eps_n", entry);
  for (Value* const one : all) {
    if (has(one)) setValue(*one, "K_eps_n", entry);
  }
}

void putScales(const char* key, const Eigen::VectorXd& factors, Value& document) {
  for (const ActuatorEntry& entry : actuatorEntries(document)) {
    Eigen::VectorXd scales = factors.segment(entry.first, entry.count);
    if (const Value* given = entry.keys->find(key)) {
      const Eigen::VectorXd before = numbersOf(*given);
      for (int i = 0; i < entry.count; ++i) scales[i] *= before[before.size() > 1 ? i : 0];
    }
    const bool common = (scales.array() == scales[0]).all();
    setValue(*entry.keys, key, common ? numberValue(scales[0]) : numbersValue(scales));
  }
}

// Angles of a ring's actuators: one turn of all keeps them evenly spaced, turns that differ list
// them.
void putPhases(const Eigen::VectorXd& turns, Value& ring) {
  const auto within = [](double degrees) {
    return std::abs(degrees) > 360 ? std::remainder(degrees, 360.0) : degrees;
  };
  const Value* given = ring.find("phase_deg");
  Eigen::VectorXd phases = given == nullptr ? Eigen::VectorXd::Zero(1) : numbersOf(*given);
  const Eigen::Index count = turns.size();
  if (phases.size() == 1 && (turns.array() == turns[0]).all()) {
    return setValue(ring, "phase_deg", numberValue(within(phases[0] + turns[0] / kDegree)));
  }
  if (phases.size() == 1) {
    phases = phases[0] + 360.0 / static_cast<double>(count) *
                             Eigen::ArrayXd::LinSpaced(count, 0, static_cast<double>(count - 1));
  }
  setValue(ring, "phase_deg", numbersValue((phases + turns / kDegree).unaryExpr(within)));
}

void putRings(const SceneCalibration& changes, Value& document) {
  std::vector<Value::Entry>& sections = sectionsOf(document);
  Eigen::Index first = 0;  // actuator of the ring
  for (std::size_t k = 0; k < sections.size(); ++k) {
    Value* const ring = findValue(sections[k].value, "ring");
    basics::require(ring != nullptr, "calibratedSceneText: ", indexPath("arm.sections", k),
                    " lists its actuators; expected a ring, whose radius and phase can be fitted");
    if (changes.ring_radius) {
      const Eigen::VectorXd radius =
          (*changes.ring_radius)[static_cast<Eigen::Index>(k)] * numbersOf(*ring->find("radius_m"));
      setValue(*ring, "radius_m",
               radius.size() > 1 ? numbersValue(radius) : numberValue(radius[0]));
    }
    if (changes.ring_phase) {
      const auto count = static_cast<Eigen::Index>(numbersOf(*ring->find("count"))[0]);
      putPhases(changes.ring_phase->segment(first, count), *ring);
      first += count;
    }
  }
}

void putPose(lie::SE3 X, Value& map) { writeKeys(poseKeys(X, kFinite), map); }

// A map of the document, which may be new.
Value& mapIn(Value& document, const char* key) {
  if (findValue(document, key) == nullptr) setValue(document, key, mapOf({}));
  return *findValue(document, key);
}

Value poseValue(const lie::SE3& X) {
  Value out = mapOf({});
  putPose(X, out);
  return out;
}

void putMotionCapture(const MotionCapture& found, Value& document) {
  if (!found.X_BF && !found.R_TM && !found.p_TM && !found.beam) return;
  Value& keys = mapIn(document, "motion_capture");
  if (found.X_BF) setValue(keys, "frame", poseValue(*found.X_BF));
  if (found.R_TM) setValue(keys, "body_rpy_deg", numbersValue(rpyDegOf(*found.R_TM)));
  if (found.p_TM) setValue(keys, "body_position_m", numbersValue(*found.p_TM));
  if (found.beam) {
    setValue(keys, "beam_deg", numbersValue(Eigen::Vector2d(*found.beam * (180 / basics::kPi))));
  }
}

// The pose of a camera's optical frame.
void putCamera(lie::SE3 X_WC, Value& camera) {
  X_WC.rotation *= kOpticalInBody.transpose();
  putPose(X_WC, camera);
}

// The frame in which the poses of a group are given, relative to that of the base curve.
lie::SE3 mountOf(const Scene& scene, const Value& group, int section, double s) {
  const Value* name = group.find("actuator");
  for (int i = scene.arm.firstActuator(section);
       name != nullptr && i < scene.arm.firstActuator(section + 1); ++i) {
    if (scene.arm.actuator(i).name == name->text) return model::poseAlong(scene.arm.actuator(i), s);
  }
  return {};
}

bool isSame(const estimation::TagPlacement& a, const estimation::TagPlacement& b) {
  return a.s == b.s && a.X_ST.rotation == b.X_ST.rotation &&
         a.X_ST.translation == b.X_ST.translation;
}

// Bodies that have moved are placed on the base curve.
void putBodies(const Scene& scene, const estimation::TagLayout& layout, Value& bodies) {
  for (std::size_t i = 0; i < layout.tags.size(); ++i) {
    const estimation::TagPlacement& body = layout.tags[i];
    if (isSame(scene.tags->tags[i], body)) continue;
    Value& keys = bodies.entries[i].value;
    for (const char* key : {"plate", "tool"}) eraseValue(keys, key);
    setValue(keys, "section", plainValue(scene.looks.at(body.section).name));
    setValue(keys, "s", numberValue(body.s));
    putPose(body.X_ST, keys);
  }
}

// A group of one tag with the mount of another group.
Value groupOf(const Scene& scene, const Value& mounted, const estimation::TagPlacement& tag) {
  Value group = mapOf({});
  for (const char* key : {"section", "actuator"}) {
    if (const Value* value = mounted.find(key)) setValue(group, key, *value);
  }
  setValue(group, "ids", listValue({plainValue(std::to_string(tag.id))}));
  setValue(group, "s", listValue({numberValue(tag.s)}));
  putPose(mountOf(scene, mounted, tag.section, tag.s).inverse() * tag.X_ST, group);
  return group;
}

void putTags(const Scene& scene, const estimation::TagLayout& layout, Value& document) {
  if (scene.hasBodies()) {
    return putBodies(scene, layout, *findValue(document, "bodies"));
  }
  Value& groups = *findValue(*findValue(document, "tags"), "groups");
  std::vector<Value> placed;
  std::size_t next = 0;
  for (const Value::Entry& entry : groups.entries) {
    const Value& group = entry.value;
    const std::size_t first = next;
    next += group.find("ids")->entries.size();
    std::vector<Value> split;
    bool moved = false;
    for (std::size_t i = first; i < next; ++i) {
      const estimation::TagPlacement& before = scene.tags->tags[i];
      const int index = layout.find(before.id);
      basics::require(index >= 0 && layout.tags[index].section == before.section,
                      "calibratedSceneText: tag ", before.id, " of scene ", scene.name,
                      " is not placed on its section; expected all tags of the scene");
      moved = moved || !isSame(before, layout.tags[index]);
      split.push_back(groupOf(scene, group, layout.tags[index]));
    }
    if (!moved) split = {group};
    placed.insert(placed.end(), split.begin(), split.end());
  }
  groups = listValue(placed);
}

void putMass(double factor, Value& document) {
  Value& mass = *findValue(*findValue(document, "load"), "mass_kg");
  const auto scaled = [factor](const Value& one) {
    return numberValue(factor * *parseNumber(one.text));
  };
  if (mass.kind != Value::Kind::kList) {
    mass = scaled(mass);
  } else {
    for (Value::Entry& one : mass.entries) one.value = scaled(one.value);
  }
}

// Applies the changes to the document of a scene: scales last, since they are of the new curves.
void putCalibration(const Scene& scene, const SceneCalibration& changes, Value& document,
                    FaultList& faults) {
  for (const auto& [name, fit] : changes.contractions) {
    putContraction(scene, name, fit, document, faults);
  }
  if (changes.stiffness) putStiffness(*changes.stiffness, changes.bending, document);
  if (changes.K_eps) putK_eps(scene, *changes.K_eps, changes.K_eps_table, document);
  if (changes.length_scale) putScales(kLengthScaleKey, *changes.length_scale, document);
  if (changes.ring_radius || changes.ring_phase) putRings(changes, document);
  for (const auto& [name, response] : changes.responses) {
    putResponse(scene, name, response, document);
  }
  if (auto mode = changes.mode) {
    writeKeys({{"mode_hz", kPositive, mode->frequency}, {"mode_damping", kPositive, mode->damping}},
              mapIn(document, "follow"));
  }
  if (changes.mass_factor) putMass(*changes.mass_factor, document);
  if (auto damping = changes.damping) {
    setValue(mapIn(document, "dynamics"), "damping_s", mapOf(dampingKeys(*damping)));
  }
  if (changes.X_CB) {
    putCamera(scene.X_WB * changes.X_CB->inverse(), *findValue(document, "camera"));
  }
  if (changes.X_BF) setValue(mapIn(document, "tags"), "frame", poseValue(*changes.X_BF));
  putMotionCapture(changes.motion_capture, document);
  if (changes.tags) putTags(scene, *changes.tags, document);
  for (const auto& [parameter, values] : changes.numbers) {
    if (parameter == estimation::FitParameter::kStrokeScaleEach) {
      putScales(kStrokeScaleKey, values, document);
    }
    if (parameter == estimation::FitParameter::kBorderShift && values[0] != 0) {
      setValue(mapIn(document, "tags"), "size_m", numberValue(scene.tags->size - 2 * values[0]));
    }
  }
  setValue(document, "calibration", writeProvenance(changes.provenance));
}

// Values of all numbers of a parameter, in their order.
Eigen::VectorXd valuesOf(estimation::FitParameter parameter,
                         const estimation::Calibration& calibration) {
  std::vector<double> values;
  for (const estimation::Parameter& one : calibration.parameters) {
    if (one.name.rfind(estimation::infoOf(parameter).name, 0) == 0) values.push_back(one.value);
  }
  return vectorOf(values.data(), values.size());
}

// Adds the changes of the scene for a fitted parameter.
void addChange(estimation::FitParameter parameter, const Scene& scene,
               const estimation::Calibration& calibration, bool corners,
               SceneCalibration& changes) {
  using estimation::FitParameter;
  switch (parameter) {
    case FitParameter::kKappa:
    case FitParameter::kGamma:
    case FitParameter::kTau:
    case FitParameter::kEps:
      changes.stiffness = calibration.stiffness;
      changes.K_eps = calibration.K_eps;
      return;
    case FitParameter::kLengthScale:
    case FitParameter::kLengthScaleEach:
      changes.length_scale = calibration.length_scale;
      return;
    case FitParameter::kContraction:  // have fits of their own
    case FitParameter::kResponse:
    case FitParameter::kMode:
    case FitParameter::kMass:
    case FitParameter::kDamping:
    case FitParameter::kRingRadius:
    case FitParameter::kRingPhase:
      return;
    case FitParameter::kBase:
      if (corners) changes.X_CB = scene.X_CB() * calibration.X_B0B;
      if (corners) return;
      (scene.tags->hasBodies() ? changes.motion_capture.X_BF : changes.X_BF) =
          calibration.X_B0B.inverse() * scene.X_BF;
      return;
    case FitParameter::kTags:
      changes.tags = calibration.layout;
      return;
    case FitParameter::kStrokeScaleEach:
    case FitParameter::kBorderShift:
      changes.numbers[parameter] = valuesOf(parameter, calibration);
      return;
  }
}

// The document as a text below a title, which is checked as the text of a scene.
std::string checkedText(const std::string& title, const Value& document, const std::string& name) {
  std::string text = title + writeDocument(document);
  sceneOfText(text, name);
  return text;
}

constexpr std::size_t kPlumbBob = 5;  // coefficients

// Up to the last that is not 0, in one of the sizes that are known.
std::size_t coefficientsOf(const estimation::Camera& camera) {
  for (std::size_t i = kPlumbBob; i < camera.distortion.size(); ++i) {
    if (camera.distortion[i] != 0) return camera.distortion.size();
  }
  return kPlumbBob;
}

Eigen::VectorXd distortionOf(const estimation::Camera& camera) {
  return vectorOf(camera.distortion.data(), coefficientsOf(camera));
}

void putIntrinsics(const estimation::Camera& camera, Value& map) {
  setValue(map, "size_px", numbersValue(Eigen::Vector2d(camera.width, camera.height)));
  setValue(map, "focal_px", numbersValue(Eigen::Vector2d(camera.fx, camera.fy)));
  setValue(map, "centre_px", numbersValue(Eigen::Vector2d(camera.cx, camera.cy)));
  if (camera.distorts()) {
    setValue(map, "distortion", numbersValue(distortionOf(camera)));
  } else {
    eraseValue(map, "distortion");
  }
}

// A base that a calibration found is no more that of a camera that was placed anew.
void forgetBase(Value& document) {
  Value* const calibration = findValue(document, "calibration");
  Value* const parameters =
      calibration == nullptr ? nullptr : findValue(*calibration, "parameters");
  if (parameters == nullptr) return;
  const auto& base = estimation::infoOf(estimation::FitParameter::kBase);
  for (const estimation::FitNumber& number : base.numbers) {
    eraseValue(*parameters, std::string(base.name) + number.suffix);
  }
}

// Gives each actuator the address or slot of another one.
void putChannels(const Scene& scene, const std::vector<int>& channels, Value& document) {
  const auto facts =
      scene.regulator ? regulator::factsOf(*scene.regulator) : regulator::DeviceFacts{};
  basics::require(facts.channels.size() == channels.size(), "the regulator of scene ", scene.name,
                  " has no addresses or slots to exchange: exchange the hoses at the regulator");
  std::vector<Value> list;
  for (const int channel : channels) {
    list.push_back(plainValue(facts.channels[static_cast<std::size_t>(channel)]));
  }
  Value& device = *findValue(*findValue(document, "regulator"), facts.kind);
  setValue(device, facts.channel_word, listValue(list));
}

void addMatrix(const char* name, int rows, const Eigen::VectorXd& entries, std::ostream& out) {
  out << name << ":\n  rows: " << rows << "\n  cols: " << entries.size() / rows << "\n  data: [";
  for (Eigen::Index i = 0; i < entries.size(); ++i) {
    out << (i > 0 ? ", " : "") << formatNumber(entries[i]);
  }
  out << "]\n";
}

}  // namespace

void addChanges(const Scene& scene, const estimation::Calibration& calibration,
                const std::set<estimation::FitParameter>& fitted, bool corners,
                SceneCalibration& changes) {
  for (const estimation::FitParameter one : fitted) {
    addChange(one, scene, calibration, corners, changes);
  }
}

std::string calibratedSceneText(const std::string& path, const std::vector<Override>& overrides,
                                const SceneCalibration& calibration, const std::string& sha256) {
  FaultList faults(path);
  auto [document, read_sha256] = readSceneDocument(path, overrides, faults);
  if (!sha256.empty() && read_sha256 != sha256) {
    throw DocumentError(path + " changed while it was calibrated; calibrate it again");
  }
  const Scene scene = makeScene(document, faults);
  putCalibration(scene, calibration, document, faults);
  faults.throwIfAny();
  return checkedText(kTitle, document, path + ", once calibrated,");
}

std::vector<Override> withLimit(const std::string& path, std::vector<Override> overrides,
                                const std::string& curve, double pressure) {
  FaultList faults(path);
  SceneDocument scene = readSceneDocument(path, overrides, faults);
  faults.throwIfAny();
  for (const ActuatorEntry& entry : actuatorEntries(scene.document)) {
    if (entry.keys->find("contraction")->text != curve) continue;
    std::string key = joinPath(entry.path, "max_pressure_kpa");
    std::replace(key.begin(), key.end(), '[', '.');
    key.erase(std::remove(key.begin(), key.end(), ']'), key.end());
    overrides.push_back({key, formatNumber(kilopascals(pressure))});
  }
  return overrides;
}

void requireRings(const std::string& path, const std::vector<Override>& overrides) {
  FaultList faults(path);
  Value document = readSceneDocument(path, overrides, faults).document;
  putRings({}, document);
}

bool hasRingsOnly(const std::string& path, const std::vector<Override>& overrides) {
  FaultList faults(path);
  Value document = readSceneDocument(path, overrides, faults).document;
  const std::vector<Value::Entry>& sections = sectionsOf(document);
  return std::all_of(sections.begin(), sections.end(),
                     [](const Value::Entry& one) { return one.value.find("ring") != nullptr; });
}

CameraPlace cameraPlaceOf(const lie::SE3& X_WC) {
  return {X_WC.translation, rpyDegOf(X_WC.rotation * kOpticalInBody.transpose())};
}

std::string sceneTextWithCamera(const std::string& path, const std::vector<Override>& overrides,
                                const CameraChange& change) {
  FaultList faults(path);
  Value document = readSceneDocument(path, overrides, faults).document;
  const Scene scene = makeScene(document, faults);
  basics::require(scene.camera.has_value(), "scene ", scene.name,
                  " has no camera; expected one with a section camera");
  Value& camera = *findValue(document, "camera");
  if (change.intrinsics) putIntrinsics(*change.intrinsics, camera);
  if (change.X_WC) {
    putCamera(*change.X_WC, camera);
    forgetBase(document);
  }
  return checkedText("# The camera of this scene was calibrated or placed by helix_arm camera.\n",
                     document, path + ", with the new camera,");
}

std::string sceneTextWithRig(const std::string& path, const std::vector<Override>& overrides,
                             const std::optional<estimation::TagLayout>& tags,
                             const std::vector<int>& channels) {
  FaultList faults(path);
  Value document = readSceneDocument(path, overrides, faults).document;
  const Scene scene = makeScene(document, faults);
  if (tags) {
    setValue(mapIn(document, "tags"), "size_m", numberValue(tags->size));
    putTags(scene, *tags, document);
  }
  if (!channels.empty()) putChannels(scene, channels, document);
  return checkedText("# A walk of helix_arm commission corrected this scene.\n", document,
                     path + ", once corrected,");
}

std::string sceneTextWithContacts(const std::string& path, const std::vector<Override>& overrides,
                                  double limit, follow::OnContact reaction,
                                  const std::string& title) {
  FaultList faults(path);
  Value document = readSceneDocument(path, overrides, faults).document;
  makeScene(document, faults);
  Value& keys = mapIn(document, "follow");
  setValue(keys, "contact_limit", numberValue(limit));
  setValue(keys, "on_contact", plainValue(nameOf(reaction)));
  return checkedText(title, document, path + ", with the new limit of contacts,");
}

std::string cameraInfoText(const estimation::Camera& camera, const std::string& name) {
  std::ostringstream out;
  const bool rational = coefficientsOf(camera) > kPlumbBob;
  Eigen::VectorXd K(9), R(9), P(12);
  K << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1;
  R << 1, 0, 0, 0, 1, 0, 0, 0, 1;
  P << camera.fx, 0, camera.cx, 0, 0, camera.fy, camera.cy, 0, 0, 0, 1, 0;
  out << "image_width: " << camera.width << "\nimage_height: " << camera.height
      << "\ncamera_name: " << name << "\n";
  addMatrix("camera_matrix", 3, K, out);
  out << "distortion_model: " << (rational ? "rational_polynomial" : "plumb_bob") << "\n";
  addMatrix("distortion_coefficients", 1, distortionOf(camera), out);
  addMatrix("rectification_matrix", 3, R, out);
  addMatrix("projection_matrix", 3, P, out);
  return out.str();
}

}  // namespace helix_arm::io
