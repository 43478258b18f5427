#include "conversions.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <optional>

#include "basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"

namespace helix_arm::ros_bridge {
namespace {

using basics::messageOf;
using control::Fault, control::Refusal;

constexpr double kShortest = 1e-3;       // a curve [m]
constexpr double kMostTipForce = 100.0;  // that a message may put on the tip [N]
// Senders round to a few digits; pieces and mean twist that differ by more are wrong [m, rad].
constexpr double kPieceTolerance = 1e-3;

std::string text(const Eigen::Vector3d& vector) {
  return messageOf("(", vector.x(), ", ", vector.y(), ", ", vector.z(), ")");
}

std::optional<Refusal> refusedFrame(const char* what, const std_msgs::Header& header,
                                    const std::string& base_frame) {
  const std::string& frame = header.frame_id;
  if (frame.empty() || frame == base_frame) return std::nullopt;
  return Refusal{Fault::kWrongFrame, std::string("the frame of ") + what + " is '" +
                                         basics::quoted(frame) + "'; transform it to '" +
                                         base_frame + "', or leave frame_id empty"};
}

// Fault of piece_twist; absent if it is valid.
std::optional<Refusal> faultOfPieces(const ArmShape& shape, int sections) {
  const auto most = static_cast<std::uint32_t>(model::kMaxPieces / sections);
  if (shape.pieces > most) {
    return Refusal{Fault::kOutOfRange,
                   messageOf(shape.pieces, " pieces per section; send at most ", most)};
  }
  if (shape.pieces <= 1 && shape.piece_twist.empty()) return std::nullopt;
  const std::size_t expected = shape.pieces <= 1 ? 0U : 6U * sections * shape.pieces;
  if (shape.piece_twist.size() != expected) {
    return Refusal{Fault::kWrongSize,
                   messageOf(shape.piece_twist.size(), " numbers in piece_twist for ", sections,
                             " sections of ", shape.pieces, " pieces; send ", expected,
                             ", and in `pieces` the number of pieces per section")};
  }
  for (std::size_t j = 0; j < expected; ++j) {
    const double value = shape.piece_twist[j];
    const std::string name = "piece_twist[" + std::to_string(j) + "] is " + std::to_string(value);
    if (!std::isfinite(value)) {
      return Refusal{Fault::kNotFinite, name + "; send finite v [m] and w [rad]"};
    }
    if (std::abs(value) > statics::kFarthestTarget) {
      return Refusal{Fault::kOutOfRange,
                     name + "; send v [m] and w [rad] of a size that an arm has"};
    }
  }
  return std::nullopt;
}

template <class Message, class Vector>
Message xyz(const Vector& vector) {
  Message msg;
  msg.x = vector.x();
  msg.y = vector.y();
  msg.z = vector.z();
  return msg;
}

}  // namespace

std_msgs::Header toHeaderMsg(const ros::Time& stamp, const std::string& frame) {
  std_msgs::Header out;
  out.stamp = stamp;
  out.frame_id = frame;
  return out;
}

geometry_msgs::Point toPointMsg(const Eigen::Vector3d& p) { return xyz<geometry_msgs::Point>(p); }

geometry_msgs::Vector3 toVectorMsg(const Eigen::Vector3d& vector) {
  return xyz<geometry_msgs::Vector3>(vector);
}

geometry_msgs::Quaternion toQuaternionMsg(const Eigen::Matrix3d& rotation) {
  const Eigen::Quaterniond q = Eigen::Quaterniond(rotation).normalized();
  auto msg = xyz<geometry_msgs::Quaternion>(q);
  msg.w = q.w();
  return msg;
}

geometry_msgs::Pose toPoseMsg(const lie::SE3& X) {
  geometry_msgs::Pose msg;
  msg.position = toPointMsg(X.translation);
  msg.orientation = toQuaternionMsg(X.rotation);
  return msg;
}

geometry_msgs::Transform toTransformMsg(const lie::SE3& X) {
  geometry_msgs::Transform msg;
  msg.translation = toVectorMsg(X.translation);
  msg.rotation = toQuaternionMsg(X.rotation);
  return msg;
}

lie::SE3 fromMsg(const geometry_msgs::Pose& pose) {
  const Eigen::Quaterniond q(pose.orientation.w, pose.orientation.x, pose.orientation.y,
                             pose.orientation.z);
  return {q.toRotationMatrix(), {pose.position.x, pose.position.y, pose.position.z}};
}

ArmShape toShapeMsg(const std_msgs::Header& header, const std::string& tier,
                    const model::Shape& shape, const Eigen::MatrixXd& covariance) {
  ArmShape msg;
  msg.header = header;
  msg.tier = tier;
  msg.sections = static_cast<std::uint32_t>(shape.sectionCount());
  msg.pieces = static_cast<std::uint32_t>(shape.piecesPerSection());
  if (msg.pieces > 1) {
    const model::Shape::Pieces& pieces = shape.pieces();
    msg.piece_twist.assign(pieces.data(), pieces.data() + pieces.size());
  }
  const model::Twists twists = shape.twists();
  msg.twist.assign(twists.data(), twists.data() + twists.size());
  // Symmetric, so the storage order does not matter.
  msg.twist_covariance.assign(covariance.data(), covariance.data() + covariance.size());
  msg.tip = toPoseMsg(model::tipPose(shape));
  return msg;
}

ArmShape toShapeMsg(const std_msgs::Header& header, const statics::TierChoice& choice,
                    const model::Shape& shape) {
  ArmShape msg = toShapeMsg(header, statics::nameOf(choice.setting.tier), shape);
  msg.order = static_cast<std::uint32_t>(choice.setting.order);
  msg.tier_reason = choice.reason;
  return msg;
}

const char* inverseWord(statics::InverseStatus status) {
  if (status == statics::InverseStatus::kReached) return "reached";
  return status == statics::InverseStatus::kUnreachable ? "unreachable" : "not_converged";
}

std::vector<std::string> namesAt(statics::Limit limit, const model::Arm& arm,
                                 const std::vector<statics::Limit>& limits) {
  std::vector<std::string> out;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    if (limits[static_cast<std::size_t>(i)] == limit) out.push_back(arm.actuator(i).name);
  }
  return out;
}

