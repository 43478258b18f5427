// ChArUco boards: geometry, dictionaries, and what is read from rendered pictures whose truth is
// known.
#include <algorithm>
#include <cmath>
#include <iostream>

#include <gtest/gtest.h>
#include <opencv2/aruco.hpp>
#include <opencv2/aruco/charuco.hpp>
#include <opencv2/imgproc.hpp>

#include "helix_arm/vision/camera_calibration.hpp"
#include "support/board_studio.hpp"
#include "support/refusal.hpp"

namespace helix_arm::vision {
namespace {

using estimation::Camera;
using namespace test;

Camera plainCamera() { return {1280, 720, 931.5, 929.8, 644.2, 357.6, {}}; }

// A picture with the whole board in it, tilted.
cv::Mat portrait(const CharucoBoard& board, double tilt = 0.4) {
  const Camera camera = plainCamera();
  const double distance =
      1.5 * camera.fy * std::max(board.height() / camera.height, board.width() / camera.width);
  return boardPicture(camera, board,
                      boardPose(camera, 0.5, 0.5, distance, {tilt, 0.3 * tilt, 0.1}));
}

TEST(MarkerDictionaries, AreThoseOfOpenCvInItsOrder) {
  const auto& known = markerDictionaries();
  ASSERT_EQ(known.size(), static_cast<std::size_t>(cv::aruco::DICT_APRILTAG_36h11) + 1);
  for (std::size_t i = 0; i < known.size(); ++i) {
    const auto dictionary = cv::aruco::getPredefinedDictionary(static_cast<int>(i));
    EXPECT_EQ(dictionary->bytesList.rows, known[i].markers) << known[i].name;
    EXPECT_EQ(dictionary->markerSize, known[i].bits) << known[i].name;
    EXPECT_EQ(dictionaryIndex(known[i].name), static_cast<int>(i));
  }
  EXPECT_EQ(dictionaryIndex("DICT_4X4_50"), cv::aruco::DICT_4X4_50);
  EXPECT_EQ(dictionaryIndex("DICT_7X7_1000"), cv::aruco::DICT_7X7_1000);
  EXPECT_EQ(dictionaryIndex("DICT_ARUCO_ORIGINAL"), cv::aruco::DICT_ARUCO_ORIGINAL);
  EXPECT_EQ(dictionaryIndex("DICT_APRILTAG_25h9"), cv::aruco::DICT_APRILTAG_25h9);
  const std::string unknown = test::refusal([] { markerDictionary("DICT_9X9"); });
  EXPECT_EQ(unknown.rfind("dictionary of markers: DICT_9X9 is not known; expected one of "
                          "DICT_4X4_50, DICT_4X4_100, ",
                          0),
            0u);
  EXPECT_EQ(test::refusal<std::out_of_range>([] { markerCells("DICT_4X4_50", 50); }),
            "marker id is 50; DICT_4X4_50 has 0 to 49");
}

TEST(CharucoBoard, MarkersFillTheWhiteSquaresRowByRow) {
  for (const auto& [columns, rows, legacy] :
       {std::tuple(5, 7, false), {4, 6, false}, {4, 6, true}, {5, 8, true}, {5, 8, false}}) {
    CharucoBoard board{columns, rows};
    board.legacy_pattern = legacy;
    EXPECT_EQ(board.isWhite(0, 0), legacy);
    int next = 0;
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        EXPECT_EQ(board.markerIn(column, row), next);
        next += board.isWhite(column, row) ? 1 : 0;
        EXPECT_NE(board.isWhite(column, row), board.isWhite(column + 1, row));
        EXPECT_NE(board.isWhite(column, row), board.isWhite(column, row + 1));
      }
    }
    EXPECT_EQ(board.count(), next);
  }
}

TEST(CharucoBoard, IsTheOneOfOpenCv) {
  // OpenCV's frame has its origin in the corner of the board; which one, and the direction of y,
  // depends on the version, so that rows are counted from above. With an odd number of rows the
  // pattern does not.
  for (const auto& [columns, rows] : {std::pair(7, 9), {6, 5}}) {
    const CharucoBoard board{columns, rows, 0.03, 0.021, "DICT_5X5_100"};
    const auto theirs = cv::aruco::CharucoBoard::create(
        columns, rows, 0.03F, 0.021F,
        cv::aruco::getPredefinedDictionary(dictionaryIndex(board.dictionary)));
    ASSERT_EQ(theirs->ids.size(), static_cast<std::size_t>(board.count()));
    ASSERT_EQ(theirs->chessboardCorners.size(), static_cast<std::size_t>(board.cornerCount()));
    const bool upwards = theirs->objPoints.front()[0].y > theirs->objPoints.back()[0].y;
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        if (!board.isWhite(column, row)) continue;
        const auto& marker =
            theirs->objPoints[static_cast<std::size_t>(board.markerIn(column, row))];
        const estimation::Corners ours = board.markerCorners(column, row);
        for (int c = 0; c < 4; ++c) {
          const cv::Point3f& their = marker[static_cast<std::size_t>(3 - c)];
          EXPECT_NEAR(ours(0, c), their.x - 0.5 * board.width(), 1e-6);
          const double y = upwards ? their.y : board.height() - their.y;
          EXPECT_NEAR(ours(1, c), y - 0.5 * board.height(), 1e-6);
        }
      }
    }
  }
}

