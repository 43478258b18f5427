// The keys keep_out and clearance_m, the body of a tool, and STL files.
#include <Eigen/Geometry>
#include <cstdint>
#include <cstring>
#include <sstream>
#include <tuple>

#include "basics/quote.hpp"
#include "basics/regular_file.hpp"
#include "scene_readers.hpp"

namespace helix_arm::io {
namespace {

using clearance::KeepOut;
using clearance::Mesh;
using clearance::Zone;
using Eigen::Vector3d;

constexpr std::size_t kMostMeshBytes = 64U << 20U;
constexpr std::size_t kMostTriangles = 1'000'000;
constexpr double kFarthestCorner = 100;  // [m]
constexpr std::size_t kStlHeader = 84, kStlTriangle = 50, kStlNormal = 12;
const Text kMeshFile{"the path of an STL file"};

// Corners of triangles, three each; those that are the same become one.
Mesh meshOf(const std::string& file, const std::vector<Vector3d>& corners) {
  Mesh mesh{file, {}, {}};
  std::map<std::tuple<double, double, double>, int> known;
  for (std::size_t i = 0; i + 2 < corners.size(); i += 3) {
    std::array<int, 3> triangle{};
    for (std::size_t k = 0; k < 3; ++k) {
      const Vector3d& p = corners[i + k];
      const auto [place, is_new] =
          known.try_emplace({p.x(), p.y(), p.z()}, static_cast<int>(mesh.corners.size()));
      if (is_new) mesh.corners.push_back(p);
      triangle[k] = place->second;
    }
    mesh.triangles.push_back(triangle);
  }
  return mesh;
}

std::vector<Vector3d> cornersOfBinary(const std::string& bytes) {
  std::vector<Vector3d> corners;
  for (std::size_t at = kStlHeader; at < bytes.size(); at += kStlTriangle) {
    float numbers[9];
    std::memcpy(numbers, bytes.data() + at + kStlNormal, sizeof numbers);
    for (int k = 0; k < 3; ++k) {
      corners.push_back(Eigen::Vector3f::Map(numbers + 3 * k).cast<double>());
    }
  }
  return corners;
}

std::vector<Vector3d> cornersOfText(const std::string& text) {
  std::vector<Vector3d> corners;
  std::istringstream in(text);
  for (std::string word; in >> word;) {
    if (word != "vertex") continue;
    Vector3d corner;
    if (!(in >> corner.x() >> corner.y() >> corner.z())) return {};
    corners.push_back(corner);
  }
  return corners;
}

bool isBinaryStl(const std::string& bytes) {
  if (bytes.size() < kStlHeader) return false;
  std::uint32_t count = 0;
  std::memcpy(&count, bytes.data() + kStlHeader - sizeof count, sizeof count);
  return bytes.size() == kStlHeader + std::size_t{count} * kStlTriangle;
}

void readMesh(const MapReader& keys, Zone& zone) {
  const auto path = keys.read("mesh", kMeshFile);
  if (!path) return;
  const std::string file = basics::printable(*path);
  basics::RegularFile opened(*path);
  const auto bytes = opened.isOpen() ? opened.readAll(kMostMeshBytes) : std::nullopt;
  if (!bytes) return keys.complain("mesh", "names a file that ", opened.fault());
  const std::vector<Vector3d> corners =
      isBinaryStl(*bytes) ? cornersOfBinary(*bytes) : cornersOfText(*bytes);
  if (corners.size() < 3 || corners.size() % 3 != 0 || corners.size() > 3 * kMostTriangles) {
    return keys.complain("mesh", "names ", file, ", which holds ", corners.size(),
                         " corners of triangles; expected an STL file, binary or text, of 1 to ",
                         kMostTriangles, " triangles");
  }
  for (const Vector3d& corner : corners) {
    if (corner.cwiseAbs().maxCoeff() <= kFarthestCorner) continue;
    return keys.complain("mesh", "names ", file, ", with a corner at ", corner.transpose(),
                         "; expected metres in the world's frame, within ", kFarthestCorner, " m");
  }
  zone.form = meshOf(file, corners);
}

std::vector<Key> withPose(std::vector<Key> rows, lie::SE3& X, const NumberRule& coordinate) {
  for (Key& row : poseKeys(X, coordinate)) rows.push_back(std::move(row));
  return rows;
}

clearance::Box readBox(const MapReader& keys, lie::SE3& X, const NumberRule& coordinate) {
  clearance::Box box;
  keys.map("box", withPose({Key("size_m", kLength, box.size).required()}, X, coordinate));
  return box;
}

clearance::Cylinder readCylinder(const MapReader& keys, lie::SE3& X, const NumberRule& coordinate) {
  clearance::Cylinder cylinder;
  keys.map("cylinder", withPose({Key("radius_m", kLength, cylinder.radius).required(),
                                 Key("length_m", kLength, cylinder.length).required()},
                                X, coordinate));
  return cylinder;
}

void readHalfSpace(const MapReader& keys, Zone& zone) {
  Vector3d normal = Vector3d::UnitZ();
  const auto half =
      keys.map("half_space", {Key("position_m", kFinite, zone.X_WZ.translation).required(),
                              Key("normal", within(kFinite, -1e3, 1e3), normal).required()});
  if (normal.norm() < 1e-3) {
    return half->fault("normal", "a direction in which the arm may be, of length 1e-3 or more");
  }
  zone.X_WZ.rotation =
      Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), normal).toRotationMatrix();
  zone.form = clearance::HalfSpace{};
}

