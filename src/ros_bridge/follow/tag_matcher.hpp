#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <deque>
#include <optional>
#include <vector>

#include <ros/time.h>

#include "helix_arm/TagDetections.h"
#include "helix_arm/estimation/tag_layout.hpp"
#include "helix_arm/model/shape.hpp"

namespace helix_arm::ros_bridge {

/// What one picture says of the arm.
struct SeenArm {
  ros::Time stamp;  ///< of the picture
  model::Shape shape;
  Eigen::MatrixXd covariance;  ///< of its twists
  /// Indices in the layout of the tags that were fitted, ascending; nothing if unknown.
  std::optional<std::vector<int>> tags = {};
};

/// Indices in the layout of the tags that a fit used, ascending; nothing if there is none, or if
/// one of them is not in the layout.
std::optional<std::vector<int>> fittedTags(const TagDetections& detections,
                                           const estimation::TagLayout& layout);

/// Joins each measured shape with the tags of its fit, by their stamps. They come on two topics, in
/// any order.
///
/// A shape waits for its tags at most kPatience; not at all once later tags have come, or where no
/// tags have come for kSilence. It then goes on without them. Shapes keep their order. At most
/// kMost shapes and kMost sets of tags are kept. Time is a number [s].
class TagMatcher {
 public:
  static constexpr double kPatience = 0.05;  ///< [s]
  static constexpr double kSilence = 1.0;    ///< [s]
  static constexpr std::size_t kMost = 8;

  void add(SeenArm seen, double now);
  /// @param tags  as SeenArm's.
  void addTags(const ros::Time& stamp, std::optional<std::vector<int>> tags, double now);
  /// The next shape that need not wait any more; nothing if there is none.
  std::optional<SeenArm> take(double now);
  /// Forgets shapes and tags.
  void clear();

 private:
  struct Waiting {
    SeenArm seen;
    double since;  ///< [s]
  };
  struct Tags {
    ros::Time stamp;
    std::optional<std::vector<int>> fitted;
  };

  bool mayGetTags(const Waiting& shape, double now) const;

  std::deque<Waiting> shapes_;  ///< as they came
  std::deque<Tags> tags_;       ///< by ascending stamp
  std::optional<double> last_tags_;
};

}  // namespace helix_arm::ros_bridge
