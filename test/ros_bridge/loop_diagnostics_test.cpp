#include "ros_bridge/follow/loop_diagnostics.hpp"

#include <gtest/gtest.h>

#include "support/paper_arm.hpp"

namespace helix_arm::ros_bridge {
namespace {

using estimation::ObservationFault;

struct Stamped {
  ObservationFault fault;
  double lead;        // over the last reading [s]
  const char* words;  // what is told; empty if the stamp is not to blame
};

TEST(LoopDiagnostics, AWrongStampIsNamedUntilTheNextPicture) {
  const estimation::ArmFilter filter(statics::ArmModel(test::ringArm(test::helicalRing())), {});
  LoopDiagnostics pictures;
  EXPECT_EQ(pictures.wrongStamp(), "");
  const Stamped stamps[] = {
      {ObservationFault::kFuture, 1.004, "stamped 1.00 s after the last reading"},
      {ObservationFault::kNone, -0.05, ""},
      {ObservationFault::kTooOld, -1.06, "stamped 1.06 s before the last reading"},
      {ObservationFault::kOutlier, -0.05, ""},
      // The clock of the pressures is the one that is behind.
      {ObservationFault::kTooOld, 0.94, "stamped 0.94 s after the last reading"},
      {ObservationFault::kNotNewer, -0.5, ""},
  };
  for (const Stamped& stamp : stamps) {
    pictures.saw(100.0, stamp.lead, {stamp.fault, 0.0}, filter, true);
    const std::string& told = pictures.wrongStamp();
    EXPECT_NE(told.find(stamp.words), std::string::npos) << told;
    EXPECT_EQ(told.empty(), *stamp.words == '\0') << told;
    if (told.empty()) continue;
    EXPECT_NE(told.find(estimation::nameOf(stamp.fault)), std::string::npos) << told;
    EXPECT_NE(told.find("synchronise the clocks"), std::string::npos) << told;
  }
  EXPECT_EQ(pictures.accepted(), 1U);
  EXPECT_EQ(pictures.refused(), 5U);
}

}  // namespace
}  // namespace helix_arm::ros_bridge
