#pragma once

#include <Eigen/Core>
#include <vector>

namespace helix_arm::procedures {

/// Detection of one tag in one picture.
struct TagObservation {
  int id;  ///< in its family
  /// x, y of bottom left, bottom right, top right, top left as one reads the tag, with lens
  /// distortion [px].
  Eigen::Matrix<double, 2, 4> corners;
};

/// The pressures and visible tags of an arm at rest.
struct Sample {
  double time;                       ///< time of its last picture [s]
  Eigen::VectorXd pressure;          ///< (actuators) gauge [Pa]
  std::vector<TagObservation> tags;  ///< unique ids in ascending order
};

/// Combines several samples at the same pressures: the median of each pressure and of each
/// coordinate of each tag. Tags seen in fewer than half of them are omitted.
///
/// @throws std::invalid_argument if there is no sample, or their numbers of pressures differ.
Sample medianOf(const std::vector<Sample>& samples);

}  // namespace helix_arm::procedures
