#include <algorithm>

#include <gtest/gtest.h>

#include "ros_bridge/names.hpp"
#include "ros_bridge/follow/loop_publisher.hpp"

namespace helix_arm::ros_bridge {
namespace {

using visualization_msgs::Marker;

LoopMarkers::Tips sample() {
  LoopMarkers::Tips out;
  out.wanted = Eigen::Vector3d(0.4, 0.1, 0);
  out.predicted = Eigen::Vector3d(0.4, 0, 0);
  out.covariance = Eigen::Vector3d(1e-6, 4e-6, 9e-6).asDiagonal();
  out.text = "closed, 0.20 mm";
  out.budget = "0.20 mm camera\ninside";
  return out;
}

Marker drawn(const LoopMarkers::Tips& tips, const std::string& ns) {
  Eigen::Matrix3d R_WB;  // it hangs
  R_WB << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  const SideView view = seenFrom(R_WB, sideView(R_WB.col(0), 0.3, 0.03));
  const auto array = LoopMarkers("arm_base", 1.0).draw(ros::Time(5), view, tips);
  for (const Marker& marker : array.markers) {
    if (marker.ns == ns) return marker;
  }
  ADD_FAILURE() << "no marker " << ns;
  return {};
}

TEST(LoopMarkers, TheBudgetIsATableBesideTheEllipsoid) {
  const Marker table = drawn(sample(), names::kErrorBudgetNs);
  EXPECT_EQ(table.action, Marker::ADD);
  EXPECT_EQ(table.type, Marker::TEXT_VIEW_FACING);
  EXPECT_EQ(table.text, sample().budget);
  EXPECT_EQ(table.header.frame_id, "arm_base");
  const Marker ellipsoid = drawn(sample(), names::kPredictedCovarianceNs);
  EXPECT_NEAR(ellipsoid.scale.x + ellipsoid.scale.y + ellipsoid.scale.z, 4 * (1 + 2 + 3) * 1e-3,
              1e-9);
  EXPECT_GT(table.pose.position.y - ellipsoid.pose.position.y, ellipsoid.scale.y);
  EXPECT_NE(table.pose.position.y, drawn(sample(), names::kLoopStateNs).pose.position.y);
}

// The same markers draw an arm that is mounted otherwise.
TEST(LoopMarkers, TheStateIsBelowTheTipAlsoOnceTheArmIsMountedOtherwise) {
  const LoopMarkers markers("arm_base", 1.0);
  Eigen::Matrix3d hangs, rolled;
  hangs << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  rolled << 0, 0, 1, 1, 0, 0, 0, 1, 0;  // runs along y
  for (const Eigen::Matrix3d& R_WB : {hangs, rolled, hangs}) {
    const SideView view = seenFrom(R_WB, sideView(R_WB.col(0), 0.3, 0.03));
    const auto array = markers.draw(ros::Time(5), view, sample());
    const auto state =
        std::find_if(array.markers.begin(), array.markers.end(),
                     [](const Marker& marker) { return marker.ns == names::kLoopStateNs; });
    ASSERT_NE(state, array.markers.end());
    const auto& at = state->pose.position;
    const Eigen::Vector3d beyond = R_WB * (Eigen::Vector3d(at.x, at.y, at.z) - *sample().predicted);
    EXPECT_LT(beyond.z(), -0.01);
    EXPECT_LT(beyond.head<2>().norm(), 1e-12);
  }
}

TEST(LoopMarkers, ABudgetThatIsContradictedHasAnotherColour) {
  LoopMarkers::Tips tips = sample();
  tips.outside = true;
  EXPECT_NE(drawn(tips, names::kErrorBudgetNs).color.r,
            drawn(sample(), names::kErrorBudgetNs).color.r);
}

TEST(LoopMarkers, WhatIsAbsentIsRemoved) {
  LoopMarkers::Tips tips = sample();
  tips.budget.clear();
  EXPECT_EQ(drawn(tips, names::kErrorBudgetNs).action, Marker::DELETE);
  EXPECT_EQ(drawn(tips, names::kLoopStateNs).action, Marker::ADD);
  EXPECT_EQ(drawn(tips, names::kTipForceNs).action, Marker::DELETE);
  tips = sample();
  tips.predicted.reset();
  for (const char* ns : {names::kErrorBudgetNs, names::kLoopStateNs, names::kPredictedTipNs,
                         names::kPredictedCovarianceNs}) {
    EXPECT_EQ(drawn(tips, ns).action, Marker::DELETE) << ns;
  }
  EXPECT_EQ(drawn(tips, names::kWantedTipNs).action, Marker::ADD);
}

}  // namespace
}  // namespace helix_arm::ros_bridge
