#include "tag_face.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "cross_product.hpp"

namespace helix_arm::vision {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kSharpening = 0.25;   // as libapriltag's, so that margins are comparable
constexpr double kBesideEdge = 0.45;   // distance of samples from edges between cells [px]
constexpr double kBesideMiddle = 0.2;  // and from the centres of cells [cells]
constexpr double kPlainCell = 4.5;     // smaller ones blur into each other [px]

// A plane fitted to gray levels over u and v.
class Plane {
 public:
  void add(const Vector2d& uv, double level) {
    const Vector3d g = uv.homogeneous();
    squares_ += g * g.transpose();
    levels_ += level * g;
  }
  Vector3d fit() const { return squares_.ldlt().solve(levels_); }

 private:
  Eigen::Matrix3d squares_ = Eigen::Matrix3d::Zero();
  Vector3d levels_ = Vector3d::Zero();
};

}  // namespace

TagFace::TagFace(const GrayPicture& picture, const estimation::Corners& corners, int cells)
    : picture_(picture) {
  const Vector2d p = corners.col(2), q = corners.col(1), r = corners.col(0);
  origin_ = corners.col(3);
  const Vector2d a = p - q, b = r - q, c = origin_ - p + q - r;
  perspective_ = Vector2d(cross(c, b), cross(a, c)) / cross(a, b);
  axes_.col(0) = p - origin_ + perspective_.x() * p;
  axes_.col(1) = r - origin_ + perspective_.y() * r;
  perspective_ /= cells;
  axes_ /= cells;
  cell_.x() = 0.5 * ((p - origin_).norm() + b.norm()) / cells;
  cell_.y() = 0.5 * ((r - origin_).norm() + a.norm()) / cells;
}

TagBits readBits(const TagFace& face, const TagPattern& pattern) {
  const int n = pattern.cells;
  // Including the ring of white cells around the border.
  std::array<std::array<double, kMostCells + 2>, kMostCells + 2> level;
  Plane white, black;
  for (int row = -1; row <= n; ++row) {
    for (int column = -1; column <= n; ++column) {
      const Vector2d middle(column + 0.5, row + 0.5);
      double sum = 0;
      for (const double u : {-kBesideMiddle, kBesideMiddle}) {
        for (const double v : {-kBesideMiddle, kBesideMiddle}) {
          sum += face.at(middle + Vector2d(u, v));
        }
      }
      level[row + 1][column + 1] = 0.25 * sum;
      if (row < 0 || column < 0 || row == n || column == n) {
        white.add(middle, 0.25 * sum);
      } else if (isBorder(pattern, row, column)) {
        black.add(middle, 0.25 * sum);
      }
    }
  }
  TagBits bits;
  bits.threshold = 0.5 * (white.fit() + black.fit());
  std::array<double, 2> sum{};
  std::array<int, 2> count{};
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) {
      const double here = level[row + 1][column + 1];
      const double threshold = bits.threshold.dot(Vector3d(column + 0.5, row + 0.5, 1));
      if (isBorder(pattern, row, column)) {
        bits.closed = bits.closed && here < threshold;
        continue;
      }
      const double around = level[row][column + 1] + level[row + 2][column + 1] +
                            level[row + 1][column] + level[row + 1][column + 2];
      const bool is_white = isWhite(pattern, row, column);
      const double over = here + kSharpening * (4 * here - around) - threshold;
      if ((over > 0) != is_white) ++bits.wrong;
      sum[is_white] += is_white ? over : -over;
      ++count[is_white];
    }
  }
  bits.margin = std::min(sum[0] / std::max(count[0], 1), sum[1] / std::max(count[1], 1));
  return bits;
}

// Where the gray level at the middle of such an edge is not the threshold, the edge is displaced;
// the displacements are fitted by those that moved corners would cause.
bool innerEdgesAgree(const TagFace& face, const TagPattern& pattern, const Vector3d& threshold,
                     const EdgeTolerance& tolerance) {
  using Vector5d = Eigen::Matrix<double, 5, 1>;
  using Matrix5d = Eigen::Matrix<double, 5, 5>;
  const int n = pattern.cells;
  const double smallest = face.cell().minCoeff();
  const double small = std::max(1.0, std::pow(kPlainCell / smallest, 1.5));
  const double least = small * std::max(tolerance.px, tolerance.cells * smallest);
  const double most = std::max(least, small * tolerance.most_px);
  for (int axis = 0; axis < 2; ++axis) {
    const auto across = [axis](double first, double second) {
      return axis == 0 ? Vector2d(first, second) : Vector2d(second, first);
    };
    const double beside = std::min(0.25, kBesideEdge / face.cell()[axis]);
    Matrix5d squares = Matrix5d::Zero();
    Vector5d moments = Vector5d::Zero();
    double square = 0, slope = 0;
    int count = 0;
    for (int second = 0; second < n; ++second) {
      for (int first = 1; first < n; ++first) {
        const auto white = [&](int i) {
          return axis == 0 ? isWhite(pattern, second, i) : isWhite(pattern, i, second);
        };
        if (white(first) == white(first - 1)) continue;
        const double sign = white(first) ? 1 : -1;
        const Vector2d edge = across(first, second + 0.5);
        double before = 0, after = 0;
        for (const double along : {-kBesideMiddle, kBesideMiddle}) {
          before += 0.5 * face.at(edge + across(-beside, along));
          after += 0.5 * face.at(edge + across(beside, along));
        }
        const double lack = sign * (threshold.dot(edge.homogeneous()) - 0.5 * (before + after));
        const Vector2d place = edge / n - Vector2d(0.5, 0.5);
        // The last entry represents white areas that grow at the cost of black ones.
        Vector5d g;
        g << 1, place, place.x() * place.y(), sign;
        squares += g * g.transpose();
        moments += lack * g;
        square += lack * lack;
        slope += sign * (after - before) / (2 * beside);
        ++count;
      }
    }
    slope /= count;
    if (!(count > 5 && slope > 0)) return false;
    const Eigen::LDLT<Matrix5d> solver(squares);
    const Vector5d fit = solver.solve(moments);
    const double variance = std::max(0.0, square - moments.dot(fit)) / (count - 5);
    const double px = face.cell()[axis] / slope;
    for (const double u : {-0.5, 0.5}) {
      for (const double v : {-0.5, 0.5}) {
        Vector5d g;
        g << 1, u, v, u * v, 0;
        const double deviation = px * std::sqrt(variance * g.dot(solver.solve(g)));
        const double limit = std::clamp(tolerance.deviations * deviation, least, most);
        if (!(px * std::abs(g.dot(fit)) <= limit)) return false;
      }
    }
  }
  return true;
}

}  // namespace helix_arm::vision
