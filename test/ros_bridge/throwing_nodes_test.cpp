// Every node in which something throws ends with 1, in order: while its publishers and services
// leave queues and a ROS that are still there.
#include <gtest/gtest.h>
#include <ros/ros.h>

#include "ros_bridge/common/run_node.hpp"
#include "support/process.hpp"

namespace helix_arm::test {
namespace {

using namespace ros_bridge;

const std::string kScene = "_scene:=" HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml";
const std::string kNode = "--node=";
const char* const kWords = "something threw";

// A node one of whose callbacks throws once the others have begun.
struct Throwing : Node {
  explicit Throwing(const std::string& program) : node(makeNode(program)) {}
  bool mayEnd() const override { return node->mayEnd(); }
  int finish() override { return node->finish(); }

  const std::unique_ptr<Node> node;
  ros::NodeHandle handle;
  ros::SteadyTimer timer = handle.createSteadyTimer(
      ros::WallDuration(0.5),
      [](const ros::SteadyTimerEvent&) { throw std::runtime_error(kWords); }, true);
};

struct Kind {
  const char* name;
  const char* program;
  std::vector<std::string> arguments;
};
const Kind kKinds[] = {
    {"pressure_command", "pressure_command", {kScene}},
    {"pressure_command_on_a_topic", "pressure_command", {kScene, "_regulator:=topic"}},
    {"visual_servo", "visual_servo", {kScene}},
    {"simulated_rig", "simulated_rig", {kScene}},
    {"vision", "vision", {kScene}},
};

TEST(ThrowingNodes, EndInOrderWith1) {
  const Master master;
  for (const Kind& kind : kKinds) {
    std::vector<std::string> command = {"/proc/self/exe", kNode + kind.name};
    command.insert(command.end(), kind.arguments.begin(), kind.arguments.end());
    Process node(command, master.variables());
    EXPECT_EQ(node.exitCode(60), kFailed) << kind.name << "\n" << node.output();
    EXPECT_NE(node.output().find(kWords), std::string::npos) << kind.name << "\n" << node.output();
  }
}

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) {
  using namespace helix_arm::test;
  for (const Kind& kind : kKinds) {
    if (argc == 1 || argv[1] != kNode + kind.name) continue;
    return runNode(argc, argv, kind.program,
                   [&] { return std::make_unique<Throwing>(kind.program); });
  }
  ::testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
