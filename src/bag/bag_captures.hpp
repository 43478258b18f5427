#pragma once

#include <string>
#include <vector>

#include "procedures/calibration_job.hpp"
#include "procedures/captures.hpp"
#include "procedures/settle_watch.hpp"

/// From what nodes say, live or in a recording, to what a calibration takes.
namespace helix_arm::ros_bridge {

/// A tag of TagDetections.msg.
struct SeenTag {
  procedures::TagObservation observation;
  bool repeated = false;  ///< in its picture
};

/// The scene's tags or bodies of one picture, ascending ids; those seen twice are left out.
std::vector<procedures::TagObservation> observationsOf(const std::vector<SeenTag>& detections,
                                                       const io::Scene& scene);

/// Samples as a data set has them, numbered from 1; their pressures, which are within a tolerance
/// of set points, brought inside the limits.
struct SampleTable {
  std::vector<io::TagCornerCapture> corners;
  std::vector<io::TagPoseCapture> poses;  ///< of a scene with bodies, seen from the poses' frame F

  SampleTable(const std::vector<procedures::Sample>& samples, const io::Scene& scene);

  int size() const { return static_cast<int>(corners.size() + poses.size()); }
  /// The text of the data set.
  std::string csv(int actuators, const std::string& comment) const;
  /// The captures. @param name  of the samples in messages.
  procedures::LoadedCaptures captures(const io::Scene& scene, const std::string& name) const;
};

/// The moments of a recording in which the arm stands still: one sample each time, the median of
/// its pictures. Times are the stamps in the messages. A process of its own reads the file, so that
/// no damage in it does harm to this one.
///
/// @param path  of a bag with one topic each that ends in tag_detections and pressure_measured; one
///              that ends in pressure_command tells the set points. The tags may also be those of
///              apriltag_ros: their poses become corners in the picture of the scene's camera. If
///              the scene has bodies, body_poses takes the place of tag_detections, or a topic
///              NAME/pose of each body as its motion-capture system publishes it; and joint_states
///              that of pressure_measured.
/// @throws io::DocumentError where it cannot be read, is damaged, has more than 16 GiB, lacks a
/// topic, has one of another type or more than one, where pressures are not of the scene's arm, or
/// where the arm never stands still.
std::vector<procedures::Sample> loadBag(const std::string& path, const io::Scene& scene,
                                        const procedures::SettleRules& rules);

/// As procedures::measurementsOf(), also of a recording (.bag).
io::DataSet loadDataSet(const io::Scene& scene, const std::string& path,
                        const procedures::RecordedPressures& pressures,
                        std::vector<std::string>& notes);

/// Data sets of all kinds: recordings (.bag), and what procedures::loadCalibrationData() reads.
/// @throws io::DocumentError with every fault of a file.
procedures::CalibrationData loadMeasurements(const io::Scene& scene,
                                             const std::vector<std::string>& paths,
                                             const procedures::SettleRules& rules,
                                             const procedures::RecordedPressures& pressures = {});

}  // namespace helix_arm::ros_bridge
