#include "inverse_task.hpp"

#include <algorithm>

#include "helix_arm/model/curve.hpp"

namespace helix_arm::model {

using lie::SE3;
using lie::Vector6;

InverseTask::InverseTask(const Arm& arm, double rotation_weight)
    : arm_(&arm), rotation_weight_(rotation_weight) {}

void InverseTask::setPosition(const Eigen::Vector3d& position) {
  kind_ = Kind::kPosition;
  rows_ = 3;
  pose_.translation = position;
}

void InverseTask::setPose(const SE3& pose) {
  kind_ = Kind::kPose;
  rows_ = 6;
  pose_ = pose;
}

void InverseTask::setTwists(const Twists& twists) {
  kind_ = Kind::kTwists;
  rows_ = 6 * arm_->sectionCount();
  twists_ = twists;
  pose_ = tipPose(twists);
}

void InverseTask::evaluate(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                           Eigen::MatrixXd& jacobian) const noexcept {
  if (kind_ == Kind::kTwists) return evaluateTwists(lengths, residual, jacobian);
  if (kind_ == Kind::kPosition && arm_->sectionCount() == 1)
    return evaluateSingleSection(lengths, residual, jacobian);
  evaluateTip(lengths, residual, jacobian);
}

// The common case without the general chain: one set of coefficients gives the tip and its
// derivative.
void InverseTask::evaluateSingleSection(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                                        Eigen::MatrixXd& jacobian) const noexcept {
  const auto& map = arm_->equilibrium(0).map;
  const int n = arm_->actuatorCount();
  Vector6 g = Vector6::Zero();
  for (int i = 0; i < n; ++i) g += map.col(i) * lengths[i];
  const Eigen::Matrix<double, 3, 6> J = SE3::translationJacobian(g);
  residual.head<3>() = J.leftCols<3>() * g.head<3>() - pose_.translation;  // dp/dv = V, and p = V v
  for (int i = 0; i < n; ++i) jacobian.col(i).head<3>() = J.lazyProduct(map.col(i));
}

void InverseTask::evaluateTip(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                              Eigen::MatrixXd& jacobian) const noexcept {
  const Twists g = arm_->twistsOfLengths(lengths);
  const SE3 tip = tipPose(g);
  residual.head<3>() = tip.translation - pose_.translation;
  Eigen::Matrix3d of_rotation = Eigen::Matrix3d::Zero();
  if (kind_ == Kind::kPose) {
    // phi = log(R*' R); a body rotation d changes it by Jr(phi)^-1 d.
    Vector6 phi = SE3{pose_.rotation.transpose() * tip.rotation, Eigen::Vector3d::Zero()}.log();
    residual.segment<3>(3) = rotation_weight_ * phi.tail<3>();
    of_rotation = rotation_weight_ * SE3::rightJacobianInverse(phi).bottomRightCorner<3, 3>();
  }
  // Body motion of the tip when section k's twist changes: Ad(X_{k+1} .. X_n)^-1 Jr(g_k).
  SE3 after;
  for (int k = arm_->sectionCount() - 1; k >= 0; --k) {
    const lie::Matrix6 body = after.inverse().adjoint() * SE3::rightJacobian(g.col(k));
    const auto& map = arm_->equilibrium(k).map;
    for (int i = 0; i < map.cols(); ++i) {
      const Vector6 motion = body * map.col(i);
      auto column = jacobian.col(arm_->firstActuator(k) + i);
      column.head<3>() = tip.rotation * motion.head<3>();
      if (kind_ == Kind::kPose) column.segment<3>(3) = of_rotation * motion.tail<3>();
    }
    after = SE3::exp(g.col(k)) * after;
  }
}

void InverseTask::evaluateTwists(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                                 Eigen::MatrixXd& jacobian) const noexcept {
  const Twists g = arm_->twistsOfLengths(lengths);
  jacobian.topRows(rows_).setZero();
  for (int k = 0; k < arm_->sectionCount(); ++k) {
    residual.segment<6>(6 * k) = g.col(k) - twists_.col(k);
    residual.segment<3>(6 * k + 3) *= rotation_weight_;
    const auto& map = arm_->equilibrium(k).map;
    auto block = jacobian.block(6 * k, arm_->firstActuator(k), 6, map.cols());
    block = map;
    block.bottomRows<3>() *= rotation_weight_;
  }
}

double InverseTask::positionError(const Eigen::VectorXd& lengths) const noexcept {
  return (tipPose(arm_->twistsOfLengths(lengths)).translation - pose_.translation).norm();
}

double InverseTask::squaredErrorOfTip(const SE3& tip) const noexcept {
  double error = (tip.translation - pose_.translation).squaredNorm();
  if (kind_ == Kind::kPose) {
    // |R - R*|_F^2 / 2 is the square of the angle to first order: good enough to rank starts by.
    error +=
        0.5 * rotation_weight_ * rotation_weight_ * (tip.rotation - pose_.rotation).squaredNorm();
  }
  return error;
}

}  // namespace helix_arm::model
