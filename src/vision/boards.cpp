#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include <opencv2/imgproc.hpp>
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 7  // of the contributed modules
#include <opencv2/aruco.hpp>
#else
#include <opencv2/objdetect/aruco_detector.hpp>
#endif

#include "camera_calibration.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::vision {
namespace {

using basics::messageOf;
using Markers = std::vector<MarkerObservation>;

constexpr char kBoard[] = "ChArUco board";

// RMS distance of the corners that both show [px]; nothing if they share too few.
std::optional<double> distanceOf(const BoardObservation& a, const BoardObservation& b, int least) {
  double sum = 0;
  int shared = 0;
  auto other = b.corners.begin();
  for (const BoardCorner& corner : a.corners) {
    while (other != b.corners.end() && other->id < corner.id) ++other;
    if (other == b.corners.end()) break;
    if (other->id != corner.id) continue;
    sum += (corner.pixel - other->pixel).squaredNorm();
    ++shared;
  }
  if (shared < least) return std::nullopt;
  return std::sqrt(sum / shared);
}

// A pixel's centre is at whole numbers.
bool isAtBorder(const estimation::Corners& corners, const cv::Size& size) {
  const Eigen::Vector2d first = corners.rowwise().minCoeff(), last = corners.rowwise().maxCoeff();
  return first.minCoeff() + 0.5 < kLeastFromBorder ||
         last.x() + 0.5 > size.width - kLeastFromBorder ||
         last.y() + 0.5 > size.height - kLeastFromBorder;
}

constexpr double kAgreement = 0.25;  // of two markers on a corner [sides of a square]
// The window in which a corner is refined: half its side [px].
constexpr int kLeastWindow = 2, kMostWindow = 10;

cv::Point2f toPoint(const Eigen::Vector2d& point) {
  return {static_cast<float>(point.x()), static_cast<float>(point.y())};
}

// The plane as one marker shows it around it.
struct BoardHomography {
  estimation::Corners corners;  // [px]
  cv::Matx33d pixel_of_board;
  double side;  // mean side [px]
};

BoardHomography homographyOf(const estimation::Corners& on_board,
                             const estimation::Corners& in_picture) {
  cv::Point2f from[4], to[4];
  double around = 0;
  for (int c = 0; c < 4; ++c) {
    from[c] = toPoint(on_board.col(c));
    to[c] = toPoint(in_picture.col(c));
    around += (in_picture.col((c + 1) % 4) - in_picture.col(c)).norm();
  }
  return {in_picture, cv::getPerspectiveTransform(from, to), 0.25 * around};
}

Eigen::Vector2d pixelOf(const BoardHomography& homography, const Eigen::Vector2d& on_board) {
  const cv::Vec3d h = homography.pixel_of_board * cv::Vec3d(on_board.x(), on_board.y(), 1);
  return {h[0] / h[2], h[1] / h[2]};
}

std::map<int, BoardHomography> homographiesOf(const CharucoBoard& board, const Markers& markers) {
  std::map<int, BoardHomography> homographies;
  auto seen = markers.begin();
  const int squares = board.columns * board.rows;
  for (int square = 0; square < squares && seen != markers.end(); ++square) {
    const int column = square % board.columns, row = square / board.columns;
    if (!board.isWhite(column, row) || board.markerIn(column, row) != seen->id) continue;
    homographies.emplace(seen->id, homographyOf(board.markerCorners(column, row), seen->corners));
    ++seen;
  }
  return homographies;
}

// An inner corner between two diagonal squares whose markers were both seen.
struct MarkedCorner {
  int id;
  Eigen::Vector2d pixel;  // mean of what the two markers tell, not refined [px]
  double room;            // from there to the nearest corner of a marker [px]
  int above, below;       // the two markers
};

bool shareMarker(const MarkedCorner& a, const MarkedCorner& b) {
  return a.above == b.above || a.above == b.below || a.below == b.above || a.below == b.below;
}

// Corners on which the markers on either side agree.
std::vector<MarkedCorner> agreedCorners(const CharucoBoard& board, const Markers& markers) {
  const std::map<int, BoardHomography> homographies = homographiesOf(board, markers);
  std::vector<MarkedCorner> corners;
  for (int id = 0; id < board.cornerCount(); ++id) {
    const int column = id % (board.columns - 1), row = id / (board.columns - 1);
    const int shift = board.isWhite(column, row) ? 0 : 1;
    const auto above = homographies.find(board.markerIn(column + shift, row));
    const auto below = homographies.find(board.markerIn(column + 1 - shift, row + 1));
    if (above == homographies.end() || below == homographies.end()) continue;
    const BoardHomography &first = above->second, &second = below->second;
    const Eigen::Vector2d a = pixelOf(first, board.corner(id)),
                          b = pixelOf(second, board.corner(id)), pixel = 0.5 * (a + b);
    const double square = std::min(first.side, second.side) * board.square_size / board.marker_size;
    if (!((a - b).norm() <= kAgreement * square)) continue;
    const auto roomTo = [&pixel](const BoardHomography& marker) {
      return (marker.corners.colwise() - pixel).colwise().norm().minCoeff();
    };
    corners.push_back(
        {id, pixel, std::min(roomTo(first), roomTo(second)), above->first, below->first});
  }
  return corners;
}

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

estimation::Corners TagBoard::corners(int id) const {
  if (!has(id)) {
    throw std::out_of_range(
        messageOf("tag id is ", id, "; the board has ", first_id, " to ", first_id + count() - 1));
  }
  const int column = (id - first_id) % columns, row = (id - first_id) / columns;
  const Eigen::Vector2d centre(column - 0.5 * (columns - 1), 0.5 * (rows - 1) - row);
  const estimation::TagLayout tag{tag_size, {}};
  return tag.corners().colwise() + (pitch * centre).eval();
}

BoardParts TagBoard::parts() const {
  return {"tags", 4, 6, "print it with helix_arm tags --board and take 15 pictures or more"};
}

bool CharucoBoard::isWhite(int column, int row) const {
  const bool begins_white = legacy_pattern && rows % 2 == 0;
  return ((column + row) % 2 == 0) == begins_white;
}

int CharucoBoard::markerIn(int column, int row) const {
  // Two rows together have one in every column.
  const auto within = [this](int count, int in_row) {
    return (count + (isWhite(0, in_row) ? 1 : 0)) / 2;
  };
  const int before = row / 2 * columns + (row % 2 == 1 ? within(columns, 0) : 0);
  return before + within(column, row);
}

int CharucoBoard::count() const { return markerIn(0, rows); }

double CharucoBoard::bitSize() const {
  return marker_size / (markerDictionary(dictionary).bits + 2);  // and the black border
}

Eigen::Vector2d CharucoBoard::corner(int id) const {
  const int column = id % (columns - 1), row = id / (columns - 1);
  return square_size * Eigen::Vector2d(column + 1 - 0.5 * columns, 0.5 * rows - row - 1);
}

estimation::Corners CharucoBoard::markerCorners(int column, int row) const {
  const Eigen::Vector2d centre(column + 0.5 - 0.5 * columns, 0.5 * rows - row - 0.5);
  const estimation::TagLayout marker{marker_size, {}};
  return marker.corners().colwise() + (square_size * centre).eval();
}

BoardParts CharucoBoard::parts() const {
  return {"inner chessboard corners", 1, kLeastCorners,
          "hold it close, wholly in the picture, flat and in even light, and take 15 pictures or "
          "more"};
}

void CharucoBoard::validate() const {
  for (const auto& [name, count] : {std::pair("across", columns), std::pair("down", rows)}) {
    basics::require(count >= 3 && count <= kMostSquares, kBoard, ": the number of squares ", name,
                    " is ", count, "; expected 3 to ", kMostSquares);
  }
  basics::require(cornerCount() >= kLeastCorners, kBoard, ": ", columns, " x ", rows,
                  " squares have ", cornerCount(), " inner corners; expected ", kLeastCorners,
                  " or more");
  basics::requirePositive(kBoard, "the side of a square [m]", square_size);
  basics::require(marker_size > 0 && marker_size < square_size, kBoard,
                  ": the side of a marker [m] is ", marker_size,
                  "; expected a value above 0 and below that of a square, ", square_size);
  basics::require(marker_size >= kLeastMarkerShare * square_size, kBoard,
                  ": the side of a marker [m] is ", marker_size, "; expected ",
                  kLeastMarkerShare * square_size, " or more, ", kLeastMarkerShare,
                  " of the side of a square: a smaller one is not found in pictures of the board");
  const MarkerDictionary& known = markerDictionary(dictionary);
  basics::require(count() <= known.markers, kBoard, ": ", columns, " x ", rows, " squares take ",
                  count(), " markers, but ", dictionary, " has ", known.markers,
                  "; expected fewer squares or a larger dictionary");
  basics::require(!legacy_pattern || rows % 2 == 0, kBoard, ": the legacy pattern with ", rows,
                  " squares down; expected an even number, since with an odd one both patterns are "
                  "the same. Leave the legacy pattern out");
}

const std::vector<MarkerDictionary>& markerDictionaries() {
  static const std::vector<MarkerDictionary> known = {
      {"DICT_4X4_50", 50, 4},           {"DICT_4X4_100", 100, 4},
      {"DICT_4X4_250", 250, 4},         {"DICT_4X4_1000", 1000, 4},
      {"DICT_5X5_50", 50, 5},           {"DICT_5X5_100", 100, 5},
      {"DICT_5X5_250", 250, 5},         {"DICT_5X5_1000", 1000, 5},
      {"DICT_6X6_50", 50, 6},           {"DICT_6X6_100", 100, 6},
      {"DICT_6X6_250", 250, 6},         {"DICT_6X6_1000", 1000, 6},
      {"DICT_7X7_50", 50, 7},           {"DICT_7X7_100", 100, 7},
      {"DICT_7X7_250", 250, 7},         {"DICT_7X7_1000", 1000, 7},
      {"DICT_ARUCO_ORIGINAL", 1024, 5}, {"DICT_APRILTAG_16h5", 30, 4},
      {"DICT_APRILTAG_25h9", 35, 5},    {"DICT_APRILTAG_36h10", 2320, 6},
      {"DICT_APRILTAG_36h11", 587, 6}};
  return known;
}

int dictionaryIndex(const std::string& name) {
  std::string names;
  for (std::size_t i = 0; i < markerDictionaries().size(); ++i) {
    const std::string known = markerDictionaries()[i].name;
    if (name == known) return static_cast<int>(i);
    names += (names.empty() ? "" : ", ") + known;
  }
  throw std::invalid_argument("dictionary of markers: " + name + " is not known; expected one of " +
                              names);
}

const MarkerDictionary& markerDictionary(const std::string& name) {
  return markerDictionaries()[static_cast<std::size_t>(dictionaryIndex(name))];
}

cv::Mat markerCells(const std::string& dictionary, int id) {
  const MarkerDictionary& known = markerDictionary(dictionary);
  if (id < 0 || id >= known.markers) {
    throw std::out_of_range("marker id is " + std::to_string(id) + "; " + dictionary +
                            " has 0 to " + std::to_string(known.markers - 1));
  }
  cv::Mat cells;
  const auto theirs = cv::aruco::getPredefinedDictionary(dictionaryIndex(dictionary));
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 7
  theirs->drawMarker(id, known.bits + 2, cells);
#else
  theirs.generateImageMarker(id, known.bits + 2, cells);
#endif
  return cells;
}

BoardObservation boardObservation(const TagBoard& board, const std::string& name,
                                  const cv::Size& size,
                                  const std::vector<TagDetection>& detections) {
  BoardObservation observation{name, {}};
  for (std::size_t i = 0; i < detections.size(); ++i) {
    const TagDetection& tag = detections[i];
    const bool repeated = (i > 0 && detections[i - 1].id == tag.id) ||
                          (i + 1 < detections.size() && detections[i + 1].id == tag.id);
    if (!board.has(tag.id) || tag.hamming > 0 || repeated) continue;
    if (isAtBorder(tag.corners, size)) continue;
    const estimation::Corners on_board = board.corners(tag.id);
    for (int c = 0; c < 4; ++c) {
      observation.corners.push_back(
          {4 * (tag.id - board.first_id) + c, on_board.col(c), tag.corners.col(c)});
    }
  }
  return observation;
}

void Coverage::add(const BoardObservation& observation) {
  for (const BoardCorner& corner : observation.corners) {
    // A pixel's centre is at whole numbers.
    const double x = (corner.pixel.x() + 0.5) / size_.width;
    const double y = (corner.pixel.y() + 0.5) / size_.height;
    const int column = std::clamp(static_cast<int>(x * kColumns), 0, kColumns - 1);
    const int row = std::clamp(static_cast<int>(y * kRows), 0, kRows - 1);
    seen_(row, column) = 1;
  }
}

std::string Coverage::emptiest() const {
  const char* const kNames[][3] = {{"top left", "top", "top right"},
                                   {"left", "centre", "right"},
                                   {"bottom left", "bottom", "bottom right"}};
  std::string name;
  double most = 0;
  for (int down = 0; down < 3; ++down) {
    for (int across = 0; across < 3; ++across) {
      const cv::Range rows(down * kRows / 3, (down + 1) * kRows / 3);
      const cv::Range columns(across * kColumns / 3, (across + 1) * kColumns / 3);
      const cv::Mat cells = cv::Mat(seen_)(rows, columns);
      const auto count = static_cast<double>(cells.total());
      const double part = (count - cv::countNonZero(cells)) / count;
      if (part <= most) continue;
      most = part;
      name = kNames[down][across];
    }
  }
  return name;
}

bool BoardViews::offer(const BoardObservation& observation) {
  if (static_cast<int>(observation.corners.size()) < least_) {
    last_.reset();
    return false;
  }
  const std::optional<double> motion =
      last_ ? distanceOf(observation, *last_, least_) : std::nullopt;
  last_ = observation;
  if (!motion || *motion > kMostMotion) return false;
  for (const BoardObservation& one : chosen_) {
    const std::optional<double> change = distanceOf(observation, one, least_);
    if (change && *change < kLeastChange * size_.width) return false;
  }
  chosen_.push_back(observation);
  coverage_.add(observation);
  return true;
}

std::vector<MarkerObservation> findMarkers(const std::string& dictionary, const cv::Mat& gray) {
  const auto known = cv::aruco::getPredefinedDictionary(dictionaryIndex(dictionary));
  std::vector<std::vector<cv::Point2f>> corners;
  std::vector<int> ids;
  if (!gray.empty()) {
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 7
    cv::aruco::detectMarkers(gray, known, corners, ids);
#else
    cv::aruco::ArucoDetector(known).detectMarkers(gray, corners, ids);
#endif
  }
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

BoardObservation charucoObservation(const CharucoBoard& board, const std::string& name,
                                    const cv::Mat& gray) {
  BoardObservation observation{name, {}};
  std::vector<MarkedCorner> corners = agreedCorners(board, findMarkers(board.dictionary, gray));
  if (corners.empty()) return observation;
  std::vector<int> set_of;
  std::vector<int> sizes(static_cast<std::size_t>(cv::partition(corners, set_of, shareMarker)));
  for (const int set : set_of) ++sizes[static_cast<std::size_t>(set)];
  const auto largest = std::max_element(sizes.begin(), sizes.end()) - sizes.begin();
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (set_of[i] != largest || !refine(gray, corners[i])) continue;
    observation.corners.push_back({corners[i].id, board.corner(corners[i].id), corners[i].pixel});
  }
  return observation;
}

std::string whyNoCharuco(const CharucoBoard& board, const std::vector<cv::Mat>& pictures) {
  constexpr std::size_t kLeastMarkers = 4;
  std::size_t most = 0;
  for (const cv::Mat& picture : pictures) {
    most = std::max(most, findMarkers(board.dictionary, picture).size());
  }
  const std::string shown =
      messageOf("a picture shows at most ", most, " markers of ", board.dictionary);
  if (most < kLeastMarkers) {
    return shown +
           ": give the board's --dictionary, leave out --board charuco for the board of tags, or "
           "hold the board close, wholly in the picture, in focus and in even light; a mirrored or "
           "inverted board is not read";
  }
  return messageOf(shown, ", which do not lie as on a board of ", board.columns, " x ", board.rows,
                   " squares with markers ", board.marker_size / board.square_size,
                   " of a square wide: give the board's --squares ACROSS,DOWN, --square-size-m, "
                   "--marker-size-m and --legacy-pattern, or hold it closer and in focus");
}

}  // namespace helix_arm::vision
