// The shape of an arm at given pressures: forward SCENE.yaml PRESSURE_1_KPA PRESSURE_2_KPA ...
#include <cstdlib>
#include <iostream>

#include "helix_arm/io/load_arm.hpp"

int main(int argc, char** argv) try {
  if (argc < 2) throw std::invalid_argument("usage: forward SCENE.yaml PRESSURE_KPA...");
  const helix_arm::io::SceneArm arm = helix_arm::io::loadArm(argv[1]);
  Eigen::VectorXd pressure(argc - 2);  // gauge [Pa], one per actuator
  for (int i = 0; i < pressure.size(); ++i) pressure[i] = 1e3 * std::atof(argv[i + 2]);

  const helix_arm::statics::Solution shape = arm.model.solve(pressure);
  if (!shape.converged()) throw std::runtime_error("no shape balances the load");
  std::cout.precision(12);
  std::cout << shape.tip.translation.transpose()
            << '\n';  // of the tip, in the arm's base frame [m]
} catch (const std::exception& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
