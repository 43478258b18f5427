// A recorded run played again: the same pictures give the same measurements.
#include <algorithm>
#include <cmath>
#include <csignal>
#include <map>

#include <gtest/gtest.h>

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

struct Likeness {
  double difference = 0;  // the largest, of the twists
  double deviations = 0;  // the largest, of the twists in standard deviations of the fit
  int shapes = 0;         // that were compared
};

// Length of a difference of twists in standard deviations of the fit.
double inDeviations(const Eigen::VectorXd& difference, const ArmShape& fit) {
  const Eigen::Index size = difference.size();
  const Eigen::MatrixXd covariance = vectorOf(fit.twist_covariance).reshaped(size, size);
  return std::sqrt(difference.dot(covariance.ldlt().solve(difference)));
}

// Of shapes of the same picture. A node on a busy machine may miss pictures, and a fit begins at
// the one before: only those count that have so many before them which both have seen, too.
Likeness compare(const Shapes& a, const Shapes& b, int before) {
  Shapes all = a;
  all.insert(b.begin(), b.end());
  Likeness out;
  int alike = 0;
  for (const auto& [stamp, shape] : all) {
    const auto one = a.find(stamp), other = b.find(stamp);
    alike = one == a.end() || other == b.end() ? 0 : alike + 1;
    if (alike <= before) continue;
    ++out.shapes;
    const Eigen::VectorXd difference =
        vectorOf(one->second->twist) - vectorOf(other->second->twist);
    out.difference = std::max(out.difference, difference.norm());
    out.deviations = std::max(out.deviations, inDeviations(difference, *one->second));
  }
  return out;
}

// The same, up to the first picture that one of them has missed.
Likeness compareToFirstMissed(Shapes a, Shapes b) {
  auto one = a.begin();
  auto other = b.begin();
  for (; one != a.end() && other != b.end() && one->first == other->first; ++one) ++other;
  a.erase(one, a.end());
  b.erase(other, b.end());
  return compare(a, b, 0);
}

std::vector<std::string> vision(const std::string& ns) {
  return {HELIX_ARM_VISION, "__ns:=" + ns, "_scene:=demo", "_source:=image/compressed",
          // that of the models, which are recorded
          "_frame_prefix:=live_"};
}

TEST(Replay, GivesTheSameMeasurementsAsOftenAsItIsPlayed) {
  constexpr std::size_t kWanted = 18;
  constexpr int kEnough = 3;
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

  const Likeness replays = compareToFirstMissed(played[0], played[1]);
  EXPECT_GE(replays.shapes, kEnough);
  EXPECT_EQ(replays.difference, 0.0);
  // The live node saw its first picture later than the recorder did, and on a busy machine it
  // misses pictures: what it has learnt of base and bleed is a little different, which shows within
  // the noise of the shapes.
  const Likeness lives = compare(since(live.measured, 0), played[0], 5);
  EXPECT_GE(lives.shapes, kEnough);
  EXPECT_LT(lives.deviations, 3.0);
  EXPECT_TRUE(node.prints("jumped back", 5.0)) << node.output();
}

}  // namespace
}  // namespace helix_arm::test
