#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "tag_tracker.hpp"

namespace helix_arm::vision {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using estimation::Corners;
using Line = Vector3d;  // homogeneous

// Minimum side of a tag [px]: below it, a cell is hardly one pixel.
constexpr double kLeastSide = 10.0;
// Maximum distance of a search for edges [px].
constexpr int kMaxReach = 16;
constexpr double kFarthest = 1e6;   // of a tag's corners from the picture's [px]
constexpr double kLeastSine = 0.2;  // of the angle between two sides
constexpr double kLeastEdge = 10;   // between black and white [gray levels]

constexpr double kReach = 0.4;      // of the tag's extent across the edge: its other side is beyond
constexpr int kRays = 12;           // across an edge
constexpr double kRaysFrom = 0.15;  // of its length: nearer to the corners, rays miss edges
constexpr int kMaxTilt = 6;         // of the edge at the first and last ray [px]
constexpr int kTiltStep = 2;        // [px]

constexpr double kSharpening = 0.25;   // as libapriltag's, so that margins are comparable
constexpr double kBesideEdge = 0.45;   // distance of samples from edges between cells [px]
constexpr double kBesideMiddle = 0.2;  // and from the centres of cells [cells]
constexpr double kPlainCell = 4.5;     // smaller ones blur into each other [px]

constexpr double kLeastMargin = 5;  // of the bits [gray levels]

constexpr int kSecondReach = 4;     // [px]
constexpr double kMovedMuch = 1.5;  // the samples were in the wrong positions [px]

// Refinement of the corners.
constexpr double kRefineReach = 3.0;  // [px]
constexpr int kRefinements = 3;
constexpr double kSettled = 0.5;  // [px]

// Samples a picture (CV_8UC1), which must outlive this object. Outside the picture, the gray
// levels of its border apply. Coordinates are in pixels; (0, 0) is the centre of the first one.
class GrayPicture {
 public:
  explicit GrayPicture(const cv::Mat& gray) : gray_(gray) {}

  bool contains(const estimation::Corners& corners) const {
    return corners.minCoeff() >= 0 && corners.row(0).maxCoeff() <= gray_.cols - 1 &&
           corners.row(1).maxCoeff() <= gray_.rows - 1;
  }

  /// Gray level at p, bilinear.
  float at(const Eigen::Vector2d& p) const {
    // In this order, NaN becomes 0.
    const float x = std::min(std::max(0.0F, static_cast<float>(p.x())), gray_.cols - 1.0F);
    const float y = std::min(std::max(0.0F, static_cast<float>(p.y())), gray_.rows - 1.0F);
    const int column = std::min(static_cast<int>(x), gray_.cols - 2);
    const int row = std::min(static_cast<int>(y), gray_.rows - 2);
    const float u = x - static_cast<float>(column), v = y - static_cast<float>(row);
    const std::uint8_t* upper = gray_.ptr(row) + column;
    const std::uint8_t* lower = gray_.ptr(row + 1) + column;
    const float above = static_cast<float>(upper[0]) + u * static_cast<float>(upper[1] - upper[0]);
    const float below = static_cast<float>(lower[0]) + u * static_cast<float>(lower[1] - lower[0]);
    return above + v * (below - above);
  }

  /// The pixels nearest to n points on a line, one step apart.
  void ray(const Eigen::Vector2d& start, const Eigen::Vector2d& step, int n,
           std::int16_t* levels) const {
    // Fixed point with 16 fractional bits.
    const auto fixed = [](double value) { return static_cast<std::int64_t>(65536 * value); };
    std::int64_t x = fixed(start.x() + 0.5), y = fixed(start.y() + 0.5);
    const std::int64_t dx = fixed(step.x()), dy = fixed(step.y());
    const std::int64_t last_column = gray_.cols - 1, last_row = gray_.rows - 1;
    for (int j = 0; j < n; ++j, x += dx, y += dy) {
      const std::int64_t column = std::clamp<std::int64_t>(x >> 16, 0, last_column);
      const std::int64_t row = std::clamp<std::int64_t>(y >> 16, 0, last_row);
      levels[j] = gray_.ptr(static_cast<int>(row))[column];
    }
  }

