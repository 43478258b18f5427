#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/io/scene.hpp"

namespace helix_arm::procedures {

/// How much a finding matters.
enum class Severity {
  kNote,     ///< worth knowing
  kWarning,  ///< it works, but less well or less safely than it could
  kFault,    ///< it does not work as described
};
/// "note", "warning" or "fault".
const char* nameOf(Severity severity);

/// One finding of a check.
struct Finding {
  Severity severity;
  std::string check;    ///< what was checked, a word: "tag_faces_inward"
  std::string culprit;  ///< "tag 7", "tags 3 and 12, 7 and 18", "muscle_1", "camera"
  std::string value;    ///< what it is, and what is expected
  std::string remedy;
};

/// The worst first, otherwise in their order.
void sortBySeverity(std::vector<Finding>& findings);

/// View that the camera has of the arm over its workspace. A tag in sight faces the camera, lies in
/// its picture and has bits of kLeastPixelsPerBit or more.
struct VisionFigures {
  int samples = 0;           ///< inputs at which a shape was found
  int least_tags = 0;        ///< fewest tags in sight
  double median_tags = 0;    ///< of tags in sight
  std::vector<int> unseen;   ///< ids of tags that are in sight at no sample
  double measured = 0;       ///< part of the samples in which the shape can be measured
  double median_tip_sd = 0;  ///< of the tip along its worst direction, where measured [m]
  double worst_tip_sd = 0;   ///< [m]
  /// Resolution of tags that face the camera, readable or not: the value that 90 % of them exceed
  /// [px].
  double pixels_per_bit = 0;
};

/// Result of checkRig().
struct RigCheck {
  std::vector<Finding> findings;
  std::optional<VisionFigures> vision;  ///< only with camera and tags

  bool hasFault() const;
};

/// Largest distance of a tag outside the arm's skin, relative to the skin's radius. The brackets of
/// the rig of scene helical_50 reach to 0.84.
inline constexpr double kFarthestTag = 1.0;
/// Pixels of a tag's bit in the picture that is searched, shrunk by vision.quad_decimate: fewer
/// cost detections, and below the second most tags are lost, so that they count as unseen.
inline constexpr double kWantedPixelsPerBit = 1.5;
inline constexpr double kLeastPixelsPerBit = 1.0;  ///< the second

/// Looks for what keeps a rig from working, without moving or connecting anything: tags that stand
/// off the arm, face inward, overlap or are too small; how many are seen over the workspace and how
/// well they tell the tip; contraction curves; a stiffness in another unit; the regulator's supply
/// and its behaviour when its line dies.
/// @param samples  number of inputs drawn within the limits, besides their corners; >= 0.
RigCheck checkRig(const io::Scene& scene, int samples = 150);

/// The supply as the regulator measures it [Pa] against the limits of the actuators.
std::vector<Finding> checkSupply(const io::Scene& scene, double supply);

}  // namespace helix_arm::procedures
