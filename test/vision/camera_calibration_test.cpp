#include "helix_arm/vision/camera_calibration.hpp"

#include <cmath>
#include <iostream>

#include <gtest/gtest.h>

#include "helix_arm/basics/median.hpp"
#include "helix_arm/vision/charuco_board.hpp"
#include "helix_arm/vision/tag_detector.hpp"
#include "support/board_studio.hpp"
#include "support/has.hpp"

namespace helix_arm::vision {
namespace {

using estimation::Camera;
using namespace test;

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
  constexpr int kDraws = 30;
  int off = 0, count = 0;
  std::vector<double> relative;
  for (int draw = 0; draw < kDraws; ++draw) {
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
  EXPECT_LE(off, count / 20);
  // 0.67 for normal errors; the larger of two estimates is on the safe side.
  EXPECT_GT(basics::medianOf(relative), 0.35);
}

TEST(CameraCalibration, ErrorsThatAViewSharesRaiseTheStandardErrors) {
  Random random(4);
  const Camera camera = boardCamera();
  const auto poses = boardPoses(camera, 15, random);
  auto observations = cornersOf(camera, poses, 0.1, random);
  const double before =
      calibrateCamera(kBoard.parts(), sizeOf(camera), observations).parameters[0].standard_error;
  // A board that is bent by up to a millimetre moves corners of a view together.
  for (BoardObservation& observation : observations) {
    const double bend = random.uniform(-0.6, 0.6);
    for (BoardCorner& corner : observation.corners) {
      corner.pixel.x() += bend * std::pow(corner.board.x() / (0.5 * kBoard.width()), 2);
    }
  }
  const CameraCalibration bent = calibrateCamera(kBoard.parts(), sizeOf(camera), observations);
  EXPECT_GT(bent.parameters[0].standard_error, 1.5 * before);
  EXPECT_LT(std::abs(bent.camera.fx - camera.fx), 4 * bent.parameters[0].standard_error);
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

TEST(CameraCalibration, WhatLimitsItIsSaidWithValueAndRemedy) {
  Random random(8);
  const Camera camera = boardCamera();
  std::vector<lie::SE3> poses;
  for (int i = 0; i < 12; ++i) {  // all on the left and far, three of them tilted
    const double tilt = i < 3 ? 0.6 : 0.1;
    poses.push_back(boardPose(camera, 0.25 + 0.01 * i, 0.45, 0.55,
                              {tilt * std::cos(i), tilt * std::sin(i), 0}));
  }
  const CameraCalibration found =
      calibrateCamera(kBoard.parts(), sizeOf(camera), cornersOf(camera, poses, 0.9, random), {2});
  std::string all = found.reason + "\n";
  for (const std::string& warning : found.warnings) all += warning + "\n";
  for (const char* const said : {"% of the picture; expected 60 %: hold the board also at the ",
                                 "views are tilted by 20 degrees or more; expected 4",
                                 "fx has a standard error of", "px; expected 0.6 px: glue"}) {
    EXPECT_NE(all.find(said), std::string::npos) << said << "\n" << all;
  }
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

TEST(Coverage, CountsCellsThatHoldCorners) {
  Coverage coverage({800, 600});
  EXPECT_EQ(coverage.fraction(), 0);
  EXPECT_EQ(coverage.emptiest(), "top left");
  const auto add = [&coverage](double x, double y) { coverage.add({"", {{0, {0, 0}, {x, y}}}}); };
  add(-0.5, -0.5);
  EXPECT_NEAR(coverage.fraction(), 1.0 / 48, 1e-15);
  add(99, 99);  // the same cell
  EXPECT_NEAR(coverage.fraction(), 1.0 / 48, 1e-15);
  for (int column = 0; column < 8; ++column) {
    for (int row = 0; row < 6; ++row) {
      if (column >= 5 && row >= 4) continue;
      add(100 * column + 50, 100 * row + 50);
    }
  }
  EXPECT_NEAR(coverage.fraction(), 42.0 / 48, 1e-15);
  EXPECT_EQ(coverage.emptiest(), "bottom right");
  for (const int column : {5, 6, 7}) {
    for (const int row : {4, 5}) add(100 * column + 50, 100 * row + 50);
  }
  EXPECT_EQ(coverage.fraction(), 1);
  EXPECT_EQ(coverage.emptiest(), "");
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

}  // namespace
}  // namespace helix_arm::vision
