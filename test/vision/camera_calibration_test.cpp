#include "vision/camera_calibration.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 7
#include <opencv2/aruco/charuco.hpp>
#else
#include <opencv2/objdetect/aruco_board.hpp>
#endif

#include "basics/median.hpp"
#include "helix_arm/vision/tag_detector.hpp"
#include "simulation/camera.hpp"
#include "support/has.hpp"
#include "support/random.hpp"
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
       {std::pair{boardCamera(), 5}, {plain, 0}, {rational, 8}}) {
    SCOPED_TRACE(coefficients);
    const auto observations = cornersOf(camera, boardPoses(camera, 15, random), 0, random);
    const CameraCalibration found =
        calibrateCamera(kBoard.parts(), sizeOf(camera), observations, {coefficients});
    ASSERT_TRUE(found.success) << found.reason;
    // OpenCV takes corners as floats.
    EXPECT_LT(worstPixel(found.camera, camera), 0.02);
    EXPECT_LT(found.rms, 1e-3);
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
  EXPECT_NEAR(found.camera.fx / camera.fx, 1, 0.005);
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

// ---- ChArUco boards: geometry, dictionaries, what is read from rendered pictures ----------------

Camera plainCamera() { return {1280, 720, 931.5, 929.8, 644.2, 357.6, {}}; }

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
      for (const BoardCorner& corner : observation.corners) {
        EXPECT_EQ(corner.board, board.corner(corner.id));
        const auto truth =
            camera.project(pose * Eigen::Vector3d(corner.board.x(), corner.board.y(), 0));
        const double error = (corner.pixel - truth.value()).norm();
        square += error * error;
        worst = std::max(worst, error);
        ++count;
      }
    }
    const double rms = std::sqrt(square / count);
    EXPECT_GT(count, 0.9 * 4 * board.cornerCount());
    EXPECT_LT(rms, 0.1);
    EXPECT_LT(worst, 0.3);
  }
}

TEST(CharucoObservation, ABoardThatOpenCvDrawsIsRead) {
  const auto known = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11);
  for (const auto& [columns, rows] : {std::pair{7, 9}, {5, 7}}) {
    const CharucoBoard board{columns, rows, 0.02, 0.015, "DICT_APRILTAG_36h11"};
    cv::Mat drawn, picture;
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 7
    cv::aruco::CharucoBoard::create(columns, rows, 0.02F, 0.015F, known)
        ->draw({100 * columns, 100 * rows}, drawn);
#else
    cv::aruco::CharucoBoard({columns, rows}, 0.02F, 0.015F, known)
        .generateImage({100 * columns, 100 * rows}, drawn);
#endif
    cv::copyMakeBorder(drawn, picture, 50, 50, 50, 50, cv::BORDER_CONSTANT, 255);
    const BoardObservation seen = charucoObservation(board, "", picture);
    ASSERT_EQ(seen.corners.size(), static_cast<std::size_t>(board.cornerCount()));
    const Eigen::Vector2d centre(50 * columns + 49.5, 50 * rows + 49.5);
    for (const BoardCorner& corner : seen.corners) {
      const Eigen::Vector2d offset(corner.board.x(), -corner.board.y());
      EXPECT_LT((corner.pixel - centre - 100 / 0.02 * offset).norm(), 0.3) << corner.id;
    }
  }
}

}  // namespace
}  // namespace helix_arm::vision
