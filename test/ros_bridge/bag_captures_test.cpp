// Captures that are taken from a recording.
#include "bag/bag_captures.hpp"

#include <fstream>

#include <geometry_msgs/PoseStamped.h>
#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <sys/wait.h>

#include "helix_arm/PressureArray.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/io/scene.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "support/has.hpp"
#include "support/random.hpp"
#include "support/refusal.hpp"
#include "support/shipped_scene.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_size.hpp"

namespace helix_arm::ros_bridge {
namespace {

using test::demo;

// A recording of an arm that is at once where it is commanded to: pressures at 50 Hz, pictures at
// 10 Hz, written a picture's time after they were taken.
class Recording {
 public:
  explicit Recording(const std::string& path) : path_(path), bag_(path, rosbag::bagmode::Write) {}

  void play(const Eigen::Vector3d& pressure, double seconds, bool commanded) {
    for (int k = 0; k < static_cast<int>(50 * seconds); ++k) {
      time_ += ros::Duration(0.02);
      std_msgs::Header header;
      header.stamp = time_;
      PressureArray message;
      message.header = header;
      for (int i = 0; i < pressure.size(); ++i) {
        message.name.push_back(scene_.arm.actuator(i).name);
        message.pressure.push_back(pressure[i]);
      }
      write("/pressure_measured", message, 0);
      if (commanded) write("/pressure_command", message, 0);
      if (++tick_ % 5 == 0) write("/tag_detections", detections(header, pressure), 0.1);
    }
  }

  // The corners of two tags of the scene, one that is not, and one that is seen twice.
  static TagDetections detections(const std_msgs::Header& header, const Eigen::Vector3d& pressure) {
    TagDetections out;
    out.header = header;
    for (const int id : {3, 8, 12, 400}) {
      TagDetection tag;
      tag.id = id;
      tag.known = id != 400;
      tag.repeated = id == 12;
      for (int c = 0; c < 8; ++c) tag.corners[c] = 100 + c + id + 1e-3 * pressure[0];
      out.tags.push_back(tag);
    }
    return out;
  }

  template <class Message>
  void write(const std::string& topic, const Message& message, double late) {
    bag_.write(topic, time_ + ros::Duration(late), message);
  }
  const std::string& close() {
    bag_.close();
    return path_;
  }

 private:
  const io::Scene scene_ = demo();
  std::string path_;
  rosbag::Bag bag_;
  ros::Time time_{1000, 0};
  int tick_ = 0;
};

TEST(BagCaptures, AreTakenWheneverTheArmIsAtRest) {
  const test::TemporaryFolder folder;
  for (const bool commanded : {true, false}) {
    Recording recording(folder / (commanded ? "with.bag" : "without.bag"));
    recording.play({0, 0, 0}, 3, commanded);
    recording.play({3e5, 0, 0}, 0.5, commanded);  // too short to settle
    recording.play({1e5, 2e5, 0}, 3, commanded);
    const auto samples = loadBag(recording.close(), demo(), {});
    ASSERT_EQ(samples.size(), 2u);
    EXPECT_LT(samples[0].pressure.norm(), 1e-6);
    EXPECT_LT((samples[1].pressure - Eigen::Vector3d(1e5, 2e5, 0)).norm(), 1e-6);
    ASSERT_EQ(samples[1].tags.size(), 2u);
    EXPECT_EQ(samples[1].tags[0].id, 3);
    EXPECT_EQ(samples[1].tags[1].id, 8);
    EXPECT_NEAR(samples[1].tags[0].corners(1, 3), 100 + 7 + 3 + 1e2, 1e-9);
  }
}

// A recording of a motion-capture system's own topics, at 50 Hz: the second body's poses come 3 ms
// later. Pressures are in a table whose clock is 40 s behind.
class BodyRecording {
 public:
  explicit BodyRecording(const test::TemporaryFolder& folder)
      : table_(folder / "pressures.csv"),
        path_(folder / "poses.bag"),
        bag_(path_, rosbag::bagmode::Write) {
    table_ << "time_s,pressure_1_kpa,pressure_2_kpa,pressure_3_kpa\n";
  }

  const io::Scene& scene() const { return scene_; }

