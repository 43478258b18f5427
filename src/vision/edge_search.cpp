#include "edge_search.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "cross_product.hpp"

namespace helix_arm::vision {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using estimation::Corners;

constexpr double kFarthest = 1e6;   // of a tag's corners from the picture's [px]
constexpr double kLeastSine = 0.2;  // of the angle between two sides
constexpr double kLeastEdge = 10;   // between black and white [gray levels]

constexpr double kReach = 0.4;      // of the tag's extent across the edge: its other side is beyond
constexpr int kRays = 12;           // across an edge
constexpr double kRaysFrom = 0.15;  // of its length: nearer to the corners, rays miss edges
constexpr int kMaxTilt = 6;         // of the edge at the first and last ray [px]
constexpr int kTiltStep = 2;        // [px]

double areaOf(const Corners& corners) {
  return 0.5 * cross(corners.col(3) - corners.col(1), corners.col(2) - corners.col(0));
}

// Outward distance of a line at the first and the last end of an edge [px].
struct Shift {
  double first, last;
};

Vector2d outwardOf(const Vector2d& from, const Vector2d& to) {
  return Vector2d(from.y() - to.y(), to.x() - from.x()).normalized();
}

// The line within reach with the clearest transition from white to black, inwards.
std::optional<Shift> searchEdge(const GrayPicture& picture, const Vector2d& from,
                                const Vector2d& to, int reach) {
  constexpr int kPlaces = 2 * kMaxReach + 1;
  const Vector2d outward = outwardOf(from, to);
  const int places = 2 * reach + 1;
  std::array<std::array<std::int16_t, kPlaces>, kRays>
      fall;  // decrease of the level, outermost first
  for (int i = 0; i < kRays; ++i) {
    const double s = kRaysFrom + (1 - 2 * kRaysFrom) * i / (kRays - 1);
    std::array<std::int16_t, kPlaces + 2> level;
    picture.ray(from + s * (to - from) + (reach + 1) * outward, -outward, places + 2, level.data());
    for (int j = 0; j < places; ++j) {
      fall[i][j] = static_cast<std::int16_t>(level[j] - level[j + 2]);
    }
  }
  std::optional<Shift> best;
  int most = static_cast<int>(kLeastEdge * kRays);
  const int max_tilt = std::min(kMaxTilt, reach / 2);
  for (int tilt = -max_tilt; tilt <= max_tilt; tilt += kTiltStep) {
    std::array<int, kPlaces> sum{};
    for (int i = 0; i < kRays; ++i) {
      const int inward = static_cast<int>(std::lround(tilt * (2.0 * i / (kRays - 1) - 1)));
      const int end = std::min(places, places - inward);
      for (int j = std::max(0, -inward); j < end; ++j) sum[j] += fall[i][j + inward];
    }
    for (int j = 0; j < places; ++j) {
      if (sum[j] <= most) continue;
      most = sum[j];
      const double at_end = tilt / (1 - 2 * kRaysFrom);
      best = {reach - j + at_end, reach - j - at_end};
    }
  }
  return best;
}

}  // namespace

bool isTagLike(const Corners& corners) {
  if (!corners.allFinite() || corners.cwiseAbs().maxCoeff() > kFarthest) return false;
  for (int k = 0; k < 4; ++k) {
    const Vector2d a = corners.col((k + 1) % 4) - corners.col(k);
    const Vector2d b = corners.col((k + 2) % 4) - corners.col((k + 1) % 4);
    if (!(a.norm() >= kLeastSide && cross(b, a) > kLeastSine * a.norm() * b.norm())) return false;
  }
  return true;
}

std::optional<Corners> searchEdges(const GrayPicture& picture, const Corners& corners,
                                   int max_reach) {
  const double area = areaOf(corners);
  std::array<Vector3d, 4> lines;
  for (int k = 0; k < 4; ++k) {
    const Vector2d from = corners.col(k), to = corners.col((k + 1) % 4);
    const double across = area / (to - from).norm();
    const int reach = std::clamp(static_cast<int>(kReach * across), 2, max_reach);
    const auto shift = searchEdge(picture, from, to, reach);
    if (!shift) return std::nullopt;
    const Vector2d outward = outwardOf(from, to);
    const Vector2d first = from + shift->first * outward, last = to + shift->last * outward;
    lines[k] = first.homogeneous().cross(last.homogeneous());
  }
  Corners found;
  for (int k = 0; k < 4; ++k) found.col(k) = lines[(k + 3) % 4].cross(lines[k]).hnormalized();
  if (!isTagLike(found)) return std::nullopt;
  return found;
}

}  // namespace helix_arm::vision
