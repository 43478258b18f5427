#include <algorithm>
#include <cstring>
#include <sstream>

#include "helix_arm/vision/charuco_reader.hpp"
#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::vision {
namespace {

using Markers = std::vector<MarkerObservation>;

// Fewer markers of another dictionary may be misread.
constexpr std::size_t kLeastMarkers = 4;
// Fewest corners on which markers must agree before a number of squares is proposed.
constexpr std::size_t kLeastAgreeing = 3;

// The picture with the most markers of a dictionary.
Markers mostMarkers(const std::string& dictionary, const std::vector<cv::Mat>& pictures) {
  Markers most;
  for (const cv::Mat& picture : pictures) {
    Markers found = findMarkers(dictionary, picture);
    if (found.size() > most.size()) most = std::move(found);
  }
  return most;
}

// Dictionaries of equal bits by OpenCV's authors begin alike; the last one has all their markers.
bool begins(const MarkerDictionary& dictionary, const MarkerDictionary& longer) {
  const auto stem = [](const MarkerDictionary& one) {
    const char* const end = std::strrchr(one.name, '_');
    return std::string(one.name, end);
  };
  return dictionary.bits == longer.bits && stem(dictionary) == stem(longer) &&
         std::strncmp(dictionary.name, "DICT_APRILTAG", 13) != 0;
}

// The smallest dictionary that begins like this one and has the marker.
const MarkerDictionary& smallestWith(int id, const MarkerDictionary& dictionary) {
  for (const MarkerDictionary& one : markerDictionaries()) {
    if (begins(one, dictionary) && id < one.markers) return one;
  }
  return dictionary;
}

std::string otherDictionary(const CharucoBoard& board, const std::vector<cv::Mat>& pictures,
                            std::size_t own_markers) {
  const auto& known = markerDictionaries();
  Markers most;
  const MarkerDictionary* best = nullptr;
  for (std::size_t i = 0; i < known.size(); ++i) {
    if (i + 1 < known.size() && begins(known[i], known[i + 1])) continue;
    Markers found = mostMarkers(known[i].name, pictures);
    if (found.size() <= most.size()) continue;
    most = std::move(found);
    best = &known[i];
  }
  if (best == nullptr || most.size() < kLeastMarkers || most.size() <= 2 * own_markers) return "";
  const MarkerDictionary& other = smallestWith(most.back().id, *best);
  std::ostringstream text;
  text << "they show " << most.size() << " markers of " << other.name << " and " << own_markers
       << " of " << board.dictionary << ": give --dictionary " << other.name;
  return text.str();
}

bool showTagBoard(const std::vector<cv::Mat>& pictures) {
  const TagBoard board;
  DetectorConfig config;
  config.family = board.family;
  TagDetector detector(config);
  return std::any_of(pictures.begin(), pictures.end(), [&](const cv::Mat& picture) {
    const BoardObservation observation =
        boardObservation(board, "", picture.size(), detector.detect(picture));
    return static_cast<int>(observation.corners.size()) >= board.parts().leastCorners();
  });
}

struct Fitting {
  CharucoBoard board;
  std::size_t corners = 0;  // on which markers agree
};

// The board on whose corners the most markers agree. What is given is preferred.
Fitting fitting(const CharucoBoard& given, const Markers& markers) {
  Fitting best;
  const double given_part = given.marker_size / given.square_size;
  for (const double part : {given_part, 0.75, 0.5, 0.6, 0.9}) {
    for (const bool legacy : {given.legacy_pattern, !given.legacy_pattern}) {
      for (int i = 0; i + 2 < CharucoBoard::kMostSquares; ++i) {
        CharucoBoard board = given;
        board.columns = i == 0 ? given.columns : i + 2;
        // Rows below the last marker change nothing.
        const int last = markers.back().id;
        board.rows = 2 * (last / board.columns + 1) + (legacy ? 0 : 1);
        board.legacy_pattern = legacy;
        board.marker_size = part * board.square_size;
        const std::size_t corners = markedCorners(board, markers).size();
        if (corners > best.corners) best = {board, corners};
      }
    }
  }
  // As few rows as have the last marker seen.
  CharucoBoard& board = best.board;
  const int step = board.legacy_pattern ? 2 : 1;
  while (board.rows > 3 && markers.back().id < board.markerIn(0, board.rows - step)) {
    board.rows -= step;
  }
  return best;
}

std::string otherSquares(const CharucoBoard& board, const Markers& markers) {
  const Fitting found = fitting(board, markers);
  std::ostringstream text;
  text << "they show " << markers.size() << " markers of " << board.dictionary << ", up to number "
       << markers.back().id << ", ";
  if (found.corners < kLeastAgreeing) {
    text << "but hardly any beside each other: show the board wholly and in focus";
    return text.str();
  }
  const bool enough = markers.back().id < board.count();
  if (found.board.columns != board.columns || !enough) {
    text << "which lie as on a board of " << found.board.columns << " squares across and "
         << found.board.rows << " or more down, not of " << board.columns << " x " << board.rows
         << ": count its squares, and give --squares ACROSS,DOWN";
  } else if (found.board.legacy_pattern != board.legacy_pattern) {
    text << "on a board with a " << (found.board.legacy_pattern ? "white" : "black")
         << " top left square: " << (board.legacy_pattern ? "leave out" : "give")
         << " --legacy-pattern";
  } else if (found.board.marker_size != board.marker_size) {
    text << "which are about " << found.board.marker_size / found.board.square_size
         << " of a square wide, not " << board.marker_size / board.square_size
         << ": measure both, and give --square-size-m and --marker-size-m";
  } else {
    text << "but its squares are too small or blurred: hold it closer and in focus";
  }
  return text.str();
}

}  // namespace

std::string whyNoCharuco(const CharucoBoard& board, const std::vector<cv::Mat>& pictures) {
  if (showTagBoard(pictures)) return "they show the board of tags: leave out --board charuco";
  const Markers own = mostMarkers(board.dictionary, pictures);
  std::string cause = otherDictionary(board, pictures, own.size());
  if (!cause.empty()) return cause;
  if (own.size() >= kLeastMarkers) return otherSquares(board, own);
  return "they show hardly any marker of any dictionary: hold the board close, wholly in the "
         "picture, in focus and in even light; a mirrored or inverted board is not read";
}

}  // namespace helix_arm::vision
