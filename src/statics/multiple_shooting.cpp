#include "multiple_shooting.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <utility>

namespace helix_arm::statics {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using lie::Matrix6;
using lie::SE3;
using lie::skew;
using lie::SO3;
using lie::Vector6;

constexpr double kContraction = 0.5;  // of Newton's steps that stay on their branch
constexpr double kLargestStep = 1.0;  // of them [rad], relative to the arm's size
constexpr double kNoise = 10;         // in tolerances: such a defect need not decrease
constexpr double kLeastGain =
    0.5;  // of a damped step, relative to the fraction of Newton's step that it takes
constexpr double kShortestStep = 1e-4;  // of a damped one, as a part of Newton's
constexpr double kNegative = 1e-9;      // of an eigenvalue, relative to the largest

// Number of negative eigenvalues of the stiffness against rotations of a segment's end, with its
// start fixed and everything beyond it free: the segment's own stiffness plus that of the rest,
// whose steps satisfy the rows. The sum over the segments is the index of the second variation of
// the energy, as long as each segment is stable between two ends that do not rotate. It is
// expressed in the moments at the start, so that it also holds for infinitely stiff sections.
int unstableMotions(const Eigen::Matrix<double, 3, 6>& rows, const Matrix6& Phi) {
  const Matrix3d by_moment = Phi.topRightCorner<3, 3>();
  const Matrix3d rest = rows.rightCols<3>().fullPivLu().solve(rows.leftCols<3>());
  const Matrix3d S = by_moment.transpose() * (Phi.bottomRightCorner<3, 3>() + rest * by_moment);
  if (!S.allFinite()) return 0;
  const Vector3d eigenvalues =
      Eigen::SelfAdjointEigenSolver<Matrix3d>(0.5 * (S + S.transpose())).eigenvalues();
  return static_cast<int>(
      (eigenvalues.array() < -kNegative * eigenvalues.cwiseAbs().maxCoeff()).count());
}

}  // namespace

// One step of all nodes: rotations in the body frame [rad], moments in the rod's unit.
struct MultipleShooting::Step {
  std::vector<Vector6> x;
  // Number of unstable motions of the shape: 0 on the branch from the unloaded shape.
  int unstable = 0;

  double size() const {
    double largest = 0.0;
    for (const Vector6& entry : x) {
      if (!entry.allFinite()) return std::numeric_limits<double>::infinity();
      largest = std::max(largest, entry.norm());
    }
    return largest;
  }
};

std::vector<Node> MultipleShooting::unloadedNodes() const {
  std::vector<Node> nodes;
  SO3 R_section;
  for (std::size_t j = 0; j < rod_.segments().size(); ++j) {
    const Segment& segment = rod_.segments()[j];
    if (j > 0 && segment.section != rod_.segments()[j - 1].section) {
      R_section = R_section * rod_.unloadedRotation(segment.section - 1, 1.0, unloaded_);
      if (const SE3* link = rod_.linkAfter(static_cast<int>(j) - 1)) {
        R_section = R_section * SO3{Eigen::Quaterniond(link->rotation)};
      }
    }
    nodes.push_back({R_section * rod_.unloadedRotation(segment.section, segment.begin, unloaded_),
                     Vector3d::Zero()});
  }
  return nodes;
}

MultipleShooting::Shot MultipleShooting::shoot(std::vector<Node> nodes, double share) const {
  const int count = rod_.segmentCount();
  Shot shot;
  shot.Phi.resize(count);
  shot.defect.resize(count);
  double square = 0.0;
  for (int j = 0; j < count; ++j) {
    const auto part = rod_.flow<6>(j, unloaded_, share);
    Flow<6>::State y;
    Matrix6 start = Matrix6::Identity();
    start.bottomRightCorner<3, 3>() *= rod_.momentUnit();
    y << nodes[j].R.quaternion.coeffs(), nodes[j].m,
        Eigen::Map<const Eigen::Matrix<double, 36, 1>>(start.data());
    double h = 0.25 * (part.segment.end - part.segment.begin);
    if (!part.advance(part.segment.begin, part.segment.end, y, h)) return shot;
    Eigen::Map<Matrix6> Phi(y.data() + 7);
    const Matrix3d R_inverse = Flow<6>::rotation(y).transpose();
    Vector3d m = y.segment<3>(4);
    for (const Pull& pull : part.segment.pulls) {
      const Vector3d f = R_inverse * (share * pull.force), t = R_inverse * (share * pull.moment);
      m -= pull.offset.cross(f) + t;
      const Matrix3d by_turn = skew(pull.offset) * skew(f) + skew(t);
      Phi.bottomRows<3>() -= (by_turn * Phi.topRows<3>()).eval();
    }
    SO3 R{{y[3], y[0], y[1], y[2]}};
    const SE3* link = j + 1 < count ? rod_.linkAfter(j) : nullptr;
    if (link != nullptr) {
      // The force beyond acts at the other end of the link.
      const Segment& next = rod_.segments()[j + 1];
      const Vector3d n = R_inverse * (share * next.forceAt(next.begin));
      const Matrix3d& R_link = link->rotation;
      m = R_link.transpose() * (m - link->translation.cross(n));
      Phi.bottomRows<3>() -= skew(link->translation) * skew(n) * Phi.topRows<3>();
      Phi.topRows<3>() = (R_link.transpose() * Phi.topRows<3>()).eval();
      Phi.bottomRows<3>() = (R_link.transpose() * Phi.bottomRows<3>()).eval();
      R = R * SO3{Eigen::Quaterniond(R_link)};
    }
    Phi.bottomRows<3>() /= rod_.momentUnit();
    shot.Phi[j] = Phi;
    if (j + 1 < count) {
      shot.defect[j] << (nodes[j + 1].R.inverse() * R).log(),
          (m - nodes[j + 1].m) / rod_.momentUnit();
    } else {
      shot.defect[j] << Vector3d::Zero(), m / rod_.momentUnit();
    }
    square += shot.defect[j].squaredNorm();
  }
  shot.nodes = std::move(nodes);
  if (std::isfinite(square)) shot.norm = std::sqrt(square);
  return shot;
}

