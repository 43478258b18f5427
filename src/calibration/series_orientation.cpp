#include "series_orientation.hpp"

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <cmath>
#include <functional>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/lie/so3.hpp"

namespace helix_arm::estimation {
namespace {

// Part of their own motion by which orientations that a mistake explains may be off.
constexpr double kExplained = 0.4;

Eigen::Matrix3d meanOf(const Rotations& rotations) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (const Eigen::Matrix3d& R : rotations) sum += R;
  return nearestRotation(sum);
}

// The frame from which the body is seen, against that of the tip: rotates the turns of one about
// their mean onto those of the other.
Eigen::Matrix3d frameBetween(const Rotations& R_FT, const Rotations& R_FM) {
  const Eigen::Matrix3d tip = meanOf(R_FT), body = meanOf(R_FM);
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (std::size_t k = 0; k < R_FT.size(); ++k) {
    sum += rotationVector(R_FM[k] * body.transpose()) *
           rotationVector(R_FT[k] * tip.transpose()).transpose();
  }
  return nearestRotation(sum);
}

// RMS angle between the body and the tip that carries it, as a part of the body's own turns.
double unexplained(const Rotations& R_FT, const Rotations& R_FM) {
  const Eigen::Matrix3d R_TM = meanBody(R_FT, R_FM);
  double sum = 0;
  for (std::size_t k = 0; k < R_FT.size(); ++k) {
    sum += rotationVector(R_FM[k].transpose() * R_FT[k] * R_TM).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(R_FT.size())) / spreadOf(R_FM);
}

Rotations changed(const Rotations& rotations,
                  const std::function<Eigen::Matrix3d(const Eigen::Matrix3d&)>& change) {
  Rotations out;
  for (const Eigen::Matrix3d& R : rotations) out.push_back(change(R));
  return out;
}

}  // namespace

Eigen::Matrix3d nearestRotation(const Eigen::Matrix3d& matrix) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double sign = (svd.matrixU() * svd.matrixV().transpose()).determinant();
  return svd.matrixU() * Eigen::Vector3d(1, 1, sign).asDiagonal() * svd.matrixV().transpose();
}

Eigen::Vector3d rotationVector(const Eigen::Matrix3d& R) {
  return lie::SO3{Eigen::Quaterniond(R)}.log();
}

Eigen::Matrix3d rotationOf(const Eigen::Vector3d& vector) {
  return lie::SO3::exp(vector).quaternion.toRotationMatrix();
}

Eigen::Matrix3d mirrored(const Eigen::Matrix3d& R, int axis) {
  Eigen::Vector3d signs = Eigen::Vector3d::Ones();
  signs[axis] = -1;
  return signs.asDiagonal() * R * signs.asDiagonal();
}

Eigen::Matrix3d meanBody(const Rotations& R_FT, const Rotations& R_FM) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (std::size_t k = 0; k < R_FT.size(); ++k) sum += R_FT[k].transpose() * R_FM[k];
  return nearestRotation(sum);
}

double spreadOf(const Rotations& rotations) {
  const Eigen::Matrix3d mean = meanOf(rotations);
  double sum = 0;
  for (const Eigen::Matrix3d& R : rotations)
    sum += rotationVector(mean.transpose() * R).squaredNorm();
  return std::sqrt(sum / static_cast<double>(rotations.size()));
}

std::string faultOfOrientations(const Rotations& R_FT, const Rotations& R_FM) {
  struct Mistake {
    const char* text;
    std::function<Eigen::Matrix3d(const Eigen::Matrix3d&)> correct;
  };
  const auto across = [](int axis) {
    return [axis](const Eigen::Matrix3d& R) { return mirrored(R, axis); };
  };
  static const char* const kMirrored =
      "they are of a left-handed frame: change the sign of one axis in positions and orientations "
      "alike";
  const Mistake mistakes[] = {
      {"the file has w first: name its columns qw, qx, qy, qz", withScalarFirst},
      {"they turn the frame of the positions into the body, not the body into that frame: change "
       "the signs of qx, qy and qz",
       [](const Eigen::Matrix3d& R) -> Eigen::Matrix3d { return R.transpose(); }},
      {kMirrored, across(0)},
      {kMirrored, across(1)},
      {kMirrored, across(2)}};
  const char* best = nullptr;
  double least = kExplained;
  for (const Mistake& one : mistakes) {
    const double left = unexplained(R_FT, changed(R_FM, one.correct));
    if (!(left < least)) continue;
    best = one.text;
    least = left;
  }
  if (best != nullptr) return best;
  const Eigen::Matrix3d frame = frameBetween(R_FT, R_FM);
  const auto seen = [&frame](const Eigen::Matrix3d& R) -> Eigen::Matrix3d { return frame * R; };
  if (unexplained(changed(R_FT, seen), R_FM) < kExplained) {
    return basics::messageOf(
        "they are seen from another frame than the positions, turned by about ",
        std::round(rotationVector(frame).norm() * 180 / M_PI),
        " deg: record both in one frame, such as after the same exchange of axes");
  }
  return "they are of a body that the tip does not carry: check its name in the recording";
}

}  // namespace helix_arm::estimation
