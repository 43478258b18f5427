#include <Eigen/Geometry>
#include <random>

#include "camera.hpp"

namespace helix_arm::simulation {
namespace {

constexpr double kEdge = 0.5;                          // of white around a board [squares]
constexpr double kNear = 0.26, kFar = 0.4;             // [m], for a focal length of kFocal
constexpr double kFocal = 930;                         // [px]
constexpr double kLeastTilt = 0.25, kMostTilt = 0.75;  // [rad]
constexpr double kTurn = 0.3;                          // part of the tilt about the optical axis
constexpr double kScatter = 0.05;                      // of the place, as a part of the picture

// A board with a white edge; the unit is a square.
CardPrint charucoPrint(const vision::CharucoBoard& board) {
  const int bits = vision::markerDictionary(board.dictionary).bits + 2;
  const int cells = bits + 2;  // of a square: those of a marker and what is around it
  const double cell = board.marker_size / board.square_size / bits;
  const double around = 0.5 * (1 - board.marker_size / board.square_size);
  const auto widths = [&](int squares) {
    std::vector<double> out{kEdge};
    for (int square = 0; square < squares; ++square) {
      out.push_back(around);
      out.insert(out.end(), static_cast<std::size_t>(bits), cell);
      out.push_back(around);
    }
    out.push_back(kEdge);
    return out;
  };
  CardPrint print{cv::Mat(board.rows * cells + 2, board.columns * cells + 2, CV_8UC1, 255.0),
                  widths(board.columns), widths(board.rows), board.square_size};
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      const cv::Rect square(1 + column * cells, 1 + row * cells, cells, cells);
      if (board.isWhite(column, row)) {
        const cv::Rect inside(square.x + 1, square.y + 1, bits, bits);
        vision::markerCells(board.dictionary, board.markerIn(column, row))
            .copyTo(print.cells(inside));
      } else {
        print.cells(square) = 0.0;
      }
    }
  }
  return print;
}

}  // namespace

std::vector<lie::SE3> boardPoses(const estimation::Camera& camera, int count, std::uint32_t seed) {
  std::mt19937_64 generator(seed);
  const auto uniform = [&generator](double least, double most) {
    return std::uniform_real_distribution<double>(least, most)(generator);
  };
  std::normal_distribution<double> normal;
  const Eigen::Matrix3d facing = Eigen::Vector3d(1, -1, -1).asDiagonal();
  std::vector<lie::SE3> poses;
  for (int i = 0; i < count; ++i) {
    // Nine places in turn.
    const double u = 0.2 + 0.3 * (i % 3) + uniform(-kScatter, kScatter);
    const double v = 0.25 + 0.25 * (i / 3 % 3) + uniform(-kScatter, kScatter);
    Eigen::Vector3d axis;
    for (double& entry : axis) entry = normal(generator);
    Eigen::Vector3d tilt = uniform(kLeastTilt, kMostTilt) * axis.normalized();
    tilt.z() *= kTurn;
    const double distance = uniform(kNear, kFar) * camera.fx / kFocal;
    const Eigen::AngleAxisd turn(tilt.norm(), tilt.normalized());
    poses.push_back({turn * facing,
                     {distance * (u * camera.width - camera.cx) / camera.fx,
                      distance * (v * camera.height - camera.cy) / camera.fy, distance}});
  }
  return poses;
}

SimulatedCamera boardCamera(const estimation::Camera& camera, const vision::TagBoard& board,
                            const lie::SE3& X_CP, const SimulatedCameraConfig& config) {
  estimation::ArmView view{camera, {}, {board.tag_size, {}}, 1};
  for (int id = board.first_id; id < board.first_id + board.count(); ++id) {
    const Eigen::Vector2d centre = board.corners(id).rowwise().mean();
    lie::SE3 X_CT = X_CP;
    X_CT.translation = X_CP * Eigen::Vector3d(centre.x(), centre.y(), 0);
    view.layout.tags.push_back({id, 0, 0.0, X_CT});
  }
  return {view, vision::TagFamily(board.family), {}, config};
}

SimulatedCamera boardCamera(const estimation::Camera& camera, const vision::CharucoBoard& board,
                            const lie::SE3& X_CP, const SimulatedCameraConfig& config) {
  const estimation::ArmView view{camera, {}, {board.square_size, {{0, 0, 0.0, X_CP}}}, 1};
  return {view, {charucoPrint(board)}, {}, config};
}

}  // namespace helix_arm::simulation