PressureArray toPressureMsg(const std_msgs::Header& header, const model::Arm& arm,
                            const model::InputRef& pressure) {
  PressureArray msg;
  msg.header = header;
  msg.name = arm.actuatorNames();
  msg.pressure.assign(pressure.data(), pressure.data() + pressure.size());
  return msg;
}

control::Checked<model::Shape> fromMsg(const ArmShape& shape, const model::Arm& arm,
                                       const std::string& base_frame) {
  const int sections = arm.sectionCount();
  const std::string& frame = shape.header.frame_id;
  if (!frame.empty() && frame != base_frame) {
    return Refusal{Fault::kWrongFrame, "its frame is '" + basics::quoted(frame) + "', not '" +
                                           base_frame +
                                           "': give both nodes the same ~frame_prefix"};
  }
  const auto checked = control::checkTwists(sections, shape.twist);
  if (const auto* refusal = std::get_if<Refusal>(&checked)) return *refusal;
  const auto& twists = std::get<model::Twists>(checked);
  if (const auto refusal = faultOfPieces(shape, sections)) return *refusal;
  if (!(twists.topRows<3>().colwise().norm().sum() > kShortest)) {
    return Refusal{Fault::kOutOfRange, "its curve is shorter than 1 mm; send the twists of an arm"};
  }
  if (shape.pieces <= 1) return model::shapeOf(arm, twists);
  const int pieces = static_cast<int>(shape.pieces);
  const model::Shape out(
      Eigen::Map<const model::Shape::Pieces>(shape.piece_twist.data(), 6, sections * pieces),
      pieces, arm.links());
  const double off = (out.twists() - twists).cwiseAbs().maxCoeff();
  if (off > kPieceTolerance) {
    return Refusal{Fault::kOutOfRange, "its pieces do not sum to the twists of its sections, " +
                                           std::to_string(off) +
                                           " m or rad off; send in `twist` the sums of the pieces"};
  }
  return out;
}

control::Checked<TipGoal> fromMsg(const TipTarget& target, const std::string& base_frame) {
  if (auto refusal = refusedFrame("the tip target", target.header, base_frame)) return *refusal;
  const auto& p = target.pose.position;
  const auto& q = target.pose.orientation;
  if (target.mode == TipTarget::POSITION) {
    const auto position = control::checkPosition({p.x, p.y, p.z});
    if (const auto* refusal = std::get_if<Refusal>(&position)) return *refusal;
    return TipGoal{false, {Eigen::Matrix3d::Identity(), std::get<Eigen::Vector3d>(position)}};
  }
  if (target.mode == TipTarget::POSE) {
    const auto pose = control::checkPose({p.x, p.y, p.z}, {q.w, q.x, q.y, q.z});
    if (const auto* refusal = std::get_if<Refusal>(&pose)) return *refusal;
    return TipGoal{true, std::get<lie::SE3>(pose)};
  }
  return Refusal{Fault::kUnknownMode, "mode " + std::to_string(target.mode) +
                                          " is not known; send 0 (POSITION) or 1 (POSE)"};
}

control::Checked<Eigen::Vector3d> fromMsg(const geometry_msgs::WrenchStamped& wrench,
                                          const std::string& base_frame) {
  if (auto refusal = refusedFrame("the force", wrench.header, base_frame)) return *refusal;
  const auto& f = wrench.wrench.force;
  const auto& t = wrench.wrench.torque;
  const Eigen::Vector3d force(f.x, f.y, f.z), torque(t.x, t.y, t.z);
  if (!force.allFinite()) {
    return Refusal{Fault::kNotFinite, "the force is " + text(force) + " N; send finite numbers"};
  }
  if (!torque.isZero(0)) {
    return Refusal{Fault::kOutOfRange, "the torque is " + text(torque) +
                                           " N m; send 0, since only a force acts on the tip"};
  }
  if (force.stableNorm() > kMostTipForce) {
    return Refusal{Fault::kOutOfRange, "the force is " + text(force) + " N; send at most " +
                                           std::to_string(std::lround(kMostTipForce)) + " N"};
  }
  return force;
}

}  // namespace helix_arm::ros_bridge
