#include <Eigen/Geometry>

#include <gtest/gtest.h>

#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "support/table_faults.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::io {
namespace {

const std::string kHeader = "capture,pressure_1_kpa,pressure_2_kpa,tag,x_m,y_m,z_m,qx,qy,qz,qw\n";

std::vector<TagPoseCapture> load(const std::string& text, const lie::SE3& X_BF = {}) {
  return loadTagPoses(loadDataSet(test::TemporaryFile(text).path()), 2, X_BF);
}

std::string faultsOf(const std::string& text) {
  return test::tableFaults(
      text, [](const std::string& path) { loadTagPoses(loadDataSet(path), 2, lie::SE3()); });
}

TEST(TagPoses, RowsOfACaptureBelongTogetherWhereverTheyStand) {
  const auto captures = load("# comment\n" + kHeader +
                             "7,10,20,3,0.1,0.2,0.3,0,0,0,1\n"
                             "2,0,5,3,0,0,0,1,0,0,0\n"
                             "7,10,20,0,-0.1,0,0,0,0,0.6,0.8\n");
  ASSERT_EQ(captures.size(), 2u);
  EXPECT_EQ(captures[0].number, 7);
  EXPECT_EQ(captures[1].number, 2);
  EXPECT_EQ(captures[0].pressure, Eigen::VectorXd(Eigen::Vector2d(10e3, 20e3)));
  EXPECT_EQ(captures[1].pressure, Eigen::VectorXd(Eigen::Vector2d(0, 5e3)));
  ASSERT_EQ(captures[0].tags.size(), 2u);
  ASSERT_EQ(captures[1].tags.size(), 1u);
  EXPECT_EQ(captures[0].tags[0].id, 3);
  EXPECT_EQ(captures[0].tags[1].id, 0);
  EXPECT_EQ(captures[0].tags[1].line, 5);
  EXPECT_EQ(captures[0].tags[0].X_BT.translation, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(captures[0].tags[0].X_BT.rotation, Eigen::Matrix3d::Identity());
  // cos and sin of half the angle about z.
  Eigen::Matrix3d turned;
  turned << 0.28, -0.96, 0, 0.96, 0.28, 0, 0, 0, 1;
  EXPECT_LT((captures[0].tags[1].X_BT.rotation - turned).norm(), 1e-15);
}

TEST(TagPoses, RoundedQuaternionsAreNormalised) {
  const auto captures = load(kHeader + "1,0,0,3,0,0,0,0,0,0.71,0.71\n");
  const Eigen::Matrix3d& R = captures[0].tags[0].X_BT.rotation;
  EXPECT_LT((R * R.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-15);
}

TEST(TagPoses, AreConvertedToTheBaseFromAnyFrame) {
  // F is turned by 90 degrees about the base's z axis: its x axis is the base's y axis.
  Eigen::Matrix3d R;
  R << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  const auto captures = load(kHeader + "1,0,0,3,0.3,0.2,0.1,0,0,0,1\n", {R, {1, 2, 3}});
  const lie::SE3& X_BT = captures[0].tags[0].X_BT;
  EXPECT_LT((X_BT.translation - Eigen::Vector3d(0.8, 2.3, 3.1)).norm(), 1e-15);
  EXPECT_LT((X_BT.rotation - R).norm(), 1e-15);
}

TEST(TagPoses, AllFaultsAreReportedWithTheirLines) {
  EXPECT_EQ(
      faultsOf(kHeader + "1,0,0,3,0,0,0,0,0,0,1\n"
                         "1,0,0,3,0,0,0,0,0,0,1\n"
                         "1,0,5,4,0,0,0,0,0,0,1\n"
                         "1.5,0,0,4,0,0,0,0,0,0,1\n"
                         "2,0,0,-1,0,0,0,0,0,0,1\n"
                         "2,0,0,5,0,0,0,0,0,0,0.5\n"
                         "2,0,0,6,0,0,0,0,0,0,0\n"),
      ":3 measures the tag of line 2 again in the same capture; expected it once\n:4 has other "
      "pressures than its capture; expected those of line 2\n:5 capture is not a whole number from "
      "0 to 1000000000\n:6 tag is not a whole number from 0 to 1000000000\n:7 has a quaternion qx, "
      "qy, qz, qw that is not of norm 1\n:8 has a quaternion qx, qy, qz, qw that is not of norm 1");
}

TEST(TagPoses, MissingColumnsAreNamed) {
  const std::string expected =
      "; expected capture, pressure_1_kpa .., tag, x_m, y_m, z_m, qx, qy, qz, qw";
  EXPECT_EQ(faultsOf("capture,pressure_1_kpa,tag,x_m,y_m,qx,qy,qz\n1,0,3,0,0,0,0,0\n"),
            " has no column z_m, qw" + expected);
  EXPECT_EQ(faultsOf("capture,tag,x_m,y_m,z_m,qx,qy,qz,qw\n1,3,0,0,0,0,0,0,1\n"),
            " has no pressures; expected columns pressure_1_kpa to pressure_2_kpa");
}

}  // namespace
}  // namespace helix_arm::io
