#include "helix_arm/vision/charuco_reader.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include <opencv2/aruco.hpp>
#include <opencv2/imgproc.hpp>

namespace helix_arm::vision {
namespace {

constexpr double kAgreement = 0.25;  // of two markers on a corner [sides of a square]
// The window in which a corner is refined: half its side [px].
constexpr int kLeastWindow = 2, kMostWindow = 10;

cv::Point2f toPoint(const Eigen::Vector2d& point) {
  return {static_cast<float>(point.x()), static_cast<float>(point.y())};
}

// What one marker tells about the plane around it.
struct Outlook {
  estimation::Corners corners;  // [px]
  cv::Matx33d pixel_of_board;
  double side;  // mean side [px]
};

Outlook outlookOf(const estimation::Corners& on_board, const estimation::Corners& in_picture) {
  cv::Point2f from[4], to[4];
  double around = 0;
  for (int c = 0; c < 4; ++c) {
    from[c] = toPoint(on_board.col(c));
    to[c] = toPoint(in_picture.col(c));
    around += (in_picture.col((c + 1) % 4) - in_picture.col(c)).norm();
  }
  return {in_picture, cv::getPerspectiveTransform(from, to), 0.25 * around};
}

Eigen::Vector2d pixelOf(const Outlook& outlook, const Eigen::Vector2d& on_board) {
  const cv::Vec3d h = outlook.pixel_of_board * cv::Vec3d(on_board.x(), on_board.y(), 1);
  return {h[0] / h[2], h[1] / h[2]};
}

double roomAround(const Eigen::Vector2d& pixel, const Outlook& outlook) {
  return (outlook.corners.colwise() - pixel).colwise().norm().minCoeff();
}

std::map<int, Outlook> outlooksOf(const CharucoBoard& board,
                                  const std::vector<MarkerObservation>& markers) {
  std::map<int, Outlook> outlooks;
  auto seen = markers.begin();
  int id = 0;
  for (int square = 0; square < board.columns * board.rows; ++square) {
    const int column = square % board.columns, row = square / board.columns;
    if (!board.isWhite(column, row)) continue;
    while (seen != markers.end() && seen->id < id) ++seen;
    if (seen == markers.end()) break;
    if (seen->id == id) {
      outlooks.emplace(id, outlookOf(board.markerCorners(column, row), seen->corners));
    }
    ++id;
  }
  return outlooks;
}

// Sets of markers that corners connect.
class Groups {
 public:
  int rootOf(int marker) {
    int root = marker;
    for (auto above = above_.find(root); above != above_.end(); above = above_.find(root)) {
      root = above->second;
    }
    return root;
  }
  void join(int a, int b) {
    const int root_a = rootOf(a), root_b = rootOf(b);
    if (root_a != root_b) above_[root_a] = root_b;
  }

 private:
  std::map<int, int> above_;
};

// Moves a corner to where the chessboard's edges cross. @return whether they do near it.
bool refine(const cv::Mat& gray, MarkedCorner& corner) {
  // A square that holds no corner of a marker, however it is turned.
  const int window = static_cast<int>(corner.room / std::sqrt(2)) - 1;
  if (window < kLeastWindow) return false;
  const int half = std::min(window, kMostWindow);
  const double margin = half + 1;
  if (!(corner.pixel.minCoeff() >= margin && corner.pixel.x() <= gray.cols - 1 - margin &&
        corner.pixel.y() <= gray.rows - 1 - margin)) {
    return false;
  }
  std::vector<cv::Point2f> points{toPoint(corner.pixel)};
  const cv::TermCriteria until(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 50, 0.005);
  cv::cornerSubPix(gray, points, cv::Size(half, half), cv::Size(-1, -1), until);
  const Eigen::Vector2d refined(points[0].x, points[0].y);
  if (!((refined - corner.pixel).norm() < half)) return false;
  corner.pixel = refined;
  return true;
}

}  // namespace

std::vector<MarkerObservation> findMarkers(const std::string& dictionary, const cv::Mat& gray) {
  const auto known = cv::aruco::getPredefinedDictionary(dictionaryIndex(dictionary));
  std::vector<std::vector<cv::Point2f>> corners;
  std::vector<int> ids;
  if (!gray.empty()) cv::aruco::detectMarkers(gray, known, corners, ids);
  std::vector<MarkerObservation> markers;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (std::count(ids.begin(), ids.end(), ids[i]) > 1) continue;
    MarkerObservation marker{ids[i], {}};
    // OpenCV begins at the top left and goes to the right.
    for (std::size_t c = 0; c < 4; ++c) {
      marker.corners.col(static_cast<Eigen::Index>(3 - c)) << corners[i][c].x, corners[i][c].y;
    }
    markers.push_back(marker);
  }
  std::sort(markers.begin(), markers.end(),
            [](const MarkerObservation& a, const MarkerObservation& b) { return a.id < b.id; });
  return markers;
}

std::vector<MarkedCorner> markedCorners(const CharucoBoard& board,
                                        const std::vector<MarkerObservation>& markers) {
  const std::map<int, Outlook> outlooks = outlooksOf(board, markers);
  std::vector<MarkedCorner> corners;
  std::vector<int> marker_of;  // one of a corner's markers
  Groups groups;
  for (int id = 0; id < board.cornerCount(); ++id) {
    const int column = id % (board.columns - 1), row = id / (board.columns - 1);
    const int above = board.isWhite(column, row) ? column : column + 1;
    const int below = above == column ? column + 1 : column;
    const auto first = outlooks.find(board.markerIn(above, row));
    const auto second = outlooks.find(board.markerIn(below, row + 1));
    if (first == outlooks.end() || second == outlooks.end()) continue;
    const Eigen::Vector2d on_board = board.corner(id);
    const Eigen::Vector2d a = pixelOf(first->second, on_board);
    const Eigen::Vector2d b = pixelOf(second->second, on_board);
    const double square =
        std::min(first->second.side, second->second.side) * board.square_size / board.marker_size;
    if (!((a - b).norm() <= kAgreement * square)) continue;
    const Eigen::Vector2d pixel = 0.5 * (a + b);
    corners.push_back(
        {id, pixel, std::min(roomAround(pixel, first->second), roomAround(pixel, second->second))});
    marker_of.push_back(first->first);
    groups.join(first->first, second->first);
  }
  std::map<int, int> sizes;
  for (const int marker : marker_of) ++sizes[groups.rootOf(marker)];
  const auto largest = std::max_element(
      sizes.begin(), sizes.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  std::vector<MarkedCorner> connected;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (groups.rootOf(marker_of[i]) == largest->first) connected.push_back(corners[i]);
  }
  return connected;
}

BoardObservation charucoObservation(const CharucoBoard& board, const std::string& name,
                                    const cv::Mat& gray) {
  BoardObservation observation{name, {}};
  for (MarkedCorner& corner : markedCorners(board, findMarkers(board.dictionary, gray))) {
    if (!refine(gray, corner)) continue;
    observation.corners.push_back({corner.id, board.corner(corner.id), corner.pixel});
  }
  return observation;
}

}  // namespace helix_arm::vision
