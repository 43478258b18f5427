#pragma once

#include <kdl/chain.hpp>

namespace helix_arm::benchmark {

/// A six-joint industrial arm (the PUMA 560's Denavit-Hartenberg table): what the peer library's
/// solvers are made for.
inline KDL::Chain sixJointRobot() {
  constexpr double kQuarterTurn = 1.5707963267948966;
  const KDL::Joint joint(KDL::Joint::RotZ);
  KDL::Chain chain;
  chain.addSegment(KDL::Segment(joint, KDL::Frame::DH(0.0, kQuarterTurn, 0.0, 0.0)));
  chain.addSegment(KDL::Segment(joint, KDL::Frame::DH(0.4318, 0.0, 0.0, 0.0)));
  chain.addSegment(KDL::Segment(joint, KDL::Frame::DH(0.0203, -kQuarterTurn, 0.15005, 0.0)));
  chain.addSegment(KDL::Segment(joint, KDL::Frame::DH(0.0, kQuarterTurn, 0.4318, 0.0)));
  chain.addSegment(KDL::Segment(joint, KDL::Frame::DH(0.0, -kQuarterTurn, 0.0, 0.0)));
  chain.addSegment(KDL::Segment(joint, KDL::Frame::DH(0.0, 0.0, 0.0563, 0.0)));
  return chain;
}

}  // namespace helix_arm::benchmark
