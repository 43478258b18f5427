// Recordings of bodies as motion-capture systems write them, with pressures of another clock.
#include "procedures/body_recording.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "simulation/bodies.hpp"
#include "simulation/rig.hpp"
#include "support/has.hpp"
#include "support/shipped_scene.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::procedures {
namespace {

constexpr double kPoseRate = 100, kReadingRate = 50;  // [Hz]
constexpr double kOffset = -37.4;  // clock of the bodies less that of the readings
const std::vector<Eigen::Vector3d> kSteps = {{0, 0, 0},         {2e5, 0, 0},     {2e5, 1.5e5, 0},
                                             {0, 1.5e5, 2.5e5}, {1e5, 0, 2.5e5}, {0, 0, 0}};
constexpr double kHold = 3.0;  // of each step [s]

// Poses of the three bodies over time, as recorded.
struct Recording {
  std::vector<double> time;
  std::vector<std::vector<estimation::BodyPose>> poses;
  std::string pressures;  // table, on its own clock
};

Recording recorded(const io::Scene& scene) {
  simulation::SimulatedRig rig(scene.model, {}, {});
  simulation::SimulatedBodies bodies(scene.view(), {});
  Recording out;
  std::ostringstream table;
  table << "time_s,pressure_1_kpa,pressure_2_kpa,pressure_3_kpa\n";
  const double step = 1 / kPoseRate;
  for (int k = 0; k < static_cast<int>(kPoseRate * kHold) * static_cast<int>(kSteps.size()); ++k) {
    const double time = k * step;
    rig.command(kSteps[static_cast<std::size_t>(time / kHold)]);
    rig.step(step);
    out.time.push_back(time);
    out.poses.push_back(bodies.see(rig.shape()));
    if (k % static_cast<int>(kPoseRate / kReadingRate) != 0) continue;
    table << time - kOffset;
    for (const double p : rig.measure()) table << "," << 1e-3 * p;
    table << "\n";
  }
  out.pressures = table.str();
  return out;
}

class BodyRecording : public ::testing::Test {
 protected:
  io::DataSet read(const std::string& text, std::optional<double> offset = std::nullopt) {
    const test::TemporaryFile file(text, ".csv"), pressures(recording_.pressures, ".csv");
    notes_.clear();
    return measurementsOf(scene_, file.path(), {pressures.path(), offset}, notes_);
  }
  // Rows of the file, each with the cells of the bodies behind `lead`.
  std::string rows(const std::function<void(std::ostream&, std::size_t)>& lead,
                   const std::function<void(std::ostream&, const lie::SE3&)>& cells) const {
    std::ostringstream out;
    out.precision(9);
    for (std::size_t k = 0; k < recording_.time.size(); ++k) {
      lead(out, k);
      for (const estimation::BodyPose& one : recording_.poses[k]) cells(out, one.X_CM);
      out << "\n";
    }
    return out.str();
  }
  std::string table() const {
    std::string head = "# recorded\ntime_s";
    for (const char* name : {"frame", "middle", "tip"}) {
      for (const char* column : {"_x_m", "_y_m", "_z_m", "_qx", "_qy", "_qz", "_qw"}) {
        head += "," + (name + std::string(column));
      }
    }
    return head + "\n" +
           rows([&](auto& out, auto k) { out << recording_.time[k]; },
                [](auto& out, const lie::SE3& X) {
                  const Eigen::Quaterniond q(X.rotation);
                  for (const double one : X.translation) out << "," << one;
                  for (const double one : q.coeffs()) out << "," << one;
                });
  }
  // One capture for each step, at its pressures, with the bodies where they were.
  void expectSteps(const io::DataSet& data) {
    const auto captures = io::loadTagPoses(data, 3, scene_.X_BF);
    ASSERT_EQ(captures.size(), kSteps.size());
    for (std::size_t k = 0; k < captures.size(); ++k) {
      EXPECT_LT((captures[k].pressure - kSteps[k]).cwiseAbs().maxCoeff(), 2e3) << k;
      const auto truth = estimation::tagPoses(*scene_.tags, scene_.model.solve(kSteps[k]).shape);
      ASSERT_EQ(captures[k].tags.size(), truth.size());
      for (std::size_t i = 0; i < truth.size(); ++i) {
        const lie::SE3 error = truth[i].inverse() * captures[k].tags[i].X_BT;
        EXPECT_LT(error.translation.norm(), 0.0015) << k << ", " << i;
        EXPECT_LT(Eigen::AngleAxisd(error.rotation).angle(), 0.02) << k << ", " << i;
      }
    }
  }

