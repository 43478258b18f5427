#pragma once

#include <optional>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "charuco_board.hpp"
#include "helix_arm/localization/camera.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/shape.hpp"
#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::vision {

/// Approximate pose X_CB of the base seen from the camera, without an initial guess.
///
/// Every tag alone gives two poses; the one with the least median error over all tags is returned.
/// So fewer than half of the tags may be misplaced.
/// @param seen   one entry per tag, indices of the layout.
/// @param focal  converts errors of directions to pixels, > 0 [px].
/// @return nothing if no pose has most tags before the camera.
std::optional<lie::SE3> startOfPlacement(const estimation::TagLayout& layout,
                                         const model::Shape& shape,
                                         const std::vector<estimation::CornerObservation>& seen,
                                         double focal);

/// One corner of a board in a picture.
struct BoardCorner {
  int id;                 ///< of the corner, on its board
  Eigen::Vector2d board;  ///< where it is in the plane of the board [m]
  Eigen::Vector2d pixel;  ///< where it is seen [px]
};

/// A board in one picture.
struct BoardObservation {
  std::string name;                  ///< of the picture
  std::vector<BoardCorner> corners;  ///< sorted by id, each once
};

/// Least distance of a tag's corners from the border of the picture [px]. The detector finds a tag
/// that the border cuts as well, with an edge up to 4 px inside the picture, which is not the
/// tag's.
inline constexpr double kLeastFromBorder = 8;

/// Corners of the board's tags among all detections. Tags with wrong bits, those that are seen
/// twice and those at the border are omitted.
/// @param size  of the picture.
BoardObservation boardObservation(const TagBoard& board, const std::string& name,
                                  const cv::Size& size,
                                  const std::vector<TagDetection>& detections);

/// Which part of a picture the corners of boards have covered.
class Coverage {
 public:
  static constexpr int kColumns = 8, kRows = 6;

  explicit Coverage(const cv::Size& size) : size_(size) {}

  void add(const BoardObservation& observation);
  /// Part of the cells that hold a corner, 0 to 1.
  double fraction() const {
    return static_cast<double>(cv::countNonZero(seen_)) / (kColumns * kRows);
  }
  /// Where the most cells are empty: "top left", "right", "centre", .. Empty if none are.
  std::string emptiest() const;

 private:
  cv::Size size_;
  cv::Matx<uchar, kRows, kColumns> seen_;
};

/// Chooses pictures of a video or a webcam for a calibration: those in which the board rests, and
/// that differ from all chosen before.
class BoardViews {
 public:
  /// Largest RMS motion of the corners since the last picture at rest [px].
  static constexpr double kMostMotion = 1.0;
  /// Least RMS distance of the corners from those of a chosen view [widths of the picture].
  static constexpr double kLeastChange = 0.04;

  BoardViews(const cv::Size& size, const BoardParts& parts)
      : size_(size), least_(parts.leastCorners()), coverage_(size) {}

  /// Takes the next picture's board. @return whether it was chosen.
  bool offer(const BoardObservation& observation);

  const std::vector<BoardObservation>& chosen() const { return chosen_; }
  const Coverage& coverage() const { return coverage_; }

 private:
  cv::Size size_;
  int least_;  // corners of a view
  Coverage coverage_;
  std::optional<BoardObservation> last_;
  std::vector<BoardObservation> chosen_;
};

/// A marker in a picture.
struct MarkerObservation {
  int id;
  estimation::Corners corners;  ///< [px], (0, 0) the centre of the top-left pixel
};

/// The markers of a dictionary in a picture, sorted by id. Those that are seen twice are omitted.
/// @param gray  (CV_8UC1).
/// @throws std::invalid_argument on an unknown dictionary.
std::vector<MarkerObservation> findMarkers(const std::string& dictionary, const cv::Mat& gray);

/// The inner corners of a ChArUco board in a picture, to a fraction of a pixel: the largest
/// connected set on which the markers on either side agree to a quarter of a square. On a board of
/// another number of squares they agree along single rows at most. Neighbours alone are compared,
/// so that distortion by the lens has no influence.
/// @param board  valid.
/// @param gray   (CV_8UC1).
BoardObservation charucoObservation(const CharucoBoard& board, const std::string& name,
                                    const cv::Mat& gray);

/// How many markers pictures show of a ChArUco board that is not found in them, and the options by
/// which the board may differ.
std::string whyNoCharuco(const CharucoBoard& board, const std::vector<cv::Mat>& pictures);

/// Parameters that calibrateCamera() fits, and number of views.
struct CameraCalibrationOptions {
  /// Number of coefficients of distortion: 0, 2 (k1 k2), 4 (k1 k2 p1 p2), 5 (and k3) or 8 (and k4
  /// k5 k6). The others are 0.
  int coefficients = 5;

  /// Fewest views that are calibrated with.
  static constexpr int kLeastViews = 5;
  /// Largest standard error of a focal length that counts as determined, relative to it.
  static constexpr double kMostFocalError = 0.02;
};

/// One intrinsic parameter.
struct CameraParameter {
  std::string name;  ///< fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5 or k6
  std::string unit;  ///< px, or empty
  double value;
  /// The larger of two estimates: the error due to the residuals as independent noise, and that due
  /// to errors that the corners of a view share, such as a board that is not flat (from the views'
  /// gradients). 0 if the parameter is not fitted.
  double standard_error;
};

/// One picture of the calibration.
struct CalibratedView {
  std::string name;
  int parts;    ///< number of the board's parts (BoardParts) that it shows
  int corners;  ///< number of corners
  bool used;
  std::string reason;   ///< why it is not used; empty if it is
  double rms = 0;       ///< of its corners' distances along one axis, if fitted [px]
  double distance = 0;  ///< from the camera to the board, if fitted [m]
  double tilt = 0;      ///< of the board's normal from the line of sight, if fitted [rad]
};

/// Intrinsics of a camera from pictures of a board, and how well they are known.
struct CameraCalibration {
  bool success = false;
  std::string reason;  ///< cause and remedy; empty with success
  estimation::Camera camera;
  std::vector<CameraParameter> parameters;
  double rms = 0;       ///< over the used views, of distances along one axis [px]
  double coverage = 0;  ///< part of the picture's cells that hold corners, as of Coverage
  /// Largest distance of a corner from the principal point, relative to that of the picture's
  /// corner that is farthest from it. Beyond it the distortion is extrapolated.
  double reach = 0;
  int tilted_views = 0;  ///< number of used views that are tilted by 20 degrees or more
  std::vector<CalibratedView> views;
  /// Limits of the accuracy, each with its value and remedy.
  std::vector<std::string> warnings;
};

/// Least squares over all views (Zhang's method, by OpenCV). Views whose RMS exceeds 0.3 px and
/// three times the median of all are left out. The scale of the print has no influence: it only
/// scales the distances.
/// @param parts   of the board.
/// @param observations  pictures of the board, all of this size.
CameraCalibration calibrateCamera(const BoardParts& parts, const cv::Size& size,
                                  const std::vector<BoardObservation>& observations,
                                  const CameraCalibrationOptions& options = {});

}  // namespace helix_arm::vision
