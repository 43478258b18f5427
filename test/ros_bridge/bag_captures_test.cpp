// What is taken from a recording; and none, however damaged, ends the process that loads it.
#include "bag/bag_captures.hpp"

#include <fstream>

#include <geometry_msgs/PoseStamped.h>
#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <sensor_msgs/JointState.h>
#include <sys/stat.h>
#include <sys/wait.h>

#include "helix_arm/BodyPoses.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/io/scene.hpp"
#include "io/document/atomic_file.hpp"
#include "ros_bridge/common/conversions.hpp"
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

  void play(const Eigen::Vector3d& pressure, double seconds, bool commanded = true,
            const std::string& ns = "") {
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
      write(ns + "/pressure_measured", message, 0);
      if (commanded) write(ns + "/pressure_command", message, 0);
      if (++tick_ % 5 == 0) write(ns + "/tag_detections", detections(header, pressure), 0.1);
    }
  }

  // The same with poses of bodies at the end of each part.
  void playWith(const Eigen::Vector3d& pressure, double seconds, BodyPoses bodies) {
    play(pressure, seconds);
    bodies.header.stamp = time_;
    write("/body_poses", bodies, 0.01);
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

std::string faultOf(const std::string& path) {
  static const io::Scene scene = demo();
  return test::refusal<io::DocumentError>([&] { loadBag(path, scene, {}); });
}

TEST(BagCaptures, AreTakenWheneverTheArmIsAtRest) {
  const test::TemporaryFolder folder;
  for (const bool commanded : {true, false}) {
    Recording recording(folder / (commanded ? "with.bag" : "without.bag"));
    recording.play({0, 0, 0}, 3, commanded);
    recording.play({3e5, 0, 0}, 0.5, commanded);  // too short to settle
    recording.play({1e5, 2e5, 0}, 3, commanded, "");
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

TEST(BagCaptures, AreDataLikeAnyOtherAndCountOn) {
  const test::TemporaryFolder folder;
  std::vector<std::string> paths;
  for (const double pressure : {1e5, 2e5}) {
    Recording recording(folder / (std::to_string(paths.size()) + ".bag"));
    recording.play({0, 0, 0}, 3);
    recording.play({pressure, 0, 0}, 3);
    paths.push_back(recording.close());
  }
  const procedures::CalibrationData data = loadMeasurements(demo(), paths, {});
  ASSERT_EQ(data.captures.size(), 4u);
  for (int i = 0; i < 4; ++i) EXPECT_EQ(data.captures[i].number, i + 1);
  EXPECT_NEAR(data.captures[3].pressure[0], 2e5, 1e-6);
  ASSERT_EQ(data.sources.size(), 2u);
  EXPECT_EQ(data.sources[1].file, paths[1]);
  EXPECT_EQ(data.sources[1].captures, 2);
  EXPECT_NE(data.sources[0].sha256, data.sources[1].sha256);
  ASSERT_EQ(data.warnings.size(), 1u);
  EXPECT_NE(data.warnings[0].find(paths[1]), std::string::npos);
}

TEST(BagCaptures, BodiesAreCapturedWithTheirPoses) {
  const io::Scene scene = test::shippedScene("mocap");
  const test::TemporaryFolder folder;
  Recording recording(folder / "bodies.bag");
  const auto hold = [&](const Eigen::Vector3d& pressure) {
    const auto places = estimation::tagPoses(*scene.tags, scene.model.solve(pressure).shape);
    for (int k = 0; k < 30; ++k) {
      BodyPoses seen;
      for (std::size_t i = 0; i < places.size(); ++i) {
        seen.name.push_back(scene.tags->tags[i].name);
        seen.pose.push_back(toPoseMsg(scene.X_CB() * places[i]));
      }
      recording.playWith(pressure, 0.1, seen);
    }
    return places;
  };
  hold({0, 0, 0});
  const std::vector<lie::SE3> truth = hold({1e5, 2e5, 0});
  const std::string& path = recording.close();
  const procedures::CalibrationData data = loadMeasurements(scene, {path}, {});
  ASSERT_EQ(data.captures.size(), 2U);
  const auto& poses = std::get<std::vector<estimation::PoseObservation>>(data.captures[1].reading);
  ASSERT_EQ(poses.size(), truth.size());
  for (const estimation::PoseObservation& one : poses) {
    EXPECT_LT((one.X_BT.inverse() * truth.at(static_cast<std::size_t>(one.tag))).log().norm(),
              1e-9);
  }
  // A scene with tags takes those.
  EXPECT_EQ(loadMeasurements(demo(), {path}, {}).captures.size(), 2U);
}

// A recording of a motion-capture system's own topics, at 50 Hz: the second body's poses come 3 ms
// later. Pressures are joint states, or a table whose clock is 40 s behind.
class BodyRecording {
 public:
  explicit BodyRecording(const test::TemporaryFolder& folder, bool joints)
      : table_(folder / "pressures.csv"),
        path_(folder / "poses.bag"),
        joints_(joints),
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
      if (joints_) bag_.write("/joint_states", time_, statesAt(pressure));
    }
    return places;
  }

  const std::string& close() {
    bag_.close();
    table_.close();
    return path_;
  }

 private:
  sensor_msgs::JointState statesAt(const Eigen::Vector3d& pressure) const {
    sensor_msgs::JointState out;
    out.header.stamp = time_;
    out.name = {"arm_bend"};
    out.position = {0.1};
    for (int i = 0; i < pressure.size(); ++i) {
      out.name.push_back(scene_.arm.actuator(i).name);
      out.position.push_back(pressure[i]);
    }
    return out;
  }

  const io::Scene scene_ = test::shippedScene("mocap");
  std::ofstream table_;
  std::string path_;
  bool joints_;
  rosbag::Bag bag_;
  ros::Time time_{1000, 0};
};

TEST(BagCaptures, PosesOfAMotionCaptureSystemAreTakenFromItsOwnTopics) {
  for (const bool joints : {true, false}) {
    const test::TemporaryFolder folder;
    BodyRecording recording(folder, joints);
    const io::Scene& scene = recording.scene();
    recording.hold({0, 0, 0}, 3);
    recording.hold({2e5, 0, 0}, 0.5);  // too short to rest
    const std::vector<lie::SE3> truth = recording.hold({1e5, 2e5, 0}, 3);
    const std::string& path = recording.close();
    procedures::RecordedPressures pressures;
    if (!joints) pressures = {folder / "pressures.csv", std::nullopt};
    const procedures::CalibrationData data = loadMeasurements(scene, {path}, {}, pressures);
    ASSERT_EQ(data.captures.size(), 2U);
    EXPECT_LT((data.captures[1].pressure - Eigen::Vector3d(1e5, 2e5, 0)).norm(), 1e-3);
    const auto& poses =
        std::get<std::vector<estimation::PoseObservation>>(data.captures[1].reading);
    ASSERT_EQ(poses.size(), truth.size());
    for (const estimation::PoseObservation& one : poses) {
      EXPECT_LT((one.X_BT.inverse() * truth.at(static_cast<std::size_t>(one.tag))).log().norm(),
                1e-9);
    }
    if (!joints) {
      ASSERT_FALSE(data.warnings.empty());
      EXPECT_NE(data.warnings[0].find("40.0"), std::string::npos) << data.warnings[0];
      EXPECT_NE(test::refusal<io::DocumentError>([&] {
                  loadBag(path, scene, {});
                }).find("topic pressure_measured is missing"),
                std::string::npos);
    }
    std::vector<std::string> notes;
    const io::DataSet table = loadDataSet(scene, path, pressures, notes);
    EXPECT_EQ(table.values.rows(), static_cast<Eigen::Index>(2 * truth.size()));
  }
}

TEST(BagCaptures, AnArmThatIsNeverAtRestIsReported) {
  const test::TemporaryFolder folder;
  Recording recording(folder / "moving.bag");
  for (int k = 0; k < 20; ++k) recording.play({1e4 * k, 0, 0}, 0.3);
  EXPECT_NE(faultOf(recording.close()).find("never at rest"), std::string::npos);
}

TEST(BagCaptures, MissingTopicsAndOtherArmsAreNamed) {
  const test::TemporaryFolder folder;
  Recording empty(folder / "empty.bag");
  const std::string missing = faultOf(empty.close());
  EXPECT_NE(missing.find("tag_detections is missing"), std::string::npos) << missing;
  EXPECT_NE(missing.find("pressure_measured is missing"), std::string::npos) << missing;

  Recording two(folder / "two.bag");
  two.play({0, 0, 0}, 1, true, "/left");
  two.play({0, 0, 0}, 1, true, "/right");
  EXPECT_NE(faultOf(two.close()).find("/left/tag_detections and /right/tag_detections"),
            std::string::npos);

  Recording other(folder / "other.bag");
  other.play({0, 0, 0}, 1);
  PressureArray foreign;
  foreign.name = {"bellows"};
  foreign.pressure = {1e5};
  other.write("/pressure_measured", foreign, 0);
  EXPECT_NE(faultOf(other.close()).find("not of this arm"), std::string::npos);

  EXPECT_NE(faultOf("/no/such.bag").find("/no/such.bag"), std::string::npos);
  const std::string text = folder / "text.bag";
  std::ofstream(text) << "pressure_kpa,length_m\n";
  EXPECT_NE(faultOf(text).find(text), std::string::npos);
}

using test::Random;

const int kDamaged = test::draws(4, 100);

void write(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

// A recording in which the arm is at rest twice.
std::string soundBag(const test::TemporaryFolder& folder) {
  Recording recording(folder / "sound.bag");
  recording.play({0, 0, 0}, 3);
  recording.play({1e5, 2e5, 0}, 3);
  return test::contentOf(recording.close());
}

// One byte is another, some are, a piece is missing, or the end is.
std::string damaged(std::string bytes, Random& random) {
  const auto place = [&] {
    // Half of them where the bag tells of itself: at its beginning and in the index at its end.
    const int size = static_cast<int>(bytes.size());
    const int part = random.integer(0, 3);
    return static_cast<std::size_t>(part == 0   ? random.integer(0, std::min(size, 6000) - 1)
                                    : part == 1 ? random.integer(std::max(0, size - 6000), size - 1)
                                                : random.integer(0, size - 1));
  };
  const int kind = random.integer(0, 3);
  if (kind == 2) bytes.erase(place(), static_cast<std::size_t>(random.integer(1, 100)));
  if (kind == 3) bytes.resize(place());
  for (int i = kind == 0 ? 1 : kind == 1 ? random.integer(2, 20) : 0; i > 0; --i) {
    bytes[place()] = static_cast<char>(random.integer(0, 255));
  }
  return bytes;
}

TEST(DamagedBags, NeverEndWhoLoadsThem) {
  const test::TemporaryFolder folder;
  const std::string sound = soundBag(folder), path = folder / "damaged.bag";
  Random random(19);
  const auto files = test::openFiles();
  int loaded = 0, refused = 0;
  for (int i = 0; i < kDamaged; ++i) {
    write(path, damaged(sound, random));
    const std::string message = faultOf(path);
    if (message == "accepted") {
      ++loaded;
      continue;
    }
    ++refused;
    EXPECT_EQ(message.find(path), 0u) << message;
    EXPECT_LT(message.size(), 1000u) << message;
  }
  EXPECT_GE(loaded, test::leastOf(kDamaged, 0.2))
      << "a byte within a message is no fault of the bag";
  EXPECT_GE(refused, test::leastOf(kDamaged, 0.4));
  EXPECT_EQ(test::openFiles(), files);
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1) << "no process is left behind";
}

}  // namespace
}  // namespace helix_arm::ros_bridge
