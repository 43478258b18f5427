#pragma once

#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/localization/tag_layout.hpp"

namespace helix_arm::vision {

/// Names of the parts of a calibration board in messages, and how many of them a picture must show.
struct BoardParts {
  std::string name;    ///< plural, as in "tags of the board"
  int corners = 1;     ///< of each part
  int least = 0;       ///< fewest parts in a picture that counts
  std::string remedy;  ///< how to get pictures of such a board

  int leastCorners() const { return least * corners; }
};

/// A flat grid of tags that a camera is calibrated with. Ids count row by row from the top left.
///
/// The default is the board that `helix_arm tags --board` prints. It fits A4 and letter, so that
/// nobody has to say which paper a board was printed on. Its ids are the last ones of the family:
/// arms take theirs from the first.
struct TagBoard {
  std::string family = "36h11";
  int first_id = 557;
  int columns = 5, rows = 6;
  double tag_size = 0.028;  ///< outer edge of the black border [m]
  double pitch = 0.036;     ///< from one tag to the next, across and down [m]

  int count() const { return columns * rows; }
  bool has(int id) const { return id >= first_id && id < first_id + count(); }
  /// Extent of the tags, without the white around them [m].
  double width() const { return (columns - 1) * pitch + tag_size; }
  double height() const { return (rows - 1) * pitch + tag_size; }

  /// Corners of a tag [m] in the plane of the board: origin in its centre, x to the right, y up, as
  /// one reads it; the board's z points to the reader.
  /// @throws std::out_of_range on an id that the board does not have.
  estimation::Corners corners(int id) const;

  BoardParts parts() const;
};

/// A ChArUco board: a chessboard with a marker in each of its white squares. Markers and corners
/// count row by row from the top left, as one reads the markers.
///
/// The default is the board that `helix_arm tags --board charuco` prints on A4 and letter.
struct CharucoBoard {
  int columns = 7, rows = 9;   ///< number of squares
  double square_size = 0.024;  ///< side of a square [m]
  double marker_size = 0.018;  ///< outer edge of a marker's black border [m]
  std::string dictionary = "DICT_4X4_50";
  /// With an even number of rows: the top left square is white, as OpenCV before 4.6 drew it. With
  /// an odd one it is black in all versions.
  bool legacy_pattern = false;

  static constexpr int kMostSquares = 100;          ///< across and down
  static constexpr int kLeastCorners = 8;           ///< of a board, and of a picture that counts
  static constexpr double kLeastMarkerShare = 0.3;  ///< marker_size, in sides of a square

  int cornerCount() const { return (columns - 1) * (rows - 1); }
  int count() const;  ///< number of markers
  /// Side of a bit of a marker [m]. @throws as markerDictionary().
  double bitSize() const;
  double width() const { return columns * square_size; }
  double height() const { return rows * square_size; }

  bool isWhite(int column, int row) const;
  /// Id of the marker in a white square.
  int markerIn(int column, int row) const;
  /// Inner corner of four squares [m] in the plane of the board: origin in its centre, x to the
  /// right, y up, as one reads it.
  Eigen::Vector2d corner(int id) const;
  /// Corners of the marker in a square, likewise.
  estimation::Corners markerCorners(int column, int row) const;

  BoardParts parts() const;

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// One of OpenCV's predefined dictionaries of markers.
struct MarkerDictionary {
  const char* name;
  int markers;  ///< ids are 0 .. markers - 1
  int bits;     ///< across a marker, without its border
};

/// In the order of OpenCV's enumerators.
const std::vector<MarkerDictionary>& markerDictionaries();
/// @throws std::invalid_argument naming the known dictionaries.
const MarkerDictionary& markerDictionary(const std::string& name);
/// OpenCV's enumerator. @throws as markerDictionary().
int dictionaryIndex(const std::string& name);

/// One pixel (0 or 255) per cell of a marker with its black border.
/// @throws std::out_of_range on an id that the dictionary does not have.
cv::Mat markerCells(const std::string& dictionary, int id);

}  // namespace helix_arm::vision
