#include "helix_arm/vision/charuco_board.hpp"

#include <stdexcept>

#include <opencv2/aruco.hpp>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::vision {

estimation::Corners TagBoard::corners(int id) const {
  if (!has(id)) {
    throw std::out_of_range("tag id is " + std::to_string(id) + "; the board has " +
                            std::to_string(first_id) + " to " +
                            std::to_string(first_id + count() - 1));
  }
  const int column = (id - first_id) % columns, row = (id - first_id) / columns;
  const Eigen::Vector2d centre(column - 0.5 * (columns - 1), 0.5 * (rows - 1) - row);
  const estimation::TagLayout tag{tag_size, {}};
  return tag.corners().colwise() + (pitch * centre).eval();
}

BoardParts TagBoard::parts() const {
  return {"tags", 4, 6, "print it with helix_arm tags --board and take 15 pictures or more"};
}

namespace {

constexpr char kBoard[] = "ChArUco board";

}  // namespace

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
  cv::aruco::drawMarker(cv::aruco::getPredefinedDictionary(dictionaryIndex(dictionary)), id,
                        known.bits + 2, cells, 1);
  return cells;
}

}  // namespace helix_arm::vision
