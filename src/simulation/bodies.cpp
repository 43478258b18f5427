#include "bodies.hpp"

namespace helix_arm::simulation {

SimulatedBodies::SimulatedBodies(const estimation::ArmView& truth,
                                 const SimulatedBodiesConfig& config)
    : truth_(truth), config_(config), generator_(config.seed) {}

std::vector<estimation::BodyPose> SimulatedBodies::see(const model::Shape& shape) {
  std::vector<estimation::BodyPose> out;
  const std::vector<lie::SE3> places = estimation::tagPoses(truth_.layout, shape);
  for (int i = 0; i < static_cast<int>(places.size()); ++i) {
    const estimation::PoseNoise& noise = *truth_.layout.tags[static_cast<std::size_t>(i)].noise;
    Eigen::Vector3d shift;
    lie::Vector6 turn = lie::Vector6::Zero();
    for (int k = 0; k < 3; ++k) {
      shift[k] = noise.position * normal_(generator_);
      turn[3 + k] = noise.rotation * normal_(generator_);
    }
    const bool lost = uniform_(generator_) < config_.lost;
    if (lost) continue;
    lie::SE3 X = truth_.X_CB * places[static_cast<std::size_t>(i)];
    X.translation += shift;
    X.rotation = noise.rotation > 0 ? Eigen::Matrix3d(X.rotation * lie::SE3::exp(turn).rotation)
                                    : Eigen::Matrix3d(Eigen::Matrix3d::Identity());
    out.push_back({i, X});
  }
  return out;
}

}  // namespace helix_arm::simulation
