#include "support/ros_rig.hpp"

int main(int argc, char** argv) { return helix_arm::test::runRostest(argc, argv); }
