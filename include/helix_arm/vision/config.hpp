#pragma once

#include <optional>
#include <string>

#include "helix_arm/localization/twist_fit.hpp"

/// How pictures are taken, searched and fitted: what a scene says of it, without OpenCV.
namespace helix_arm::vision {

/// A webcam, by V4L2.
struct WebcamConfig {
  std::string device = "/dev/video0";
  int width = 1280, height = 720;  ///< [px]
  std::string fourcc = "MJPG";     ///< MJPG, YUYV, UYVY or GREY
  double fps = 30.0;               ///< > 0 [Hz]
  /// Fixed focus, so that the focal length stays as calibrated; in the driver's units, >= 0.
  int focus = 0;
  int exposure = 157;  ///< fixed; in the driver's units (often 100 us), >= 0
};

/// How tags are searched for.
struct DetectorConfig {
  std::string family = "36h11";
  /// Factor by which the picture is shrunk for the quad search: 1, 1.5 or a whole number up to 32.
  double quad_decimate = 2.0;
  double quad_sigma = 0.0;   ///< blur before the quad search (below 0: sharpen), -10 to 10 [px]
  int threads = 1;           ///< 1 to 64
  bool refine_edges = true;  ///< refine the corners at the edges of the full picture
  /// Maximum number of wrong bits: 0 to 3, fewer than half of the family's distance, and no more
  /// than 2 GB of memory allow.
  int max_hamming = 2;

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// How a picture is searched when the approximate positions of the tags are known. Each mode
/// falls back to those above it, within the same picture.
enum class TrackingMode {
  kFull,     ///< the whole picture, always
  kRegions,  ///< a region around each expected tag, wider by half its size
  /// The edges and bits of each expected tag. It may be off by a quarter of its shorter side and at
  /// most 12 px. Families with bits outside their border are searched by regions instead.
  kEdges,
};

/// How pictures become shapes: key vision of a scene.
struct LocalizerConfig {
  DetectorConfig detector;
  TrackingMode tracking = TrackingMode::kEdges;
  estimation::TwistFitOptions fit;
  /// If set, base and border shift, as far as they are fitted, are learnt over the pictures
  /// (estimation::RigMemory); else they are fitted anew in each. The covariance of what errors of
  /// the placements make of them, see estimation::rigByPlacements().
  std::optional<estimation::RigEstimate::Matrix> rig_by_placements = {};
  /// Fewest visible tags of the arm for a measurement, >= 2; of bodies >= 1.
  int min_tags = 2;
  bool frame_known = true;  ///< of the poses of bodies; else none of them is measured
};

}  // namespace helix_arm::vision