 private:
  const cv::Mat& gray_;
};

// z component of the cross product of two image vectors.
double cross(const Vector2d& a, const Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

Line lineThrough(const Vector2d& p, const Vector2d& q) {
  return p.homogeneous().cross(q.homogeneous());
}

// Where the lines of the edges meet; edge k goes from corner k to the next.
Corners cornersBetween(const std::array<Line, 4>& lines) {
  Corners corners;
  for (int k = 0; k < 4; ++k) corners.col(k) = lines[(k + 3) % 4].cross(lines[k]).hnormalized();
  return corners;
}

double largestMove(const Corners& a, const Corners& b) {
  return (a - b).colwise().norm().maxCoeff();
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
  std::array<std::array<std::int16_t, kPlaces>, kRays> fall;  // of the level, outermost first
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

// Whether sides are long enough and in the right order, and no corner is flat.
bool isTagLike(const Corners& corners) {
  if (!corners.allFinite() || corners.cwiseAbs().maxCoeff() > kFarthest) return false;
  for (int k = 0; k < 4; ++k) {
    const Vector2d a = corners.col((k + 1) % 4) - corners.col(k);
    const Vector2d b = corners.col((k + 2) % 4) - corners.col((k + 1) % 4);
    if (!(a.norm() >= kLeastSide && cross(b, a) > kLeastSine * a.norm() * b.norm())) return false;
  }
  return true;
}

// Corners [px]: the intersections of the lines with the strongest change from white to black,
// going into a tag. Nothing if there are none.
// @param corners    where the tag is expected; tag-like.
// @param max_reach  maximum distance from its edges [px], at most kMaxReach.
std::optional<Corners> searchEdges(const GrayPicture& picture, const Corners& corners,
                                   int max_reach) {
  const double area = 0.5 * cross(corners.col(3) - corners.col(1), corners.col(2) - corners.col(0));
  std::array<Line, 4> lines;
  for (int k = 0; k < 4; ++k) {
    const Vector2d from = corners.col(k), to = corners.col((k + 1) % 4);
    const double across = area / (to - from).norm();
    const int reach = std::clamp(static_cast<int>(kReach * across), 2, max_reach);
    const auto shift = searchEdge(picture, from, to, reach);
    if (!shift) return std::nullopt;
    const Vector2d outward = outwardOf(from, to);
    const Vector2d first = from + shift->first * outward, last = to + shift->last * outward;
    lines[k] = lineThrough(first, last);
  }
  const Corners found = cornersBetween(lines);
  if (!isTagLike(found)) return std::nullopt;
  return found;
}

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

// The face of a tag in a picture, which must outlive this object. Coordinates in cells: u to the
// right and v downwards from its top left corner.
class TagFace {
 public:
  /// @param corners  [px] of the border's outer edge. @param cells  along it.
  TagFace(const GrayPicture& picture, const estimation::Corners& corners, int cells)
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

  /// Mean size of a cell along u and v [px].
  const Eigen::Vector2d& cell() const { return cell_; }

  /// Gray level at (u, v).
  double at(const Eigen::Vector2d& uv) const {
    return picture_.at((origin_ + axes_ * uv) / (1 + perspective_.dot(uv)));
  }

 private:
  const GrayPicture& picture_;
  Eigen::Vector2d origin_, perspective_, cell_;
  Eigen::Matrix2d axes_;
};

// A tag's bits as read from a face.
struct TagBits {
  bool closed = true;         ///< all of the border is black
  int wrong = 0;              ///< number of wrong bits
  double margin = 0;          ///< distance of black and white from the threshold [gray levels]
  Eigen::Vector3d threshold;  ///< between black and white, over (u, v, 1)
};

TagBits readBits(const TagFace& face, const TagCells& cells) {
  const int n = cells.cols;
  const auto isBorder = [n](int row, int column) {
    return row == 0 || column == 0 || row == n - 1 || column == n - 1;
  };
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
      } else if (isBorder(row, column)) {
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
      if (isBorder(row, column)) {
        bits.closed = bits.closed && here < threshold;
        continue;
      }
      const double around = level[row][column + 1] + level[row + 2][column + 1] +
                            level[row + 1][column] + level[row + 1][column + 2];
      const bool is_white = cells(row, column) != 0;
      const double over = here + kSharpening * (4 * here - around) - threshold;
      if ((over > 0) != is_white) ++bits.wrong;
      sum[is_white] += is_white ? over : -over;
      ++count[is_white];
    }
  }
  bits.margin = std::min(sum[0] / std::max(count[0], 1), sum[1] / std::max(count[1], 1));
  return bits;
}

// Maximum disagreement between a corner and the edges between the cells.
struct EdgeTolerance {
  double px;
  double cells;       ///< paper bends and lenses distort
  double deviations;  ///< standard deviations of the noise
  double most_px;     ///< upper bound for any noise
};

// An edge lock can fall back to a search of the region, a detection cannot.
constexpr EdgeTolerance kOfLock{0.3, 0.06, 2.5, 0.6};
constexpr EdgeTolerance kOfDetection{0.8, 0.2, 4.0, 1.5};

using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;

// Sums over the edges between the cells along one axis. Where the gray level at the middle of an
// edge is not the threshold, it is displaced; this is fitted by what moved corners would cause.
struct EdgeSums {
  Matrix5d squares = Matrix5d::Zero();
  Vector5d moments = Vector5d::Zero();
  double square = 0, slope = 0;
  int count = 0;
};

EdgeSums sumEdges(const TagFace& face, const TagCells& cells, const Vector3d& threshold, int axis) {
  const auto across = [axis](double first, double second) {
    return axis == 0 ? Vector2d(first, second) : Vector2d(second, first);
  };
  const int n = cells.cols;
  const double beside = std::min(0.25, kBesideEdge / face.cell()[axis]);
  EdgeSums sums;
  for (int second = 0; second < n; ++second) {
    for (int first = 1; first < n; ++first) {
      const auto white = [&](int i) {
        return (axis == 0 ? cells(second, i) : cells(i, second)) != 0;
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
      sums.squares += g * g.transpose();
      sums.moments += lack * g;
      sums.square += lack * lack;
      sums.slope += sign * (after - before) / (2 * beside);
      ++sums.count;
    }
  }
  sums.slope /= sums.count;
  return sums;
}

// Whether the edges between the cells agree with the corners.
bool innerEdgesAgree(const TagFace& face, const TagCells& cells, const Vector3d& threshold,
                     const EdgeTolerance& tolerance) {
  const double smallest = face.cell().minCoeff();
  const double small = std::max(1.0, std::pow(kPlainCell / smallest, 1.5));
  const double least = small * std::max(tolerance.px, tolerance.cells * smallest);
  const double most = std::max(least, small * tolerance.most_px);
  for (int axis = 0; axis < 2; ++axis) {
    const EdgeSums sums = sumEdges(face, cells, threshold, axis);
    if (!(sums.count > 5 && sums.slope > 0)) return false;
    const Eigen::LDLT<Matrix5d> solver(sums.squares);
    const Vector5d fit = solver.solve(sums.moments);
    const double variance = std::max(0.0, sums.square - sums.moments.dot(fit)) / (sums.count - 5);
    const double px = face.cell()[axis] / sums.slope;
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

// Constants of the refinement of corners.
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
    const Corners moved = cornersBetween(lines);
    // Also where it is not finite.
    return largestMove(moved, corners) <= reach_ ? moved : corners;
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

  // Outward position nearest to a point at which the gray level crosses the threshold.
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

std::optional<TagDetection> lockOnEdges(const cv::Mat& gray, const TagFamily& family, int id,
                                        const TagCells& cells, const Corners& expected,
                                        int max_hamming) {
  if (std::min(gray.cols, gray.rows) < kLeastSide || !isTagLike(expected)) return std::nullopt;
  const GrayPicture picture(gray);
  std::optional<Corners> found = searchEdges(picture, expected, kMaxReach);
  if (found && largestMove(*found, expected) > kMovedMuch) {
    found = searchEdges(picture, *found, kSecondReach);
  }
  if (!found) return std::nullopt;
  for (int i = 0; i < kRefinements; ++i) {
    const Corners refined = refineCorners(gray, family, kRefineReach, *found);
    const bool settled = largestMove(refined, *found) < kSettled;
    *found = refined;
    if (settled) break;
  }
  if (!isTagLike(*found) || !picture.contains(*found)) return std::nullopt;
  const TagFace face(picture, *found, cells.cols);
  const TagBits bits = readBits(face, cells);
  if (!bits.closed || bits.wrong > max_hamming || !(bits.margin >= kLeastMargin) ||
      !innerEdgesAgree(face, cells, bits.threshold, kOfLock)) {
    return std::nullopt;
  }
  return TagDetection{id, bits.wrong, bits.margin, *found};
}

bool cornersHold(const cv::Mat& gray, const TagCells& cells, const Corners& corners) {
  if (!isTagLike(corners)) return true;  // too small to decide
  const GrayPicture picture(gray);
  const TagFace face(picture, corners, cells.cols);
  return innerEdgesAgree(face, cells, readBits(face, cells).threshold, kOfDetection);
}

Corners refineCorners(const cv::Mat& gray, const TagFamily& family, double reach,
                      const Corners& corners) {
  return Refiner(gray, family, reach).refined(corners);
}

}  // namespace helix_arm::vision
