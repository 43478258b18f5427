#include "node_mains.hpp"

int main(int argc, char** argv) { return helix_arm::ros_bridge::runVisualServo(argc, argv); }
