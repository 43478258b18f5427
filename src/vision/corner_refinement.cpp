#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "edge_lock.hpp"

namespace helix_arm::vision {
namespace {

using Eigen::Vector2d;
using estimation::Corners;
using Line = Eigen::Vector3d;  // homogeneous

constexpr int kMostSamples = 32;          // along an edge
constexpr int kFewestSamples = 8;         // that must show the edge, and at least half of them
constexpr double kStep = 0.5;             // across it [px]
constexpr double kReachCells = 0.7;       // and in cells: other edges are farther away
constexpr double kInset = 0.08;           // of an edge at each end, where the corner rounds it off
constexpr double kLeastContrast = 10;     // [gray levels]
constexpr double kLeastTolerance = 0.15;  // of a point's distance from its line [px]
constexpr int kRounds = 3;                // of removing points that are off the line

template <class Array>
double medianOf(Array values, int count) {
  std::nth_element(values.begin(), values.begin() + count / 2, values.begin() + count);
  return values[count / 2];
}

Line lineThrough(const Vector2d& p, const Vector2d& q) {
  return p.homogeneous().cross(q.homogeneous());
}

class Refiner {
 public:
  Refiner(const cv::Mat& gray, const TagFamily& family, double reach)
      : gray_(gray),
        cells_(family.borderCells()),
        sign_(family.isReversed() ? -1 : 1),
        reach_(reach) {}

  Corners refined(const Corners& corners) const {
    std::array<Line, 4> lines;
    for (int k = 0; k < 4; ++k) {
      // An edge that is not visible keeps its line.
      lines[k] = edge(corners, k).value_or(lineThrough(corners.col(k), corners.col((k + 1) % 4)));
    }
    Corners moved;
    for (int k = 0; k < 4; ++k) {
      moved.col(k) = lines[(k + 3) % 4].cross(lines[k]).hnormalized();
    }
    const double shift = (moved - corners).colwise().norm().maxCoeff();
    return shift <= reach_ ? moved : corners;  // also where it is not finite
  }

 private:
  struct Samples {
    int count = 0;
    std::array<double, kMostSamples> along, offset;
  };

  std::optional<double> level(const Vector2d& p) const {
    if (!(p.x() >= 0 && p.y() >= 0 && p.x() < gray_.cols - 1 && p.y() < gray_.rows - 1)) {
      return std::nullopt;
    }
    const int x = static_cast<int>(p.x()), y = static_cast<int>(p.y());
    const double u = p.x() - x, v = p.y() - y;
    const std::uint8_t* upper = gray_.ptr(y) + x;
    const std::uint8_t* lower = gray_.ptr(y + 1) + x;
    return (1 - v) * ((1 - u) * upper[0] + u * upper[1]) + v * ((1 - u) * lower[0] + u * lower[1]);
  }

  // The line of the edge from corner k to the next.
  std::optional<Line> edge(const Corners& corners, int k) const {
    const Vector2d a = corners.col(k), b = corners.col((k + 1) % 4);
    const double length = (b - a).norm();
    const Vector2d along = (b - a) / length;
    const Vector2d outward(-along.y(), along.x());
    // Inward distance of one cell at each end of the edge.
    const double depth_a = (a - corners.col((k + 3) % 4)).dot(outward) / cells_;
    const double depth_b = (b - corners.col((k + 2) % 4)).dot(outward) / cells_;
    if (!(depth_a > 0 && depth_b > 0)) return std::nullopt;

    const double inset = std::max(kInset * length, 1.0);
    const int count =
        std::clamp(static_cast<int>(length - 2 * inset), kFewestSamples, kMostSamples);
    std::array<Vector2d, kMostSamples> points;
    std::array<double, kMostSamples> depths, inside, outside;
    int shown = 0;
    for (int i = 0; i < count; ++i) {
      const double s = (inset + (length - 2 * inset) * (i + 0.5) / count) / length;
      const double depth = (1 - s) * depth_a + s * depth_b;
      const Vector2d point = (1 - s) * a + s * b;
      const auto in = level(point - 0.5 * depth * outward);
      const auto out = level(point + 0.5 * depth * outward);
      if (!in || !out) continue;
      points[shown] = point;
      depths[shown] = depth;
      inside[shown] = *in;
      outside[shown] = *out;
      ++shown;
    }
    if (shown < kFewestSamples) return std::nullopt;
    const double in = medianOf(inside, shown), out = medianOf(outside, shown);
    if (sign_ * (out - in) < kLeastContrast) return std::nullopt;

    Samples samples;
    for (int i = 0; i < shown; ++i) {
      const double reach = std::min(reach_, kReachCells * depths[i]);
      const auto offset = crossing(points[i], outward, reach, 0.5 * (in + out));
      if (!offset) continue;
      samples.along[samples.count] = (points[i] - a).dot(along);
      samples.offset[samples.count] = *offset;
      ++samples.count;
    }
    if (samples.count < std::max(kFewestSamples / 2, count / 2)) return std::nullopt;
    const auto [offset, slope] = fit(samples);
    const Vector2d p = a + offset * outward, q = b + (offset + slope * length) * outward;
    return lineThrough(p, q);
  }

  // Position nearest to a point where the gray level crosses the threshold, in the outward
  // direction.
  std::optional<double> crossing(const Vector2d& point, const Vector2d& outward, double reach,
                                 double passed) const {
    const int steps = static_cast<int>(std::ceil(reach / kStep));
    std::optional<double> nearest;
    double last = 0;
    for (int j = -steps; j <= steps; ++j) {
      const auto gray = level(point + j * kStep * outward);
      if (!gray) return std::nullopt;
      const double above = sign_ * (*gray - passed);
      if (j > -steps && last < 0 && above >= 0) {
        const double offset = (j - above / (above - last)) * kStep;
        if (!nearest || std::abs(offset) < std::abs(*nearest)) nearest = offset;
      }
      last = above;
    }
    return nearest;
  }

  // Offset and slope of the line, without outliers.
  static std::pair<double, double> fit(const Samples& samples) {
    double offset = 0, slope = 0, tolerance = std::numeric_limits<double>::infinity();
    std::array<double, kMostSamples> distance{};
    for (int round = 0; round < kRounds; ++round) {
      double n = 0, t = 0, o = 0, tt = 0, to = 0;
      for (int i = 0; i < samples.count; ++i) {
        if (distance[i] > tolerance) continue;
        n += 1;
        t += samples.along[i];
        o += samples.offset[i];
        tt += samples.along[i] * samples.along[i];
        to += samples.along[i] * samples.offset[i];
      }
      slope = (n * to - t * o) / (n * tt - t * t);
      offset = (o - slope * t) / n;
      for (int i = 0; i < samples.count; ++i) {
        distance[i] = std::abs(samples.offset[i] - offset - slope * samples.along[i]);
      }
      tolerance = std::max(kLeastTolerance, 2.5 * medianOf(distance, samples.count));
    }
    return {offset, slope};
  }

  const cv::Mat& gray_;
  int cells_;
  double sign_;
  double reach_;
};

}  // namespace

Corners refineCorners(const cv::Mat& gray, const TagFamily& family, double reach,
                      const Corners& corners) {
  return Refiner(gray, family, reach).refined(corners);
}

}  // namespace helix_arm::vision
