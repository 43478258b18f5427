#pragma once

#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/vision/charuco_board.hpp"
#include "vision/board_views.hpp"

namespace helix_arm::vision {

/// A marker in a picture.
struct MarkerObservation {
  int id;
  estimation::Corners corners;  ///< [px], (0, 0) the centre of the top-left pixel
};

/// The markers of a dictionary in a picture, sorted by id. Those that are seen twice are omitted.
/// @param gray  (CV_8UC1).
/// @throws std::invalid_argument on an unknown dictionary.
std::vector<MarkerObservation> findMarkers(const std::string& dictionary, const cv::Mat& gray);

/// An inner corner between two diagonal squares whose markers were both seen.
struct MarkedCorner {
  int id;
  Eigen::Vector2d pixel;  ///< mean of what the two markers tell, not refined [px]
  double room;            ///< from there to the nearest corner of a marker [px]
};

/// The largest connected set of corners on which the markers on either side agree to a quarter of a
/// square. On a board of another number of squares they agree along single rows at most. Neighbours
/// alone are compared, so that distortion by the lens has no influence.
/// @param markers  sorted by id, each once.
std::vector<MarkedCorner> markedCorners(const CharucoBoard& board,
                                        const std::vector<MarkerObservation>& markers);

/// The inner corners of a ChArUco board in a picture, to a fraction of a pixel.
/// @param board  valid.
/// @param gray   (CV_8UC1).
BoardObservation charucoObservation(const CharucoBoard& board, const std::string& name,
                                    const cv::Mat& gray);

/// Why pictures that were taken of a ChArUco board show none of these sizes, and the remedy:
/// another dictionary, another number of squares, another size of the markers, or no markers.
std::string whyNoCharuco(const CharucoBoard& board, const std::vector<cv::Mat>& pictures);

}  // namespace helix_arm::vision