TEST(CharucoBoard, WhatBreaksARuleIsSaid) {
  const auto refusal = [](const CharucoBoard& board) {
    return test::refusal([&board] { board.validate(); });
  };
  EXPECT_EQ(refusal({}), "accepted");
  EXPECT_EQ(refusal({3, 4}),
            "ChArUco board: 3 x 4 squares have 6 inner corners; expected 8 or more");
  EXPECT_EQ(refusal({3, 5}), "accepted");
  EXPECT_EQ(refusal({7, 9, 0.02, 0.006}), "accepted");
  EXPECT_EQ(refusal({7, 9, 0.02, 0.0059}),
            "ChArUco board: the side of a marker [m] is 0.0059; expected 0.006 or more, 0.3 of the "
            "side of a square: a smaller one is not found in pictures of the board");
  EXPECT_EQ(refusal({8, 9, 0.02, 0.01, "DICT_APRILTAG_16h5"}),
            "ChArUco board: 8 x 9 squares take 36 markers, but DICT_APRILTAG_16h5 has 30; expected "
            "fewer squares or a larger dictionary");
  EXPECT_NE(refusal({7, 9, 0.02, 0.01, "DICT_4X4_50", true})
                .find("the legacy pattern with 9 squares down; expected an even number"),
            std::string::npos);
}

TEST(CharucoObservation, CornersAreReadToATenthOfAPixel) {
  Camera camera = plainCamera();
  camera.distortion = {-0.28, 0.09, 0.0008, -0.0006, 0, 0, 0, 0};
  CharucoBoard legacy{6, 8, 0.03, 0.024, "DICT_5X5_100", true};
  const CharucoBoard boards[] = {
      {}, legacy, {8, 6, 0.03, 0.015, "DICT_APRILTAG_36h11"}, {5, 7, 0.04, 0.03, "DICT_6X6_250"}};
  Random random(3);
  for (const CharucoBoard& board : boards) {
    SCOPED_TRACE(board.dictionary);
    double square = 0, worst = 0;
    int count = 0;
    for (int i = 0; i < 4; ++i) {
      const lie::SE3 pose = boardPose(camera, 0.5, 0.5, 0.36, 0.4 * random.direction<3>());
      const BoardObservation observation =
          charucoObservation(board, "a", boardPicture(camera, board, pose));
      EXPECT_EQ(observation.name, "a");
      for (const BoardCorner& corner : observation.corners) {
        EXPECT_EQ(corner.board, board.corner(corner.id));
        const auto truth =
            camera.project(pose * Eigen::Vector3d(corner.board.x(), corner.board.y(), 0));
        const double error = (corner.pixel - truth.value()).norm();
        square += error * error;
        worst = std::max(worst, error);
        ++count;
      }
      EXPECT_TRUE(std::is_sorted(observation.corners.begin(), observation.corners.end(),
                                 [](const auto& a, const auto& b) { return a.id < b.id; }));
    }
    const double rms = std::sqrt(square / count);
    std::cout << board.dictionary << ": " << count << " of " << 4 * board.cornerCount()
              << " corners, RMS " << rms << " px, worst " << worst << " px\n";
    EXPECT_GT(count, 0.9 * 4 * board.cornerCount());
    EXPECT_LT(rms, 0.1);
    EXPECT_LT(worst, 0.3);
  }
}

TEST(CharucoObservation, BoardsWithTheSmallestMarkersThatAreAcceptedAreRead) {
  for (const char* const dictionary : {"DICT_4X4_50", "DICT_7X7_50"}) {
    const CharucoBoard board{7, 9, 0.024, CharucoBoard::kLeastMarkerShare * 0.024, dictionary};
    const std::size_t read = charucoObservation(board, "", portrait(board)).corners.size();
    std::cout << dictionary << ": " << read << " of 48 corners\n";
    EXPECT_GE(read, CharucoBoard::kLeastCorners) << dictionary;
  }
}

TEST(CharucoObservation, AnotherBoardIsNotTakenForIt) {
  const CharucoBoard board;
  const cv::Mat picture = portrait(board);
  EXPECT_EQ(charucoObservation(board, "", picture).corners.size(), 48u);
  for (const CharucoBoard& other : {CharucoBoard{6, 9},
                                    {8, 9},
                                    {5, 11},
                                    {7, 9, 0.024, 0.01},
                                    {7, 9, 0.024, 0.018, "DICT_5X5_100"}}) {
    EXPECT_LT(charucoObservation(other, "", picture).corners.size(), 8u)
        << other.columns << " x " << other.rows << " " << other.marker_size << " "
        << other.dictionary;
  }
  EXPECT_TRUE(
      charucoObservation(board, "", cv::Mat(480, 640, CV_8UC1, cv::Scalar(128))).corners.empty());
}

