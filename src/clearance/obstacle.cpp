#include "obstacle.hpp"

#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/geometry/shape/box.h>
#include <fcl/geometry/shape/cylinder.h>
#include <fcl/geometry/shape/sphere.h>
#include <fcl/narrowphase/detail/gjk_solver_libccd.h>
#include <fcl/narrowphase/distance.h>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::clearance {
namespace {

using Eigen::Vector3d;
using Geometry = std::shared_ptr<fcl::CollisionGeometryd>;
using Surface = fcl::BVHModel<fcl::OBBRSSd>;

void requireSize(const char* what, double size) { basics::requirePositive("keep_out", what, size); }

Geometry make(const Box& box) {
  for (const double edge : box.size) requireSize("an edge of a box [m]", edge);
  return std::make_shared<fcl::Boxd>(box.size);
}
Geometry make(const Cylinder& cylinder) {
  requireSize("the radius of a cylinder [m]", cylinder.radius);
  requireSize("the length of a cylinder [m]", cylinder.length);
  return std::make_shared<fcl::Cylinderd>(cylinder.radius, cylinder.length);
}
Geometry make(const Sphere& sphere) {
  requireSize("the radius of a sphere [m]", sphere.radius);
  return std::make_shared<fcl::Sphered>(sphere.radius);
}
Geometry make(const HalfSpace&) { return nullptr; }
Geometry make(const Mesh& mesh) {
  basics::requireKey(!mesh.triangles.empty(), "keep_out", mesh.file, " has no triangles");
  std::vector<fcl::Triangle> triangles;
  for (const auto& one : mesh.triangles) {
    triangles.emplace_back(static_cast<std::size_t>(one[0]), static_cast<std::size_t>(one[1]),
                           static_cast<std::size_t>(one[2]));
  }
  auto surface = std::make_shared<Surface>();
  surface->beginModel();
  surface->addSubModel(mesh.corners, triangles);
  surface->endModel();
  return surface;
}

const fcl::Sphered kPoint(0.0);

// By closed forms; FCL leaves what lies inside to its caller.
template <class Shape>
Obstacle::Distance fromShape(const fcl::CollisionGeometryd& geometry, const Eigen::Isometry3d& X_BZ,
                             const Vector3d& place) {
  const fcl::detail::GJKSolver_libccd<double> solver;
  double distance = 0;
  Vector3d own, nearest;
  const Eigen::Isometry3d at(Eigen::Translation3d(place.x(), place.y(), place.z()));
  if (!solver.shapeDistance(kPoint, at, static_cast<const Shape&>(geometry), X_BZ, &distance, &own,
                            &nearest)) {
    return {0.0, Vector3d::Zero()};
  }
  return {distance, (place - nearest) / distance};
}

fcl::DistanceRequestd request() { return fcl::DistanceRequestd(true, false); }

}  // namespace

Obstacle::Obstacle(const Form& form, const lie::SE3& X_BZ, double from)
    : form_(form), from_(from), X_BZ_(isometryOf(X_BZ)) {
  geometry_ = std::visit([](const auto& one) { return make(one); }, form);
  if (!geometry_) return;
  convex_ = !std::holds_alternative<Mesh>(form);
  geometry_->computeLocalAABB();
  radius_ = geometry_->aabb_radius;
  centre_ = X_BZ_ * geometry_->aabb_center;
}

Obstacle::Distance Obstacle::of(const Vector3d& place) const {
  if (std::holds_alternative<Box>(form_)) return fromShape<fcl::Boxd>(*geometry_, X_BZ_, place);
  if (std::holds_alternative<Cylinder>(form_)) {
    return fromShape<fcl::Cylinderd>(*geometry_, X_BZ_, place);
  }
  if (std::holds_alternative<Sphere>(form_)) {
    return fromShape<fcl::Sphered>(*geometry_, X_BZ_, place);
  }
  if (std::holds_alternative<HalfSpace>(form_)) {
    const Vector3d normal = X_BZ_.linear().col(2);
    const double height = normal.dot(place - X_BZ_.translation());
    if (height <= 0) return {0.0, Vector3d::Zero()};
    return {height, normal};
  }
  fcl::DistanceResultd result;
  const Eigen::Isometry3d at(Eigen::Translation3d(place.x(), place.y(), place.z()));
  const double distance = fcl::distance(geometry_.get(), X_BZ_, &kPoint, at, request(), result);
  return {std::max(distance, 0.0), Vector3d::Zero()};
}

double Obstacle::of(const fcl::CollisionGeometryd& body, const Eigen::Isometry3d& X_BT) const {
  if (geometry_) {
    fcl::DistanceResultd result;
    return std::max(fcl::distance(geometry_.get(), X_BZ_, &body, X_BT, request(), result), 0.0);
  }
  // The lowest point of the body, seen along the normal.
  const Vector3d normal = X_BZ_.linear().col(2);
  const Vector3d along = (X_BT.linear().transpose() * normal).cwiseAbs();
  double half = 0;
  if (body.getNodeType() == fcl::GEOM_BOX) {
    half = along.dot(static_cast<const fcl::Boxd&>(body).side) / 2;
  } else {
    const auto& cylinder = static_cast<const fcl::Cylinderd&>(body);
    half = along.z() * cylinder.lz / 2 + along.head<2>().norm() * cylinder.radius;
  }
  return std::max(normal.dot(X_BT.translation() - X_BZ_.translation()) - half, 0.0);
}

double Obstacle::atLeast(const Vector3d& place) const {
  return geometry_ ? (place - centre_).norm() - radius_ : of(place).value;
}

Geometry geometryOf(const std::variant<Box, Cylinder>& form) {
  return std::visit([](const auto& one) { return make(one); }, form);
}

Eigen::Isometry3d isometryOf(const lie::SE3& X) {
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  out.linear() = X.rotation;
  out.translation() = X.translation;
  return out;
}

}  // namespace helix_arm::clearance
