// Where the simulated camera draws the tags: it is the truth of every figure of accuracy.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "helix_arm/simulation/camera.hpp"
#include "support/random.hpp"
#include "tag_studio.hpp"

namespace helix_arm::test {
namespace {

using estimation::Camera;
using estimation::Corners;

enum class Paper { kNone, kBlack, kWhite };

// What the definition says is printed at (u, v) of a tag's plane [m]; white reaches `bleed` into
// black.
Paper paperAt(const cv::Mat& cells, int quiet, double u, double v, double bleed) {
  const double cell = kTagSize / (cells.cols - 2 * quiet);
  const auto colour = [&](double x, double y) {
    const int column = static_cast<int>(std::floor(x / cell + 0.5 * cells.cols));
    const int row = static_cast<int>(std::floor(0.5 * cells.rows - y / cell));
    if (column < 0 || row < 0 || column >= cells.cols || row >= cells.rows) return Paper::kNone;
    return cells.at<uchar>(row, column) != 0 ? Paper::kWhite : Paper::kBlack;
  };
  const Paper here = colour(u, v);
  if (here != Paper::kBlack || bleed == 0) return here;
  for (const double du : {-bleed, bleed}) {
    for (const double dv : {-bleed, bleed}) {
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
                    int px, int py, double bleed) {
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
    const Paper paper = paperAt(cells, quiet, p_T.x(), p_T.y(), bleed);
    white += paper == Paper::kWhite;
    card += paper != Paper::kNone;
  }
  constexpr double kAll = kPoints * kPoints;
  return {white / kAll, card / kAll};
}

// Pixels wholly on the card are black + (white - black) * white area; both levels are taken from
// the picture. The sampled areas are good to half a row of points, 1/32.
void expectExactPixels(const Camera& camera, const lie::SE3& X_CT, double bleed) {
  const vision::TagFamily family("36h11");
  const cv::Mat cells = family.cells(0);
  auto config = sharpConfig();
  config.bleed = bleed;
  const cv::Mat picture = photograph(studio(camera, {X_CT}), config);
  const auto middle = camera.project(X_CT.translation);
  ASSERT_TRUE(middle);
  const int reach = static_cast<int>(camera.fx * kTagSize / X_CT.translation.z());
  std::vector<std::pair<double, double>> inside;  // white area, gray level
  int edges = 0;
  double darkest = 255, brightest = 0;
  for (int y = std::max(0, static_cast<int>(middle->y()) - reach);
       y < std::min(camera.height, static_cast<int>(middle->y()) + reach); ++y) {
    for (int x = std::max(0, static_cast<int>(middle->x()) - reach);
         x < std::min(camera.width, static_cast<int>(middle->x()) + reach); ++x) {
      const Coverage c = coverageOf(camera, X_CT, cells, family.quietCells(), x, y, bleed);
      if (c.card < 1) continue;
      inside.emplace_back(c.white, picture.at<uchar>(y, x));
      if (c.white > 0.1 && c.white < 0.9) ++edges;
      if (c.white == 0) darkest = std::min(darkest, inside.back().second);
      if (c.white == 1) brightest = std::max(brightest, inside.back().second);
    }
  }
  ASSERT_GT(edges, 200);
  ASSERT_GT(brightest - darkest, 80);
  double sum = 0, squares = 0, worst = 0;
  for (const auto& [white, gray] : inside) {
    const double difference = (gray - darkest) / (brightest - darkest) - white;
    sum += difference;
    squares += difference * difference;
    worst = std::max(worst, std::abs(difference));
  }
  const double n = static_cast<double>(inside.size());
  EXPECT_LT(std::abs(sum / n), 0.001);
  EXPECT_LT(std::sqrt(squares / n), 0.008);
  EXPECT_LT(worst, 0.05);
}

TEST(Picture, EveryPixelIsTheMeanOfTheCardThatItShows) {
  Random random(5);
  for (const Camera& camera : {plainCamera(), distortingCamera()}) {
    for (int i = 0; i < 2; ++i) {
      expectExactPixels(camera, randomTagPose(random, 0.35, 0.6), 0.0);
      expectExactPixels(camera, randomTagPose(random, 0.35, 0.6), random.uniform(1e-4, 1e-3));
    }
  }
}

TEST(Picture, EdgesAlongTheRowsOfPixelsAreAsExact) {
  Camera camera = plainCamera();
  camera.fx = camera.fy = 800;
  expectExactPixels(camera, {facingCamera(), {0.0123, -0.0077, 0.37}}, 0.0);
}

TEST(Picture, TagsThatReachOutOfThePictureAreDrawnAsFarAsTheyAreIn) {
  expectExactPixels(plainCamera(), {facingCamera(), {-0.161, 0.01, 0.4}}, 0.0);
  expectExactPixels(distortingCamera(), {facingCamera(), {0.02, 0.119, 0.4}}, 0.0);
}

double brightnessAt(const cv::Mat& picture, const Eigen::Vector2d& p) {
  const int x = static_cast<int>(std::floor(p.x())), y = static_cast<int>(std::floor(p.y()));
  const double fx = p.x() - x, fy = p.y() - y;
  return (1 - fy) * ((1 - fx) * picture.at<uchar>(y, x) + fx * picture.at<uchar>(y, x + 1)) +
         fy * ((1 - fx) * picture.at<uchar>(y + 1, x) + fx * picture.at<uchar>(y + 1, x + 1));
}

// How far outside of where it is expected an edge of the border lies, mean along it [px]: from the
// brightness on a way across it, well inside the border and the quiet zone.
double edgeError(const cv::Mat& picture, const Camera& camera, const lie::SE3& X_CT,
                 const Corners& corners, int edge) {
  constexpr int kPlaces = 60, kSteps = 400;
  const double way = 0.8 * kTagSize / 8;  // of a cell
  const Eigen::Vector2d a = corners.col(edge), b = corners.col((edge + 1) % 4);
  const Eigen::Vector2d outward = Eigen::Vector2d(b.y() - a.y(), a.x() - b.x()).normalized();
  const auto pixelAt = [&](const Eigen::Vector2d& q) {
    return *camera.project(X_CT * Eigen::Vector3d(q.x(), q.y(), 0.0));
  };
  double mean = 0;
  for (int i = 0; i < kPlaces; ++i) {
    const Eigen::Vector2d on = a + (0.1 + 0.8 * (i + 0.5) / kPlaces) * (b - a);
    double white = 0;
    const double inside = brightnessAt(picture, pixelAt(on - 0.5 * way * outward));
    const double outside = brightnessAt(picture, pixelAt(on + 0.5 * way * outward));
    for (int k = 0; k < kSteps; ++k) {
      const double off = way * ((k + 0.5) / kSteps - 0.5);
      white += (brightnessAt(picture, pixelAt(on + off * outward)) - inside) /
               ((outside - inside) * kSteps);
    }
    const double pixels =
        (pixelAt(on + 0.5 * way * outward) - pixelAt(on - 0.5 * way * outward)).norm();
    mean += (0.5 - white) * pixels / kPlaces;
  }
  return mean;
}

struct EdgeErrors {
  double mean = 0, worst = 0;
};

EdgeErrors edgeErrors(const Camera& camera, double bleed, unsigned seed) {
  constexpr int kTags = 12;
  Random random(seed);
  auto config = sharpConfig();
  config.blur = 0.7;
  config.bleed = bleed;
  EdgeErrors errors;
  for (int i = 0; i < kTags; ++i) {
    const lie::SE3 X_CT = randomTagPose(random, 0.12, 0.2);
    const estimation::ArmView view = studio(camera, {X_CT});
    const cv::Mat picture = photograph(view, config);
    for (int edge = 0; edge < 4; ++edge) {
      const double error = edgeError(picture, camera, X_CT, view.layout.corners(bleed), edge);
      errors.mean += error / (4 * kTags);
      errors.worst = std::max(errors.worst, std::abs(error));
    }
  }
  return errors;
}

TEST(Picture, BorderEdgesLieWhereTheCameraProjectsThem) {
  for (const Camera& camera : {plainCamera(), distortingCamera()}) {
    const EdgeErrors errors = edgeErrors(camera, 0.0, 11);
    EXPECT_LT(std::abs(errors.mean), 0.001);
    EXPECT_LT(errors.worst, 0.01);
  }
}

TEST(Picture, BleedShrinksTheBorderByAsMuchAtEachEdge) {
  for (const double bleed : {2e-4, 5e-4}) {
    const EdgeErrors errors = edgeErrors(distortingCamera(), bleed, 12);
    EXPECT_LT(std::abs(errors.mean), 0.001);
    EXPECT_LT(errors.worst, 0.01);
  }
}

}  // namespace
}  // namespace helix_arm::test
