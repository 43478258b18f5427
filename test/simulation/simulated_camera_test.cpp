#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "simulation/camera.hpp"
#include "support/random.hpp"

namespace helix_arm::test {
namespace {

constexpr double kTagSize = 0.031;  // [m]

estimation::Camera plainCamera() { return {640, 480, 800, 790, 322.3, 237.8, {}}; }

// One whose straight lines bend by tens of pixels.
estimation::Camera distortingCamera() {
  estimation::Camera camera = plainCamera();
  camera.distortion = {-0.35, 0.12, 0.004, -0.003, 0.02, 0.05, 0.01, 0.0};
  return camera;
}

// Without blur and noise.
simulation::SimulatedCameraConfig sharpConfig() {
  simulation::SimulatedCameraConfig config;
  config.blur = 0;
  config.noise = 0;
  return config;
}

// The tag's face to the camera: x right, y up in the picture.
Eigen::Matrix3d facingCamera() { return Eigen::Vector3d(1, -1, -1).asDiagonal(); }

// A tag somewhere before the camera, turned off its line of sight by up to 60 degrees.
lie::SE3 randomTagPose(Random& random, double nearest, double farthest) {
  const double z = random.uniform(nearest, farthest);
  const Eigen::Vector3d tilt = random.uniform(0, 1.0) * random.direction<3>();
  const Eigen::AngleAxisd turn(tilt.norm(), tilt.normalized());
  const Eigen::AngleAxisd roll(random.uniform(0, 6.28), Eigen::Vector3d::UnitZ());
  return {turn * (facingCamera() * roll.toRotationMatrix()),
          {random.uniform(-0.22, 0.22) * z, random.uniform(-0.15, 0.15) * z, z}};
}

// Tags with these poses X_CT, ids from 0, and an arm that is out of sight: beside the camera.
estimation::ArmView studio(const estimation::Camera& camera, const std::vector<lie::SE3>& poses) {
  estimation::ArmView view{camera, {}, {kTagSize, {}}, 1};
  for (const lie::SE3& X_CT : poses) {
    view.layout.tags.push_back({static_cast<int>(view.layout.tags.size()), 0, 0.0, X_CT});
  }
  return view;
}
model::Twists studioTwists() { return model::Twists::Identity(6, 1) * 0.4; }

cv::Mat photograph(const estimation::ArmView& view,
                   const simulation::SimulatedCameraConfig& config) {
  simulation::SimulatedCamera camera(view, vision::TagFamily("36h11"), {}, config);
  return camera.render(studioTwists()).clone();
}

using namespace simulation;

const lie::SE3 kBefore{facingCamera(), {0.0, 0.0, 0.3}};  // in the middle of the picture

bool same(const cv::Mat& a, const cv::Mat& b) { return cv::norm(a, b, cv::NORM_INF) == 0; }

TEST(SimulatedCamera, TagsThatShowTheirBacksOrAreBehindTheCameraOrOutOfThePictureAreNotDrawn) {
  const lie::SE3 back{Eigen::Matrix3d::Identity(), {0.0, 0.0, 0.3}};
  const lie::SE3 behind{Eigen::Vector3d(1, 1, 1).asDiagonal(), {0.0, 0.0, -0.3}};
  const lie::SE3 beside{facingCamera(), {0.4, 0.0, 0.3}};
  for (const estimation::Camera& camera : {plainCamera(), distortingCamera()}) {
    const cv::Mat empty = photograph(studio(camera, {}), sharpConfig());
    EXPECT_TRUE(same(photograph(studio(camera, {back, behind, beside}), sharpConfig()), empty));
    EXPECT_FALSE(same(photograph(studio(camera, {kBefore}), sharpConfig()), empty));
  }
}

// Where the simulated camera draws the tags: it is the truth of every figure of accuracy.

using estimation::Camera;

enum class Paper { kNone, kBlack, kWhite };

// What the definition says is printed at (u, v) of a tag's plane [m]; white reaches `border_shift`
// into black.
Paper paperAt(const cv::Mat& cells, int quiet, double u, double v, double border_shift) {
  const double cell = kTagSize / (cells.cols - 2 * quiet);
  const auto colour = [&](double x, double y) {
    const int column = static_cast<int>(std::floor(x / cell + 0.5 * cells.cols));
    const int row = static_cast<int>(std::floor(0.5 * cells.rows - y / cell));
    if (column < 0 || row < 0 || column >= cells.cols || row >= cells.rows) return Paper::kNone;
    return cells.at<uchar>(row, column) != 0 ? Paper::kWhite : Paper::kBlack;
  };
  const Paper here = colour(u, v);
  if (here != Paper::kBlack || border_shift == 0) return here;
  for (const double du : {-border_shift, border_shift}) {
    for (const double dv : {-border_shift, border_shift}) {
      if (colour(u + du, v + dv) == Paper::kWhite) return Paper::kWhite;
    }
  }
  return here;
}

struct Coverage {
  double white = 0, card = 0;
};

// By brute force: rays through 16 x 16 points of the pixel.
Coverage coverageOf(const Camera& camera, const lie::SE3& X_CT, const cv::Mat& cells, int quiet,
                    int px, int py, double border_shift) {
  constexpr int kPoints = 16;
  int white = 0, card = 0;
  for (int i = 0; i < kPoints * kPoints; ++i) {
    const auto direction = camera.directionOf(
        {px - 0.5 + (i % kPoints + 0.5) / kPoints, py - 0.5 + (i / kPoints + 0.5) / kPoints});
    if (!direction) continue;
    const Eigen::Vector3d ray(direction->x(), direction->y(), 1.0);
    const Eigen::Vector3d normal = X_CT.rotation.col(2);
    const double z = normal.dot(X_CT.translation) / normal.dot(ray);
    const Eigen::Vector3d p_T = X_CT.inverse() * Eigen::Vector3d(z * ray);
    const Paper paper = paperAt(cells, quiet, p_T.x(), p_T.y(), border_shift);
    white += paper == Paper::kWhite;
    card += paper != Paper::kNone;
  }
  constexpr double kAll = kPoints * kPoints;
  return {white / kAll, card / kAll};
}

// White area and gray level, by column and row.
using Pixels = std::map<std::pair<int, int>, std::pair<double, double>>;

// The motion of the edges that explains best what the gray levels differ from the areas by [px]:
// affine, with 1 `reach` px from the middle, and out of white.
double edgeMotion(const Pixels& pixels, const Eigen::Vector2d& middle, int reach, double darkest,
                  double brightest) {
  using Motion = Eigen::Matrix<double, 7, 1>;
  Eigen::Matrix<double, 7, 7> normal = Eigen::Matrix<double, 7, 7>::Zero();
  Motion right = Motion::Zero();
  for (const auto& [pixel, at] : pixels) {
    const auto& [x, y] = pixel;
    const auto left = pixels.find({x - 1, y}), next = pixels.find({x + 1, y}),
               above = pixels.find({x, y - 1}), below = pixels.find({x, y + 1});
    if (left == pixels.end() || next == pixels.end()) continue;
    if (above == pixels.end() || below == pixels.end()) continue;
    const Eigen::Vector2d slope(0.5 * (next->second.first - left->second.first),
                                0.5 * (below->second.first - above->second.first));
    Motion by;
    by << -slope, -(x - middle.x()) / reach * slope, -(y - middle.y()) / reach * slope,
        slope.norm();
    normal += by * by.transpose();
    right += by * ((at.second - darkest) / (brightest - darkest) - at.first);
  }
  return Motion(normal.ldlt().solve(right)).cwiseAbs().maxCoeff();
}

// Pixels wholly on the card are black + (white - black) * white area; both levels are taken from
// the picture. The sampled areas are good to half a row of points, 1/32.
// @param motion  of edges, at most [px]: of those along rows of points the areas tell less.
void expectExactPixels(const Camera& camera, const lie::SE3& X_CT, double border_shift,
                       double motion) {
  const vision::TagFamily family("36h11");
  const cv::Mat cells = family.cells(0);
  auto config = sharpConfig();
  config.border_shift = border_shift;
  const cv::Mat picture = photograph(studio(camera, {X_CT}), config);
  const auto middle = camera.project(X_CT.translation);
  ASSERT_TRUE(middle);
  const int reach = static_cast<int>(camera.fx * kTagSize / X_CT.translation.z());
  Pixels inside;
  int edges = 0;
  double darkest = 255, brightest = 0;
  for (int y = std::max(0, static_cast<int>(middle->y()) - reach);
       y < std::min(camera.height, static_cast<int>(middle->y()) + reach); ++y) {
    for (int x = std::max(0, static_cast<int>(middle->x()) - reach);
         x < std::min(camera.width, static_cast<int>(middle->x()) + reach); ++x) {
      const Coverage c = coverageOf(camera, X_CT, cells, family.quietCells(), x, y, border_shift);
      if (c.card < 1) continue;
      const double gray = picture.at<uchar>(y, x);
      inside[{x, y}] = {c.white, gray};
      if (c.white > 0.1 && c.white < 0.9) ++edges;
      if (c.white == 0) darkest = std::min(darkest, gray);
      if (c.white == 1) brightest = std::max(brightest, gray);
    }
  }
  ASSERT_GT(edges, 200);
  ASSERT_GT(brightest - darkest, 80);
  double sum = 0, squares = 0, worst = 0;
  for (const auto& [pixel, at] : inside) {
    const auto& [white, gray] = at;
    const double difference = (gray - darkest) / (brightest - darkest) - white;
    sum += difference;
    squares += difference * difference;
    worst = std::max(worst, std::abs(difference));
  }
  const double n = static_cast<double>(inside.size());
  EXPECT_LT(std::abs(sum / n), 0.001);
  EXPECT_LT(std::sqrt(squares / n), 0.008);
  EXPECT_LT(worst, 0.05);
  EXPECT_LT(edgeMotion(inside, *middle, reach, darkest, brightest), motion);
}

TEST(Picture, EveryPixelIsTheMeanOfTheCardThatItShowsAndEdgesLieWithin5ThousandthsOfAPixel) {
  Random random(5);
  for (const Camera& camera : {plainCamera(), distortingCamera()}) {
    for (int i = 0; i < 2; ++i) {
      expectExactPixels(camera, randomTagPose(random, 0.35, 0.6), 0.0, 0.005);
      const lie::SE3 X_CT = randomTagPose(random, 0.35, 0.6);
      expectExactPixels(camera, X_CT, random.uniform(1e-4, 1e-3), 0.005);
    }
  }
}

}  // namespace
}  // namespace helix_arm::test
