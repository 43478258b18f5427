// A recorded run played again: the same pictures give the same measurements.
#include <csignal>

#include "support/process.hpp"
#include "support/temporary_folder.hpp"
#include "support/vision_rig.hpp"

namespace helix_arm::test {
namespace {

using Shapes = std::map<ros::Time, ArmShape::ConstPtr>;

Shapes since(const Inbox<ArmShape>& inbox, std::size_t first) {
  Shapes out;
  for (std::size_t k = first; k < inbox.all().size(); ++k) {
    out[inbox.all()[k]->header.stamp] = inbox.all()[k];
  }
  return out;
}

std::vector<std::string> vision(const std::string& ns) {
  return {HELIX_ARM_VISION, "__ns:=" + ns, "_scene:=demo", "_source:=image/compressed",
          // that of the models, which are recorded
          "_frame_prefix:=live_"};
}

TEST(Replay, GivesTheSameMeasurementsAsOftenAsItIsPlayed) {
  constexpr std::size_t kWanted = 18;
  const TemporaryFolder folder;
  const std::string bag = folder / "run.bag";
  VisionListener live("live"), replay("replay");
  const std::vector<std::string> topics = {names::kCompressedImage, names::kCameraInfo,
                                           names::kModel};

  // The recorder listens before the node does, so that the bag holds all that the node sees; the
  // rig takes pictures only while someone does.
  const Inbox<sensor_msgs::CameraInfo> info(live.node, names::kCameraInfo);
  std::vector<std::string> record = {"rosrun", "rosbag", "record", "-O", bag};
  for (const std::string& topic : topics) record.push_back("/live/" + topic);
  Process recorder(record);
  ASSERT_TRUE(waitFor([&] { return info.all().size() >= 3; })) << recorder.output();
  {
    Process node(vision("live"));
    ASSERT_TRUE(waitFor([&] { return live.measured.all().size() >= kWanted; })) << node.output();
    recorder.signal(SIGINT);
    ASSERT_EQ(recorder.exitCode(), 0) << recorder.output();
  }

  // Only nodes that start from now on go by the clock of the bag.
  ros::param::set("/use_sim_time", true);
  Process node(vision("replay"));
  ASSERT_TRUE(node.prints("looks for")) << node.output();
  Shapes played[2];
  for (Shapes& shapes : played) {
    const std::size_t begin = replay.measured.all().size();
    std::vector<std::string> play = {
        "rosrun", "rosbag", "play", "--clock", "--wait-for-subscribers", bag};
    for (const std::string& topic : topics) play.push_back("/live/" + topic + ":=/replay/" + topic);
    play.insert(play.end(), {"--topics"});
    for (const std::string& topic : topics) play.push_back("/live/" + topic);
    Process player(play);
    int code = -1;
    ASSERT_TRUE(waitFor([&] { return (code = player.exitCode(0.01)) >= 0; }, 30))
        << player.output();
    ASSERT_EQ(code, 0) << player.output();
    ASSERT_TRUE(waitFor([&] { return replay.measured.all().size() >= begin + kWanted / 2; }))
        << replay.measured.all().size() - begin << " came again\n"
        << player.output();
    shapes = since(replay.measured, begin);
  }
  ros::param::del("/use_sim_time");

  // A fit begins at the one before: up to the first picture that a node on a busy machine misses.
  int alike = 0;
  for (auto one = played[0].begin(), other = played[1].begin();
       one != played[0].end() && other != played[1].end() && one->first == other->first;
       ++one, ++other, ++alike) {
    EXPECT_EQ(one->second->twist, other->second->twist) << alike;
  }
  EXPECT_GE(alike, 3);
  EXPECT_TRUE(node.prints("jumped back", 5.0)) << node.output();
}

}  // namespace
}  // namespace helix_arm::test
