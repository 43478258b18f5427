#pragma once

#include <Eigen/Core>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/shape.hpp"

namespace helix_arm::simulation {

/// A plant that ended, is silent or talks nonsense; what() names its command.
struct PlantError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A true arm that another program simulates: it gets pressures and answers with poses, one line of
/// JSON a turn, as docs/closed_loop.md says.
class Plant {
 public:
  /// Starts the program and tells it of the arm.
  /// @param command  for /bin/sh.
  /// @param arm      of the scene: names of the actuators, number of sections, links.
  /// @param tags     poses are asked for at their places too; may be empty.
  /// @throws PlantError: it does not start, ends, is silent for 10 s, or what it says is not of the
  /// protocol.
  Plant(const std::string& command, const model::Arm& arm,
        const std::vector<estimation::TagPlacement>& tags);
  ~Plant();

  /// Advances its time by dt > 0 [s], under pressures (n), gauge [Pa], and a force at the tip, base
  /// frame [N]. Throws as the constructor.
  void step(double dt, const Eigen::VectorXd& pressure, const Eigen::Vector3d& tip_force);
  /// The present shape, through all poses that it gave.
  const model::Shape& shape() const { return shape_; }

 private:
  class Process;

  std::string ask(const std::string& line);
  void takePoses(const std::string& answer, bool first);
  [[noreturn]] void refuse(const std::string& fault) const;

  const std::string command_;
  const model::Arm arm_;
  const int pieces_;  // per section
  const std::unique_ptr<Process> process_;
  std::string received_;  // beyond the last line
  model::Shape shape_;
};

}  // namespace helix_arm::simulation