  const io::Scene scene_ = test::shippedScene("mocap");
  const Recording recording_ = recorded(scene_);
  std::vector<std::string> notes_;
};

TEST_F(BodyRecording, TheClocksAreFoundAndTold) {
  expectSteps(read(table()));
  ASSERT_EQ(notes_.size(), 1U);
  EXPECT_TRUE(test::has(notes_[0], "--offset-s -37."));
  expectSteps(read(table(), kOffset));
  EXPECT_TRUE(notes_.empty());
}

TEST_F(BodyRecording, AnExportOfMotive) {
  std::string names = ",Name", ids = ",ID", kinds = ",", axes = "Frame,Time (Seconds)",
              types = ",Type";
  for (const char* name : {"frame", "middle", "tip"}) {
    for (const char* axis : {"X", "Y", "Z", "W", "X", "Y", "Z"}) {
      names += "," + std::string(name);
      ids += ",123";
      types += ",Rigid Body";
      axes += "," + std::string(axis);
    }
    kinds += ",Rotation,Rotation,Rotation,Rotation,Position,Position,Position";
  }
  const std::string head =
      "Format Version,1.23,Take Name,Take 1,Capture Frame Rate,100,Rotation Type,Quaternion,Length "
      "Units,Millimeters,Coordinate Space,Global\n\n" +
      types + "\n" + names + "\n" + ids + "\n" + kinds + "\n" + axes + "\n";
  expectSteps(read(head + rows([&](auto& out, auto k) { out << k << "," << recording_.time[k]; },
                               [](auto& out, const lie::SE3& X) {
                                 const Eigen::Quaterniond q(X.rotation);
                                 for (const double one : q.coeffs()) out << "," << one;
                                 for (const double one : X.translation) out << "," << 1e3 * one;
                               })));
}

TEST_F(BodyRecording, AnExportOfVicon) {
  const std::string head =
      "Objects\n100\n,,Lab:frame,,,,,,Lab:middle,,,,,,Lab:tip,,,,,\n"
      "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ,RX,RY,RZ,TX,TY,TZ,RX,RY,RZ,TX,TY,TZ\n"
      ",,deg,deg,deg,mm,mm,mm,deg,deg,deg,mm,mm,mm,deg,deg,deg,mm,mm,mm\n";
  expectSteps(read(head + rows([](auto& out, auto k) { out << k << ",0"; },
                               [](auto& out, const lie::SE3& X) {
                                 const Eigen::AngleAxisd turn(X.rotation);
                                 const Eigen::Vector3d r = 180 / M_PI * turn.angle() * turn.axis();
                                 for (const double one : r) out << "," << one;
                                 for (const double one : X.translation) out << "," << 1e3 * one;
                               })));
}

TEST_F(BodyRecording, LostBodiesAreEmptyCells) {
  std::string text = table();
  // The last body is lost in every third row.
  std::istringstream in(text);
  std::string changed;
  int k = 0;
  for (std::string line; std::getline(in, line); ++k) {
    if (k > 2 && k % 3 == 0) {
      std::size_t at = line.size();
      for (int cell = 0; cell < 7; ++cell) at = line.rfind(',', at - 1);
      line = line.substr(0, at) + ",,,,,,,";
    }
    changed += line + "\n";
  }
  expectSteps(read(changed, kOffset));
}

TEST_F(BodyRecording, FaultsAreNamed) {
  const auto refusal = [this](const std::string& text, std::optional<double> offset) {
    try {
      read(text, offset);
    } catch (const io::DocumentError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_TRUE(test::has(refusal(table(), 1e4), "the arm is never at rest"));
  // Bodies that do not move as the pressures do.
  std::ostringstream still;
  still << "time_s,frame_x_m,frame_y_m,frame_z_m,middle_x_m,middle_y_m,middle_z_m,tip_x_m,tip_y_m,"
           "tip_z_m\n";
  for (int k = 0; k < 1000; ++k) {
    still << 0.01 * k;
    for (int i = 0; i < 9; ++i) still << "," << 1e-3 * ((7919 * k + 104729 * i) % 1000);
    still << "\n";
  }
  EXPECT_TRUE(test::has(refusal(still.str(), std::nullopt), "moves at no time as the pressures"));
}

}  // namespace
}  // namespace helix_arm::procedures
