// One program for each node, compiled with its name; node_mains.cpp defines the functions.
namespace helix_arm::ros_bridge::mains {

int HELIX_ARM_NODE(int argc, char** argv);

}  // namespace helix_arm::ros_bridge::mains

int main(int argc, char** argv) {
  return helix_arm::ros_bridge::mains::HELIX_ARM_NODE(argc, argv);
}