Zone readZone(const Value& value, const std::string& path, std::size_t number, FaultList& faults) {
  static const std::vector<std::string> kForms{"box", "cylinder", "sphere", "half_space", "mesh"};
  Zone zone;
  std::vector<Key> rows = keysOf(kForms);
  rows.push_back({"name", kWord, zone.name});
  rows.push_back({"from_m", within(kNotNegative, 0, 10, " m"), zone.from});
  const MapReader keys(value, path, rows, faults);
  if (!keys.isMap()) return zone;
  const auto form = keys.exactlyOne(kForms);
  if (!form) return zone;
  if (zone.name.empty()) zone.name = kForms[*form] + "_" + std::to_string(number);
  if (*form == 0) zone.form = readBox(keys, zone.X_WZ, kFinite);
  if (*form == 1) zone.form = readCylinder(keys, zone.X_WZ, kFinite);
  if (*form == 2) {
    clearance::Sphere sphere;
    keys.map("sphere", {Key("radius_m", kLength, sphere.radius).required(),
                        Key("position_m", kFinite, zone.X_WZ.translation).required()});
    zone.form = sphere;
  }
  if (*form == 3) readHalfSpace(keys, zone);
  if (*form == 4) readMesh(keys, zone);
  return zone;
}

}  // namespace

std::optional<clearance::ToolBody> readToolBody(const MapReader& tool) {
  clearance::ToolBody body;
  const auto keys = tool.map("body", keysOf({"box", "cylinder"}));
  if (!keys || !keys->isMap()) return std::nullopt;
  const auto form = keys->exactlyOne({"box", "cylinder"});
  if (!form) return std::nullopt;
  if (*form == 0) body.form = readBox(*keys, body.X_TB, kCoordinate);
  if (*form == 1) body.form = readCylinder(*keys, body.X_TB, kCoordinate);
  return body;
}

std::optional<KeepOut> readKeepOut(const MapReader& scene, const ArmParts* arm) {
  if (!scene.has("keep_out") && !scene.has("clearance_m")) return std::nullopt;
  KeepOut out;
  Key("clearance_m", within(kNotNegative, 0, 1, " m"), out.clearance).read(scene);
  std::set<std::string> names;
  if (scene.has("keep_out")) {
    scene.eachOf("keep_out", [&](const Value& value, const std::string& path) {
      out.zones.push_back(readZone(value, path, out.zones.size() + 1, scene.faults()));
      const std::string& name = out.zones.back().name;
      if (name.empty() || names.insert(name).second) return;
      report(scene.faults(), value.place, joinPath(path, "name"), " makes a second zone named ",
             name, "; expected distinct names");
    });
  }
  if (arm == nullptr) return std::nullopt;
  out.X_WB = arm->X_WB;
  for (const SectionLook& look : arm->looks) out.radii.push_back(look.separator_radius);
  out.tool = arm->tool_body;
  return out;
}

std::vector<Value*> relativeMeshes(Value& scene) {
  std::vector<Value*> out;
  Value* const zones = findValue(scene, "keep_out");
  if (zones == nullptr) return out;
  for (Value::Entry& zone : zones->entries) {
    Value* const mesh = findValue(zone.value, "mesh");
    if (mesh != nullptr && mesh->kind == Value::Kind::kText && !mesh->text.empty() &&
        mesh->text.front() != '/') {
      out.push_back(mesh);
    }
  }
  return out;
}

}  // namespace helix_arm::io
