#pragma once

#include <functional>
#include <vector>

#include <opencv2/core.hpp>
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 7
#include <opencv2/aruco.hpp>
#include <opencv2/aruco/charuco.hpp>
#else
#include <opencv2/objdetect/charuco_detector.hpp>
#endif

namespace helix_arm::test {

// A ChArUco board as OpenCV itself describes and reads it.
struct OpenCvBoard {
  std::vector<int> ids;                           // of its markers
  std::vector<std::vector<cv::Point3f>> markers;  // their corners
  std::vector<cv::Point3f> corners;               // of the chessboard
  // Writes the ids of markers in a picture, and the corners there with their ids.
  std::function<void(const cv::Mat&, std::vector<int>&, std::vector<cv::Point2f>&,
                     std::vector<int>&)>
      find;
};

inline OpenCvBoard openCvBoard(int columns, int rows, float square, float marker, int dictionary) {
  std::vector<std::vector<cv::Point2f>> around;
  const auto known = cv::aruco::getPredefinedDictionary(dictionary);
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 7
  const auto board = cv::aruco::CharucoBoard::create(columns, rows, square, marker, known);
  return {board->ids, board->objPoints, board->chessboardCorners,
          [=](const cv::Mat& page, auto& markers, auto& corners, auto& ids) mutable {
            cv::aruco::detectMarkers(page, known, around, markers);
            cv::aruco::interpolateCornersCharuco(around, markers, page, board, corners, ids);
          }};
#else
  const cv::aruco::CharucoBoard board({columns, rows}, square, marker, known);
  return {board.getIds(), board.getObjPoints(), board.getChessboardCorners(),
          [=](const cv::Mat& page, auto& markers, auto& corners, auto& ids) mutable {
            cv::aruco::CharucoDetector(board).detectBoard(page, corners, ids, around, markers);
          }};
#endif
}

}  // namespace helix_arm::test
