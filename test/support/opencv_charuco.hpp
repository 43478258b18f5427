#pragma once

#include <functional>
#include <vector>

#include <opencv2/core.hpp>
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 7
#include <opencv2/aruco/charuco.hpp>
#else
#include <opencv2/objdetect/charuco_detector.hpp>
#endif

namespace helix_arm::test {

// A ChArUco board as OpenCV itself describes and reads it. find() writes the markers in a picture,
// and the corners there with their ids.
struct OpenCvBoard {
  std::vector<cv::Point3f> corners;
  using Points = std::vector<cv::Point2f>;
  std::function<void(const cv::Mat&, std::vector<Points>&, Points&, std::vector<int>&)> find;
};

inline OpenCvBoard openCvBoard(int columns, int rows, float square, float marker, int dictionary) {
  const auto known = cv::aruco::getPredefinedDictionary(dictionary);
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 7
  const auto board = cv::aruco::CharucoBoard::create(columns, rows, square, marker, known);
  return {board->chessboardCorners, [=](auto& page, auto& markers, auto&... corners) {
            std::vector<int> ids;
            cv::aruco::detectMarkers(page, known, markers, ids);
            cv::aruco::interpolateCornersCharuco(markers, ids, page, board, corners...);
          }};
#else
  const cv::aruco::CharucoBoard board({columns, rows}, square, marker, known);
  return {board.getChessboardCorners(), [=](auto& page, auto& markers, auto&... corners) {
            std::vector<int> ids;
            cv::aruco::CharucoDetector(board).detectBoard(page, corners..., markers, ids);
          }};
#endif
}

}  // namespace helix_arm::test
