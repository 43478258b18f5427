#include "board_arguments.hpp"

#include <cmath>
#include <stdexcept>
#include <utility>

#include "arguments.hpp"
#include "completion.hpp"

namespace helix_arm::cli {
namespace {

const char* const kTags = "tags";
const char* const kCharuco = "charuco";
constexpr double kUsualMarker = 0.75;  // of the side of a square

void addCharucoOptions(CLI::App& command, BoardArguments& arguments) {
  command
      .add_option("--squares", arguments.squares,
                  "of a ChArUco board: number of squares across and down, default 7,9")
      ->type_name("ACROSS,DOWN");
  command
      .add_option("--square-size-m", arguments.square_size,
                  "of a ChArUco board: side of a square [m], default 0.024")
      ->type_name("S");
  command
      .add_option("--marker-size-m", arguments.marker_size,
                  "of a ChArUco board: side of a marker's black border [m], default three quarters "
                  "of a square")
      ->type_name("S");
  std::vector<std::string> dictionaries;
  for (const vision::MarkerDictionary& known : vision::markerDictionaries()) {
    dictionaries.emplace_back(known.name);
  }
  offerWords(command
                 .add_option("--dictionary", arguments.dictionary,
                             "of a ChArUco board: its markers, by OpenCV's name, default "
                             "DICT_4X4_50")
                 ->type_name("NAME"),
             dictionaries);
  command.add_flag("--legacy-pattern", arguments.legacy_pattern,
                   "of a ChArUco board with an even number of squares down: its top left square is "
                   "white, as OpenCV before 4.6 drew it");
}

vision::CharucoBoard charucoOf(const BoardArguments& arguments) {
  vision::CharucoBoard board;
  if (!arguments.squares.empty()) {
    const std::vector<double> squares = numberList("--squares", arguments.squares, 2);
    for (const double count : squares) {
      if (count == std::floor(count) && std::abs(count) <= 1e6) continue;
      throw CallerError("--squares is " + arguments.squares +
                        "; expected two whole numbers: across,down");
    }
    board.columns = static_cast<int>(squares[0]);
    board.rows = static_cast<int>(squares[1]);
  }
  if (arguments.square_size) {
    board.square_size = *arguments.square_size;
    board.marker_size = kUsualMarker * board.square_size;
  }
  if (arguments.marker_size) board.marker_size = *arguments.marker_size;
  if (!arguments.dictionary.empty()) board.dictionary = arguments.dictionary;
  board.legacy_pattern = arguments.legacy_pattern;
  try {
    board.validate();
  } catch (const std::invalid_argument& error) {
    throw CallerError(error.what());
  }
  return board;
}

}  // namespace

void addBoardOption(CLI::App& command, BoardArguments& arguments, const std::string& what) {
  command.add_option("--board", arguments.kind, what)
      ->type_name("KIND")
      ->check(CLI::IsMember({kTags, kCharuco}))
      ->default_val(kTags);
  addCharucoOptions(command, arguments);
}

void addBoardFlag(CLI::App& command, BoardArguments& arguments, const std::string& what) {
  offerWords(command.add_flag("--board{tags}", arguments.kind, what)
                 ->check(CLI::IsMember({kTags, kCharuco})),
             {kTags, kCharuco});
  addCharucoOptions(command, arguments);
}

std::vector<std::string> joinBoardKind(std::vector<std::string> arguments) {
  for (std::size_t i = 0; i + 1 < arguments.size(); ++i) {
    const std::string& kind = arguments[i + 1];
    if (arguments[i] != "--board" || (kind != kTags && kind != kCharuco)) continue;
    arguments[i] += "=" + kind;
    arguments.erase(arguments.begin() + static_cast<std::ptrdiff_t>(i) + 1);
  }
  return arguments;
}

void checkBoard(const BoardArguments& arguments) {
  if (arguments.kind == kCharuco) return;
  const std::pair<const char*, bool> options[] = {
      {"--squares", !arguments.squares.empty()},
      {"--square-size-m", arguments.square_size.has_value()},
      {"--marker-size-m", arguments.marker_size.has_value()},
      {"--dictionary", !arguments.dictionary.empty()},
      {"--legacy-pattern", arguments.legacy_pattern}};
  for (const auto& [name, given] : options) {
    if (!given) continue;
    throw CallerError(
        std::string(name) + " is of a ChArUco board, and " +
        (arguments.given() ? "--board is " + arguments.kind : "--board is not given") +
        "; add --board charuco, or leave out " + name);
  }
}

CalibrationBoard boardOf(const BoardArguments& arguments) {
  checkBoard(arguments);
  if (arguments.kind == kCharuco) return charucoOf(arguments);
  return vision::TagBoard();
}

nlohmann::json boardJson(const CalibrationBoard& board) {
  if (const auto* tags = std::get_if<vision::TagBoard>(&board)) {
    return {{"family", tags->family}, {"first_id", tags->first_id}, {"columns", tags->columns},
            {"rows", tags->rows},     {"size_m", tags->tag_size},   {"pitch_m", tags->pitch}};
  }
  const auto& charuco = std::get<vision::CharucoBoard>(board);
  return {{"dictionary", charuco.dictionary},
          {"columns", charuco.columns},
          {"rows", charuco.rows},
          {"square_size_m", charuco.square_size},
          {"marker_size_m", charuco.marker_size},
          {"legacy_pattern", charuco.legacy_pattern}};
}

}  // namespace helix_arm::cli