// Rows P x_j = c that the steps x_j must satisfy so that everything beyond node j fits, propagated
// from the tip to the base. They are orthonormal, so that components that grow towards the tip
// decay in them.
MultipleShooting::Step MultipleShooting::newtonStep(const Shot& shot) const {
  using Rows = Eigen::Matrix<double, 3, 6>;
  const int count = rod_.segmentCount();
  std::vector<Rows> P(count);
  std::vector<Vector3d> c(count);
  Rows rows = Rows::Zero();
  rows.rightCols<3>().setIdentity();
  Vector3d right = Vector3d::Zero();
  Step step;
  for (int j = count - 1; j >= 0; --j) {
    right -= rows * shot.defect[j];
    step.unstable += unstableMotions(rows, shot.Phi[j]);
    const Eigen::HouseholderQR<Eigen::Matrix<double, 6, 3>> qr((rows * shot.Phi[j]).transpose());
    const Matrix3d L = qr.matrixQR().topRows<3>().triangularView<Eigen::Upper>().transpose();
    rows = (qr.householderQ() * Eigen::Matrix<double, 6, 3>::Identity()).transpose();
    right = L.triangularView<Eigen::Lower>().solve(right);
    P[j] = rows;
    c[j] = right;
  }
  step.x.assign(count, Vector6::Zero());
  step.x[0].tail<3>() = P[0].rightCols<3>().fullPivLu().solve(c[0]);
  for (int j = 1; j < count; ++j) {
    step.x[j] = shot.Phi[j - 1] * step.x[j - 1] + shot.defect[j - 1];
    step.x[j] -= P[j].transpose() * (P[j] * step.x[j] - c[j]);
  }
  return step;
}

std::vector<Node> MultipleShooting::moved(const std::vector<Node>& nodes, const Step& step,
                                          double factor) const {
  std::vector<Node> out = nodes;
  for (std::size_t j = 0; j < out.size(); ++j) {
    out[j].R = (nodes[j].R * SO3::exp(factor * step.x[j].head<3>())).normalized();
    out[j].m += factor * rod_.momentUnit() * step.x[j].tail<3>();
  }
  return out;
}

Balance MultipleShooting::balance(std::vector<Node> nodes, double share, bool damped,
                                  int& iterations) const {
  Balance out;
  Shot shot = shoot(std::move(nodes), share);
  while (std::isfinite(shot.norm)) {
    const Step step = newtonStep(shot);
    const double size = step.size();
    if (!std::isfinite(size)) return out;
    out.residual = size;
    if (size <= options_.tolerance) {
      out.found = step.unstable == 0 || (damped && !rod_.conservative());
      out.nodes = moved(shot.nodes, step, 1.0);
      return out;
    }
    if (iterations == options_.max_iterations || (!damped && size > kLargestStep)) return out;
    ++iterations;
    Shot next = shoot(moved(shot.nodes, step, 1.0), share);
    if (damped) {
      for (double factor = 0.5; !(next.norm < (1.0 - kLeastGain * factor) * shot.norm);
           factor *= 0.5) {
        if (factor < kShortestStep) return out;
        next = shoot(moved(shot.nodes, step, factor), share);
      }
    } else if (!(next.norm <= std::max(kContraction * shot.norm, kNoise * options_.tolerance))) {
      return out;
    }
    shot = std::move(next);
  }
  return out;
}

double MultipleShooting::residualOf(std::vector<Node> nodes, double share) const {
  const Shot shot = shoot(std::move(nodes), share);
  return std::isfinite(shot.norm) ? newtonStep(shot).size()
                                  : std::numeric_limits<double>::infinity();
}

}  // namespace helix_arm::statics