TEST(CharucoObservation, OfAnUnnoticedFirstRowItsCornersAreShiftedByASquare) {
  // Taken for a board that begins with a white square, all but the markers at the end of a row lie
  // one square further to the left: the board is the same to a calibration.
  const CharucoBoard board, legacy{7, 10, 0.024, 0.018, "DICT_4X4_50", true};
  const cv::Mat picture = portrait(board);
  const BoardObservation right = charucoObservation(board, "", picture);
  const BoardObservation shifted = charucoObservation(legacy, "", picture);
  ASSERT_GE(shifted.corners.size(), 30u);
  std::vector<Eigen::Vector2d> shifts;
  for (const BoardCorner& corner : shifted.corners) {
    const auto same = std::find_if(
        right.corners.begin(), right.corners.end(),
        [&](const BoardCorner& one) { return (one.pixel - corner.pixel).norm() < 0.01; });
    ASSERT_NE(same, right.corners.end());
    shifts.push_back(corner.board - same->board);
    EXPECT_LT((shifts.back() - shifts.front()).norm(), 1e-12);
  }
}

TEST(CharucoObservation, AMarkerSeenTwiceIsNotUsed) {
  const CharucoBoard board;
  cv::Mat picture = portrait(board, 0);
  const auto markers = findMarkers(board.dictionary, picture);
  ASSERT_EQ(markers.size(), 31u);
  // Marker 8 again, on the empty part of the picture.
  cv::Mat again;
  cv::resize(markerCells(board.dictionary, 8), again, {60, 60}, 0, 0, cv::INTER_NEAREST);
  cv::Mat corner = picture(cv::Rect(0, 0, 100, 100));
  corner = 255.0;
  again.copyTo(corner(cv::Rect(20, 20, 60, 60)));
  const auto found = findMarkers(board.dictionary, picture);
  EXPECT_EQ(found.size(), 30u);
  EXPECT_TRUE(
      std::none_of(found.begin(), found.end(), [](const auto& one) { return one.id == 8; }));
}

TEST(WhyNoCharuco, NamesTheLikelyCause) {
  const CharucoBoard board;
  const auto why = [](const CharucoBoard& asked, const cv::Mat& picture) {
    EXPECT_LT(charucoObservation(asked, "", picture).corners.size(), 8u);
    return whyNoCharuco(asked, {picture});
  };
  const cv::Mat own = portrait(board);
  EXPECT_EQ(why({7, 9, 0.024, 0.018, "DICT_6X6_250"}, own),
            "they show 31 markers of DICT_4X4_50 and 0 of DICT_6X6_250: give --dictionary "
            "DICT_4X4_50");
  EXPECT_EQ(
      why({5, 7, 0.024, 0.018}, own),
      "they show 31 markers of DICT_4X4_50, up to number 30, which lie as on a board of 7 "
      "squares across and 9 or more down, not of 5 x 7: count its squares, and give --squares "
      "ACROSS,DOWN");
  EXPECT_EQ(
      why({9, 7, 0.024, 0.018}, own),
      "they show 31 markers of DICT_4X4_50, up to number 30, which lie as on a board of 7 "
      "squares across and 9 or more down, not of 9 x 7: count its squares, and give --squares "
      "ACROSS,DOWN");
  EXPECT_EQ(
      why({7, 9, 0.024, 0.01}, own),
      "they show 31 markers of DICT_4X4_50, up to number 30, which are about 0.75 of a square "
      "wide, not 0.416667: measure both, and give --square-size-m and --marker-size-m");
  const CharucoBoard legacy{6, 8, 0.03, 0.024, "DICT_5X5_250", true};
  CharucoBoard black = legacy;
  black.legacy_pattern = false;
  EXPECT_EQ(
      why(black, portrait(legacy)),
      "they show 24 markers of DICT_5X5_250, up to number 23, on a board with a white top left "
      "square: give --legacy-pattern");
  EXPECT_EQ(
      why(legacy, portrait(black)),
      "they show 24 markers of DICT_5X5_250, up to number 23, on a board with a black top left "
      "square: leave out --legacy-pattern");
  const cv::Mat tags =
      boardPicture(plainCamera(), TagBoard(), boardPose(plainCamera(), 0.5, 0.5, 0.4, {0.3, 0, 0}));
  EXPECT_EQ(why(board, tags), "they show the board of tags: leave out --board charuco");
  EXPECT_EQ(why(board, cv::Mat(480, 640, CV_8UC1, cv::Scalar(128))),
            "they show hardly any marker of any dictionary: hold the board close, wholly in the "
            "picture, in focus and in even light; a mirrored or inverted board is not read");
}

}  // namespace
}  // namespace helix_arm::vision
