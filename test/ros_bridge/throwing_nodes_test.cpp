// Every node in which something throws ends with 1, in order: while its publishers and services
// leave queues and a ROS that are still there.
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "ros_bridge/calibration/calibration_node.hpp"
#include "ros_bridge/follow/visual_servo_node.hpp"
#include "ros_bridge/pressure/pressure_command_node.hpp"
#include "ros_bridge/tools/follow_path_node.hpp"
#include "ros_bridge/tools/monitor_node.hpp"
#include "ros_bridge/tools/pressure_series_node.hpp"
#include "ros_bridge/tools/simulated_rig_node.hpp"
#include "ros_bridge/tools/workspace_cloud_node.hpp"
#include "ros_bridge/vision/vision_node.hpp"
#include "support/process.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {
namespace {

using namespace ros_bridge;

const std::string kScene = "_scene:=" HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml";
const std::string kNode = "--node=";
const std::string kDestroy = "--destroy";
const char* const kWords = "something threw";
const char* const kPathKind = "follow_path";  // takes a path file

// One of whose callbacks throws once the others have begun.
template <class Node>
struct Throwing : Node {
  ros::NodeHandle node;
  ros::SteadyTimer timer = node.createSteadyTimer(
      ros::WallDuration(0.5),
      [](const ros::SteadyTimerEvent&) { throw std::runtime_error(kWords); }, true);
};
template <class Node>
bool mayEnd(const Throwing<Node>& node) {
  return ros_bridge::mayEnd(static_cast<const Node&>(node));
}

// What throws is not caught before the node's destructor.
template <class Node>
int destroy(int argc, char** argv, const char* name) {
  ros::init(argc, argv, name);
  const ros::NodeHandle started;
  return guarded([]() -> int {
    const Throwing<Node> node;
    ros::spin();
    return kDone;
  });
}

template <class Node>
int run(int argc, char** argv, const char* name) {
  const bool destroys = argv[argc - 1] == kDestroy;
  return destroys ? destroy<Node>(argc, argv, name) : runNode<Throwing<Node>>(argc, argv, name);
}

struct Kind {
  const char* name;
  int (*run)(int, char**, const char*);
  std::vector<std::string> arguments;
};
const Kind kKinds[] = {
    {"calibration", run<CalibrationNode>, {kScene}},
    {kPathKind, run<FollowPathNode>, {}},
    {"monitor", run<MonitorNode>, {}},
    {"pressure_command", run<PressureCommandNode>, {kScene}},
    {"pressure_command_on_a_topic", run<PressureCommandNode>, {kScene, "_regulator:=topic"}},
    {"pressure_series", run<PressureSeriesNode>, {kScene}},
    {"visual_servo", run<VisualServoNode>, {kScene}},
    {"simulated_rig", run<SimulatedRigNode>, {kScene}},
    {"vision", run<VisionNode>, {kScene}},
    {"workspace_cloud", run<WorkspaceCloudNode>, {kScene, "_count:=100"}},
};

TEST(ThrowingNodes, EndInOrderWith1) {
  const Master master;
  const TemporaryFile path("time_s,x_m,y_m,z_m\n0,0.366,0,0\n1,0.366,0.01,0\n", ".csv");
  for (const bool destroys : {false, true}) {
    for (const Kind& kind : kKinds) {
      std::vector<std::string> command = {"/proc/self/exe", kNode + kind.name};
      command.insert(command.end(), kind.arguments.begin(), kind.arguments.end());
      if (kind.name == kPathKind) command.push_back("_path:=" + path.path());
      if (destroys) command.push_back(kDestroy);
      Process node(command, master.variables());
      EXPECT_EQ(node.exitCode(60), kFailed) << kind.name << "\n" << node.output();
      EXPECT_NE(node.output().find(kWords), std::string::npos) << kind.name << "\n"
                                                               << node.output();
    }
  }
}

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) {
  using namespace helix_arm::test;
  for (const Kind& kind : kKinds) {
    if (argc > 1 && argv[1] == kNode + kind.name) return kind.run(argc, argv, kind.name);
  }
  ::testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