  // @return the poses, seen from the arm's base.
  std::vector<lie::SE3> hold(const Eigen::Vector3d& pressure, double seconds) {
    const auto places = estimation::tagPoses(*scene_.tags, scene_.model.solve(pressure).shape);
    for (int k = 0; k < 50 * seconds; ++k) {
      time_ += ros::Duration(0.02);
      for (std::size_t i = 0; i < places.size(); ++i) {
        geometry_msgs::PoseStamped message;
        message.header.stamp = time_ + ros::Duration(i == 1 ? 0.003 : 0.0);
        message.pose = toPoseMsg(scene_.X_CB() * places[i]);
        bag_.write("/vrpn_client_node/" + scene_.tags->tags[i].name + "/pose", time_, message);
      }
      table_ << time_.toSec() - 40;
      for (const double value : pressure) table_ << "," << 1e-3 * value;
      table_ << "\n";
    }
    return places;
  }

  const std::string& close() {
    bag_.close();
    table_.close();
    return path_;
  }

 private:
  const io::Scene scene_ = test::shippedScene("mocap");
  std::ofstream table_;
  std::string path_;
  rosbag::Bag bag_;
  ros::Time time_{1000, 0};
};

TEST(BagCaptures, PosesOfAMotionCaptureSystemAreTakenFromItsOwnTopics) {
  const test::TemporaryFolder folder;
  BodyRecording recording(folder);
  const io::Scene& scene = recording.scene();
  recording.hold({0, 0, 0}, 3);
  recording.hold({2e5, 0, 0}, 0.5);  // too short to rest
  const std::vector<lie::SE3> truth = recording.hold({1e5, 2e5, 0}, 3);
  const procedures::CalibrationData data =
      loadMeasurements(scene, {recording.close()}, {}, {folder / "pressures.csv", std::nullopt});
  ASSERT_EQ(data.captures.size(), 2U);
  EXPECT_LT((data.captures[1].pressure - Eigen::Vector3d(1e5, 2e5, 0)).norm(), 1e-3);
  const auto& poses = std::get<std::vector<estimation::PoseObservation>>(data.captures[1].reading);
  ASSERT_EQ(poses.size(), truth.size());
  for (const estimation::PoseObservation& one : poses) {
    EXPECT_LT((one.X_BT.inverse() * truth.at(static_cast<std::size_t>(one.tag))).log().norm(),
              1e-9);
  }
  ASSERT_FALSE(data.warnings.empty());
  EXPECT_NE(data.warnings[0].find("40.0"), std::string::npos) << data.warnings[0];
}

TEST(BagCaptures, MissingTopicsAndAnotherArmAreNamed) {
  const test::TemporaryFolder folder;
  Recording empty(folder / "empty.bag"), other(folder / "other.bag");
  other.play({0, 0, 0}, 1, true);
  PressureArray foreign;
  foreign.name = {"bellows"};
  foreign.pressure = {1e5};
  other.write("/pressure_measured", foreign, 0);
  for (const auto& [path, words] : {std::pair{empty.close(), "tag_detections is missing"},
                                    std::pair{other.close(), "not of this arm"}}) {
    const std::string& bag = path;
    EXPECT_TRUE(
        test::has(test::refusal<io::DocumentError>([&] { loadBag(bag, demo(), {}); }), words));
  }
}

// A node loads recordings beside an arm: no damage ends it, or leaves a process behind.
TEST(DamagedBags, NeverEndWhoLoadsThem) {
  const test::TemporaryFolder folder;
  Recording recording(folder / "sound.bag");
  recording.play({0, 0, 0}, 3, true);
  const std::string sound = test::contentOf(recording.close()), path = folder / "damaged.bag";
  test::Random random(19);
  int refused = 0;
  for (int i = 0; i < test::draws(6, 100); ++i) {
    std::string bytes = sound;
    if (i % 2 == 0) bytes.resize(random.integer(6000, static_cast<int>(sound.size()) - 1));
    for (int k = 0; k < 20; ++k) {
      bytes[random.integer(0, 5999)] = static_cast<char>(random.integer(0, 255));
    }
    std::ofstream(path, std::ios::binary) << bytes;
    refused += test::refusal<io::DocumentError>([&] { loadBag(path, demo(), {}); }) != "accepted";
  }
  EXPECT_GT(refused, 0);
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
}

}  // namespace
}  // namespace helix_arm::ros_bridge
