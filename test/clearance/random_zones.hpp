#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
#include <string>
#include <variant>
#include <vector>

#include "helix_arm/clearance/arm_clearance.hpp"
#include "helix_arm/lie/so3.hpp"
#include "helix_arm/model/curve.hpp"
#include "support/random.hpp"

/// Zones drawn at random, and distances from them by their definitions, without FCL.
namespace helix_arm::test {

inline lie::SE3 randomPose(Random& random, double farthest) {
  lie::SE3 X;
  X.rotation = lie::SO3::exp(3.0 * random.direction<3>()).quaternion.toRotationMatrix();
  X.translation = random.uniform(0, farthest) * random.direction<3>();
  return X;
}

/// The surface of a box.
inline clearance::Mesh boxMesh(const Eigen::Vector3d& size) {
  clearance::Mesh mesh{"box.stl", {}, {}};
  for (int i = 0; i < 8; ++i) {
    mesh.corners.emplace_back(size.x() * ((i & 1) - 0.5), size.y() * ((i >> 1 & 1) - 0.5),
                              size.z() * ((i >> 2 & 1) - 0.5));
  }
  mesh.triangles = {{0, 1, 3}, {0, 3, 2}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                    {2, 3, 7}, {2, 7, 6}, {0, 2, 6}, {0, 6, 4}, {1, 3, 7}, {1, 7, 5}};
  return mesh;
}

inline clearance::Zone randomZone(Random& random, double size, double farthest, int kind,
                                  const std::string& name) {
  const auto edge = [&] { return random.uniform(0.1, 1.0) * size; };
  const auto draw = [&]() -> clearance::Form {
    if (kind == 0) return clearance::Box{{edge(), edge(), edge()}};
    if (kind == 1) return clearance::Cylinder{edge() / 2, edge()};
    if (kind == 2) return clearance::Sphere{edge() / 2};
    if (kind == 3) return boxMesh({edge(), edge(), edge()});
    return clearance::HalfSpace{};
  };
  clearance::Zone zone{name, draw(), randomPose(random, farthest)};
  if (kind == 4) {  // below the arm
    zone.X_WZ.translation = -random.uniform(0.5, 1.0) * farthest * zone.X_WZ.rotation.col(2);
  }
  return zone;
}

/// Distance of a point from a zone by its definition; 0 inside [m].
inline double distanceFrom(const clearance::Zone& zone, const Eigen::Vector3d& place) {
  const Eigen::Vector3d p = zone.X_WZ.inverse() * place;
  if (const auto* box = std::get_if<clearance::Box>(&zone.form)) {
    return (p.cwiseAbs() - box->size / 2).cwiseMax(0.0).norm();
  }
  if (const auto* mesh = std::get_if<clearance::Mesh>(&zone.form)) {  // of boxMesh()
    return (p.cwiseAbs() - mesh->corners.back().cwiseAbs()).cwiseMax(0.0).norm();
  }
  if (const auto* round = std::get_if<clearance::Cylinder>(&zone.form)) {
    return Eigen::Vector2d(std::max(p.head<2>().norm() - round->radius, 0.0),
                           std::max(std::abs(p.z()) - round->length / 2, 0.0))
        .norm();
  }
  if (const auto* ball = std::get_if<clearance::Sphere>(&zone.form)) {
    return std::max(p.norm() - ball->radius, 0.0);
  }
  return std::max(p.z(), 0.0);
}

/// Clearance of the tube of an arm from zones, by many places along the curve and its links.
inline double denseClearance(const clearance::KeepOut& keep_out, const model::Shape& shape,
                             int places) {
  double least = std::numeric_limits<double>::infinity(), arc = 0;
  Eigen::Vector3d before = Eigen::Vector3d::Zero();
  lie::SE3 X;
  const auto look = [&](const Eigen::Vector3d& place, double radius) {
    arc += (place - before).norm();
    before = place;
    for (const clearance::Zone& zone : keep_out.zones) {
      if (arc < zone.from) continue;
      least = std::min(least, distanceFrom(zone, keep_out.X_WB * place) - radius);
    }
  };
  for (int j = 0; j < shape.pieces().cols(); ++j) {
    const double radius = keep_out.radii[static_cast<std::size_t>(j / shape.piecesPerSection())];
    for (int i = 0; i <= places; ++i) {
      look((X * lie::SE3::exp(static_cast<double>(i) / places * shape.pieces().col(j))).translation,
           radius);
    }
    X = shape.beyond(X, j);
    const Eigen::Vector3d end = before;
    if (keep_out.tool && j + 1 == shape.pieces().cols()) break;
    for (int i = 1; i <= places; ++i) {
      look(end + static_cast<double>(i) / places * (X.translation - end), radius);
    }
  }
  return least;
}

}  // namespace helix_arm::test
