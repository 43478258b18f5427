#include "vision/camera_calibration.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iostream>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "basics/median.hpp"
#include "helix_arm/vision/tag_detector.hpp"
#include "simulation/camera.hpp"
#include "support/has.hpp"
#include "support/opencv_charuco.hpp"
#include "support/random.hpp"
#include "support/refusal.hpp"
#include "support/test_size.hpp"
#include "vision/charuco_board.hpp"

namespace helix_arm::vision {
namespace {

using estimation::Camera;
using namespace test;

// A webcam of 1280 x 720 with the distortion that such have.
Camera boardCamera() {
  return {1280, 720, 931.5, 929.8, 644.2, 357.6, {0.08, -0.17, 0.0008, -0.0006, 0.06, 0, 0, 0}};
}

// Board frame: origin in its centre, x right, y up, z to the reader.
// @param u, v  where its centre appears, as parts of the picture.
// @param tilt  rotation vector of the board from facing the camera [rad].
lie::SE3 boardPose(const Camera& camera, double u, double v, double distance,
                   const Eigen::Vector3d& tilt) {
  const Eigen::Matrix3d facing = Eigen::Vector3d(1, -1, -1).asDiagonal();
  const Eigen::AngleAxisd turn(
      tilt.norm(), tilt.norm() > 0 ? Eigen::Vector3d(tilt.normalized()) : Eigen::Vector3d(1, 0, 0));
  return {turn * facing,
          {distance * (u * camera.width - camera.cx) / camera.fx,
           distance * (v * camera.height - camera.cy) / camera.fy, distance}};
}

// Poses as a person would hold the board: near, all over the picture, tilted to each side.
std::vector<lie::SE3> boardPoses(const Camera& camera, int count, Random& random) {
  std::vector<lie::SE3> poses;
  for (int i = 0; i < count; ++i) {
    const double u = (0.2 + 0.6 * (i % 3) / 2.0) + random.uniform(-0.05, 0.05);
    const double v = (0.25 + 0.5 * ((i / 3) % 3) / 2.0) + random.uniform(-0.05, 0.05);
    Eigen::Vector3d tilt = random.uniform(0.25, 0.75) * random.direction<3>();
    tilt.z() *= 0.3;
    poses.push_back(boardPose(camera, u, v, random.uniform(0.24, 0.4), tilt));
  }
  return poses;
}

// A picture of a board, of either kind.
template <class Board>
cv::Mat boardPicture(const Camera& camera, const Board& board, const lie::SE3& X_CP,
                     const simulation::SimulatedCameraConfig& config = {}) {
  return simulation::boardCamera(camera, board, X_CP, config)
      .render(simulation::kArmOutOfView)
      .clone();
}

// What a detector would find, each coordinate off by normal noise [px].
BoardObservation boardCorners(const Camera& camera, const TagBoard& board, const lie::SE3& X_CP,
                              double noise, Random& random) {
  BoardObservation observation{"", {}};
  for (int id = board.first_id; id < board.first_id + board.count(); ++id) {
    const estimation::Corners plane = board.corners(id);
    std::vector<BoardCorner> tag;
    for (int c = 0; c < 4; ++c) {
      const auto pixel = camera.project(X_CP * Eigen::Vector3d(plane(0, c), plane(1, c), 0));
      if (!pixel || !camera.contains(*pixel)) break;
      tag.push_back({4 * (id - board.first_id) + c, plane.col(c),
                     *pixel + noise * Eigen::Vector2d(random.normal(), random.normal())});
    }
    if (tag.size() == 4)
      observation.corners.insert(observation.corners.end(), tag.begin(), tag.end());
  }
  return observation;
}

const TagBoard kBoard;

cv::Size sizeOf(const Camera& camera) { return {camera.width, camera.height}; }

std::vector<BoardObservation> cornersOf(const Camera& camera, const std::vector<lie::SE3>& poses,
                                        double noise, Random& random) {
  std::vector<BoardObservation> observations;
  for (const lie::SE3& pose : poses) {
    observations.push_back(boardCorners(camera, kBoard, pose, noise, random));
    observations.back().name = "view_" + std::to_string(observations.size());
  }
  return observations;
}

// In the order of the parameters.
std::vector<double> truthOf(const Camera& camera) {
  std::vector<double> truth{camera.fx, camera.fy, camera.cx, camera.cy};
  truth.insert(truth.end(), camera.distortion.begin(), camera.distortion.end());
  return truth;
}

// Largest distance between the pixels of a direction, over the picture up to 5 % from its edge.
double worstPixel(const Camera& a, const Camera& truth) {
  double worst = 0;
  for (double u = 0.05; u < 0.96; u += 0.05) {
    for (double v = 0.05; v < 0.96; v += 0.05) {
      const Eigen::Vector2d pixel(u * truth.width, v * truth.height);
      worst = std::max(worst, (a.pixelOf(truth.directionOf(pixel).value()) - pixel).norm());
    }
  }
  return worst;
}

TEST(CameraCalibration, ExactCornersGiveTheCameraItself) {
  Random random(1);
  Camera rational = boardCamera();
  rational.distortion = {0.31, -0.12, 0.0008, -0.0006, 0.02, 0.2, -0.05, 0.01};
  const Camera plain{1280, 720, 700, 705, 630, 365, {}};
  for (const auto& [camera, coefficients] :
       {std::pair{boardCamera(), 5}, {plain, 0}, {plain, 2}, {plain, 4}, {rational, 8}}) {
    SCOPED_TRACE(coefficients);
    const auto observations = cornersOf(camera, boardPoses(camera, 15, random), 0, random);
    const CameraCalibration found =
        calibrateCamera(kBoard.parts(), sizeOf(camera), observations, {coefficients});
    ASSERT_TRUE(found.success) << found.reason;
    // OpenCV takes corners as floats.
    EXPECT_LT(worstPixel(found.camera, camera), 0.02);
    EXPECT_LT(found.rms, 1e-3);
    EXPECT_EQ(found.camera.width, camera.width);
    EXPECT_EQ(found.camera.height, camera.height);
  }
}

TEST(CameraCalibration, TrueParametersLieWithinThreeStandardErrors) {
  Random random(3);
  const Camera camera = boardCamera();
  const std::vector<double> truth = truthOf(camera);
  const int draws = test::draws(10, 30);
  int off = 0, count = 0;
  std::vector<double> relative;
  for (int draw = 0; draw < draws; ++draw) {
    const auto observations = cornersOf(camera, boardPoses(camera, 12, random), 0.3, random);
    const CameraCalibration found = calibrateCamera(kBoard.parts(), sizeOf(camera), observations);
    ASSERT_TRUE(found.success) << found.reason;
    EXPECT_NEAR(found.rms, 0.3, 0.03);
    for (std::size_t i = 0; i < found.parameters.size(); ++i) {
      const double error = std::abs(found.parameters[i].value - truth[i]);
      relative.push_back(error / found.parameters[i].standard_error);
      off += relative.back() > 3 ? 1 : 0;
      ++count;
    }
  }
  std::cout << off << " of " << count << " beyond 3 standard errors, median error "
            << basics::medianOf(relative) << " standard errors\n";
  EXPECT_LE(off, test::isFullSize() ? count / 20 : test::mostOf(count, 0.0027));
  // 0.67 for normal errors; the larger of two estimates is on the safe side.
  EXPECT_GT(basics::medianOf(relative), 0.35);
}

TEST(CameraCalibration, ViewsFromTheFrontAloneDoNotDetermineTheFocalLength) {
  Random random(5);
  const Camera camera = boardCamera();
  std::vector<lie::SE3> poses;
  for (int i = 0; i < 12; ++i) {
    poses.push_back(
        boardPose(camera, 0.3 + 0.4 * (i % 3) / 2, 0.4 + 0.2 * (i / 6), 0.4, {0, 0, 0.3 * i}));
  }
  const CameraCalibration found =
      calibrateCamera(kBoard.parts(), sizeOf(camera), cornersOf(camera, poses, 0.5, random));
  ASSERT_FALSE(found.success);
  EXPECT_TRUE(has(found.reason, "tilt the board to each side"));
}

TEST(CameraCalibration, AViewThatDoesNotFitIsLeftOutAndNamed) {
  Random random(6);
  const Camera camera = boardCamera();
  auto observations = cornersOf(camera, boardPoses(camera, 14, random), 0.2, random);
  for (BoardCorner& corner : observations[4].corners) corner.pixel.y() += 12 * random.normal();
  const CameraCalibration found = calibrateCamera(kBoard.parts(), sizeOf(camera), observations);
  ASSERT_TRUE(found.success) << found.reason;
  for (std::size_t i = 0; i < found.views.size(); ++i) {
    EXPECT_EQ(found.views[i].used, i != 4) << i;
  }
  EXPECT_EQ(found.views[4].name, "view_5");
  EXPECT_TRUE(has(found.views[4].reason, "the larger of 0.3 px and three times the median"));
  EXPECT_NEAR(found.camera.fx / camera.fx, 1, 0.005);
}

TEST(CameraCalibration, TooFewViewsAreRefusedWithTheRemedy) {
  Random random(7);
  const Camera camera = boardCamera();
  auto observations = cornersOf(camera, boardPoses(camera, 6, random), 0.2, random);
  observations[0].corners.resize(20);
  observations[1].corners.resize(20);
  const CameraCalibration found = calibrateCamera(kBoard.parts(), sizeOf(camera), observations);
  EXPECT_FALSE(found.success);
  EXPECT_EQ(found.reason,
            "4 of 6 pictures show 6 tags of the board or more; expected 5: print it with helix_arm "
            "tags --board and take 15 pictures or more");
  EXPECT_EQ(found.views[0].reason, "it shows 5 tags of the board; expected 6");
  EXPECT_TRUE(found.parameters.empty());
  EXPECT_EQ(calibrateCamera(kBoard.parts(), {}, {}).success, false);
}

TEST(CameraCalibration, ViewsOfOneRowOfCornersAreNotUsed) {
  Random random(11);
  const Camera camera = boardCamera();
  const CharucoBoard board{10, 5, 0.02, 0.015};
  std::vector<BoardObservation> observations;
  for (const lie::SE3& pose : boardPoses(camera, 6, random)) {
    BoardObservation observation{"", {}};
    for (int id = 0; id < board.cornerCount(); ++id) {
      const Eigen::Vector2d at = board.corner(id);
      observation.corners.push_back(
          {id, at, camera.project(pose * Eigen::Vector3d(at.x(), at.y(), 0)).value()});
    }
    observations.push_back(observation);
  }
  EXPECT_TRUE(calibrateCamera(board.parts(), sizeOf(camera), observations, {2}).success);
  observations[2].corners.resize(9);
  const CameraCalibration found = calibrateCamera(board.parts(), sizeOf(camera), observations, {2});
  EXPECT_FALSE(found.views[2].used);
  EXPECT_EQ(found.views[2].reason, "all inner chessboard corners that it shows are on one line");
  EXPECT_TRUE(found.success);
}

TEST(BoardObservation, HoldsOnlyTagsOfTheBoardThatAreReadWithoutDoubt) {
  const auto tag = [](int id, int hamming) {
    return TagDetection{id, hamming, 50, estimation::Corners::Constant(100)};
  };
  const BoardObservation observation = boardObservation(
      kBoard, "a.png", {200, 200},
      {tag(3, 0), tag(556, 0), tag(557, 0), tag(560, 1), tag(570, 0), tag(570, 0), tag(586, 0)});
  EXPECT_EQ(observation.name, "a.png");
  ASSERT_EQ(observation.corners.size(), 8u);
  for (int c = 0; c < 4; ++c) {
    const auto first = static_cast<std::size_t>(c);
    EXPECT_EQ(observation.corners[first].id, c);
    EXPECT_EQ(observation.corners[first].board, kBoard.corners(557).col(c));
    EXPECT_EQ(observation.corners[first + 4].id, 4 * 29 + c);
    EXPECT_EQ(observation.corners[first + 4].board, kBoard.corners(586).col(c));
  }
}

// Corners at pixel p lie p + 0.5 px from the left and upper border.
TEST(BoardObservation, OmitsTagsThatTheBorderMayCut) {
  const auto seen = [](double left, double top, double right, double bottom) {
    TagDetection tag{557, 0, 50, {}};
    tag.corners << left, right, right, left, bottom, bottom, top, top;
    return boardObservation(kBoard, "", {1280, 720}, {tag}).corners.size() == 4;
  };
  EXPECT_TRUE(seen(7.6, 7.6, 1271.4, 711.4));
  EXPECT_FALSE(seen(7.4, 7.6, 1271.4, 711.4));
  EXPECT_FALSE(seen(7.6, 7.4, 1271.4, 711.4));
  EXPECT_FALSE(seen(7.6, 7.6, 1271.6, 711.4));
  EXPECT_FALSE(seen(7.6, 7.6, 1271.4, 711.6));
}

TEST(BoardViews, AreChosenAtRestAndAtNewPlaces) {
  Random random(9);
  const Camera camera = boardCamera();
  BoardViews views(sizeOf(camera), kBoard.parts());
  const auto at = [&](double u) {
    return boardCorners(camera, kBoard, boardPose(camera, u, 0.5, 0.4, {0.3, 0, 0}), 0.1, random);
  };
  EXPECT_FALSE(views.offer(at(0.4))) << "nothing says that it rests";
  EXPECT_TRUE(views.offer(at(0.4)));
  EXPECT_FALSE(views.offer(at(0.4))) << "there is this view";
  EXPECT_FALSE(views.offer(at(0.6))) << "it moves";
  EXPECT_TRUE(views.offer(at(0.6)));
  EXPECT_FALSE(views.offer(at(0.602))) << "2.6 px: it moves";
  EXPECT_FALSE(views.offer(at(0.602))) << "too close to the last";
  BoardObservation few = at(0.2);
  few.corners.resize(static_cast<std::size_t>(kBoard.parts().leastCorners() - 1));
  EXPECT_FALSE(views.offer(few));
  EXPECT_FALSE(views.offer(at(0.2))) << "nothing says that it rests";
  EXPECT_EQ(views.chosen().size(), 2u);
}

TEST(TagBoard, IdsCountRowByRowFromTheTopLeftCornersAreThoseOfTheBorder) {
  TagBoard board;
  board.first_id = 7;
  board.columns = 3;
  board.rows = 2;
  board.tag_size = 0.02;
  board.pitch = 0.03;
  EXPECT_EQ(board.count(), 6);
  EXPECT_NEAR(board.width(), 0.08, 1e-15);
  EXPECT_NEAR(board.height(), 0.05, 1e-15);
  estimation::Corners first, last;
  first << -0.04, -0.02, -0.02, -0.04, 0.005, 0.005, 0.025, 0.025;
  last << 0.02, 0.04, 0.04, 0.02, -0.025, -0.025, -0.005, -0.005;
  EXPECT_TRUE(board.corners(7).isApprox(first, 1e-12)) << board.corners(7);
  EXPECT_TRUE(board.corners(12).isApprox(last, 1e-12)) << board.corners(12);
}

TEST(TagBoard, TheShippedOneHasTheLastTagsOfItsFamily) {
  const TagBoard board;
  EXPECT_EQ(board.first_id + board.count(), TagFamily(board.family).count());
}

// ---- ChArUco boards: geometry, dictionaries, what is read from rendered pictures ----------------

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
    const cv::aruco::Dictionary dictionary(cv::aruco::getPredefinedDictionary(static_cast<int>(i)));
    EXPECT_EQ(dictionary.bytesList.rows, known[i].markers) << known[i].name;
    EXPECT_EQ(dictionary.markerSize, known[i].bits) << known[i].name;
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

}  // namespace
}  // namespace helix_arm::vision
