#pragma once

#include <Eigen/Core>
#include <vector>

namespace helix_arm::procedures {

/// What one picture says of one tag.
struct TagSighting {
  int id;  ///< in its family
  /// x, y of left below, right below, right above, left above as one reads the tag, as the camera
  /// sees them: with the distortion of its lens [px].
  Eigen::Matrix<double, 2, 4> corners;
};

/// An arm that stands still: its pressures and the tags that are seen of it.
struct Sample {
  double time;                    ///< of its last picture [s]
  Eigen::VectorXd pressure;       ///< (actuators) gauge [Pa]
  std::vector<TagSighting> tags;  ///< none twice, ascending ids
};

/// One sample out of several at the same pressures: the median of each pressure and of each
/// coordinate of each tag. Tags seen in fewer than half of them are left out.
///
/// @throws std::invalid_argument when there is none, or their pressures are not of one number.
Sample medianOf(const std::vector<Sample>& samples);

}  // namespace helix_arm::procedures
